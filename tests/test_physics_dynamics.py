"""Motion: its frequencies, its energy, its order, its limit of slow loading, impacts, a published benchmark."""

import dataclasses
from dataclasses import replace

import h5py
import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg

import fidelity
from datagen.files.trajectory import write_trajectory
from datagen.sets.check import against_scene
from datagen.sets.generate import trajectory_of
from physics import journal
from physics.equilibrium.balance import cell_size
from physics.mesh.build import build_mesh
from physics.modes.elastic import elastic_modes
from physics.motion.dynamics import Motion
from physics.schema import InputError
from physics.solution import solve
from tests.scenes import beam, pressed

BODY = {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [10, 2, 2]}
BLOCK = {"length": 0.02, "width": 0.02, "height": 0.02, "cells": [4, 4, 4]}


def moving(duration, count, *, velocity=(0.0, 0.0, 0.0), **changes):
    steps = {"dynamic": True, "duration": float(duration), "count": count, "velocity": list(velocity)}
    return beam(**({"body": BODY, "steps": steps} | changes))


def thrown(count=200, *, velocity=-1.0, duration=0.02, cells=4, **changes):
    """A block without supports that flies at 1 m/s towards a floor 1 mm below it."""
    floor = {"shape": "half-space", "normal": [0.0, 0.0, 1.0], "path": [[0.0, 0.0, -0.001]]}
    return beam(**({"body": BLOCK | {"cells": [cells] * 3}, "support": [], "obstacle": floor,
                    "steps": {"dynamic": True, "duration": duration, "count": count, "velocity": [0.0, 0.0, velocity]}} | changes))


def total_energy(solution):
    return solution.energy + solution.kinetic_energy


def lumped_hz(motion):
    """The first frequency of K phi = omega^2 M phi with the masses of the nodes, by scipy."""
    space = motion.body.space
    start, column, value = motion.body.stiffness(np.zeros_like(motion.fixed, float)).getValuesCSR()
    stiffness, free = scipy.sparse.csr_matrix((value, column, start)), ~space.to_dofs(motion.fixed)
    mass = space.to_dofs(np.broadcast_to(motion.moving.node_mass, motion.fixed.shape))
    value, vector = scipy.sparse.linalg.eigsh(stiffness[free][:, free].tocsc(), 1, scipy.sparse.diags(mass[free]), sigma=0.0)
    whole = np.zeros(len(mass))
    whole[free] = vector[:, 0]
    return float(np.sqrt(value[0])) / (2 * np.pi), space.from_dofs(whole)


@pytest.mark.parametrize("cells, near", [([10, 2, 2], 1e-2), ([20, 4, 4], 2.5e-3)])
def test_frequency_of_free_vibration(cells, near):
    """Against the elastic modes, whose mass is the consistent one: a difference of second order in the size of the cells."""
    scene = moving(1.0, 100, body=BODY | {"cells": cells})
    mesh = build_mesh(scene.body)
    expected = float(elastic_modes(scene, count=1, mesh=mesh).frequencies_hz[0])
    motion = Motion(replace(scene, steps=replace(scene.steps, duration=3 / expected, count=90)), mesh)
    lumped, shape = lumped_hz(motion)
    motion.velocity = 1e-6 * shape / abs(shape).max()
    way = []
    for step in range(1, 91):
        motion.advance(step / 90)
        way.append(motion.states[-1].u[np.abs(shape).max(axis=1).argmax(), 2])
    way = np.array([0.0, *way])
    down = np.flatnonzero((way[:-1] > 0) != (way[1:] > 0))[1:]
    crossings = down + way[down] / (way[down] - way[down + 1])
    found = (len(crossings) - 1) / 2 / np.ptp(crossings) * 30 * expected
    shorter = 1 - (2 * np.pi / 30) ** 2 / 12  # what steps of a thirtieth of a period make of it, to fourth order
    assert found == pytest.approx(lumped * shorter, rel=3e-4)
    assert found / shorter == pytest.approx(expected, rel=near)


def energy_lost(law):
    """A beam released under its weight, 30 steps a period for 100 periods: its motion, and its energy (T,) [J], zero at the start."""
    scene = moving(1.0, 1, material={"law": law, "young_modulus": 2e5, "poisson_ratio": 0.4},
                   load=[{"acceleration": [0.0, 0.0, -9.81], "sudden": True}])
    period = 1 / float(elastic_modes(scene, count=1).frequencies_hz[0])
    scene = replace(scene, steps=replace(scene.steps, duration=100 * period, count=3000))
    solution = solve(scene)
    fallen = (solution.displacement * Motion(scene, solution.mesh).sudden).sum(axis=(1, 2))
    return solution, total_energy(solution) - fallen


@pytest.mark.parametrize("law", ["neo-hookean", pytest.param("saint-venant-kirchhoff", marks=pytest.mark.slow)])
def test_energy_is_kept_over_a_hundred_periods(law):
    solution, lost = energy_lost(law)
    assert not solution.failure and abs(solution.displacement).max() > 0.025  # a quarter of its length
    # 1 % is what is asked for. The tolerance of each step, 1e-6 of the largest force, adds up to less than a hundredth of that.
    assert abs(lost).max() < 1e-4 * solution.energy.max()
    assert solution.kinetic_energy[-300:].max() > 0.5 * solution.kinetic_energy.max()  # it still swings


def test_second_order_in_the_step():
    """A soft swing under a growing load: the error at one time falls to a quarter when the step is halved."""
    load = [{"where": "x-max", "traction": [0.0, 0.0, -500.0]}]
    last = {count: solve(moving(0.3, count, load=load)).displacement[-1] for count in (40, 80, 160, 1280)}
    error = [np.linalg.norm(last[count] - last[1280]) for count in (40, 80, 160)]
    # The finest has an error itself, 1/64 of that of the second finest.
    assert np.log2(error[0] / error[1]) == pytest.approx(2, abs=0.15)
    assert np.log2(error[1] / error[2]) == pytest.approx(2, abs=0.1)


def test_a_slow_push_tends_to_the_equilibrium():
    """The swing about it is bounded by T / (pi t), inertia.py, and falls with the time t of the push.

    The cylinder bends the beam until it slides along it: nothing must be pumped into the beam on that way.
    """
    rest = pressed(body=BODY | {"length": 0.06}, steps={"count": 20})
    still, (start, end) = solve(rest), rest.obstacle.path
    period = 1 / float(elastic_modes(rest, count=1).frequencies_hz[0])
    errors = []
    for periods in (5, 40):
        steps = replace(rest.steps, dynamic=True, duration=periods * period, count=20 * periods)
        solution = solve(replace(rest, steps=steps))
        errors.append(abs(solution.displacement[-1] - still.displacement[-1]).max() / abs(still.displacement[-1]).max())
        assert errors[-1] < 1 / (np.pi * periods)
        work = np.cumsum(-solution.reaction @ np.subtract(end, start) / steps.count)
        assert (total_energy(solution) - work).max() < 1e-6 * work[-1]  # the solver's tolerance
        assert work[-1] == pytest.approx(still.energy[-1], rel=2e-2 / periods)
    assert errors[1] < errors[0] / 4


def test_free_fall_is_a_parabola():
    scene = moving(0.2, 7, support=[], body=BLOCK, load=[{"acceleration": [0.0, 0.0, -9.81], "sudden": True}],
                   velocity=(0.5, 0.0, 0.0))
    solution = solve(scene)
    t = np.linspace(0, 0.2, 8)[:, None]
    way = solution.displacement - np.stack([0.5 * t, 0 * t, -9.81 / 2 * t**2], axis=-1)
    assert abs(way).max() < 1e-9  # the step is exact for it; what is left is rounding
    assert solution.kinetic_energy[-1] == pytest.approx(0.008 / 2 * (0.5**2 + (9.81 * 0.2) ** 2), rel=1e-9)


@pytest.mark.parametrize("cells", [2, 4])
def test_a_block_bounces_and_contact_makes_no_energy(cells):
    solution = solve(thrown(cells=cells))
    energy = total_energy(solution)
    assert energy[0] == pytest.approx(0.008 / 2, rel=1e-9)
    # The solver's tolerance, 1e-6 of the largest force over the way of a step, and the softness of contact.
    assert np.diff(energy).max() < 2e-5 * energy[0]
    # Its lowest layer of nodes is stopped, a half of a layer of cells: 1 / (2 cells) of its energy, and nothing more.
    assert energy[-1] / energy[0] == pytest.approx(1 - 1 / (2 * cells), abs=3e-3)
    rises = (solution.displacement[-1] - solution.displacement[-2])[:, 2].mean() * 200 / 0.02
    assert 0.5 < rises < 1.0
    # All momentum comes from the floor.
    pushed = -solution.reaction[:, 2].sum() * 0.02 / 200
    assert pushed == pytest.approx(0.008 * (1 + rises), rel=2e-2)
    assert solution.penetration.max() < 1e-4 * cell_size(solution.mesh)


def test_an_obstacle_that_strikes_does_all_the_work():
    """Struck by a cylinder at 1 m/s: what moves and strains the beam never exceeds the work of the cylinder."""
    scene = pressed(steps={"dynamic": True, "duration": 0.015, "count": 150})
    solution = solve(scene)
    start, end = (np.array(point) for point in scene.obstacle.path)
    work = np.cumsum(-solution.reaction @ (end - start) / 150)
    energy = total_energy(solution)
    assert energy.max() > 0 and not solution.failure
    assert (energy - work).max() < 1e-5 * energy.max()  # the solver's tolerance and the softness of contact
    assert energy[-1] > 0.8 * work[-1]  # what is lost is the motion of the layer that was struck


def test_broken_off_and_gone_on_with(tmp_path, monkeypatch):
    monkeypatch.setattr(journal, "EVERY", 0.0)
    scene = pressed(steps={"dynamic": True, "duration": 0.05, "count": 20})
    whole = solve(scene)

    def stop(step):
        if step in (6, 13):
            raise KeyboardInterrupt

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            solve(scene, journal=tmp_path / "part", on_step=stop)
    again = solve(scene, journal=tmp_path / "part")
    assert again.resumed == 13
    for name in ("displacement", "reaction", "kinetic_energy", "newton_iterations"):
        assert np.array_equal(getattr(again, name), getattr(whole, name)), name


def test_the_file_of_a_motion(tmp_path, capsys):
    scene = pressed(steps={"dynamic": True, "duration": 0.05, "count": 10})
    trajectory = trajectory_of(scene)
    assert against_scene(trajectory) == []
    assert trajectory.extra["model"]["inertia"].startswith("in motion")
    write_trajectory(tmp_path / "t.vtkhdf", trajectory)
    with h5py.File(tmp_path / "t.vtkhdf") as file:
        assert file["VTKHDF/Steps/Values"][()] == pytest.approx(np.linspace(0, 0.05, 11))
        assert file["VTKHDF/FieldData/kinetic_energy"][-1] > 0
    assert fidelity.main(["verify", str(tmp_path / "t.vtkhdf"), "--reference", str(tmp_path / "t.vtkhdf")]) == 2
    assert "a body in motion" in capsys.readouterr().err


@pytest.mark.parametrize("steps, load, words", [
    ({"dynamic": True}, [], "steps.duration: missing"),
    ({"velocity": [0.0, 0.0, 1.0]}, [], "steps.velocity: needs dynamic"),
    ({"duration": 1.0}, [{"acceleration": [0.0, 0.0, 1.0], "sudden": True}], "sudden"),
    ({"dynamic": True, "duration": -1.0}, [], "must be above 0"),
])
def test_what_does_not_go_together_is_refused(steps, load, words):
    with pytest.raises(InputError, match=words):
        beam(steps=steps, load=load)


def csm3(element="standard"):
    """The bar of Turek and Hron's fluid-structure benchmark, released under gravity: lowest u_x and u_y of its tip [m], frequency [Hz]."""
    young = 2 * 0.5e6 * 1.4
    scene = beam(
        body={"length": 0.35, "width": 0.02, "height": 0.02 / 8, "cells": [280, 8, 1], "cell": "hexahedron", "element": element},
        material={"law": "saint-venant-kirchhoff", "young_modulus": young, "poisson_ratio": 0.4},
        support=[{"where": "x-min"}, {"where": "z-min", "fixed": "z"}, {"where": "z-max", "fixed": "z"}],
        load=[{"acceleration": [0.0, -2.0, 0.0], "sudden": True}], steps={"dynamic": True, "duration": 2.0, "count": 400})
    straight = build_mesh(scene.body)
    x, y, z = straight.points.T
    left = np.sqrt(0.05**2 - (y - 0.01) ** 2) - 0.05  # it is clamped to a cylinder
    mesh = dataclasses.replace(straight, points=np.stack([left + x * (0.35 - left) / 0.35, y, z], axis=1))
    motion = Motion(scene, mesh)
    tip = int(np.linalg.norm(mesh.points - [0.35, 0.01, 0.0], axis=1).argmin())
    way = np.array([motion.advance(step / 400).u[tip] for step in range(1, 401)])
    low = np.array([k for k in range(1, 399) if way[k, 1] < min(-0.1, way[k - 1, 1]) and way[k, 1] <= way[k + 1, 1]])
    before, at, after = way[low - 1, 1], way[low, 1], way[low + 1, 1]
    time = (low + 1 + (before - after) / 2 / (before - 2 * at + after)) * 0.005
    assert len(low) == 2
    return way[:, 0].min(), way[:, 1].min(), float(1 / np.diff(time)[0])


@pytest.mark.slow
def test_turek_and_hron_csm3():
    """Published: u_x = -14.305 +- 14.305 mm, u_y = -63.607 +- 65.160 mm, 1.0995 Hz."""
    # First-order cells: with the same mesh the static deflection, CSM1, is 1.4 % short of the published one.
    assert csm3() == pytest.approx((-2 * 14.305e-3, -63.607e-3 - 65.160e-3, 1.0995), rel=1.5e-2)
