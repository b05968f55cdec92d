"""What a predictor sees of a trajectory, against a beam made by hand: everything but the motion of its free nodes."""

import csv
import dataclasses

import numpy as np
import pytest
import pyvista

from datagen.files import trajectory as trajectory_module
from datagen.files.inputs import inputs_of, poses, predicted, write_table
from datagen.files.trajectory import read_trajectory, write_trajectory
from datagen.sets.dataset import digest
from datagen.sets.generate import trajectory_of
from physics.mesh.build import build_mesh
from physics.schema import InputError
from tests import unsolved
from tests.scenes import pressed
from tests.synthetic import bending


def test_inputs_are_the_body_alone_without_the_motion_of_its_free_nodes():
    trajectory = bending(cells=(4, 2, 2), steps=5, travel=0.02, at=0.07)
    seen, nodes = inputs_of(trajectory), 5 * 9
    assert seen.points.shape == (nodes, 3) and seen.cells.shape == (32, 6) and seen.cell == "prism" and seen.frames == 6
    # the 9 nodes at x = 0 are held; of an undivided prism of 4 x 2 x 2: along x 36, y 30, z 30, and a diagonal in each of 4 squares of 5
    assert np.array_equal(seen.free, seen.points[:, 0] > 0) and seen.edges.shape == (36 + 30 + 30 + 20, 2)
    assert seen.held.shape == (6, nodes, 3) and not seen.held.any() and seen.modes.shape == (2, nodes, 3) and seen.scene is None
    other = dataclasses.replace(trajectory, displacement=np.where(trajectory.free[:, None], 7, trajectory.displacement))
    for one, two in zip(vars(seen).values(), vars(inputs_of(other)).values(), strict=True):
        assert np.array_equal(one, two)
    lifted = trajectory.displacement.copy()
    lifted[2, 0] = [1, 2, 3]  # a held node
    assert inputs_of(dataclasses.replace(trajectory, displacement=lifted)).held[2, 0].tolist() == [1, 2, 3]


def test_the_pose_of_an_obstacle_is_its_centre_in_each_frame():
    """Of a set without a scene the middle of its nodes: a cylinder of 10 mm that starts 1 mm above a beam of 20 mm at x = 70 mm."""
    trajectory = bending(cells=(4, 2, 2), steps=5, travel=0.02, at=0.07)
    assert np.allclose(poses(trajectory), [[0.07, 0.01, 0.031 - 0.004 * t] for t in range(6)], atol=1e-8)
    seen = inputs_of(trajectory)
    assert seen.obstacle_points.shape == (48, 3) and np.allclose(seen.obstacle_points.mean(axis=0), [0.07, 0.01, 0.031])
    assert seen.obstacle_triangles.min() == 0 and seen.obstacle_triangles.max() == 47
    # with a scene as it prescribes it: a plane that comes down from 20 to 10 mm in twelve steps, here stopped after the fifth
    scene = unsolved.scene()
    made = unsolved.trajectory(scene)
    stopped = dataclasses.replace(made, displacement=made.displacement[:6])
    assert np.allclose(poses(stopped), [[0, 0, 0.02 - 0.01 * t / 12] for t in range(6)], atol=1e-15) and inputs_of(made).scene == scene
    free = unsolved.trajectory(unsolved.scene(obstacle={"shape": "sphere", "radius": 1.0, "path": [[0, 0, 9]] * 2}))
    alone = dataclasses.replace(free, points=free.points[:-3], node_kind=free.node_kind[:-3], displacement=free.displacement[:, :-3])
    assert poses(alone) is None


def test_a_prediction_takes_the_place_of_the_motion_and_keeps_its_name_and_time(tmp_path):
    trajectory = bending(cells=(4, 2, 2), steps=5)
    u = np.arange(6 * 45 * 3.0).reshape(6, 45, 3)
    write_trajectory(tmp_path / "p.vtkhdf", predicted(trajectory, u.tolist(), name="mine", seconds_per_step=0.25))
    kept = read_trajectory(tmp_path / "p.vtkhdf")
    assert np.array_equal(kept.displacement[:, :45], u) and kept.extra == {"name": "mine", "seconds_per_step": 0.25}
    assert np.array_equal(kept.displacement[:, 45:], trajectory.displacement[:, 45:])
    assert predicted(trajectory, u).extra == {}
    for wrong in (u[:5], u[:, :44], u[..., :2], trajectory.displacement):
        with pytest.raises(InputError, match=r"must be \(6, 45, 3\), frames from the rest state on, nodes of the body, x y z"):
            predicted(trajectory, wrong)


@pytest.mark.parametrize("wrong", [(6, 45, 3), (6, 93, 2), (93, 6, 3), (6, 93), (0, 93, 3)])
def test_displacements_of_another_shape_are_not_written(tmp_path, wrong):
    trajectory = bending(cells=(4, 2, 2), steps=5)
    assert len(trajectory.points) == len(build_mesh(unsolved.read_scene(
        {"body": {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [4, 2, 2]}, "material": {"young_modulus": 1, "poisson_ratio": 0}}
    ).body).points) + 48 == 93
    with pytest.raises(InputError, match=r"must be \(T, 93, 3\).* those of the body \(45\) first, then those of the obstacle \(48\)"):
        write_trajectory(tmp_path / "p.vtkhdf", dataclasses.replace(trajectory, displacement=np.zeros(wrong)))
    assert not list(tmp_path.iterdir())


def test_positions_are_not_written_as_displacements(tmp_path):
    trajectory = bending(cells=(4, 2, 2), steps=5)
    with pytest.raises(InputError, match="positions"):
        write_trajectory(tmp_path / "p.vtkhdf", dataclasses.replace(trajectory, displacement=trajectory.displacement + trajectory.points))
    write_trajectory(tmp_path / "p.vtkhdf", dataclasses.replace(trajectory, displacement=trajectory.displacement.astype(np.float64)))
    kept = read_trajectory(tmp_path / "p.vtkhdf").displacement
    assert kept.dtype == np.float32 and np.array_equal(kept, trajectory.displacement)


def test_the_table_of_a_trajectory_has_the_reaction_beside_the_place_of_the_obstacle(tmp_path):
    """A beam under a cylinder that comes down 15 mm in 3 steps: obstacle, reaction, energy of each frame, to be drawn in three lines."""
    made = trajectory_of(pressed(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [4, 1, 2]}, steps={"count": 3}))
    assert np.allclose(made.per_frame["obstacle"], [[0.05, 0.01, 0.0305 - 0.005 * t] for t in range(4)], atol=1e-15)
    write_table(tmp_path / "t.csv", made)
    with open(tmp_path / "t.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["step"] for row in rows] == ["0", "1", "2", "3"] and "newton_iterations" in rows[0]
    for name in ("obstacle", "reaction"):
        assert np.array_equal([[float(row[f"{name}_{axis}"]) for axis in "xyz"] for row in rows], made.per_frame[name])
    assert np.array_equal([float(row["energy"]) for row in rows], made.per_frame["energy"]) and made.per_frame["energy"][-1] > 0
    bare = dataclasses.replace(made, per_frame={name: array for name, array in made.per_frame.items() if name != "obstacle"})
    assert digest(bare) == digest(made) and np.array_equal(poses(bare), poses(made))  # the scene says where it is
    moved = dataclasses.replace(made, per_frame=made.per_frame | {"energy": made.per_frame["energy"] + 1})
    assert digest(moved) != digest(made)


def test_pyvista_steps_through_a_file_as_its_page_says(tmp_path):
    trajectory = bending(cells=(4, 2, 2), steps=5)
    write_trajectory(tmp_path / "t.vtkhdf", dataclasses.replace(trajectory, per_frame={"reaction": np.arange(18.0).reshape(6, 3)}))
    reader = pyvista.get_reader(tmp_path / "t.vtkhdf")
    for frame in (0, 3, 5, 1):
        reader.reader.SetStep(frame)
        mesh = reader.read()
        assert np.array_equal(mesh["displacement"], trajectory.displacement[frame])
        assert np.array_equal(mesh.field_data["reaction"][0], [3 * frame, 3 * frame + 1, 3 * frame + 2])
    assert "reader.reader.SetStep(7)" in trajectory_module.__doc__
