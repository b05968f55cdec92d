"""A data set in one small file, with a bound on the error of every displacement.

The motion of a body has low rank: all T frames of n moving nodes are sums of few shapes, X (T, 3n) = A V + error. The
shapes V are the leading right singular vectors of X, each scaled by its largest share in any frame, so that an error in V
counts the same in all of them: V is rounded to multiples of one step, then A is fitted again to the rounded V by least
squares and rounded in turn. Rank and step are the coarsest that keep

    |u_packed - u| <= tolerance [m]   for the displacement vector of every node in every frame,

which is verified on the unpacked arrays before a trajectory is written. Where nothing coarser than single precision would
do, displacements are kept as they are. Nodes that never move stay exactly at rest and obstacles that move as one body
keep their exact path; modes are kept to 1e-6 of their largest entry, numbers of each frame in single precision, and all
else exactly. The velocity and the pressure of a flow are packed as displacements are, to a share of their largest value in
the median frame: at an impulsive start the pressure is many times what it is later.

The file is a ZIP archive: manifest.json (the set's manifest, with the tolerance) and for each trajectory a member
split/0000, compressed by LZMA: the length of a JSON header (8 bytes, little-endian), the header, and the arrays that
it lists, each as its first bytes, then its second bytes, and so on. Legend: T frames, N nodes, n moving nodes, r rank.
"""

from __future__ import annotations

import json
import lzma
import math
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.files.layout import misshapen
from datagen.files.trajectory import OBSTACLE, Trajectory, problems, read_trajectory, write_trajectory
from datagen.sets import dataset
from datagen.sets.workers import progress
from physics.mesh.cell import OF_VTK
from physics.schema import InputError, read_table, to_table
from physics.whole import folder_whole, written_whole

Arrays = dict[str, NDArray[Any]]
SCHEMA = 1
MODE_STEP = 1e-6
TOLERANCE, SHARE = 1e-6, 1e-3  # where none is given
HEADER = ("frequencies_hz", "scene", "seed", "index", "versions", "commit", "complete", "extra")
FLOW = ("velocity", "pressure")
AS_IT_IS = ("points", "types", "node_kind")


def pack(folder: str | Path, out: str | Path, *, tolerance: float | None = None, share: float | None = None) -> dict[str, Any]:
    """Pack a data set.

    Args:
        tolerance: largest error of any node's displacement in any frame [m]; TOLERANCE when left out
        share: of flows the same of velocity and pressure, over their largest value in the median frame; SHARE when left out

    Returns:
        the numbers of trajectories and bytes, how many times smaller that is, the largest error [m], and of flows the largest share

    Raises:
        InputError: the folder is no data set, the tolerance no length, the share none, or what was given is not of such a set
        RuntimeError: a file is not what the manifest says
        OSError: the file cannot be written
    """
    if tolerance is not None and not (math.isfinite(tolerance) and tolerance > 0):
        raise InputError(f"tolerance = {tolerance}: must be above 0 m")
    if share is not None and not 0 < share < 1:
        raise InputError(f"share = {share}: must be above 0 and below 1")
    folder, out = Path(folder), Path(out)
    manifest = dataset.read_manifest(folder)
    _check_kind(folder, manifest, tolerance, share)
    tolerance, share = tolerance or TOLERANCE, share or SHARE
    before, error, of_flows = 0, 0.0, 0.0
    with written_whole(out) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_LZMA) as archive:
        about = {"schema": SCHEMA, "tolerance": tolerance, "manifest": to_table(manifest)}
        archive.writestr("manifest.json", json.dumps(about))
        for entry in progress(manifest.trajectories, "packing"):
            trajectory = read_trajectory(folder / entry.file)
            if dataset.digest(trajectory) != entry.sha256:
                raise RuntimeError(f"{folder / entry.file}: its checksum differs from the manifest's; make it anew before packing")
            blob, off = encode(trajectory, tolerance, share)
            archive.writestr(entry.file.removesuffix(".vtkhdf"), blob)
            before, error = before + (folder / entry.file).stat().st_size, max(error, off)
            of_flows = max(of_flows, _share(decode(blob), trajectory) if trajectory.flows else 0.0)
    size = out.stat().st_size
    return {"trajectories": len(manifest.trajectories), "bytes": size, "ratio": before / size, "largest_error": error,
            "tolerance": tolerance} | ({"largest_share": of_flows, "share": share} if of_flows else {})


def _check_kind(folder: Path, manifest: dataset.Manifest, tolerance: float | None, share: float | None) -> None:
    """Refuse a bound of what a set has not: of displacements in one of flows, of velocity and pressure in one of solids."""
    if not manifest.trajectories or (tolerance is None and share is None):
        return
    if read_trajectory(folder / manifest.trajectories[0].file).flows:
        if tolerance is not None:
            raise InputError(f"tolerance = {tolerance}: {folder} is of flows, which nothing displaces; share bounds velocity and pressure")
    elif share is not None:
        raise InputError(f"share = {share}: {folder} is of solids; tolerance bounds their displacements")


def unpack(file: str | Path, out: str | Path) -> dict[str, Any]:
    """Write the trajectory files and the manifest of a packed set into a folder that holds none.

    Raises:
        InputError: the file is no packed set, or damaged; or the folder holds a set already
        OSError: the folder cannot be written
    """
    file, out = Path(file), Path(out)
    if (out / "manifest.json").exists():
        raise InputError(f"{out} holds a data set already; choose another folder")
    try:
        with zipfile.ZipFile(file) as archive, folder_whole(out) as part:
            about = json.loads(archive.read("manifest.json"))
            if about.get("schema") != SCHEMA:
                raise InputError(f"{file}: packed schema {about.get('schema')}, this program reads {SCHEMA}")
            manifest, entries = read_table(dataset.Manifest, about["manifest"]), []
            for entry in progress(manifest.trajectories, "unpacking"):
                trajectory = decode(archive.read(entry.file.removesuffix(".vtkhdf")))
                if wrong := misshapen(trajectory) or "".join(problems(trajectory)[:1]):
                    raise InputError(f"{file}: {entry.file}: {wrong}")
                write_trajectory(_inside(part, entry.file), trajectory)
                entries.append(replace(entry, sha256=dataset.digest(trajectory)))
            dataset.write_manifest(part, replace(manifest, trajectories=tuple(entries)))
    except FileNotFoundError:
        raise InputError(f"{file}: no such file") from None
    except (zipfile.BadZipFile, lzma.LZMAError, KeyError, ValueError, TypeError, IndexError, AttributeError, EOFError, OverflowError,
            RuntimeError, NotImplementedError, OSError) as error:
        # A damaged place in the archive is an OSError without a file's name; with one it is a folder that cannot be written.
        if isinstance(error, InputError) or getattr(error, "filename", None):
            raise
        raise InputError(f"{file}: not a whole packed data set: {error}") from None
    return {"trajectories": len(entries), "tolerance": about["tolerance"]}


def _inside(folder: Path, name: str) -> Path:
    """The place of a file in a folder. Raises `InputError` for one that would lie elsewhere."""
    if not (folder / name).resolve().is_relative_to(folder.resolve()):
        raise InputError(f"its manifest names {name!r}, which is no file of a data set")
    return folder / name


def encode(trajectory: Trajectory, tolerance: float, share: float = 1e-3) -> tuple[bytes, float]:
    """A packed trajectory, verified, and the largest error of its displacements [m]."""
    moving, rigid = _moving(trajectory)
    arrays: Arrays = {name: getattr(trajectory, name) for name in AS_IT_IS}
    arrays["connectivity"] = np.diff(trajectory.connectivity, prepend=0).astype(np.int32)
    arrays["modes"] = np.round(trajectory.modes.astype(np.float64) / MODE_STEP).astype(np.int32)
    arrays |= {f"frame {name}": array.astype(np.float32 if array.dtype.kind == "f" else array.dtype)
               for name, array in trajectory.per_frame.items()}
    header = {name: getattr(trajectory, name) for name in HEADER}
    header["extra"] = {**trajectory.extra, "tolerance": max(tolerance, trajectory.extra.get("tolerance", 0.0))}
    header["frames"] = len(trajectory.displacement)
    known = trajectory.extra.get("field_tolerance", {})
    header["field_steps"], allowed = {}, dict(known)
    for name, array in trajectory.fields.items():
        there, limit = array.any(axis=(0, 2)), share * _scale(array)
        found = _squeezed(array[:, there], limit) if name in FLOW and trajectory.flows and limit else None
        if found is None:
            arrays[f"field {name}"] = array
        else:
            arrays |= {f"there {name}": there, f"shapes {name}": found[0], f"shares {name}": found[1]}
            header["field_steps"][name], allowed[name] = found[2:], max(limit, known.get(name, 0.0))
    if allowed:
        header["extra"]["field_tolerance"] = allowed
    if trajectory.segment is not None:
        arrays["segment"] = trajectory.segment
    for number, place in enumerate((trajectory.places or {}).values()):
        arrays |= {f"place {number} {kind}": array for kind, array in place.items()}
    if trajectory.places is not None:
        header["places"] = list(trajectory.places)
    if rigid:
        arrays["path"] = trajectory.displacement[:, trajectory.node_kind == OBSTACLE][:, 0]
    arrays["moving"] = moving
    motion = trajectory.displacement[:, moving]
    found = _squeezed(motion, tolerance)
    if found is None:
        arrays["motion"] = motion
    else:
        arrays["shapes"], arrays["shares"], header["step"], header["share_steps"] = found
    blob = _bytes(header, arrays)
    error = _error(decode(blob).displacement, trajectory.displacement)
    assert error <= (0.0 if found is None else tolerance)
    return blob, error


def decode(blob: bytes) -> Trajectory:
    """The trajectory of `encode`. Raises ValueError or KeyError when it is damaged."""
    header, arrays = _arrays(blob)
    kinds, moving, frames = arrays["node_kind"], arrays["moving"], header.pop("frames")
    displacement = np.zeros((frames, len(kinds), 3), np.float32)
    if "path" in arrays:
        displacement[:, kinds == OBSTACLE] = arrays["path"][:, None]
    steps = header.pop("step", None), header.pop("share_steps", None)  # none where the motion is kept as it is
    displacement[:, moving] = arrays["motion"] if "motion" in arrays else _motion(arrays["shapes"], arrays["shares"], *steps)
    for name, how in header.pop("field_steps", {}).items():
        there, shapes = arrays[f"there {name}"], arrays[f"shapes {name}"]
        arrays[f"field {name}"] = np.zeros((frames, len(kinds), shapes.shape[2]), np.float32)
        arrays[f"field {name}"][:, there] = _motion(shapes, arrays[f"shares {name}"], *how)
    ends = np.cumsum([OF_VTK[int(kind)].nodes for kind in arrays["types"]])
    header["frequencies_hz"] = tuple(header["frequencies_hz"])
    names = header.pop("places", None)

    def named(prefix: str) -> Arrays:
        return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}

    places = None if names is None else {name: named(f"place {number} ") for number, name in enumerate(names)}
    per_frame = {name: array.astype(np.float64 if array.dtype.kind == "f" else array.dtype) for name, array in named("frame ").items()}
    return Trajectory(
        points=arrays["points"], types=arrays["types"], node_kind=kinds, connectivity=np.cumsum(arrays["connectivity"], dtype=np.int64),
        offsets=np.concatenate([[0], ends]).astype(np.int64), displacement=displacement, segment=arrays.get("segment"),
        modes=(arrays["modes"] * MODE_STEP).astype(np.float32), per_frame=per_frame, fields=named("field "),
        places=places, **header)


def _moving(trajectory: Trajectory) -> tuple[NDArray[np.bool_], bool]:
    """(N,) nodes whose motion has to be stored one by one, and whether the obstacle moves as one."""
    moving = trajectory.displacement.any(axis=(0, 2))
    obstacle = trajectory.node_kind == OBSTACLE
    of_obstacle = trajectory.displacement[:, obstacle]
    rigid = bool(obstacle.any() and (of_obstacle == of_obstacle[:, :1]).all())
    return moving & ~obstacle if rigid else moving, rigid


def _scale(field: NDArray[np.float32]) -> float:
    """The largest length of a field's vectors (T, N, k) in the median frame."""
    return float(np.median(np.linalg.norm(field.astype(np.float64), axis=2).max(axis=1)))


def _share(made: Trajectory, true: Trajectory) -> float:
    """The largest error of the velocity and pressure of a flow, as a share of `_scale`."""
    return max(_error(made.fields[name], true.fields[name]) / (_scale(true.fields[name]) or 1.0)
               for name in FLOW if name in true.fields)


def _squeezed(motion: NDArray[np.float32], tolerance: float) -> tuple[NDArray[np.int32], NDArray[np.int64], float, list[float]] | None:
    """The coarsest shapes and shares of `_low_rank` that keep to a tolerance; None where there are none."""
    return next((found for found in _low_rank(motion, tolerance) if _error(_motion(*found), motion) <= tolerance), None)


def _low_rank(motion: NDArray[np.float32], tolerance: float) -> Any:
    """Ever finer shapes (r, n, k) and shares (T, r), as integers, with the step of each; ends where it is no use."""
    frames, nodes, width = motion.shape
    x = motion.reshape(frames, width * nodes).astype(np.float64)
    left, size, right = np.linalg.svd(x, full_matrices=False)
    left_over = np.sqrt(np.cumsum(size[::-1] ** 2)[::-1] / max(1, frames * nodes))  # at each rank the root of the mean square
    rank = int(np.searchsorted(-left_over, -0.5 * tolerance))  # and no smaller rank can do
    rest = x - (left[:, :rank] * size[:rank]) @ right[:rank]
    while rank < len(size) and _error(rest.reshape(motion.shape), np.float64(0)) > 0.5 * tolerance:
        rest -= np.outer(left[:, rank] * size[rank], right[rank])
        rank += 1
    largest = abs(left[:, :rank]).max(axis=0, initial=0)  # every singular vector has an entry above 0
    shapes = right[:rank] * (size[:rank] * largest)[:, None]  # [m]
    step = 3 * tolerance / math.sqrt(max(1, rank))
    while rank < len(size) and step > 1e-3 * tolerance and abs(shapes).max(initial=0) / step < 2**31:
        rounded = np.round(shapes / step)
        shares = np.linalg.lstsq((rounded * step).T, x.T, rcond=None)[0].T if rank else np.zeros((frames, 0))
        share_steps = [2.0 ** math.floor(math.log2(0.1 * step / max(1e-300, float(row.max())))) for row in abs(rounded * step)]
        whole = np.round(shares / np.array(share_steps).reshape(1, rank))
        if abs(whole).max(initial=0) < 2**31:
            changes = np.diff(whole, axis=0, prepend=0).astype(np.int64)
            yield rounded.reshape(rank, nodes, width).astype(np.int32), changes, step, share_steps
        step *= 0.85


def _motion(shapes: NDArray[Any], shares: NDArray[Any], step: float, share_steps: Sequence[float]) -> NDArray[np.float32]:
    """(T, n, k) displacements of what `_low_rank` gives; frames at rest are exactly so."""
    shares = np.cumsum(shares, axis=0)
    motion = (shares * np.array(share_steps)) @ (shapes.reshape(len(shapes), math.prod(shapes.shape[1:])) * step)  # of rank 0 too
    return motion.reshape(len(shares), *shapes.shape[1:]).astype(np.float32)


def _error(packed: NDArray[Any], true: NDArray[Any] | np.float64) -> float:
    """Largest length of a node's error over all frames (T, n, k)."""
    off = packed.astype(np.float64) - true
    return float(np.sqrt(np.einsum("tnk,tnk->tn", off, off).max(initial=0.0)))


def _bytes(header: dict[str, Any], arrays: Arrays) -> bytes:
    listed = {name: [array.dtype.str, array.shape] for name, array in arrays.items()}
    text = json.dumps({**header, "arrays": listed}).encode()
    planes = [np.ascontiguousarray(a).reshape(-1).view(np.uint8).reshape(a.size, -1).T.tobytes() for a in arrays.values() if a.size]
    return len(text).to_bytes(8, "little") + text + b"".join(planes)


def _arrays(blob: bytes) -> tuple[dict[str, Any], Arrays]:
    start = 8 + int.from_bytes(blob[:8], "little")
    header = json.loads(blob[8:start])
    arrays: Arrays = {}
    for name, (kind, shape) in header.pop("arrays").items():
        dtype, count = np.dtype(kind), math.prod(shape)
        planes = np.frombuffer(blob, np.uint8, count * dtype.itemsize, start).reshape(dtype.itemsize, count)
        arrays[name] = np.ascontiguousarray(planes.T).reshape(-1).view(dtype).reshape(shape)
        start += count * dtype.itemsize
    return header, arrays
