"""The table of modes in docs/verification.md: computed values beside exact or published ones.

    .venv/bin/python -m benchmarks.verify_modes
"""

import tempfile
from pathlib import Path

import numpy as np

from benchmarks import footing
from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS
from physics.modes.elastic import elastic_modes
from physics.modes.laplacian import laplacian_modes
from physics.scene import read_scene
from tests import test_physics_laplacian as laplacian
from tests import test_physics_modes_elastic as elastic


def main() -> None:
    footing.parser(__doc__).parse_args()
    table = footing.Table()

    def row(what: str, mesh: str, reference: list[float], found: list[float], residual: float) -> None:
        table.add({"case": what, "mesh": mesh, "reference": ", ".join(f"{x:.6g}" for x in reference),
                   "found": ", ".join(f"{x:.6g}" for x in found),
                   "largest difference": f"{100 * max(abs(np.array(found) / np.array(reference) - 1)):.2g} %",
                   "largest residual": f"{residual:.0e}"})

    modes = elastic_modes(elastic.plate_on_edges([4, 4, 1]), count=10)
    row("NAFEMS FV52, its solid reference [Hz]", "4 x 4 x 1 hexahedra, order 2",
        [44.762, 110.52, 110.52, 169.08, 193.93, 206.64, 206.64],
        list(modes.frequencies_hz[3:]), modes.residuals.max())
    with tempfile.TemporaryDirectory() as folder:
        body = elastic.tapered(Path(folder), 8) | {"order": 2}
        held = [{"where": "root", "fixed": "xy"}]
        modes = elastic_modes(read_scene({"body": body, "material": elastic.STEEL, "support": held}), count=6)
    row("NAFEMS FV32 [Hz]", "16 x 8 quadrilaterals, order 2", [44.623, 130.03, 162.70, 246.05, 379.90, 391.44],
        list(modes.frequencies_hz), modes.residuals.max())
    modes = elastic_modes(elastic.sliding(6, "hexahedron", 2), count=10)
    row("box with sliding walls, exact [Hz]", "6 x 6 x 6 hexahedra, order 2", elastic.sliding_exact(10).tolist(),
        list(modes.frequencies_hz), modes.residuals.max())
    for cell, order, cells in (("prism", 1, [40, 5, 5]), ("tetrahedron", 2, [40, 5, 5])):
        body = {**elastic.SLENDER, "cells": cells, "cell": cell, "order": order}
        scene = read_scene({"body": body, "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": "x-min"}]})
        modes = elastic_modes(scene, count=1)
        row("cantilever, first bending, converged value [Hz]", f"40 x 5 x 5 {CELLS[cell].plural}, order {order}", [elastic.CONVERGED],
            list(modes.frequencies_hz), modes.residuals.max())
    scene = elastic.beam(body={**elastic.SLENDER, "cells": [20, 8, 8], "cell": "tetrahedron", "order": 2})
    modes = elastic_modes(scene, count=1, mesh=elastic.graded(build_mesh(scene.body), 3, 3))
    row("the same", "20 x 8 x 8 tetrahedra, order 2, small at the clamped face", [elastic.CONVERGED], list(modes.frequencies_hz),
        modes.residuals.max())
    found = laplacian_modes(laplacian.square(20, order=2), count=6)
    row("unit square, Dirichlet, exact [1/m2]", "20 x 20 x 2 triangles, order 2", laplacian.SQUARE.tolist(), found.eigenvalues.tolist(),
        found.residuals.max())
    found = laplacian_modes(laplacian.square(20, order=2), count=4, dirichlet=[])
    row("unit square, Neumann, exact, after one zero [1/m2]", "20 x 20 x 2 triangles, order 2",
        (np.pi**2 * np.array([1, 1, 2])).tolist(), found.eigenvalues[1:].tolist(), found.residuals.max())
    found = laplacian_modes(laplacian.cube(6, "hexahedron", order=2), count=1)
    row("unit cube, Dirichlet, exact [1/m2]", "6 x 6 x 6 hexahedra, order 2", [3 * np.pi**2], found.eigenvalues.tolist(),
        found.residuals.max())
    found = laplacian_modes(laplacian.square(1, order=2), mesh=laplacian.l_shape(24), count=3)
    row("L-shape, first and third [1/m2]", "24 triangles a side, order 2", [laplacian.L_SHAPE, 2 * np.pi**2],
        found.eigenvalues[[0, 2]].tolist(), found.residuals.max())


if __name__ == "__main__":
    main()
