"""A predicted trajectory held against finite elements: against a reference trajectory, and against the equations.

Against the reference: root mean square errors, mesh quality (quality.py), energy, reaction and stress (stress.py). Against the
equations, needing no reference:
- residual force: what is missing to equilibrium at each frame, f(u) - b - sum_q p_q n_q on the free components, for the
  contact forces p >= 0 that leave the least of it (`Balance.missing`). The reference for its size is the largest reaction of the
  trajectory.
- estimated error |K^-1 R|: one Newton step from the prediction, contact included, is about what it lacks to the equilibrium
  nearby. Its effectivity, estimated over true error, says whether that may be believed: 1 is perfect.
- penetration of the obstacle, smallest det F and inverted cells.
A frame of an FE solution scores the solver's tolerance, or the rounding of the file that it was stored in.

Legend: T frames (the rest state first), N body nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from physics.body.stress import von_mises
from physics.equilibrium.balance import Balance
from physics.equilibrium.newton import Newton
from physics.equilibrium.state import NoEquilibrium
from physics.mesh import quality
from physics.mesh.mesh import Mesh
from physics.scene import Scene

Floats = NDArray[np.float64]
OF_CELLS = ("mc", "ar", "smallest_det_f", "smallest_scaled_jacobian", "inverted_elements")
OF_EQUATIONS = ("relative_residual", "energy_error", "reaction_error", "stress_error", "estimated_error", "effectivity",
                "largest_penetration")


@dataclass(frozen=True, kw_only=True)
class Fidelity:
    """How far a prediction is from the truth; lengths in metres. "free": nodes that are neither held nor obstacle."""

    rmsd_1: float  # free nodes, one step from the true state before; without such predictions the first step, if it moves the truth
    rmsd_50: float  # free nodes, steps 1 .. 50 of the rollout
    rmsd_all: float  # free nodes, all steps
    rmsd_1_all_nodes: float  # the same over all nodes of the body, held ones too
    rmsd_50_all_nodes: float
    rmsd_all_all_nodes: float
    rmse_1: float  # of a coordinate, as published: free nodes, the same steps
    rmse_50: float
    rmse_all: float
    rmse_1_by_step: float  # the mean over steps of each step's root
    rmse_50_by_step: float
    rmse_all_by_step: float
    rmse_1_all_nodes: float
    rmse_50_all_nodes: float
    rmse_all_all_nodes: float
    rmse_1_by_step_all_nodes: float
    rmse_50_by_step_all_nodes: float
    rmse_all_by_step_all_nodes: float
    gf_h: float  # mean over steps of the Hausdorff distance
    gf_c: float  # [m2] mean over steps of the Chamfer distance
    mc: float  # mean over steps of the error of mesh continuity
    ar: float  # mean over steps of the error of aspect ratio
    relative_residual: float  # root mean square over the checked frames of |R| / largest reaction
    energy_error: float  # root mean square over the checked frames, over the largest energy of the reference
    reaction_error: float  # root mean square over the checked frames, over the largest reaction of the reference
    stress_error: float  # von Mises at the cells' centres: root mean square over cells and checked frames, over that of the reference
    estimated_error: float  # free nodes, root mean square over the checked frames; infinite where no step can be made
    effectivity: float  # estimated over true error of the checked frames; not a number when there is no error
    largest_penetration: float
    smallest_det_f: float
    smallest_scaled_jacobian: float
    inverted_elements: int  # in the worst frame
    worst_step: int  # with the largest error of free nodes


@dataclass(frozen=True)
class Frame:
    """What the equations say about one frame."""

    residual: float  # [N] missing to equilibrium on free components
    reactions: Floats  # (K, 3) [N] of the body on each obstacle; without one, (1, 3) on its supports
    energy: float  # [J] stored

    @property
    def reaction(self) -> Floats:
        """(3,) [N] all of them together."""
        return np.asarray(self.reactions.sum(axis=0))

    @property
    def push(self) -> float:
        """[N] the sum of their sizes: of two obstacles that press against each other the reactions cancel."""
        return sum(float(np.linalg.norm(each)) for each in self.reactions)


class Checker:
    """The equations of one scene, ready to check any displacement of its body."""

    def __init__(self, scene: Scene, mesh: Mesh) -> None:
        self.balance = Balance(scene, mesh)
        self._newton = Newton(self.balance)

    def frame(self, u: Floats, fraction: float) -> Frame:
        """Displacements (N, 3) at a fraction of the loading, held against the equations."""
        balance = self.balance
        left, reactions = balance.missing(u, fraction)
        if balance.contact is None:
            reactions = -left[balance.bearing].sum(axis=0)[None]
        return Frame(float(np.linalg.norm(left[~balance.fixed])), reactions, balance.elasticity.energy(u))

    def correction(self, u: Floats, fraction: float) -> Floats:
        """(N, 3) one Newton step from displacements (N, 3), contact included; infinite where none can be made."""
        try:
            return self._newton.correction(fraction, u)
        except NoEquilibrium:
            return np.full_like(u, np.inf)

    def penetration(self, u: Floats, fraction: float) -> float:
        """Largest penetration [m] of the obstacle at displacements (N, 3); infinite where they are not all numbers."""
        contact = self.balance.contact
        if contact is None:
            return 0.0
        deepest = -float(contact.gaps(u, contact.obstacle.position(fraction))[0].min())
        return max(0.0, deepest) if np.isfinite(u).all() else float("inf")


def verify(prediction: ArrayLike, reference: ArrayLike, *, scene: Scene | None, mesh: Mesh, free: NDArray[np.bool_],
           one_step: ArrayLike | None = None, sample: int | None = None) -> Fidelity:
    """Hold a predicted trajectory against a reference and against the equations.

    Args:
        prediction, reference: (T, N, 3) displacements of the body [m]
        scene: None where there is none: what needs its equations is not a number then
        free: (N,) True on nodes that are not held
        one_step: (T - 1, N, 3) predictions of frames 1 .. T - 1, each made from the true frame before it
        sample: check the equations at about this many frames, evenly spaced; at all of them by default
    """
    return Reference(np.asarray(reference, np.float64), scene, mesh, free, sample).verify(prediction, one_step)


@dataclass(frozen=True)
class Reference:
    """What predictions of one trajectory are held against; what is to be known of it alone is found once.

    displacement (T, N, 3) [m]; scene, free and sample as in `verify`; shapes: judge the deformed mesh at about so many frames too
    """

    displacement: Floats
    scene: Scene | None
    mesh: Mesh
    free: NDArray[np.bool_]
    sample: int | None = None
    shapes: int | None = None

    def verify(self, prediction: ArrayLike, one_step: ArrayLike | None = None) -> Fidelity:
        """See `verify`."""
        u, truth, free = np.asarray(prediction, np.float64), self.displacement, self.free
        first = u[1:2] if one_step is None else np.asarray(one_step, np.float64)
        of_first = truth[1:len(first) + 1]
        if one_step is None and not of_first[:, free].any():  # before anything touches, standing still is no achievement
            of_first = np.full_like(of_first, np.nan)
        error = np.sqrt(np.mean(np.sum((u - truth)[:, free] ** 2, axis=2), axis=1))  # (T,)
        return Fidelity(
            **_errors({"1": (first, of_first), "50": (u[1:51], truth[1:51]), "all": (u[1:], truth[1:])}, free, _space(self.mesh, truth)),
            worst_step=int(np.argmax(error)), **self._of_shape(u), **self._of_equations(u, error))

    def _frames(self, sample: int | None) -> NDArray[np.int64]:
        """At most so many frames, evenly spaced, the rest state not among them."""
        steps = len(self.displacement) - 1
        return np.unique(np.linspace(1, steps, min(steps, sample or steps)).round().astype(int))

    @cached_property
    def _checker(self) -> Checker:
        assert self.scene is not None
        return Checker(self.scene, self.mesh)

    @cached_property
    def _due(self) -> list[Frame]:
        return [self._checker.frame(self.displacement[t], t / (len(self.displacement) - 1)) for t in self._frames(self.sample)]

    @cached_property
    def _stress(self) -> Floats:
        return self._stress_of(self.displacement)

    @cached_property
    def _cells(self) -> tuple[Floats, Floats]:
        positions, cells = self.mesh.points + self.displacement[self._frames(self.shapes)], (self.mesh.cells, self.mesh.cell)
        return quality.mesh_continuity(positions, *cells), quality.aspect_ratio(positions, *cells)

    def _stress_of(self, u: Floats) -> Floats:
        assert self.scene is not None
        return np.array([von_mises(self.mesh, u[t], self.scene.material) for t in self._frames(self.sample)])  # (frames, C)

    def _of_shape(self, u: Floats) -> dict[str, Any]:
        """The figures of the deformed mesh; of a cloth, plane cells that leave their plane, there are fewer."""
        mesh, frames = self.mesh, self._frames(self.shapes)
        predicted, true = mesh.points + u[frames], mesh.points + self.displacement[frames]
        distances = np.array([quality.set_distances(a, b) for a, b in zip(predicted, true, strict=True)])
        cells, found = (mesh.cells, mesh.cell), dict.fromkeys(OF_CELLS, np.nan)
        continuity, ratio = self._cells
        found |= {"mc": float(np.mean(abs(quality.mesh_continuity(predicted, *cells) - continuity))),
                  "ar": float(np.mean(abs(quality.aspect_ratio(predicted, *cells) - ratio)))}
        if mesh.dimension == 3 or not (mesh.points[:, 2].any() or u[..., 2].any()):
            det = quality.det_f(mesh.points, u[frames], *cells)
            found |= {"smallest_det_f": float(det.min()),
                      "smallest_scaled_jacobian": float(quality.scaled_jacobian(predicted, *cells).min()),
                      "inverted_elements": int(np.count_nonzero(~(det > 0), axis=-1).max())}
        return {"gf_h": float(distances[:, 0].mean()), "gf_c": float(distances[:, 1].mean()), **found}

    def _of_equations(self, u: Floats, error: Floats) -> dict[str, Any]:
        """What the equations say of some frames; error (T,) [m]."""
        if self.scene is None:
            return dict.fromkeys(OF_EQUATIONS, np.nan)
        checker, steps, due, frames = self._checker, len(u) - 1, self._due, self._frames(self.sample)
        itself = np.array_equal(u, self.displacement)
        found = due if itself else [checker.frame(u[t], t / steps) for t in frames]
        reaction = max(frame.push for frame in due) or np.nan  # no force, no ratio to it
        energy = max(frame.energy for frame in due) or np.nan
        lacking = np.array([checker.correction(u[t], t / steps)[self.free] for t in frames])
        estimated, missed = _rms(np.linalg.norm(lacking, axis=2)), _rms(error[frames])
        return {
            "relative_residual": _rms([frame.residual for frame in found]) / reaction,
            "energy_error": _rms([a.energy - b.energy for a, b in zip(found, due, strict=True)]) / energy,
            "reaction_error": _rms([np.linalg.norm(a.reactions - b.reactions) for a, b in zip(found, due, strict=True)]) / reaction,
            "stress_error": _rms((self._stress if itself else self._stress_of(u)) - self._stress) / (_rms(self._stress) or np.nan),
            "estimated_error": estimated, "effectivity": estimated / missed if missed else np.nan,
            "largest_penetration": max(checker.penetration(u[t], t / steps) for t in range(1, steps + 1))}


def _errors(steps: dict[str, tuple[Floats, Floats]], free: NDArray[np.bool_], space: int) -> dict[str, Any]:
    """Every kind of root mean square of some steps, by their name: prediction and truth (T, N, 3)."""
    found: dict[str, Any] = {}
    for name, pair in steps.items():
        for where, nodes in (("", free), ("_all_nodes", slice(None))):
            found |= {f"rmsd_{name}{where}": quality.rmsd(*pair, nodes), f"rmse_{name}{where}": quality.rmse(*pair, nodes, space=space),
                      f"rmse_{name}_by_step{where}": quality.rmse(*pair, nodes, by_step=True, space=space)}
    return found


def _space(mesh: Mesh, truth: Floats) -> int:
    """Along how many axes a body extends or moves: 2 for one in a plane, 3 for a cloth."""
    return max(1, int(np.count_nonzero((np.ptp(mesh.points, axis=0) > 0) | truth.any(axis=(0, 1)))))


def _rms(values: ArrayLike) -> float:
    """Root mean square; infinite where something is not a number, as beyond a cell turned inside out."""
    value = float(np.sqrt(np.mean(np.square(values))))
    return value if np.isfinite(value) else float("inf")


def as_table(fidelity: Fidelity) -> dict[str, Any]:
    """The figures as plain numbers under the names of the command line."""
    return dict(vars(fidelity))
