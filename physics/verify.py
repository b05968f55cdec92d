"""A predicted trajectory held against finite elements: against a reference trajectory, and against the equations.

Against the reference: root mean square errors, mesh quality (quality.py). Against the equations, needing no reference:
- residual force: what is missing to equilibrium at each frame, f(u) - b - sum_q p_q n_q on the free components, for the
  contact forces p >= 0 at touching points that leave the least of it (a non-negative least-squares problem). A point
  touches when its gap is below TOUCHING cell sizes. The reference for its size is the largest reaction of the trajectory.
- penetration of the obstacle, smallest det F and inverted cells.
A frame of an FE solution scores the solver's tolerance, or the rounding of the file that it was stored in.

Legend: T frames (the rest state first), N body nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.optimize
from numpy.typing import ArrayLike, NDArray

from physics import quality
from physics.equilibrium import Path
from physics.mesh import Mesh
from physics.scene import Scene

Floats = NDArray[np.float64]
TOUCHING = 0.05  # of a cell size


@dataclass(frozen=True, kw_only=True)
class Fidelity:
    """How far a prediction is from the truth; lengths in metres. "free": nodes that are neither held nor obstacle."""

    rmse_1: float  # free nodes, one step from the true state before; without such predictions, the first step alone
    rmse_50: float  # free nodes, steps 1 .. 50 of the rollout
    rmse_all: float  # free nodes, all steps
    rmse_1_pooled: float  # the same over all nodes of the body, held ones too
    rmse_50_pooled: float
    rmse_all_pooled: float
    gf_h: float  # mean over steps of the Hausdorff distance
    gf_c: float  # [m2] mean over steps of the Chamfer distance
    mc: float  # mean over steps of the error of mesh continuity
    ar: float  # mean over steps of the error of aspect ratio
    relative_residual: float  # root mean square over the checked frames of |R| / largest reaction
    largest_penetration: float
    smallest_det_f: float
    inverted_elements: int  # in the worst frame
    worst_step: int  # with the largest error of free nodes


class Checker:
    """The equations of one scene, ready to check any displacement of its body."""

    def __init__(self, scene: Scene, mesh: Mesh) -> None:
        self.path = Path(scene, mesh)

    def residual(self, u: Floats, fraction: float) -> tuple[float, float]:
        """|R| and |reaction| [N] of displacements (N, 3) at a fraction of the loading."""
        path = self.path
        force = path.elasticity.force(u) - fraction * path.load
        free = ~path.fixed
        missing, reaction = force[free], np.zeros(3)
        if path.contact is not None and np.isfinite(force).all():
            zone = path.contact.zone(u, path.contact.obstacle.position(fraction), TOUCHING * path.size)
            if len(zone.points):
                _, normal = zone.gaps(u, path.contact.obstacle.position(fraction))
                movable = free[zone.nodes]  # (m, 3)
                points, nodes = np.arange(len(zone.points)), np.arange(len(zone.nodes))
                pull = zone.gradient(points, nodes, normal)[:, movable.ravel()].T  # (3 m, q)
                p = scipy.optimize.nnls(pull, force[zone.nodes][movable])[0]
                force[zone.nodes] -= zone.forces(p, normal)
                missing, reaction = force[free], -p @ normal
        elif path.contact is None:
            reaction = force[path.fixed]
        return float(np.linalg.norm(missing)), float(np.linalg.norm(reaction))

    def penetration(self, u: Floats, fraction: float) -> float:
        """Largest penetration [m] of the obstacle at displacements (N, 3)."""
        contact = self.path.contact
        if contact is None:
            return 0.0
        return max(0.0, -float(contact.gaps(u, contact.obstacle.position(fraction))[0].min()))


def verify(prediction: ArrayLike, reference: ArrayLike, *, scene: Scene, mesh: Mesh, free: NDArray[np.bool_],
           one_step: ArrayLike | None = None, sample: int | None = None) -> Fidelity:
    """Hold a predicted trajectory against a reference and against the equations.

    Args:
        prediction, reference: (T, N, 3) displacements of the body [m]
        free: (N,) True on nodes that are not held
        one_step: (T - 1, N, 3) predictions of frames 1 .. T - 1, each made from the true frame before it
        sample: check the equations at about this many frames, evenly spaced; at all of them by default
    """
    u, truth = np.asarray(prediction, np.float64), np.asarray(reference, np.float64)
    steps = len(u) - 1
    first = u[1:2] if one_step is None else np.asarray(one_step, np.float64)
    of_first = truth[1:len(first) + 1]
    predicted, true = mesh.points + u[1:], mesh.points + truth[1:]
    error = np.sqrt(np.mean(np.sum((u - truth)[:, free] ** 2, axis=2), axis=1))

    checker = Checker(scene, mesh)
    frames = np.unique(np.linspace(1, steps, min(steps, sample or steps)).round().astype(int))
    missing = np.array([checker.residual(u[t], t / steps)[0] for t in frames])
    reaction = max(checker.residual(truth[t], t / steps)[1] for t in frames)
    cells = (mesh.cells, mesh.cell)
    return Fidelity(
        rmse_1=quality.rmse(first, of_first, free), rmse_50=quality.rmse(u[1:51], truth[1:51], free),
        rmse_all=quality.rmse(u[1:], truth[1:], free), rmse_1_pooled=quality.rmse(first, of_first),
        rmse_50_pooled=quality.rmse(u[1:51], truth[1:51]), rmse_all_pooled=quality.rmse(u[1:], truth[1:]),
        gf_h=float(np.mean([quality.hausdorff(a, b) for a, b in zip(predicted, true, strict=True)])),
        gf_c=float(np.mean([quality.chamfer(a, b) for a, b in zip(predicted, true, strict=True)])),
        mc=float(np.mean(quality.mesh_continuity_error(predicted, true, *cells))),
        ar=float(np.mean(quality.aspect_ratio_error(predicted, true, *cells))),
        relative_residual=float(np.sqrt(np.mean(missing**2)) / reaction) if reaction > 0 else float(missing.max()),
        largest_penetration=max(checker.penetration(u[t], t / steps) for t in range(1, steps + 1)),
        smallest_det_f=float(quality.smallest_det_f(mesh.points, u, *cells).min()),
        inverted_elements=int(quality.inverted_cells(mesh.points, u, *cells).max()),
        worst_step=int(np.argmax(error)))


def as_table(fidelity: Fidelity) -> dict[str, Any]:
    """The figures as plain numbers under the names of the command line."""
    return dict(vars(fidelity))
