"""Data sets in the format of DeepMind's mesh data (DeformingPlate, CylinderFlow): train, valid and test.tfrecord, meta.json.

meta.json names the fields and their layout; every record of a .tfrecord file (tfrecord.py) is one trajectory and holds the
raw little-endian bytes of each field. "static" fields have one row, "dynamic" ones trajectory_length rows:

    DeformingPlate   cells (1, C, 4) int32, mesh_pos (1, N, 3) float32, node_type (1, N, 1) int32, world_pos (T, N, 3) float32,
                     stress (T, N, 1) float32
    CylinderFlow     cells (1, C, 3), mesh_pos (1, N, 2), node_type (1, N, 1), velocity (T, N, 2), pressure (T, N, 1)

The width of mesh_pos tells what four nodes of a cell are: in a plane a quadrilateral, in space a tetrahedron. A cloth has a mesh_pos of
two components, its own plane, and a world_pos of three.

Reading, nodes of the obstacle are moved to the end and its cells replaced by their outer triangles, which is how our files
have them; mesh_pos becomes Points, world_pos the displacement, and other dynamic fields stay what they are, but for a velocity in the
plane, which gets a third component of zero. Such files have no scene, so their physics cannot be checked.

Writing, prisms are cut into three tetrahedra each, and those of ten nodes into eight, because readers of DeformingPlate take four nodes
of a cell for granted (cells "own" keeps them); the obstacle's triangles go to a field of their own, obstacle_cells (1, F, 3). Positions
are in single precision there: of a body of 0.3 m, to 1.5e-8 m. Their stress is von Mises'; where our files have it
(files/fields.py) it is written under that name, and the tensor as cauchy_stress (T, N, 6). A body in a plane that moves has a mesh_pos
of two components, too, as a cloth. Of a flow the first frame, in which the fluid is at rest, is left out, so 600 steps are 600 rows, as
theirs are; dt is the time between two of them [s].
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.family.family import LARGEST_SPLIT, SPLITS
from datagen.files.tfrecord import parse_example, read_records, write_example, write_records
from datagen.files.trajectory import KINDS, OBSTACLE, Trajectory, problems, read_trajectory, write_trajectory
from datagen.flow.figures import resting
from datagen.sets import dataset
from datagen.sets.workers import progress
from physics.mesh.cell import CELLS, OF_VTK
from physics.mesh.mesh import Mesh
from physics.mesh.quality import cell_volumes
from physics.mesh.second import cut_into_eight
from physics.mesh.shapes.boxes import tetrahedra
from physics.schema import InputError
from physics.whole import folder_whole

Fields = dict[str, NDArray[Any]]
OURS = ("cells", "obstacle_cells", "mesh_pos", "world_pos", "node_type")
KIND_OF = {3: "triangle", 4: "tetrahedron", 6: "prism", 8: "hexahedron"}  # by the nodes of a cell, of bodies in space
IN_A_PLANE = {3: "triangle", 4: "quadrilateral"}  # where mesh_pos has two components
STATIC = ("cells", "obstacle_cells", "mesh_pos", "node_type")


def import_records(folder: str | Path, out: str | Path, *, count: int | None = None) -> dict[str, Any]:
    """Write the trajectories of a folder with meta.json and .tfrecord files as files of ours, with a manifest.

    Args:
        count: at most so many of each split

    Raises:
        InputError: a file is missing, cut short, damaged or not in this format; or the other folder holds a set already
        OSError: the other folder cannot be written
    """
    folder, out, entries = Path(folder), Path(out), []
    if (out / "manifest.json").exists():
        raise InputError(f"{out} holds a data set already; choose another folder")
    meta = _read_meta(folder / "meta.json")
    found = [split for split in SPLITS if (folder / f"{split}.tfrecord").exists()]
    if not found:
        raise InputError(f"{folder}: no train.tfrecord, valid.tfrecord or test.tfrecord")
    dt = meta.get("dt")
    span = float(dt) if isinstance(dt, int | float) and 0 < dt < 1e9 else None
    with folder_whole(out) as part:
        for split in found:
            path = folder / f"{split}.tfrecord"
            for number, record in enumerate(progress(read_records(path), f"reading {path.name}")):
                if number == count:
                    break
                try:
                    trajectory = from_fields(_decoded(record, meta), index=SPLITS.index(split) * LARGEST_SPLIT + number,
                                             source=f"{path.name}, record {number}")
                except InputError as error:
                    raise InputError(f"{path}, record {number}: {error}") from None
                if trajectory.flows and span is not None:
                    trajectory = replace(trajectory, extra={**trajectory.extra, "step_seconds": span})
                file = dataset.file_name(split, number)
                write_trajectory(part / file, trajectory)
                entries.append(dataset.entry_of(file, trajectory))
        name = json.dumps(str(meta.get("simulator", "")) or folder.name)
        manifest = dataset.Manifest(schema=dataset.SCHEMA, family=f"# Imported from {folder.name}\nname = {name}\n", seed=0,
                                    trajectories=tuple(entries))
        dataset.write_manifest(part, manifest)
    return {"trajectories": len(entries), "fields": list(meta["features"])}


def export_records(folder: str | Path, out: str | Path, *, cells: str = "tetrahedra") -> dict[str, Any]:
    """Write a data set of ours as meta.json and .tfrecord files.

    Args:
        cells: "tetrahedra" or "own"

    Raises:
        InputError: the folder is no data set, or its trajectories differ in length or kind of cell
        OSError: the other folder cannot be written
    """
    folder, out = Path(folder), Path(out)
    entries = dataset.read_manifest(folder).trajectories
    layout: dict[str, Any] = {}

    def records(split: str) -> Iterator[bytes]:
        for entry in progress([entry for entry in entries if entry.split == split], f"writing {split}"):
            trajectory = read_trajectory(folder / entry.file)
            fields = to_fields(trajectory, cells=cells)
            meta: dict[str, Any] = {name: _feature(name, field) for name, field in fields.items()}
            meta["dt"] = trajectory.extra.get("step_seconds", 1.0) if trajectory.flows else 1.0
            if layout.setdefault("features", meta) != meta:
                raise InputError(f"{folder / entry.file}: its steps or cells differ from those of the files before; this format "
                                 "has one layout for all")
            yield write_example({name: field.tobytes() for name, field in fields.items()})

    if not entries:
        raise InputError(f"{folder}: no trajectories")
    with folder_whole(out) as part:
        written = {split: write_records(part / f"{split}.tfrecord", records(split)) for split in SPLITS
                   if any(entry.split == split for entry in entries)}
        features = layout["features"]
        dt = features.pop("dt")
        length = max(feature["shape"][0] for feature in features.values())
        meta = {"simulator": "fidelity", "dt": dt, "features": features, "field_names": list(features), "trajectory_length": length}
        (part / "meta.json").write_text(json.dumps(meta, indent=1))
    return {"trajectories": sum(written.values()), "fields": list(features), **written}


def from_fields(fields: Fields, *, index: int = 0, source: str = "") -> Trajectory:
    """A trajectory from fields as they stand in the module's docstring. Raises `InputError`."""
    _check_fields(fields)
    kind, cells, rest = fields["node_type"][0, :, 0], fields["cells"][0].astype(np.int64), fields["mesh_pos"][0]
    nodes, width = len(kind), cells.shape[1]
    cell = (KIND_OF if rest.shape[1] == 3 else IN_A_PLANE)[width]
    moving = fields.get("world_pos")
    if rest.shape[1] < 3 and moving is not None:  # a cloth's coordinates in its own plane: it starts as it lies
        rest = moving[0]
    points = np.zeros((nodes, 3))
    points[:, :rest.shape[1]] = rest
    cells = _upright(points, cells, cell)
    frames = max(len(field) for field in fields.values()) if moving is None else len(moving)
    displacement = np.zeros((frames, nodes, 3)) if moving is None else moving - points

    order = np.argsort(kind == OBSTACLE, kind="stable")
    place = np.empty(nodes, np.int64)
    place[order] = np.arange(nodes)
    of_obstacle = (kind == OBSTACLE)[cells]
    if (of_obstacle.any(axis=1) != of_obstacle.all(axis=1)).any():
        raise InputError("a cell has nodes of both the body and the obstacle")
    body, rigid = place[cells[~of_obstacle[:, 0]]], place[cells[of_obstacle[:, 0]]]
    surface = [place[fields["obstacle_cells"][0]]] if "obstacle_cells" in fields else []
    if len(rigid):
        surface += Mesh(points[order], rigid, cell, {}).surface
    halves = [facets[:, pick] for facets in surface for pick in ([0, 1, 2], [0, 2, 3])[:facets.shape[1] - 2]]
    corners = np.concatenate([np.empty((0, 3), np.int64), *halves])
    types = np.repeat([CELLS[cell].vtk, CELLS["triangle"].vtk], [len(body), len(corners)]).astype(np.uint8)
    made = Trajectory(
        points=points[order], connectivity=np.concatenate([body.ravel(), corners.ravel()]).astype(np.int64),
        offsets=np.concatenate([[0], np.cumsum([OF_VTK[int(t)].nodes for t in types])]).astype(np.int64), types=types,
        node_kind=kind[order].astype(np.uint8), displacement=displacement[:, order].astype(np.float32),
        modes=np.zeros((0, nodes, 3), np.float32), index=index, extra={"imported": source},
        fields={name: _in_space(name, field[:, order].astype(np.float32)) for name, field in fields.items()
                if name not in OURS and len(field) == frames and field.shape[1] == nodes})
    for wrong in problems(made):
        raise InputError(wrong)
    return made


def _in_space(name: str, field: NDArray[np.float32]) -> NDArray[np.float32]:
    """A velocity (T, N, 2) with a third component, as ours have it; other fields as they are."""
    return np.pad(field, ((0, 0), (0, 0), (0, 1))) if name == "velocity" and field.shape[2] == 2 else field


def _check_fields(fields: Fields) -> None:
    """Raise `InputError` unless the fields have the same nodes and frames, and cells of a known kind."""
    for name in ("cells", "mesh_pos", "node_type"):
        if name not in fields:
            raise InputError(f"no field {name}")
    for name in STATIC:
        if name in fields and len(fields[name]) != 1:
            raise InputError(f"{name} has {len(fields[name])} rows; it does not change, so one is expected")
    for name, kinds, widths in (("cells", "iu", None), ("obstacle_cells", "iu", (3,)), ("node_type", "iu", (1,)), ("mesh_pos", "f", (2, 3)),
                                ("world_pos", "f", (3,))):
        if name in fields and not (fields[name].dtype.kind in kinds and (widths is None or fields[name].shape[2] in widths)):
            said = f"{' or '.join(map(str, widths))} {'whole ' * (kinds == 'iu')}numbers" if widths else "whole numbers"
            raise InputError(f"{name} has {fields[name].shape[2]} numbers of {fields[name].dtype.name} for each entry; {said} are expected")
    nodes, plane, width = fields["mesh_pos"].shape[1], fields["mesh_pos"].shape[2] == 2, fields["cells"].shape[2]
    for name in ("node_type", "world_pos"):
        if name in fields and fields[name].shape[1] != nodes:
            raise InputError(f"{name} has {fields[name].shape[1]} nodes, mesh_pos has {nodes}")
    known = IN_A_PLANE if plane else KIND_OF
    if width not in known:
        said = ", ".join(map(str, known))
        raise InputError(f"cells of {width} nodes, where mesh_pos has {2 if plane else 3} components; known are {said}")
    if not fields["cells"].shape[1]:
        raise InputError("no cells")
    for name in ("cells", "obstacle_cells"):
        if name in fields and fields[name].size and not (0 <= fields[name].min() and fields[name].max() < nodes):
            raise InputError(f"a cell names a node outside of 0 .. {nodes - 1}")
    kinds_there = fields["node_type"]
    if not np.isin(kinds_there, KINDS).all():
        raise InputError(f"node_type has a {kinds_there[~np.isin(kinds_there, KINDS)][0]}; known are 0 to {max(KINDS)}")
    if (kinds_there == OBSTACLE).all():
        raise InputError("every node is of the obstacle, none of a body")


def _upright(points: NDArray[np.float64], cells: NDArray[np.int64], cell: str) -> NDArray[np.int64]:
    """Solid cells with positive volume. Raises `InputError` for one without any, as a plane one is that is taken for it."""
    if CELLS[cell].dimension < 3:
        return cells
    first, *others = (points[cells[:, i]] for i in range(cells.shape[1]))
    spanned = np.stack([other - first for other in others], axis=1)  # (C, k - 1, 3)
    size = np.linalg.norm(spanned, axis=2).max(axis=1, initial=0.0)
    with np.errstate(all="ignore"):
        rank = (np.linalg.svd(np.nan_to_num(spanned / size[:, None, None]), compute_uv=False) > 1e-6).sum(axis=1)
    flat = np.flatnonzero(rank < 3)
    if len(flat):
        raise InputError(f"cell {flat[0]}, a {cell}, has no volume")
    return np.where((cell_volumes(points, cells, cell) < 0)[:, None], cells[:, CELLS[cell].mirrored], cells)


def to_fields(trajectory: Trajectory, *, cells: str = "tetrahedra") -> Fields:
    """The fields of a trajectory, as they stand in the module's docstring. Raises `InputError` for cells that cannot be cut."""
    mesh = trajectory.mesh
    body = mesh.surface[0] if cells == "tetrahedra" and mesh.dimension == 2 else mesh.cells  # plane cells of second order in four
    if cells == "tetrahedra" and body.shape[1] == 6:
        body = tetrahedra(body)
    elif cells == "tetrahedra" and body.shape[1] == 10:
        body = cut_into_eight(body)
    elif cells == "tetrahedra" and body.shape[1] == 8:
        raise InputError("hexahedra are not cut into tetrahedra here: ask for --cells own")
    flat = mesh.dimension == 2 and not trajectory.points[:, 2].any() and not trajectory.displacement[0].any()
    found: Fields = {"cells": body[None].astype(np.int32)}
    surface = trajectory.obstacle
    if surface is not None:
        found["obstacle_cells"] = (surface[1] + int(trajectory.body.sum()))[None].astype(np.int32)
    found["mesh_pos"] = trajectory.points[None, :, :2 if flat else 3].astype(np.float32)
    found["node_type"] = trajectory.node_kind[None, :, None].astype(np.int32)
    if not flat or trajectory.displacement.any():
        found["world_pos"] = (trajectory.points + trajectory.displacement).astype(np.float32)
    if not trajectory.flows:
        return found | _further(trajectory.fields)
    moving = slice(resting(trajectory), None)
    return found | {name: field[moving, :, :2] if name == "velocity" and flat and not field[:, :, 2:].any() else field[moving]
                    for name, field in trajectory.fields.items()}


def _further(fields: Fields) -> Fields:
    """Fields by their names there: the tensor of stress gives way to von Mises', which is what their stress is."""
    if "von_mises" not in fields:
        return fields
    found = {"cauchy_stress" if name == "stress" else name: field for name, field in fields.items()}
    found["stress"] = found.pop("von_mises")
    return found


def _feature(name: str, field: NDArray[Any]) -> dict[str, Any]:
    return {"type": "static" if name in STATIC else "dynamic", "shape": [len(field), -1, field.shape[2]], "dtype": field.dtype.name}


def _read_meta(path: Path) -> dict[str, Any]:
    try:
        meta = json.loads(path.read_text())
        features = {name: (feature["type"], [int(n) for n in feature["shape"]], np.dtype(feature["dtype"]))
                    for name, feature in meta["features"].items()}
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise InputError(f"{path}: not the description of a data set: {error}") from None
    for name, (kind, shape, dtype) in features.items():
        if dtype.kind not in "biuf":
            raise InputError(f"{path}: field {name} is of {dtype.name}; numbers are read")
        if kind not in ("static", "dynamic"):
            raise InputError(f"{path}: field {name} is {kind!r}; static and dynamic fields are read")
        if len(shape) != 3 or shape.count(-1) > 1 or not all(-1 <= n < 2**31 for n in shape):
            raise InputError(f"{path}: field {name} has shape {shape}; three numbers are expected, one of them -1 at most")
    return {**meta, "features": features}


def _decoded(record: bytes, meta: dict[str, Any]) -> Fields:
    """The fields of one record."""
    example, fields = parse_example(record), {}
    for name, (_, shape, dtype) in meta["features"].items():
        if len(example.get(name, ())) != 1:
            raise InputError(f"field {name} has {len(example.get(name, ()))} values, one is expected")
        data = example[name][0]
        row = abs(math.prod(shape)) * dtype.itemsize
        if row == 0 or len(data) % row or (-1 not in shape and len(data) != row):
            raise InputError(f"field {name} has {len(data)} bytes, which do not fit its shape {shape}")
        fields[name] = np.frombuffer(data, dtype.newbyteorder("<")).reshape(shape)
    return fields
