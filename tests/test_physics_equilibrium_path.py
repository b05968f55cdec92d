"""The way from one equilibrium to the next: what is foreseen, halved, handed on and said. Nothing is solved that need not be."""

from dataclasses import replace

import numpy as np
import pytest

from physics.equilibrium import path as equilibrium
from physics.equilibrium.balance import cells_said, contact_said
from physics.equilibrium.path import LoadPath
from physics.equilibrium.state import HALVINGS, NoEquilibrium, State, best_order, polynomial
from physics.mesh.build import build_mesh
from tests.scenes import bent, pressed


def path_of(scene):
    return LoadPath(scene, build_mesh(scene.body))


def state(fraction, u, **more):
    return State(fraction, np.asarray(u, float), np.zeros(0), **more)


@pytest.mark.parametrize("degree", range(4))
def test_a_polynomial_through_the_last_states_goes_on_as_itself(degree):
    """Of degree d through d + 1 states at unequal fractions, with another polynomial for each component."""
    rng = np.random.default_rng(degree)
    curve = rng.normal(size=(degree + 1, 2, 3))
    at = [0.1, 0.25, 0.3, 0.6][:degree + 1]
    states = [state(t, sum(c * t**k for k, c in enumerate(curve))) for t in at]
    for t in (0.0, 0.25, 0.7, 1.3):
        expected = sum(c * t**k for k, c in enumerate(curve))
        assert polynomial(states, t) == pytest.approx(expected, rel=1e-10, abs=1e-10)


@pytest.mark.parametrize("degree", range(5))
def test_the_order_is_that_of_the_polynomial_that_foresees_the_next_state(degree):
    """States on a curve of degree d: order d is exact, and three is the highest, however many states there are."""
    at = [0.0, 0.1, 0.3, 0.35, 0.5]
    states = [state(t, [[1 + t**degree, 2 * t**degree, 0]]) for t in at]
    # Higher orders are exact too, to rounding: noise of 1e-6 in what they reach back to makes them worse.
    for i in range(len(states) - 1 - degree):
        states[i] = state(at[i], states[i].u + 1e-6)
    following = state(0.7, [[1 + 0.7**degree, 2 * 0.7**degree, 0]])
    errors = [np.linalg.norm(polynomial(states[-1 - order:], 0.7) - following.u) for order in range(4)]
    assert best_order(states, following) == min(degree, 3) == int(np.argmin(errors))
    assert best_order(states[-1:], following) == 0 and best_order(states[-2:], following) == min(degree, 1)


def test_a_path_keeps_four_states_and_the_order_that_was_best(monkeypatch):
    """Equilibria on a cubic, whose prediction is asked for with the right states; held components are led to their prescription."""
    asked = []

    class Cubic:
        def equilibrium(self, fraction, start, last):
            asked.append((fraction, start, last.fraction))
            return state(fraction, np.full((2, 3), fraction**3 + fraction))

        def led(self, u, target):
            return u + 1000 * target

    path = path_of(bent())
    path.linear, path.newton, path.states = None, Cubic(), [state(0.0, np.zeros((2, 3)))]
    path.balance = replace_target(path.balance, np.ones((2, 3)))
    for step in range(1, 9):
        path.advance(step / 8)
        assert len(path.states) == min(step + 1, 4) and path.states[-1].fraction == step / 8
    assert path.order == 3 and [last for _, _, last in asked] == [step / 8 for step in range(8)]
    for fraction, start, _ in asked[5:]:  # the last four states were on the curve
        assert start == pytest.approx(np.full((2, 3), fraction**3 + fraction + 1000 * fraction), abs=1e-9)
    assert asked[1][1] == pytest.approx(np.full((2, 3), asked[0][0]**3 + asked[0][0] + 250.0))  # order 0: two states, one known


def test_where_states_are_known_ahead_a_step_begins_on_the_polynomial_between_them_and_the_last_three():
    """From rest on it does not: the stiffness of a body that is bent before it has moved is no one's."""
    asked = []

    class Quintic:
        def equilibrium(self, fraction, start, last):
            asked.append((fraction, start))
            return state(fraction, np.full((2, 3), fraction**5 + fraction))

        def led(self, u, target):
            return u

    path = path_of(bent())
    path.linear, path.newton, path.states = None, Quintic(), [state(0.0, np.zeros((2, 3)))]
    path.ahead = [state(t, np.full((2, 3), value)) for t, value in ((0.1, 1e9), (0.5, 7.0), (0.75, 11.0), (1.0, 1e9))]
    for step in range(1, 9):
        path.advance(step / 8)
    assert not asked[0][1].any()
    behind = {0.0: 0.0, 0.125: 0.125**5 + 0.125, 0.25: 0.25**5 + 0.25}
    for fraction, known in ((0.25, [0.0, 0.125, 0.5, 0.75]), (0.375, [0.0, 0.125, 0.25, 0.5, 0.75]), (0.5, [0.5]), (0.75, [0.75])):
        values = {**behind, 0.5: 7.0, 0.75: 11.0}
        lagrange = sum(values[t] * np.prod([(fraction - s) / (t - s) for s in known if s != t]) for t in known)
        assert dict(asked)[fraction] == pytest.approx(np.full((2, 3), lagrange), rel=1e-9)


def test_a_step_that_fails_between_states_known_ahead_is_tried_without_them_before_it_is_halved():
    """And so are all that follow: those states may be of another branch, from which nothing leads back to the path. From rest on,
    where none of them was of use, the step is halved at once."""
    asked, path = [], path_of(bent())

    class Line:
        """Equilibria on a line, which are found from near them alone."""

        def equilibrium(self, fraction, start, last):
            asked.append(fraction)
            if abs(start - fraction).max() > 0.3:
                raise NoEquilibrium("none")
            return state(fraction, np.full((2, 3), fraction))

        def led(self, u, target):
            return u

    path.linear, path.newton, path.states = None, Line(), [state(0.0, np.zeros((2, 3)))]
    path.ahead = [state(t, np.full((2, 3), -9.0)) for t in (0.5, 1.0)]
    for step in (2, 3, 4):
        path.advance(step / 4)
    assert asked == [0.5, 0.25, 0.5, 0.5, 0.75, 1.0] and path.halvings == 1
    assert [known.u[0, 0] for known in path.states] == [0.25, 0.5, 0.75, 1.0]


def replace_target(balance, target):
    balance.moves.target = target
    return balance


def test_a_step_without_equilibrium_is_halved_six_times_and_then_the_body_is_left_to_itself(monkeypatch):
    """None past 0.5: 0.25 is reached, then 0.5 ... up to the last 64th of the step to 0.75 before which there is none."""
    path, tried, settled = path_of(bent()), [], []
    path.linear = None

    def find(fraction, start, last):
        tried.append(fraction)
        if fraction > 0.5 and not settled:
            raise NoEquilibrium("none")
        return state(fraction, np.full_like(last.u, fraction))

    class Left:
        def __init__(self, balance):
            assert balance is path.balance

        def settle(self, fraction, last, newton):
            settled.append((fraction, last.fraction, newton))
            return state(fraction, np.full_like(last.u, fraction)), 0.125 - len(settled) / 64, 3.0 + len(settled)

    monkeypatch.setattr(equilibrium, "Relaxation", Left)
    path.newton.equilibrium, path.newton.led = find, lambda u, target: u
    for fraction in (0.25, 0.5):
        path.advance(fraction)
    assert path.halvings == 0 and HALVINGS == 6
    path.advance(0.75)
    assert tried[:2] == [0.25, 0.5] and tried[2:9] == [0.5 + 0.25 / 2**n for n in range(7)]
    assert settled == [(0.5 + 0.25 / 64, 0.5, path.newton)] and path.halvings == 6
    # After it the halves are gone through, each a start anew; nothing fails.
    assert tried[9:] == [0.5 + 0.25 / 2**n for n in (5, 4, 3, 2, 1, 0)]
    assert path.snap == 0.125 - 1 / 64 and path.released == 4.0
    # A second motion before the frame is written: the larger way, and the sum of what was released.
    path._snap(0.8, NoEquilibrium(""))
    assert path.snap == 0.125 - 1 / 64 and path.released == 9.0
    assert len(path.states) == 1 and path.order == 0
    found = path.frame()
    assert found["snap"] == 0.125 - 1 / 64 and found["released"] == 9.0 and path.snap == path.released == 0.0
    path._snap(0.9, NoEquilibrium(""))
    assert path.snap == 0.125 - 3 / 64 and path.released == 6.0


def test_where_the_body_does_not_come_to_rest_all_is_said(monkeypatch):
    path = path_of(bent(steps={"count": 40}))
    path.linear = None

    class Lost:
        def __init__(self, balance):
            pass

        def settle(self, *_):
            raise NoEquilibrium("nowhere to go")

    monkeypatch.setattr(equilibrium, "Relaxation", Lost)
    with pytest.raises(NoEquilibrium, match="^gone after 6 halvings; nowhere to go; ask for more than 40 steps$"):
        path._snap(0.5, NoEquilibrium("gone"))


def test_the_advice_tells_how_many_cells_the_obstacle_moves_in_a_step():
    """Legs of 9 and 12 mm in 20 steps: 10 for each; at most 1.2 mm of cells of 10 mm (the median of edges of 20, 10 and 10 mm)."""
    way = [[0.05, 0.01, 0.05], [0.05, 0.01, 0.041], [0.05, 0.022, 0.041]]
    path = path_of(bent(obstacle={"shape": "sphere", "radius": 0.01, "path": way}, steps={"count": 20}))
    assert path._advice() == "the obstacle moves 0.12 cell sizes in one step"
    one = path_of(bent(obstacle={"shape": "sphere", "radius": 0.01, "path": way[:1]}))
    assert one._advice() == "the obstacle moves 0 cell sizes in one step"


def test_an_obstacle_goes_no_further_at_once_than_half_of_what_is_narrower():
    """2.5 times as far as is safe in one step: four quarters, and no more."""
    down = {"shape": "sphere", "radius": 0.01, "path": [[0.05, 0.01, 0.1], [0.05, 0.01, 0.075]]}
    path = path_of(bent(load=[], obstacle=down))
    seen, append = [], path._append
    path._append = lambda found: (seen.append(found.fraction), append(found))[1]
    path.advance(1.0)
    assert seen == [0.25, 0.5, 0.75, 1.0] and path.halvings == 0
    path = path_of(bent(load=[], obstacle=down | {"path": [[0.05, 0.01, 0.1], [0.05, 0.01, 0.0901]]}))
    path.advance(1.0)
    assert len(path.states) == 2  # 9.9 of 10 mm


def test_what_is_said_of_cells_and_contact():
    scene = bent()
    assert cells_said(scene) == "hexahedra, of first order" and contact_said(scene) == "none: the scene has no obstacle"
    raised = replace(scene, body=replace(scene.body, element="enhanced"))
    assert cells_said(raised) == "hexahedra, of first order, enhanced element"
    assert cells_said(replace(scene, body=replace(scene.body, shape="file"))) == "the cells of the file, of first order"
    ball = pressed(obstacle={"shape": "sphere", "radius": 0.01, "path": [[0.05, 0.01, 0.04]]})
    assert contact_said(ball).startswith("frictionless at points of the surface facets, rigid sphere; nothing")
    nodes = replace(ball, obstacle=replace(ball.obstacle, contact="nodes"))
    assert contact_said(nodes).startswith("frictionless at surface nodes, rigid sphere")


def test_small_strain_is_left_once_it_no_longer_holds_and_the_step_is_taken_anew():
    scene = bent(load=[{"where": "x-max", "traction": [0.0, 0.0, -0.1]}])
    path = path_of(scene)
    small = path.newton
    assert path.linear is not None and path.linear.newton is small and path.balance is small.balance
    path.advance(0.25)
    path.frame()
    assert path.linear_steps == 1
    path.linear.holds, path.linear.error = lambda u: False, 2.5e-4
    found = path.advance(0.5)
    assert path.linear is None and path.newton is not small and path.balance is path._finite is path.newton.balance
    assert path.kinematics == ("finite strain after 1 steps of linear elasticity, which in the next one would have been off by 2.5e-04 "
                               "of the largest displacement, 0.0001 is allowed")
    out = (path.balance.elasticity.force(found.u) - 0.5 * path.balance.load)[~path.balance.fixed]
    assert found.iterations >= 1 and path.halvings == 0
    assert np.linalg.norm(out) <= 1e-6 * np.linalg.norm(path.balance.elasticity.force(found.u)[path.balance.fixed])
    path.frame()
    assert path.linear_steps == 1 and len(path.states) == 3


@pytest.mark.parametrize("asked", [True, False])
def test_small_strain_that_was_asked_for_is_halved_and_any_other_left(asked):
    """Where its equations have no equilibrium: the linear law has no other to turn to."""
    path = path_of(bent(load=[{"where": "x-max", "traction": [0.0, 0.0, -0.1]}]))
    path.linear.asked, tried = asked, []

    def scaled(fraction):
        tried.append(fraction)
        raise NoEquilibrium("none")

    path.linear.scaled = scaled
    path._snap = lambda fraction, error: path._append(State(fraction, path.states[-1].u, np.zeros(0)))
    path.advance(0.25)
    assert (path.linear is None) != asked and path.states[-1].fraction == 0.25
    assert tried[:8] == [0.25 / 2**n for n in range(7)] + [0.25 / 32] if asked else tried == [0.25]
    assert (path.halvings > 0) == asked
