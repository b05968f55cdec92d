"""Cells of second order held against the equations, and drawn: what their middle nodes alone do wrong is found, and seen."""

import numpy as np
import pytest

from physics import view
from physics.equilibrium.newton import TOLERANCE
from physics.fidelity.verify import verify
from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS
from physics.scene import Body
from physics.solution import solve
from tests.scenes import pressed
from tests.test_physics_view import reds


def middles(mesh):
    """(N,) whether a node is no corner."""
    return ~np.isin(np.arange(len(mesh.points)), mesh.cells[:, :CELLS[mesh.cell].corners])


def body(cell, length=0.06, cells=(4, 1, 1)):
    """A beam, or a plate of plane cells."""
    plane = CELLS[cell].dimension == 2
    sizes = {"shape": "plate", "cells": cells[:2]} if plane else {"height": 0.02, "cells": cells}
    return {"length": length, "width": 0.02, "cell": cell, "order": 2} | sizes


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron", "triangle", "quadrilateral"])
def test_a_solved_path_scores_nothing_and_noise_at_the_middles_is_found(cell):
    plane = CELLS[cell].dimension == 2
    path = [[0.05, 0.0301, 0.0], [0.05, 0.028, 0.0]] if plane else [[0.05, 0.01, 0.0301], [0.05, 0.01, 0.028]]
    scene = pressed(body=body(cell) | {"cells": list(body(cell)["cells"])}, steps={"count": 2},
                    obstacle={"shape": "cylinder", "radius": 0.01, "axis": [0, 0, 1] if plane else [0, 1, 0], "path": path})
    solution = solve(scene)
    mesh, truth = solution.mesh, solution.displacement
    free = np.ones(len(mesh.points), bool)
    free[mesh.place("x-min")] = False
    own = verify(truth, truth, scene=scene, mesh=mesh, free=free)
    assert own.rmsd_all == own.mc == own.inverted_elements == 0 and own.relative_residual < 2 * TOLERANCE
    assert own.largest_penetration < 1e-6
    wrong = truth + np.where((free & middles(mesh))[:, None], [0.0, 1e-6, 0.0], 0.0)
    found = verify(wrong, truth, scene=scene, mesh=mesh, free=free)
    share = (free & middles(mesh)).sum() / free.sum()
    assert found.rmsd_all == pytest.approx(1e-6 * share**0.5, rel=1e-6) and found.relative_residual > 100 * TOLERANCE
    assert found.effectivity == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron", "triangle", "quadrilateral"])
def test_an_error_of_the_middles_alone_is_seen(tmp_path, cell):
    mesh = build_mesh(Body(**body(cell, 0.1, (10, 2, 2))))
    truth = np.zeros_like(mesh.points)
    wrong = truth + np.where((middles(mesh) & (mesh.points[:, 0] > 0.07))[:, None], [0.0, 2e-3, 0.0], 0.0)
    view.frame_picture(tmp_path / "a.png", mesh, prediction=wrong, truth=truth, step=1, steps=1)
    assert reds(tmp_path / "a.png", slice(0, 600)) > 500 and reds(tmp_path / "a.png", slice(600, None)) == 0
