"""One pose of a pressed body: its equations written out at the state that is found, and when Newton's method gives one up."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import cho_solve

from physics.contact.conditions import ContactSurface, cell_size
from physics.contact.obstacles import Rigid
from physics.mesh.build import build_mesh
from physics.reduced import pose as module
from physics.reduced.elastic import Elastic
from physics.reduced.pose import PoseState, Press, _factor, _rotation
from physics.reduced.space import Reduced, derivatives
from physics.scene import Body, Material, Obstacle

MESH = build_mesh(Body(length=0.06, width=0.03, height=0.02, cells=(4, 3, 2), cell="hexahedron"))
HELD = MESH.points[:, 0] < 1e-9
TOP = np.array([0.052, 0.011, 0.032])  # where a ball of 12 mm touches


@pytest.fixture(scope="module")
def press():
    """In the space of the answers to a push down and one aside at the free end, with their derivatives."""
    elastic = Elastic(MESH, HELD, Material(young_modulus=3e6, poisson_ratio=0.3, law="saint-venant-kirchhoff"))
    loads = np.zeros((len(MESH.points), 3, 2))
    end = MESH.points[:, 0] > 0.06 - 1e-9
    loads[end, 2, 0], loads[end, 1, 1] = -1.0, 1.0
    ball = Rigid(Obstacle(shape="sphere", radius=0.012, path=(tuple(TOP),)))
    reduced = Reduced(elastic, derivatives(elastic, loads.reshape(-1, 2), 2e-3))
    return Press(MESH, cell_size(MESH), ContactSurface(MESH, "facets", HELD), ball, elastic, reduced)


def balanced(press, state, start):
    """How far a state is from each of the equations in pose.py's docstring, the way written out."""
    space, surface = press.model.space, press.surface
    u = press.displacement(state)
    assert u == pytest.approx((space @ state.q).reshape(-1, 3) + state.local)
    gap, normal = press.obstacle.gap(surface.weights @ (MESH.points + u), state.centre)
    p, soft = state.pressure, press.size / (2e4 * surface.area)
    push = np.einsum("qn,qi->ni", surface.weights.toarray(), p[:, None] * normal)
    push[HELD] = 0
    before, _ = press.obstacle.gap(surface.weights @ (MESH.points + press.displacement(start)), state.centre)
    near = (before < 1.5 * press.size) | (start.pressure > 0)
    patch = np.flatnonzero(surface.weights.toarray()[near].any(axis=0))
    turn = _rotation(MESH.points[patch], MESH.points[patch] + (space @ state.q).reshape(-1, 3)[patch])
    back = (push @ turn).ravel()
    local = (press.elastic.solve(back) - space @ (space.T @ back)).reshape(-1, 3) @ turn.T
    assert np.linalg.norm(turn - np.eye(3)) > 0.02  # it has turned
    return {"open or pressed": np.minimum(gap + soft * p, 0).min() / press.size,
            "either": abs(p * (gap + soft * p)).max() / (p.max() * press.size),
            "forces": abs(state.push.reshape(-1, 3) - push).max() / p.max(),
            "slope": abs(press.model.slope(state.q) - space.T @ push.ravel()).max() / abs(space.T @ push.ravel()).max(),
            "local": abs(state.local - local).max() / abs(local).max()}


def test_a_pressed_body_is_in_balance_and_its_surface_yields_as_at_rest(press):
    """3 mm deep and drawn aside by 1: a ball that is round takes part of the stiffness, and the end turns by some degrees."""
    at = press.rest(TOP + [0, 0, 1e-4])
    for step in range(1, 5):
        before, at = at, press.newton(TOP + [0, 2.5e-4 * step, -7.5e-4 * step], at, np.zeros(len(at.q)))
    assert (at.pressure > 0).sum() > 1 and np.linalg.norm(press.displacement(at), axis=1).max() > 2.5e-3
    off = balanced(press, at, before)
    assert -1e-8 < off["open or pressed"] <= 0 and off["either"] < 1e-8, off
    assert max(off[name] for name in ("forces", "slope", "local")) < 1e-4, off
    pulled = press.newton(at.centre, at, 0.1 * press.model.slope(at.q))  # what the law has beyond the polynomial adds to it
    assert press.model.slope(pulled.q) + 0.1 * press.model.slope(at.q) == pytest.approx(press.model.space.T @ pulled.push, rel=2e-2)


def test_the_figures_that_results_were_measured_with():
    assert (module.ITERATIONS, module.LOOSE, module.HALVINGS, module.FRESH, module.SAMPLE) == (40, 1e-3, 4, 0.02, 50)
    assert (module.REACH, module.NEAR, module.SOFTEST, module.TOLERANCE) == (1.5, 0.5, 1e-6, 1e-5)


def test_where_nothing_is_near_a_body_at_rest_stays_there(press):
    far = press.rest(TOP)
    moved = press.newton(TOP + [0, 0, 1.0], far, np.zeros(len(far.q)))
    assert moved.centre.tolist() == (TOP + [0, 0, 1.0]).tolist() and moved.q is far.q
    shapes = (moved.q.shape, moved.local.shape, moved.pressure.shape, moved.push.shape)
    assert shapes == ((press.model.space.shape[1],), MESH.points.shape, (len(press.surface.area),), (MESH.points.size,))
    # One that is bent comes back, by way of the nearest point alone.
    bent = replace(far, q=np.full(len(far.q), 1e-6))
    assert abs(press.newton(TOP + [0, 0, 1.0], bent, np.zeros(len(far.q))).q).max() < 1e-9


@pytest.mark.parametrize(("fresh", "made"), [(0.02, "some"), (0.0, "all"), (np.inf, "one")])
def test_second_derivatives_are_made_anew_after_large_steps_alone(press, fresh, made, monkeypatch):
    start, steps = press.rest(TOP + [0, 0, 1e-4]), []
    monkeypatch.setattr(module, "FRESH", fresh)
    monkeypatch.setattr(press, "_bent", None)
    hessian, slope = press.model.hessian, press.model.slope
    calls = {"hessian": 0}
    monkeypatch.setattr(press.model, "hessian", lambda q: (calls.update(hessian=calls["hessian"] + 1), hessian(q))[1])
    monkeypatch.setattr(press.model, "slope", lambda q: (steps.append(q), slope(q))[1])
    found = press.newton(TOP - [0, 0, 2e-3], start, np.zeros(len(start.q)))
    assert found is not None
    moved = [abs(press.model.space @ (b - a)).max() for a, b in pairwise(steps)]
    if made == "some":  # one at the start, and one for each larger step but the last, after which it is done
        assert module.FRESH == 0.02 and 1 < calls["hessian"] < len(steps)
        assert calls["hessian"] >= 1 + sum(way > 0.02 * press.size for way in moved)
    else:
        assert calls["hessian"] == {"all": len(steps), "one": 1}[made]
    known = calls["hessian"]
    press.newton(TOP - [0, 0, 2.01e-3], found, np.zeros(len(start.q)))  # a fraction of a cell further
    assert (calls["hessian"] > known) == (made == "all")


def test_a_state_is_given_up_where_a_step_is_a_cell_long_or_steps_do_not_end(press, monkeypatch):
    start = press.rest(TOP + [0, 0, 1e-4])
    nothing = np.zeros(len(start.q))
    wild = press.model.slope(np.full(len(nothing), 1e-6)) + 1.0
    assert press.newton(TOP - [0, 0, 1e-3], start, 1e3 * wild) is None
    monkeypatch.setattr(module, "ITERATIONS", 2)
    assert press.newton(TOP - [0, 0, 2e-3], start, nothing) is None  # two steps are not enough
    monkeypatch.setattr(module, "LOOSE", 1.0)  # unless what is left over may be as large
    assert press.newton(TOP - [0, 0, 2e-3], start, nothing) is not None


def test_a_way_of_a_cell_is_gone_at_once_and_a_longer_one_in_halves(press):
    asked = []

    class Noted(Press):
        def newton(self, centre, state, c):
            asked.append(np.linalg.norm(centre - state.centre) / self.size)
            return replace(state, centre=centre)

    noted = Noted(press.mesh, press.size, press.surface, press.obstacle, press.elastic, press.model)
    for length, ways in ((1.0, [1.0]), (1.01, [0.505, 0.505]), (2.02, 4 * [0.505]), (0.0, [0.0])):
        asked.clear()
        start = noted.rest(np.zeros(3))
        found = noted.advance(length * press.size * np.array([0.6, 0, 0.8]) * (1 - 1e-12), start, np.zeros(len(start.q)))
        assert asked == pytest.approx(ways, rel=1e-9) and found.centre == pytest.approx(length * press.size * np.array([0.6, 0, 0.8]))
    other = noted.within(press.model)
    assert (type(other), other.size, other.model, other.elastic) == (Press, press.size, press.model, press.elastic)
    assert (other.mesh, other.surface, other.obstacle) == (press.mesh, press.surface, press.obstacle)


def rotation(degrees, axis):
    axis = np.array(axis) / np.linalg.norm(axis)
    k = np.cross(np.eye(3), axis)
    return np.eye(3) + np.sin(np.radians(degrees)) * k + (1 - np.cos(np.radians(degrees))) * k @ k


def test_the_rotation_of_a_patch():
    rest = np.random.default_rng(0).normal(size=(7, 3)) + [5, -3, 2]
    for degrees in (0, 40, 170):
        turn = rotation(degrees, [1, 2, -1])
        np.testing.assert_allclose(_rotation(rest, rest @ turn.T + [0.3, 7, -2]), turn, atol=1e-13)
        stretched = rest @ np.diag([1.2, 0.9, 1.1]) @ turn.T
        np.testing.assert_allclose(_rotation((rest - rest.mean(axis=0)) @ np.diag([1, 2, 3]), stretched @ np.eye(3)) @ np.eye(3)
                                   @ _rotation((rest - rest.mean(axis=0)) @ np.diag([1, 2, 3]), stretched).T, np.eye(3), atol=1e-13)
    flat = rest * [1, 1, 0]  # points in a plane have a rotation, not a reflection
    turn = rotation(30, [2, 0, 1])
    np.testing.assert_allclose(_rotation(flat, flat @ turn.T), turn, atol=1e-13)
    mirrored = _rotation(rest, rest * [1, 1, -1])
    assert np.linalg.det(mirrored) == pytest.approx(1)
    line = np.outer([0.0, 1, 2, 4], [1, 2, 3])
    np.testing.assert_array_equal(_rotation(line, line @ turn.T), np.eye(3))
    np.testing.assert_array_equal(_rotation(line[:1], line[:1] + 1), np.eye(3))


def test_a_factor_of_what_is_not_positive_definite_lifts_it_to_the_softest():
    turn = rotation(40, [1, 2, 3])
    good = turn @ np.diag([1.0, 2, 5]) @ turn.T
    np.testing.assert_allclose(cho_solve(_factor(good), np.eye(3)), np.linalg.inv(good), atol=1e-13)
    bad = turn @ np.diag([-3.0, 2, 5]) @ turn.T  # 3 is added, and a millionth of 5
    lifted = np.linalg.inv(cho_solve(_factor(bad), np.eye(3)))
    np.testing.assert_allclose(np.linalg.eigvalsh(lifted), [5e-6, 5 + 5e-6, 8 + 5e-6], rtol=1e-5)
    np.testing.assert_allclose(lifted - bad, (3 + 5e-6) * np.eye(3), atol=1e-8)


def test_a_state_far_from_the_pose_is_reached_in_halves():
    """Each half no longer than a cell; where Newton's method does not lead there from nearby either, there is no state."""
    press, asked = Press.__new__(Press), []
    press.size = 1.0
    start = PoseState(np.zeros(3), np.zeros(1), np.zeros((1, 3)), np.zeros(1), np.zeros(3))

    def newton(centre, state, c):
        asked.append((float(state.centre[0]), float(centre[0])))
        return replace(state, centre=centre, q=state.q + 1)

    press.newton = newton
    found = press.advance(np.array([2.0, 0, 0]), start, np.zeros(1))
    assert asked == [(0, 1), (1, 2)] and found.q[0] == 2
    asked.clear()
    press.newton = lambda centre, state, c: asked.append(1)
    assert press.advance(np.array([1.0, 0, 0]), start, np.zeros(1)) is None
    assert len(asked) == 5  # the whole way, the first half of it, .. down to the first 2^-4
