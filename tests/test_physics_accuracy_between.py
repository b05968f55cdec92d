"""Steps of a path that are not solved: how far splines through the others are off, where more are solved, and when all are."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from physics.accuracy import between
from physics.accuracy.between import BETWEEN, solve_chosen, splines
from physics.accuracy.choose import choose
from physics.accuracy.estimate import distance
from physics.accuracy.table import judge
from physics.body.supports import held
from physics.equilibrium.state import NoEquilibrium, State
from physics.fidelity.verify import Checker
from physics.solution import solve
from tests.scenes import beam

SIDES = {"length": 0.06, "width": 0.02, "height": 0.02}
FORCE = {"where": "x-max", "traction": [0.0, 0.0, -5e3]}


def asked(**changes):
    """A beam that bends by a fifth of its length in 24 steps, of which an error is asked."""
    return beam(**({"body": SIDES, "load": [FORCE], "steps": {"count": 24, "error": 0.05}} | changes))


@pytest.fixture(scope="module")
def bent():
    choice = choose(asked())
    return choice, solve_chosen(choice), solve_chosen(choice, balanced=True)


def test_splines_are_exact_for_cubics():
    at, to = np.arange(0, 25, 3), np.arange(25)
    assert splines(at, to) @ (at**3 - 7.0 * at**2) == pytest.approx(to**3 - 7.0 * to**2, abs=1e-9)


def test_of_a_bent_beam_a_third_of_the_steps_are_solved_and_the_others_are_as_near_as_is_said(bent):
    choice, found, whole = bent
    assert (found.knots, whole.knots) == (tuple(range(0, 25, 3)), ()) and len(found.displacement) == 25
    assert np.flatnonzero(found.newton_iterations).tolist() == list(range(3, 25, 3)) and "8 of 24" in found.model["steps"]
    assert (whole.newton_iterations[1:] > 0).all() and "steps" not in whole.model
    frames, of = list(range(25)), choice.pilots.of
    off = distance(of(choice.scene, found, frames), of(choice.scene, whole, frames), choice.pilots.weights)
    assert off < BETWEEN * 0.05 + choice.loose and np.linalg.norm(found.displacement[-1], axis=1).max() > 0.01
    for name in ("reaction", "energy"):
        one, other = getattr(found, name), getattr(whole, name)
        assert abs(one - other).max() < 1e-3 * abs(other).max(), name
    assert not found.penetration.any() and not found.snap.any()


def test_a_step_between_has_the_residual_of_the_middle_and_all_steps_of_data_that_of_data(bent):
    choice, _, whole = bent
    assert whole.relative_residual.max() <= 1e-6
    found = solve_chosen(replace(choice, tolerance=1e-6))  # so that what is left is the splines'
    solved = found.relative_residual[3::3]
    assert solved.max() <= 1e-6 and (found.relative_residual[1::3] == found.relative_residual[2::3]).all()
    assert solved.max() < found.relative_residual[1::3].max() < 1e-3  # of loads of another step a tenth and more would be left


def test_steps_begin_between_what_was_found_to_choose_and_what_is_solved(bent):
    """With two thirds of the Newton steps at most, and fewer at the poses of the pilot, where that ended."""
    choice, found, _ = bent
    fewer = replace(choice.scene, steps=replace(choice.scene.steps, count=8))
    alone = solve(fewer, mesh=choice.mesh, tolerance=choice.tolerance, small_strain=choice.small_strain)
    assert found.newton_iterations.sum() <= 2 / 3 * alone.newton_iterations.sum()
    assert abs(found.displacement[::3] - alone.displacement).max() < 1e-3 * abs(alone.displacement).max()
    at = [round(8 * fraction) for fraction in choice.pilots.fractions]
    assert (found.newton_iterations[::3][at] < alone.newton_iterations[at]).all()


def test_what_is_held_stays_where_it_is_prescribed_to_be():
    """A support that turns: its nodes go round in circles, which no spline does."""
    turn = {"where": "x-max", "axis": [1.0, 0.0, 0.0], "angle": 60.0}
    choice = choose(asked(load=[], support=[{"where": "x-min"}, turn]))
    found = solve_chosen(choice)
    assert found.knots
    mesh, fixed = found.mesh, held(choice.scene, found.mesh)
    end = mesh.place("x-max")
    for frame in range(25):
        angle = np.radians(60.0 * frame / 24)
        y, z = (mesh.points[end, 1:] - 0.01).T
        there = np.stack([np.cos(angle) * y - np.sin(angle) * z - y, np.sin(angle) * y + np.cos(angle) * z - z], axis=1)
        assert fixed[end].all() and abs(found.displacement[frame, end, 1:] - there).max() < 1e-14


def test_under_an_obstacle_few_steps_are_solved_from_where_it_touches():
    """A ball that reaches the beam after a fifth of 60 steps; the others as near as is said, in force as well."""
    ball = {"shape": "sphere", "radius": 0.01, "path": [[0.05, 0.01, 0.032], [0.05, 0.01, 0.022]]}
    choice = choose(asked(load=[], obstacle=ball, steps={"count": 60, "error": 0.02}))
    found, whole = solve_chosen(choice), solve_chosen(choice, balanced=True)
    rest = int(np.flatnonzero(whole.displacement.any(axis=(1, 2)))[0]) - 1
    assert found.knots[:2] == (0, rest) and 5 < rest < 20 and len(found.knots) <= 20
    assert not found.displacement[:rest + 1].any() and not found.reaction[:rest + 1].any()
    frames, of = list(range(61)), choice.pilots.of
    off = distance(of(choice.scene, found, frames), of(choice.scene, whole, frames), choice.pilots.weights)
    assert max(found.between, off) < BETWEEN * 0.02 and off < 1.5 * (found.between + choice.loose)
    assert abs(found.reaction - whole.reaction).max() < 0.02 * abs(whole.reaction).max()
    left = np.setdiff1d(np.arange(rest + 1, 61), found.knots)
    assert 1e-6 < found.relative_residual[left].max() < 0.3  # of the ball elsewhere nearly all would be left


def test_an_obstacle_that_is_away_at_two_knots_bears_nothing_between_and_nothing_is_below_zero():
    """Two balls, of which the second touches near the clamp, late; splines would have it pull for the whole time before."""
    first = {"shape": "sphere", "radius": 0.01, "path": [[0.05, 0.01, 0.031], [0.05, 0.01, 0.025]]}
    second = {"shape": "sphere", "radius": 0.004, "path": [[0.01, 0.01, 0.0265], [0.01, 0.01, 0.0227]]}
    choice = choose(asked(load=[], obstacle=[first, second], steps={"count": 100, "error": 0.2}))
    found = solve_chosen(choice)
    knots, bears = list(found.knots), found.reactions.any(axis=2)
    touches = next(i for i, knot in enumerate(knots) if bears[knot, 1])
    assert touches > 4 and not bears[:knots[touches - 1] + 1, 1].any() and bears[knots[touches]:, 1].all()
    assert bears[knots[1] + 1:, 0].all() and abs(found.reaction - found.reactions.sum(axis=1)).max() < 1e-12
    assert found.energy.min() == 0 and found.penetration.min() == 0


def test_splines_end_where_an_obstacle_comes_to_a_body_that_moves_already():
    """A ball above a beam that sinks under its weight: before it touches splines alone are enough, and none runs across that step."""
    ball = {"shape": "sphere", "radius": 0.01, "path": [[0.05, 0.01, 0.034], [0.05, 0.01, 0.025]]}
    choice = choose(asked(load=[{"acceleration": [0.0, 0.0, -2.0]}], obstacle=ball, steps={"count": 200, "error": 0.02}))
    found, whole = solve_chosen(choice), solve_chosen(choice, balanced=True)
    touches = int(np.flatnonzero(whole.penetration)[0] if whole.penetration.any() else np.argmax(whole.reaction[:, 2] > 0))
    assert {touches - 1, touches} <= set(found.knots) and 50 < touches < 150 and len(found.knots) <= 50
    frames, of = list(range(201)), choice.pilots.of
    off = distance(of(choice.scene, found, frames), of(choice.scene, whole, frames), choice.pilots.weights)
    assert max(off, found.between) < BETWEEN * 0.02


def test_under_an_obstacle_what_splines_leave_is_measured_of_the_linear_law_too():
    """As `Checker` finds it; the knots have less than a fifth of it."""
    ball = {"shape": "sphere", "radius": 0.01, "path": [[0.05, 0.01, 0.032], [0.05, 0.01, 0.028]]}
    law = {"law": "linear", "young_modulus": 1e6, "poisson_ratio": 0.3}
    choice = choose(asked(load=[], obstacle=ball, material=law, steps={"count": 200, "error": 0.05}))
    found = solve_chosen(choice)
    assert found.linear_steps == 200 and max(np.diff(found.knots)[-3:]) > 1
    a, b = found.knots[-2:]
    frame = Checker(choice.scene, found.mesh).frame(found.displacement[(a + b + 1) // 2], (a + b + 1) // 2 / 200)
    assert found.relative_residual[b - 1] == pytest.approx(frame.residual / frame.push, rel=1e-6)
    assert found.relative_residual[b - 1] > 5 * found.relative_residual[b]


def test_splines_end_where_a_table_turns():
    """A load that comes and goes: the beam is as bent at the turn as a solution of that step alone, and there is no wave before it."""
    there_and_back = FORCE | {"steps": [0.0, 0.5, 1.0], "factor": [0.0, 1.0, 0.0]}
    choice = choose(asked(load=[there_and_back], steps={"count": 80, "error": 0.02}))
    found, whole = solve_chosen(choice), solve_chosen(choice, balanced=True)
    assert 40 in found.knots and len(found.knots) <= 27 and between.turns(choice.scene) == [0.0, 0.5, 1.0]
    tip = np.abs(found.displacement[:, -1, 2])
    path = next(row["error"] for row in judge(choice, found).rows if row["choice"] == "the path")
    assert path < 1e-3  # the end is at rest: nothing to be off against
    assert tip.argmax() == 40 and abs(found.displacement - whole.displacement).max() < 1e-3 * tip.max()


class Made:
    """In the place of `LoadPath`: one number along each path, which fails at some step; keeps which steps were sought."""

    def __init__(self, path, fails=None):
        self.path, self.fails, self.sought = path, fails, []
        self.balance, self.linear, self.halvings = SimpleNamespace(rests=lambda fraction: False, loaded=True), None, 0
        self.newton, self.model, self.ahead = SimpleNamespace(factorisations=0), dict, []

    def __call__(self, scene, mesh, **how):
        self.states = [State(0.0, self._u(0.0), np.zeros(0))]
        return self

    def _u(self, fraction):
        return np.full((1, 3), self.path(fraction))

    def advance(self, fraction):
        if self.fails is not None and fraction >= self.fails:
            raise NoEquilibrium("the body would snap")
        assert self.states[-1].fraction < fraction and all(state.fraction > fraction for state in self.ahead)
        self.sought.append(round(400 * fraction))
        self.states = [*self.states, State(fraction, self._u(fraction), np.zeros(0))]

    def frame(self):
        zero = np.zeros(())
        return {"displacement": self.states[-1].u, "reaction": self.states[-1].u[0]} | dict.fromkeys(
            ("energy", "penetration", "newton_iterations", "relative_residual", "snap", "released"), zero)


def knots_of(monkeypatch, path, **how):
    """The steps that are solved of a path, all of them where it is `solve` that was asked, and what it was asked."""
    made, asked_for = Made(path, **how), []
    monkeypatch.setattr(between, "LoadPath", made)
    monkeypatch.setattr(between.Course, "_filled", lambda course, off: sorted(course._knots))
    monkeypatch.setattr(between, "solve", lambda scene, **how: asked_for.append(how) or list(range(scene.steps.count + 1)))
    return solve_chosen(stand_in(), journal="part"), asked_for


def test_of_a_path_that_splines_tell_of_the_fewest_steps_are_solved(monkeypatch):
    assert knots_of(monkeypatch, lambda t: t)[0] == list(range(0, 401, 50))


@pytest.mark.parametrize("path, most", [
    (lambda t: t + 0.03 * np.sin(3 * np.pi * t), 25),  # a wave and a half of 3 %
    (lambda t: t + 0.01 * np.tanh((t - 0.7) / 0.02), 40),  # a bend within a tenth of the path
])
def test_more_steps_are_solved_where_splines_through_fewer_are_too_far_off(monkeypatch, path, most):
    knots, _ = knots_of(monkeypatch, path)
    assert 9 < len(knots) <= most
    at = np.arange(401)
    off = CubicSpline(knots, path(np.array(knots) / 400))(at) - path(at / 400)
    assert np.sqrt((off**2).mean() / (path(at / 400) ** 2).mean()) < BETWEEN * 0.01


def test_knots_gather_where_the_path_bends(monkeypatch):
    knots, _ = knots_of(monkeypatch, lambda t: abs(t - 0.51))
    gaps = np.diff(knots)
    assert gaps[np.searchsorted(knots, 204) - 1] <= 2 and gaps[0] >= 5 and gaps[-1] >= 5


@pytest.mark.parametrize("path, how", [
    (lambda t: t + 0.1 * np.sin(1e4 * t**2), {}),  # what no third of the steps tells of
    (lambda t: t, {"fails": 0.4}),
])
def test_all_steps_are_solved_and_kept_in_the_journal_where_few_are_not_enough_or_one_fails(monkeypatch, path, how):
    knots, [asked_for] = knots_of(monkeypatch, path, **how)
    assert knots == list(range(401)) and asked_for["journal"] == "part"


def stand_in():
    """A choice of which only what is asked of a path is there: the values are the displacements of the only node."""
    scene = beam(load=[FORCE], steps={"count": 400})
    pilots = SimpleNamespace(of=lambda scene, solution, frames: solution.displacement[frames], weights=np.ones(1))
    return SimpleNamespace(scene=scene, mesh=None, tolerance=1e-4, small_strain=0.0, pilots=pilots, asked=0.01, states=[])


def test_the_error_of_stress_is_that_of_the_stress_which_the_displacements_between_have():
    """Not that of splines through stresses, which know nothing of how splines through displacements stretch a thin strip."""
    strip = {"body": SIDES | {"height": 0.002}, "load": [FORCE | {"traction": [0.0, 0.0, -50.0]}]}
    choice = choose(asked(**strip, steps={"count": 24, "error": 0.3, "quantity": "stress"}), most=400)
    whole, of = solve_chosen(choice, balanced=True), choice.pilots.of
    kept, left = [0, 6, 12, 18, 24], [3, 9, 15, 21]
    u = whole.displacement.copy()
    u[left] = CubicSpline(kept, u[kept])(left)
    there = of(choice.scene, whole, left)
    off = np.sqrt(((of(choice.scene, replace(whole, displacement=u), left) - there) ** 2).mean())
    size = np.sqrt((of(choice.scene, whole, list(range(3, 25, 3))) ** 2).mean())
    course = between.Course(choice, lambda step: None)
    course._knots |= {step: between.Knot(State(step / 24, whole.displacement[step], np.zeros(0)), {
        name: getattr(whole, name)[step] for name in course._knots[0].row}, False) for step in range(3, 25, 3)}
    missed = course._missed()
    each = [missed[step - 3, step] for step in left]
    assert np.sqrt(np.mean(np.square(each))) == pytest.approx(off / size / 4, rel=1e-9)
    assert off > 1.5 * np.sqrt(((CubicSpline(kept, of(choice.scene, whole, kept))(left) - there) ** 2).mean())


def test_small_strain_makes_all_steps_of_one_line():
    scene = asked(load=[FORCE | {"traction": [0.0, 0.0, -1.0]}])
    choice = choose(scene)
    found = solve_chosen(choice)
    end = solve(replace(choice.scene, steps=replace(choice.scene.steps, count=1)), mesh=choice.mesh, small_strain=choice.small_strain)
    assert found.linear_steps == 24 and len(found.knots) == 9
    line = np.arange(25)[:, None, None] / 24 * end.displacement[-1]
    assert abs(found.displacement - line).max() < 1e-12 * abs(line).max()
