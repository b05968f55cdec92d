"""A folder of trajectories, and whether each of them still satisfies what it says.

    DIR/train/0000.vtkhdf ...   the format of trajectory.py; valid/ and test/ likewise
    DIR/manifest.json           family, seed, and an entry for each file with a checksum of its arrays (see `Manifest`)

Legend: T frames, N nodes.
"""

from __future__ import annotations

import hashlib
import json
import os
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from datagen.family import SPLITS
from datagen.trajectory import OBSTACLE, Trajectory, problems, read_trajectory
from physics.mesh import Mesh, build_mesh
from physics.obstacle import Rigid
from physics.quality import smallest_det_f
from physics.scene import Scene, read_scene
from physics.schema import InputError, nearest, read_table, to_table
from physics.supports import held, prescribed

SCHEMA = 1
PENETRATION = 1e-3  # largest one that passes, over the smallest side of the body


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One file of a data set."""

    file: str  # relative to the folder
    split: str
    index: int  # with the seed it determines the scene
    failed_attempts: tuple[str, ...]  # why earlier draws at this index were given up
    nodes: int
    cells: int
    steps: int
    seconds: float  # of the solver
    sha256: str  # of the arrays, see `digest`


@dataclass(frozen=True, kw_only=True)
class Manifest:
    """What a folder holds and where it comes from."""

    schema: int
    family: str  # TOML
    seed: int
    trajectories: tuple[Entry, ...]

    @property
    def recipe(self) -> tuple[dict[str, Any], int]:
        """What determines the scenes: the family but for the sizes of its splits, and the seed."""
        return {key: value for key, value in tomllib.loads(self.family).items() if key != "splits"}, self.seed


def file_name(split: str, number: int) -> str:
    """The place of a trajectory in its folder."""
    return f"{split}/{number:04d}.vtkhdf"


def files(folder: str | Path, split: str) -> list[Path]:
    """The trajectory files of one split, in order. Raises `InputError` when there are none."""
    if split not in SPLITS:
        raise InputError(f"split = {split!r}: must be one of {', '.join(SPLITS)}{nearest(split, SPLITS)}")
    found = sorted(Path(folder, split).glob("[0-9]*.vtkhdf"))
    if not found:
        raise InputError(f"{Path(folder, split)}: no trajectory files")
    return found


def read_manifest(folder: str | Path) -> Manifest:
    """The manifest of a folder. Raises `InputError` when there is none, or none that this program reads."""
    path = Path(folder, "manifest.json")
    try:
        return read_table(Manifest, json.loads(path.read_text()))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    except ValueError as error:
        raise InputError(f"{path}: not a manifest: {error}") from None


def write_manifest(folder: str | Path, manifest: Manifest) -> None:
    """Write a whole manifest, or none. Raises OSError."""
    path = Path(folder, "manifest.json")
    part = path.with_name(f".manifest.json.{os.getpid()}.part")
    try:
        part.write_text(json.dumps(to_table(manifest), indent=1))
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def entry_of(file: str, trajectory: Trajectory) -> Entry:
    """What a manifest says about a trajectory."""
    return Entry(file=file, split=file.split("/")[0], index=trajectory.index,
                 failed_attempts=tuple(trajectory.extra.get("failed_attempts", ())), nodes=len(trajectory.points),
                 cells=len(trajectory.types), steps=len(trajectory.displacement) - 1,
                 seconds=float(trajectory.extra.get("seconds", 0.0)), sha256=digest(trajectory))


def digest(trajectory: Trajectory) -> str:
    """SHA-256 over the mesh and every result; segments, timings and versions play no part."""
    arrays = {name: getattr(trajectory, name)
              for name in ("points", "connectivity", "offsets", "types", "node_kind", "displacement", "modes")}
    arrays |= {"frequencies_hz": np.array(trajectory.frequencies_hz)} | dict(sorted(trajectory.per_frame.items()))
    digest = hashlib.sha256()
    for name, array in arrays.items():
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def check(folder: str | Path) -> list[str]:
    """What is wrong with a data set, a line each, the file's name first; empty when nothing is.

    Every file is held against its checksum and against its own scene: the mesh, the motion of supports and obstacle, det F
    and penetration. Raises `InputError` when the folder has no manifest.
    """
    folder, manifest = Path(folder), read_manifest(folder)
    found = []
    for entry in manifest.trajectories:
        try:
            trajectory = read_trajectory(folder / entry.file)
            wrong = problems(trajectory) or against_scene(trajectory)
        except InputError as error:
            found.append(str(error))
            continue
        if digest(trajectory) != entry.sha256:
            wrong = [*wrong, "the arrays are not those that were written: their checksum differs from the manifest's"]
        found += [f"{folder / entry.file}: {line}" for line in wrong]
    listed = {folder / entry.file for entry in manifest.trajectories}
    there = {path for split in SPLITS for path in Path(folder, split).glob("*.vtkhdf")}
    return found + [f"{path}: not in the manifest" for path in sorted(there - listed)]


def against_scene(trajectory: Trajectory) -> list[str]:
    """What contradicts the scene that a trajectory is said to be of, a line each. Raises `InputError` for a bad scene."""
    try:
        scene = read_scene(tomllib.loads(trajectory.scene))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"its scene is not TOML: {error}") from None
    mesh, frames = build_mesh(scene.body), len(trajectory.displacement)
    nodes = len(mesh.points)
    if frames != scene.steps.count + 1:
        return [f"{frames} frames for {scene.steps.count} steps"]
    if not np.array_equal(trajectory.points[trajectory.body], mesh.points):
        return ["the body's nodes are not those of its scene"]
    if not np.array_equal(trajectory.connectivity[:mesh.cells.size], mesh.cells.ravel()):
        return ["the body's cells are not those of its scene"]
    fraction = np.arange(frames)[:, None, None] / scene.steps.count
    # The file holds displacements in single precision: four times its rounding.
    rounding = 4.8e-7 * max(float(abs(trajectory.displacement).max()), 1e-9)
    body = trajectory.displacement[:, :nodes].astype(np.float64)
    fixed, found = held(scene, mesh), []

    off = abs(body - fraction * prescribed(scene, mesh))[:, fixed].max(initial=0.0)
    if off > rounding:
        found.append(f"held nodes leave their prescription by {off:.2g} m")
    det = smallest_det_f(mesh.points, body, mesh.cells, mesh.cell)
    if not det.min() > 0:
        found.append(f"det F = {det.min():.2g} at step {det.argmin()}: a cell is inverted")
    return found + (_against_obstacle(trajectory, scene, mesh, fixed, rounding) if scene.obstacle is not None else [])


def _against_obstacle(trajectory: Trajectory, scene: Scene, mesh: Mesh, fixed: Any, rounding: float) -> list[str]:
    """What contradicts the obstacle's motion and its hardness."""
    assert scene.obstacle is not None
    rigid, steps, found = Rigid(scene.obstacle), scene.steps.count, []
    way = np.array([rigid.position(step / steps) for step in range(steps + 1)])  # (T, 3)
    moved = trajectory.displacement[:, trajectory.node_kind == OBSTACLE]
    off = abs(moved - (way - way[0])[:, None]).max(initial=0.0)
    if off > rounding:
        found.append(f"the obstacle leaves its path by {off:.2g} m")
    loose = np.flatnonzero(~fixed.all(axis=1))
    body = mesh.points[loose] + trajectory.displacement[:, loose].astype(np.float64)
    deepest = np.array([-rigid.gap(x, centre)[0].min() for x, centre in zip(body, way, strict=True)])
    deepest = np.maximum(deepest, trajectory.per_frame.get("penetration", 0.0))
    limit = PENETRATION * min(scene.body.extent)
    if deepest.max() > limit:
        found.append(f"the obstacle penetrates {deepest.max():.2g} m at step {deepest.argmax()}; {limit:.2g} m is allowed")
    return found
