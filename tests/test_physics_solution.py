"""The answer to a scene: what its frames hold, where a path ends, and which scene a journal is of."""

import itertools
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from physics import journal, solution
from physics.equilibrium.balance import Balance
from physics.equilibrium.path import LoadPath
from physics.equilibrium.state import NoEquilibrium, State
from physics.mesh.build import build_mesh
from physics.schema import InputError
from physics.solution import identity, snapped, solve
from tests.scenes import beam, bent


def test_frames_hold_what_the_states_are():
    """Each figure by another way: the energy by a path of forces, the reaction and the residual by the forces themselves."""
    scene = bent()
    steps = []
    solution = solve(scene, on_step=steps.append)
    assert steps == [1, 2, 3, 4] and solution.resumed == 0 and not solution.failure and solution.seconds > 0
    assert solution.linear_steps == 0 and solution.kinetic_energy is None and not solution.snap.any() and not solution.released.any()
    balance = Balance(scene, solution.mesh)
    force = 2e3 * 0.02 * 0.02
    for t, u in enumerate(solution.displacement):
        out = balance.elasticity.force(u) - t / 4 * balance.load
        assert solution.reaction[t] == pytest.approx([0, 0, -force * t / 4], abs=2e-6 * force)  # on the support
        if t:
            # Over the forces at the held components, of which bending makes more than their sum is.
            free, held = np.linalg.norm(out[~balance.fixed]), np.linalg.norm(out[balance.fixed])
            assert held > 2 * np.linalg.norm(solution.reaction[t])
            assert solution.relative_residual[t] == pytest.approx(free / held, rel=1e-9)
            assert solution.relative_residual[t] <= 1e-6 and solution.newton_iterations[t] >= 1
            assert solution.energy[t] == pytest.approx(balance.elasticity.energy(u), rel=1e-12)
    assert solution.energy[0] == solution.relative_residual[0] == solution.newton_iterations[0] == 0
    assert solution.factorisations >= 1 and np.isfinite(solution.smallest_det_f).all() and solution.smallest_det_f[0] == 1
    # Nearly a straight line of force against displacement: the work of the load is stored.
    assert solution.energy[-1] == pytest.approx(0.5 * (balance.load * solution.displacement[-1]).sum(), rel=0.05)


def test_steps_of_small_strain_are_counted_but_not_the_rest_state():
    solution = solve(bent(load=[{"where": "x-max", "traction": [0.0, 0.0, -0.1]}]))
    assert solution.linear_steps == 4 and solution.newton_iterations.tolist() == [0, 0, 0, 0, 0]
    assert solution.displacement[1:] == pytest.approx(solution.displacement[-1] * np.arange(1, 5)[:, None, None] / 4, rel=1e-12)
    assert solution.reaction[2] == pytest.approx([0, 0, -0.1 * 4e-4 / 2], abs=1e-9)


def test_a_path_that_failed_says_at_which_step_and_keeps_those_before(monkeypatch):
    def fail(self, fraction, depth=0):
        if fraction > 0.5:
            raise NoEquilibrium("of no use")
        return self._append(State(fraction, np.full_like(self.states[-1].u, 1e-4), self.states[-1].pressure))

    monkeypatch.setattr(LoadPath, "advance", fail)
    with pytest.raises(NoEquilibrium, match="^no equilibrium at step 3: of no use$") as raised:
        solve(bent())
    assert np.array_equal(raised.value.solution.displacement, solve(bent(), partial=True).displacement)
    solution = solve(bent(), partial=True)
    assert solution.failure == "no equilibrium at step 3: of no use" and len(solution.displacement) == 3


def test_motion_in_time_is_not_spread_over_processes():
    with pytest.raises(InputError, match="motion in time runs as one process"):
        solve(bent(steps={"count": 2, "dynamic": True, "duration": 0.01}), spread=True)


def test_snaps_are_named_up_to_five():
    assert snapped(np.zeros(4)) == {}
    assert snapped(np.array([0, 0, 0.25, 0.5]))["snaps"].startswith("at step 2, 3 the body moved by up to 0.5 m without")
    five, six, seven = (np.array([0.0] + count * [0.125]) for count in (5, 6, 7))
    assert snapped(five)["snaps"].startswith("at step 1, 2, 3, 4, 5 the body")
    assert snapped(six)["snaps"].startswith("at step 1, 2, 3, 4, 5 and 1 more the body")
    assert snapped(seven)["snaps"].startswith("at step 1, 2, 3, 4, 5 and 2 more the body moved by up to 0.125 m")


def test_an_identity_is_that_of_scene_points_and_cells():
    scene = bent()
    mesh = build_mesh(scene.body)
    moved = mesh.points.copy()
    moved[5, 1] += 1e-15
    other = mesh.cells.copy()
    other[0] = other[0][::-1]
    made = [(scene, mesh), (bent(steps={"count": 5}), mesh), (scene, replace(mesh, points=moved)), (scene, replace(mesh, cells=other))]
    names = [identity(*each) for each in made]
    assert identity(scene, build_mesh(scene.body)) == names[0]
    assert all(one != two for one, two in itertools.combinations(names, 2))


def test_an_identity_of_a_file_knows_its_places():
    """Of a file, where the supports hold may change with nodes and cells the same; of a shape that we build, it cannot."""
    scene = bent()
    mesh = replace(build_mesh(scene.body), places={"foot": np.array([0, 1])})
    other = replace(mesh, places={"foot": np.array([0, 2])})
    assert identity(scene, mesh) == identity(scene, other)
    of_file = replace(scene, body=replace(scene.body, shape="file"))
    assert identity(of_file, mesh) != identity(of_file, other)


@pytest.mark.parametrize(("asked", "good", "counts"), [
    (3, 0, [4]), (50, 0, [4]), (50, 16, [4, 16]), (50, 50, [4, 16, 50]), (64, 64, [4, 16, 64])])
@pytest.mark.parametrize("bad", [{"failure": "none"}, {"snap": np.array([0, 0.1])}])
def test_an_end_is_sought_in_four_steps_then_in_four_times_as_many(monkeypatch, asked, good, counts, bad):
    tried = []

    def tell(scene, *, partial, **how):
        tried.append((scene.steps.count, partial))
        assert how["tolerance"] == 1e-3 and scene.steps.duration == 2.0
        return SimpleNamespace(**({"failure": "", "snap": np.zeros(2)} | (bad if scene.steps.count < good else {})))

    scene = bent(steps={"count": asked, "duration": 2.0})
    monkeypatch.setattr(solution, "solve", tell)
    found = solve(scene, final=True, tolerance=1e-3)
    assert not found.failure and not found.snap.any() and [count for count, _ in tried] == counts
    assert [partial for _, partial in tried] == [count < max(4, asked) for count in counts]  # only the last may raise


def test_seconds_add_up_over_the_starts(monkeypatch, tmp_path):
    """A clock that goes on by 10 s at each look: looked at when a solve begins, at each of five frames and at the end."""
    clock, processor = itertools.count(10.0, 10.0), itertools.count(1.0, 0.25)
    for module in (solution, journal):
        monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=lambda: next(clock), process_time=lambda: next(processor),
                                                            monotonic=time.monotonic))
    first = solve(bent(), journal=tmp_path / "kept")
    assert first.seconds == 60 and first.set_up == 0.25 and first.resumed == 0
    again = solve(bent(), journal=tmp_path / "kept")
    assert again.seconds == 50 + 10 and again.resumed == 4
    assert np.array_equal(first.displacement, again.displacement)


@pytest.mark.parametrize(("changes", "words"), [
    ({"obstacle": {"shape": "sphere", "radius": 0.01, "path": [[50, 10, 31], [50, 10, 20]]}}, "no obstacle reaches the body"),
    ({}, "no load and no support moves the body")])
def test_a_scene_in_which_nothing_moves_says_so(changes, words):
    scene = beam(steps={"count": 2}, **changes)
    assert solve(scene).idle(scene) == (f"nothing moves: {words}, which lies between (0, 0, 0) and (0.06, 0.02, 0.02) m",)


def test_a_scene_in_which_something_moves_does_not():
    scene = bent()
    found = solve(scene)
    assert found.idle(scene) == () and replace(found, displacement=0 * found.displacement, failure="x").idle(scene) == ()
