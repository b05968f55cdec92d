"""Iterations instead of a factor: the same equilibria, on one process and on two."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from datagen.files.trajectory import read_trajectory
from physics.equilibrium.balance import Balance, cell_size
from physics.equilibrium.newton import TOLERANCE
from physics.linalg import cholesky
from physics.linalg.factor import factor_for, solver_for
from physics.linalg.multigrid import Multigrid, NotSolved
from physics.mesh.build import build_mesh
from physics.solution import solve
from tests.scenes import beam, pressed

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize("scene", [
    pressed(steps={"count": 8}),
    pressed(obstacle={"shape": "capsule", "radius": 0.02, "length": 0.01, "path": [[0.05, 0.01, 0.0405], [0.05, 0.01, 0.033]]},
            steps={"count": 8}),
    beam(load=[{"where": "x-max", "traction": [0.0, 0.0, -1e4]}], steps={"count": 4}),
    beam(support=[{"where": "x-min"}, {"where": "x-max", "fixed": "z", "displacement": [0.0, 0.0, -0.01]}], steps={"count": 4}),
    pressed(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [6, 1, 1], "cell": "tetrahedron", "order": 2}, steps={"count": 2},
            obstacle={"shape": "cylinder", "radius": 0.01, "path": [[0.05, 0.01, 0.0301], [0.05, 0.01, 0.028]]}),
], ids=["cylinder", "capsule", "traction", "displacement", "second order"])
def test_both_ways_find_the_same_equilibria(scene):
    direct, iterated = solve(scene, method="direct"), solve(scene, method="multigrid")
    assert not direct.failure and not iterated.failure
    assert "Cholesky" in direct.model["factor"] and "multigrid, as asked for" in iterated.model["factor"]
    assert iterated.relative_residual.max() <= TOLERANCE
    assert iterated.penetration.max() < 1e-4 * cell_size(iterated.mesh)
    # Both are solved to 1e-6 of the reaction; a beam turns that into up to ten times as much of its displacement.
    assert abs(iterated.displacement - direct.displacement).max() < 1e-5 * abs(direct.displacement).max()
    assert iterated.reaction == pytest.approx(direct.reaction, abs=1e-5 * abs(direct.reaction).max())


def test_multigrid_needs_hardly_more_iterations_on_a_finer_mesh():
    """To 1e-10 of the force, on meshes of 8 and 64 times as many cells: the point of multigrid. Its solutions are those of a factor."""
    taken = []
    for n in (2, 4, 8):
        scene = beam(body={"length": 0.06, "width": 0.02, "height": 0.02, "cells": [3 * n, n, n]})
        balance = Balance(scene, build_mesh(scene.body))
        solver, exact = Multigrid(balance.elasticity, why=""), factor_for(balance.elasticity)
        u, force = np.zeros(balance.fixed.shape), np.random.default_rng(0).normal(size=balance.fixed.shape)
        solver.update(u)
        exact.update(u)
        assert solver.solve(force) == pytest.approx(exact.solve(force), abs=1e-7 * abs(exact.solve(force)).max())
        taken.append(solver.iterations)
    assert taken[2] < 2 * taken[1] and taken[2] < 60


def test_a_stiffness_that_is_not_definite_is_noticed():
    balance = Balance(beam(), build_mesh(beam().body))
    solver = Multigrid(balance.elasticity, why="")
    solver.update(-0.6 * balance.mesh.points * [0, 0, 1])  # pressed flat everywhere
    with pytest.raises(NotSolved, match="not positive definite"):
        solver.solve(np.random.default_rng(0).normal(size=balance.fixed.shape))


def test_a_body_too_large_for_a_factor_is_iterated_and_that_is_said(monkeypatch):
    scene = beam(body={"length": 0.03, "width": 0.02, "height": 0.02, "cells": [12, 10, 10]})
    elasticity = Balance(scene, build_mesh(scene.body)).elasticity
    assert "nested dissection" in solver_for(elasticity).name
    monkeypatch.setattr(cholesky, "MOST_NUMBERS", 100_000)
    assert "a factor would take" in solver_for(elasticity).name and "0.0008 GB" in solver_for(elasticity).name


@pytest.mark.skipif(not shutil.which("mpirun"), reason="no mpirun")
def test_two_processes_simulate_what_one_does(tmp_path):
    (tmp_path / "scene.toml").write_text(pressed(steps={"count": 4}).to_toml())
    environment = {key: value for key, value in os.environ.items() if not key.startswith("OMPI_")} | {
        "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "OMPI_MCA_plm": "isolated", "OMP_NUM_THREADS": "1",
        "HWLOC_HIDE_ERRORS": "2", "OMPI_MCA_rmaps_base_oversubscribe": "1", "OMPI_MCA_mpi_yield_when_idle": "1"}
    command = [sys.executable, ROOT / "fidelity.py", "simulate", tmp_path / "scene.toml", "--json", "--out"]
    two = subprocess.run(["mpirun", "-n", "2", *command, tmp_path / "two.vtkhdf"], capture_output=True, text=True, env=environment,
                         timeout=120)
    assert two.returncode == 0, two.stderr
    one = subprocess.run([*command, tmp_path / "one.vtkhdf"], capture_output=True, text=True)
    said, expected = json.loads(two.stdout), json.loads(one.stdout)
    assert "on 2 processes" in said["model"]["factor"] and said["steps"] == expected["steps"] == 4
    assert np.array(said["reaction"]) == pytest.approx(np.array(expected["reaction"]), abs=1e-5 * np.abs(expected["reaction"]).max())
    mine, reference = (read_trajectory(tmp_path / name).displacement for name in ("two.vtkhdf", "one.vtkhdf"))
    assert abs(mine - reference).max() < 1e-5 * abs(reference).max()  # as above
    assert not list(tmp_path.glob("*.part"))
