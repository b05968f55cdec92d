"""What it costs to hold a prediction against its reference and against the equations: 400 steps of the press scene, 1476 nodes.

    .venv/bin/python -m benchmarks.verify

All figures that need only the two arrays, for the whole trajectory; and per frame the checks by finite elements (residual with the
contact forces that leave the least of it, energy, penetration, one Newton step, stress).
"""

import numpy as np

from benchmarks import footing
from physics.body.stress import von_mises
from physics.fidelity.verify import Checker, verify
from physics.mesh import quality
from physics.solution import solve


def main() -> None:
    footing.parser(__doc__).parse_args()
    scene = footing.press()
    solution = solve(scene)
    mesh, truth = solution.mesh, solution.displacement
    free = np.ones(len(mesh.points), bool)
    free[mesh.places["x-min"]] = False
    drift = 1e-5 * np.sin(60 * mesh.points[:, :1]) * np.linspace(0, 1, len(truth))[:, None, None]
    prediction = truth + np.where(free[:, None], drift, 0.0)
    verify(prediction[:3], truth[:3], scene=scene, mesh=mesh, free=free)  # compiled forms
    last, checker = len(truth) - 1, Checker(scene, mesh)
    cells, now, then = (mesh.cells, mesh.cell), mesh.points + prediction, mesh.points + truth

    def checks() -> None:
        for t in range(1, last + 1):
            checker.frame(prediction[t], t / last)
            checker.correction(prediction[t], t / last)
            checker.penetration(prediction[t], t / last)
            von_mises(mesh, prediction[t], scene.material)

    def metrics() -> None:
        quality.rmsd(prediction, truth)
        quality.rmsd(prediction, truth, free)
        for a, b in zip(now, then, strict=True):
            quality.set_distances(a, b)
        quality.mesh_continuity(now, *cells)
        quality.aspect_ratio(now, *cells)
        quality.det_f(mesh.points, prediction, *cells)
        quality.scaled_jacobian(now, *cells)

    footing.Table().add({
        "nodes": len(mesh.points), "frames": last, "figures of the two arrays [s]": footing.cost(metrics)[0],
        "checks by finite elements [ms a frame]": 1e3 * footing.cost(checks)[0] / last,
        "effectivity": verify(prediction, truth, scene=scene, mesh=mesh, free=free).effectivity})


if __name__ == "__main__":
    main()
