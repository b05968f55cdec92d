"""Steps of a smooth path that are not solved: how far splines through the others are off, and when all are solved."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from physics.accuracy import between
from physics.accuracy.between import BETWEEN, solve_chosen, splines
from physics.accuracy.choose import choose
from physics.accuracy.estimate import distance
from physics.body.supports import held
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
    assert (found.every, whole.every) == (3, 1) and len(found.displacement) == 25
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
    assert found.every > 1
    mesh, fixed = found.mesh, held(choice.scene, found.mesh)
    end = mesh.place("x-max")
    for frame in range(25):
        angle = np.radians(60.0 * frame / 24)
        y, z = (mesh.points[end, 1:] - 0.01).T
        there = np.stack([np.cos(angle) * y - np.sin(angle) * z - y, np.sin(angle) * y + np.cos(angle) * z - z], axis=1)
        assert fixed[end].all() and abs(found.displacement[frame, end, 1:] - there).max() < 1e-14


@pytest.mark.parametrize("changes", [
    {"load": [FORCE | {"steps": [0.0, 0.5, 1.0], "factor": [0.0, 1.0, 0.0]}]},
    {"load": [], "obstacle": {"shape": "sphere", "radius": 0.01, "path": [[0.05, 0.01, 0.031], [0.05, 0.01, 0.029]]}},
])
def test_of_a_path_that_may_have_kinks_all_steps_are_solved(changes):
    assert not between.smooth(asked(**changes)) and between.smooth(asked())


@dataclass
class Frames:
    displacement: np.ndarray
    reaction: np.ndarray
    failure: str = ""


class Made:
    """In the place of `solve`: one number along each path, and what goes wrong in so many steps; keeps what is asked for."""

    def __init__(self, path, wrong=()):
        self.path, self.wrong, self.counts = path, dict(wrong), []

    def __call__(self, scene, *, journal=None, snaps, **how):
        count = scene.steps.count
        self.counts.append((count, journal, snaps))
        u = self.path(np.arange(count + 1) / count)[:, None, None] * np.ones((1, 1, 3))
        return Frames(u, u[:, 0], **self.wrong.get(count, {}))


@pytest.mark.parametrize("path, counts", [
    (lambda t: t, [8]),
    (lambda t: t + 0.03 * np.sin(3 * np.pi * t), [8, 16]),
    (lambda t: np.abs(t - 0.51), [8, 40, 400]),
])
def test_more_steps_are_solved_where_splines_through_fewer_are_too_far_off_and_all_where_it_would_be_most(monkeypatch, path, counts):
    """Eight points tell of a wave and a half of 3 % too little, sixteen enough; of a kink no third of the steps does."""
    made = Made(path)
    monkeypatch.setattr(between, "solve", made)
    monkeypatch.setattr(between, "_filled", lambda scene, found, every: found)
    assert len(solve_chosen(stand_in()).displacement) == counts[-1] + 1
    assert [count for count, *_ in made.counts] == counts


@pytest.mark.parametrize("snaps", [True, False])
def test_a_path_that_fails_in_large_steps_or_would_snap_there_is_solved_in_all_and_kept_in_the_journal(monkeypatch, snaps):
    """In large steps nobody asks where a body that snaps comes to rest: that is found out in all steps, and takes the most time."""
    made = Made(lambda t: t, {8: {"failure": "no equilibrium at step 3"}})
    monkeypatch.setattr(between, "solve", made)
    solve_chosen(stand_in(), journal="part", snaps=snaps)
    assert made.counts == [(8, None, False), (400, "part", snaps)]


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
    assert between.missed(choice, whole, 3) == pytest.approx(off / size / 4, rel=1e-9)
    assert off > 1.5 * np.sqrt(((CubicSpline(kept, of(choice.scene, whole, kept))(left) - there) ** 2).mean())


def test_small_strain_makes_all_steps_of_one_line():
    scene = asked(load=[FORCE | {"traction": [0.0, 0.0, -1.0]}])
    choice = choose(scene)
    found = solve_chosen(choice)
    end = solve(replace(choice.scene, steps=replace(choice.scene.steps, count=1)), mesh=choice.mesh, small_strain=choice.small_strain)
    assert found.linear_steps == 24 and found.every == 3
    line = np.arange(25)[:, None, None] / 24 * end.displacement[-1]
    assert abs(found.displacement - line).max() < 1e-12 * abs(line).max()
