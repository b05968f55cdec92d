"""Whether the trajectories of a data set still satisfy what they say: layout, checksum, motion, and their own equations.

Equilibrium is computed anew at sampled frames: the internal forces f(u) are assembled from the stored displacements, and
contact forces p >= 0 are sought that balance them (physics/fidelity/verify.py). What is left, |R|, is held against

    |R| <= TOLERANCE |reaction| + ROUNDING max_k |f(u + d_k) - f(u)|

The first term is what the solver was asked for. The second is what storing u costs: u is known to half a unit in its last
place (single precision: 2^-24 |u| a component, 2^-12 of that where the file keeps the remainder, or the tolerance of a packed
set, in metres), and the d_k are that large with random signs. Rounding errors are uniform between these limits, so |K d| of the
true ones is 1/sqrt(3) of that of the d_k on average; ROUNDING = 2 leaves 3.5 times the expected size. The stored reaction,
energy and stress must agree with the ones computed anew within the change that the same d_k make in them.

Legend: T frames, N nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from datagen.family.family import SPLITS
from datagen.files import layout
from datagen.files.fields import Stress
from datagen.files.inputs import centres, numbered
from datagen.files.layout import HALF_ULP
from datagen.files.places import remarks_on_file
from datagen.files.solved import as_solved, solved_on
from datagen.files.trajectory import OBSTACLE, Trajectory, problems, read_trajectory
from datagen.flow.check import against_flow
from datagen.sets.dataset import digest, read_manifest
from datagen.sets.workers import progress
from physics.body.schedule import Moves
from physics.body.supports import held
from physics.contact.conditions import cell_size
from physics.contact.obstacles import Rigid
from physics.equilibrium.newton import TOLERANCE
from physics.fem import release
from physics.fidelity.verify import Checker
from physics.mesh.mesh import Mesh
from physics.mesh.quality import smallest_det_f
from physics.scene import FlowScene, Scene, scene_of
from physics.schema import InputError

PENETRATION = 1e-3  # largest one that passes, over the smallest side of the body
GIVES = 0.05  # of a cell, by which a smooth surface may give way (physics/contact/conditions.py)
ROUNDING = 2.0


def check(folder: str | Path, *, steps: int = 5, remark: Callable[[str], None] = lambda text: None) -> list[str]:
    """What is wrong with a data set, a line each, the file's name first; empty when nothing is.

    Every file is held against its checksum and against its own scene: the mesh, the motion of supports and obstacle, det F,
    penetration, and, unless it has inertia, the equilibrium of some of its steps. A set without scenes (imported) is checked as data alone.

    Args:
        steps: of each trajectory whose equilibrium is computed anew, evenly spaced, the last one among them
        remark: takes what is odd but not wrong: a line for each mesh file that is not there as it was

    Raises:
        InputError: the folder has no manifest
    """
    folder, manifest = Path(folder), read_manifest(folder)
    found, remarks = [], dict[str, None]()
    for entry in progress(manifest.trajectories, "checking"):
        try:
            trajectory = read_trajectory(folder / entry.file)
            wrong = problems(trajectory)
            remarks |= dict.fromkeys(remarks_on_file(trajectory.extra))
            if not wrong and trajectory.scene:
                wrong = against_scene(trajectory, steps=steps)
        except InputError as error:
            text = str(error)
            found.append(text if text.startswith(str(folder)) else f"{folder / entry.file}: {text}")
            continue
        if digest(trajectory) != entry.sha256:
            wrong = [*wrong, "the arrays are not those that were written: their checksum differs from the manifest's"]
        found += [f"{folder / entry.file}: {line}" for line in wrong]
    for text in remarks:
        remark(text)
    listed = {folder / entry.file for entry in manifest.trajectories}
    there = {path for split in SPLITS for path in Path(folder, split).glob("*.vtkhdf")}
    return found + [f"{path}: not in the manifest" for path in sorted(there - listed)]


def unfit(trajectory: Trajectory) -> list[str]:
    """Why a solved trajectory is none for a data set, a line each: by what its solver says of its frames."""
    zero, frames = np.zeros(1), trajectory.per_frame
    snaps = np.flatnonzero(frames.get("snap", zero))
    inverted = np.flatnonzero(~(frames.get("smallest_det_f", np.ones(1)) > 0))
    deep = np.flatnonzero(frames.get("penetration", zero) > deepest_allowed(
        scene_of(trajectory.scene) if trajectory.scene else None, trajectory.mesh))
    return ([f"the body snaps at step {snaps[0]}"] if len(snaps) else []) + (
        [f"a cell turns inside out at step {inverted[0]}"] if len(inverted) else []) + (
        [f"the obstacle penetrates too far at step {deep[0]}"] if len(deep) else []) + (
        [folds] if (folds := trajectory.extra.get("model", {}).get("folds")) else [])


def deepest_allowed(scene: Scene | FlowScene | None, mesh: Mesh) -> float:
    """[m] how far an obstacle may penetrate."""
    smooth = isinstance(scene, Scene) and any(obstacle.contact == "smooth" for obstacle in scene.obstacles)
    return max(PENETRATION * float(mesh.extent.min()), GIVES * cell_size(mesh) * smooth)


def precision(trajectory: Trajectory) -> NDArray[np.float64]:
    """(T, N, 3) [m] how far each stored displacement may be from what the solver found."""
    rounding = layout.precision(trajectory.displacement, trajectory.remainder)
    return np.maximum(rounding, float(trajectory.extra.get("tolerance", 0.0)))


def against_scene(trajectory: Trajectory, *, steps: int = 5) -> list[str]:
    """What contradicts the scene that a trajectory is said to be of, a line each. Raises `InputError` for a bad scene."""
    scene = scene_of(trajectory.scene)
    if isinstance(scene, FlowScene):
        return against_flow(trajectory, scene, steps=steps)
    mesh, frames = solved_on(scene, trajectory), len(trajectory.displacement)
    nodes = len(mesh.points)
    if frames != scene.steps.count + 1:
        return [f"{frames} frames for {scene.steps.count} steps"]
    if not np.array_equal(trajectory.points[trajectory.body], mesh.points):
        return ["the body's nodes are not those of its scene"]
    if not np.array_equal(trajectory.connectivity[:mesh.cells.size], mesh.cells.ravel()):
        return ["the body's cells are not those of its scene"]
    # Four times the rounding of single precision, or what packing may have changed.
    rounding = max(4.8e-7 * max(float(abs(trajectory.displacement).max()), 1e-9), float(trajectory.extra.get("tolerance", 0.0)))
    body = trajectory.exact[:, :nodes]
    fixed, found = held(scene, mesh), []

    moves = Moves(scene, mesh)
    due = np.array([moves.at(t / scene.steps.count) for t in range(frames)])
    off = abs(body - due)[:, fixed].max(initial=0.0)
    if off > rounding:
        found.append(f"held nodes leave their prescription by {off:.2g} m")
    det = smallest_det_f(mesh.points, body, mesh.cells, mesh.cell)
    if not det.min() > 0:
        found.append(f"det F = {det.min():.2g} at step {det.argmin()}: a cell is inverted")
    if scene.obstacles:
        found += _against_obstacles(trajectory, scene, mesh, fixed, rounding)
    return found or ([] if scene.steps.dynamic else _against_equilibrium(trajectory, scene, mesh, steps))


def _against_obstacles(trajectory: Trajectory, scene: Scene, mesh: Mesh, fixed: NDArray[np.bool_], rounding: float) -> list[str]:
    """What contradicts the motion of the obstacles and their hardness."""
    found, way = [], centres(scene, scene.steps.count + 1)  # (T, K, 3)
    loose = np.flatnonzero(~fixed.all(axis=1))
    body = mesh.points[loose] + trajectory.displacement[:, loose].astype(np.float64)
    limit, each = deepest_allowed(scene, mesh), [Rigid(obstacle) for obstacle in scene.obstacles]
    around = [rigid.surface_mesh(mesh.points, size=cell_size(mesh), plane=mesh.dimension == 2)[0] for rigid in each[:-1]]
    ends = np.cumsum([len(points) for points in around], dtype=np.int64)
    moved = np.split(trajectory.displacement[:, trajectory.node_kind == OBSTACLE], ends, axis=1)
    for k, rigid in enumerate(each):
        name = "the obstacle" if len(each) == 1 else f"obstacle {k + 1}"
        off = abs(moved[k] - (way[:, k] - way[0, k])[:, None]).max(initial=0.0)
        if off > rounding:
            found.append(f"{name} leaves its path by {off:.2g} m")
        deepest = np.array([-rigid.gap(x, centre)[0].min() for x, centre in zip(body, way[:, k], strict=True)])
        deepest = np.maximum(deepest, trajectory.per_frame.get("penetration", 0.0))
        if deepest.max() > limit:
            found.append(f"{name} penetrates {deepest.max():.2g} m at step {deepest.argmax()}; {limit:.2g} m is allowed")
    return found


def _against_equilibrium(trajectory: Trajectory, scene: Scene, mesh: Mesh, steps: int) -> list[str]:
    """What contradicts equilibrium, and the stored reaction and energy, at some frames."""
    count, nodes = scene.steps.count, len(mesh.points)
    release()
    checkers: dict[Scene, Checker] = {}
    fields = [trajectory.fields[name] for name in ("stress", "von_mises") if name in trajectory.fields]
    stresses, held_stress = (Stress(mesh, scene.material), np.concatenate(fields, axis=2)[:, :nodes]) if len(fields) == 2 else (None, None)
    blur, path, random = precision(trajectory)[:, :nodes], trajectory.exact[:, :nodes], np.random.default_rng(0)
    for t in np.unique(np.linspace(count / steps, count, steps).round().astype(int)):
        solved = as_solved(scene, trajectory, t)
        checker = checkers[solved] = checkers.get(solved) or Checker(solved, mesh)
        balance = checker.balance
        elasticity, fixed = balance.elasticity, balance.fixed
        u = path[t]
        found, force = checker.frame(u, t / count), elasticity.force(u)
        lost = lost_energy = lost_reaction = lost_stress = 0.0
        stress = np.zeros((nodes, 7)) if stresses is None else stresses.at(u, solved.material)
        for _ in range(3):
            near = np.where(fixed, u, u + blur[t] * random.choice((-1.0, 1.0), u.shape))
            other = checker.frame(near, t / count)
            lost = max(lost, float(np.linalg.norm(elasticity.force(near) - force)))
            lost_energy = max(lost_energy, abs(other.energy - found.energy))
            lost_reaction = max(lost_reaction, float(np.linalg.norm(other.reactions - found.reactions)))
            if stresses is not None:
                lost_stress = max(lost_stress, float(abs(stresses.at(near, solved.material) - stress).max()))
        # The solver stops at its floor where rounding in f itself takes over.
        scale = max(found.push, float(np.linalg.norm(force[fixed])))
        allowed = max(TOLERANCE * scale, balance.floor) + ROUNDING * lost
        if not found.residual <= allowed:
            return [f"no equilibrium at step {t}: |R| = {found.residual:.2g} N, where rounding allows {allowed:.2g} N"]
        # To first order energy changes by f . d, whose sign may cancel in the sample: add its size were it aligned at random.
        lost_energy += float(np.linalg.norm(force * blur[t]))
        stored = trajectory.per_frame.get("energy")
        room = 1e-9 * abs(found.energy) + balance.floor * balance.size + ROUNDING * lost_energy
        if stored is not None and not abs(stored[t] - found.energy) <= room:
            return [f"energy {stored[t]:.6g} J at step {t}, computed anew {found.energy:.6g} J"]
        for name, (anew,) in (numbered("reaction", found.reactions[None]) | {"reaction": found.reaction[None]}).items():
            stored = trajectory.per_frame.get(name)
            # What the solver left over may be missing in the sum as well.
            if stored is not None and not np.linalg.norm(stored[t] - anew) <= allowed + ROUNDING * lost_reaction:
                return [f"{name} {np.round(stored[t], 6).tolist()} N at step {t}, computed anew {np.round(anew, 6).tolist()} N"]
        if held_stress is not None:
            off = float(abs(held_stress[t] - stress).max())
            if not off <= 2 * HALF_ULP * float(abs(stress).max()) + ROUNDING * lost_stress:
                return [f"stress at step {t} is off by {off:.2g} Pa from that of its displacements"]
    return []
