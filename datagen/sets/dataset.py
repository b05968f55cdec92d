"""A folder of trajectories and its manifest.

    DIR/train/0000.vtkhdf ...   the format of trajectory.py; valid/ and test/ likewise
    DIR/manifest.json           family, seed, and an entry for each file with a checksum of its arrays (see `Manifest`)
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from datagen.family.family import SPLITS
from datagen.files.trajectory import Trajectory
from physics.schema import InputError, nearest, read_table, to_table
from physics.whole import write_whole

SCHEMA = 1


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
    promised: bool | None = None  # whether it has the error that its scene asked for; None where it asked for none


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
    found = _there(folder, split)
    if not found:
        raise InputError(f"{Path(folder, split)}: no trajectory files")
    return found


def splits(folder: str | Path) -> list[str]:
    """The splits of which a folder has files, in the order of SPLITS."""
    return [split for split in SPLITS if _there(folder, split)]


def _there(folder: str | Path, split: str) -> list[Path]:
    return sorted(Path(folder, split).glob("[0-9]*.vtkhdf"))


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
    write_whole(Path(folder, "manifest.json"), json.dumps(to_table(manifest), indent=1).encode())


def entry_of(file: str, trajectory: Trajectory) -> Entry:
    """What a manifest says about a trajectory."""
    return Entry(file=file, split=file.split("/")[0], index=trajectory.index,
                 failed_attempts=tuple(trajectory.extra.get("failed_attempts", ())), nodes=len(trajectory.points),
                 cells=len(trajectory.types), steps=len(trajectory.displacement) - 1,
                 seconds=float(trajectory.extra.get("seconds", 0.0)), sha256=digest(trajectory),
                 promised=trajectory.extra.get("accuracy", {}).get("reached"))


def digest(trajectory: Trajectory) -> str:
    """SHA-256 over the mesh and every result; segments, timings and versions play no part."""
    arrays = {name: getattr(trajectory, name)
              for name in ("points", "connectivity", "offsets", "types", "node_kind", "displacement", "modes")}
    # Where the obstacles are the scene prescribes.
    found = {name: array for name, array in sorted(trajectory.per_frame.items()) if not name.startswith("obstacle")}
    arrays |= {} if trajectory.remainder is None else {"remainder": trajectory.remainder}
    arrays |= {"frequencies_hz": np.array(trajectory.frequencies_hz)} | found | trajectory.fields
    arrays |= {f"place {name} {kind}": array for name, place in sorted((trajectory.places or {}).items())
               for kind, array in sorted(place.items())}
    digest = hashlib.sha256()
    for name, array in arrays.items():
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
