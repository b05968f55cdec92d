"""Mesh files of any kind that meshio reads: gmsh .msh 2 and 4, .vtu, .vtk, .xdmf, .inp and others.

The cells of highest dimension are the body; they must all be of one kind. Cells of second order keep their corners only,
so their sides become straight. Places are the physical groups of gmsh (any dimension: points, lines, surfaces, regions), the
cell and point sets of other formats, and groups without a name under their number.
"""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from physics.mesh.cell import CELLS, OF_MESHIO
from physics.mesh.mesh import Floats, Integers, Mesh, Parts
from physics.schema import InputError

TAGS = ("gmsh:physical", "medit:ref")


def read_mesh(path: str | Path, *, order: int = 1) -> Mesh:
    """The body in a mesh file, with its groups as places.

    Raises:
        InputError: no such file, a format that is not known, no cells, several kinds of cells in the body, a curved surface,
            a cell without volume, or prisms where `order` is 2
    """
    raw = _read(Path(path))
    blocks: list[tuple[str, Any]] = []
    for block in raw.cells:
        known = _kind(block.type)
        if known is None:
            raise InputError(f"{path}: has cells of kind {block.type!r}; known are {', '.join(OF_MESHIO)}")
        blocks.append((known, block.data))
    if not blocks:
        raise InputError(f"{path}: no cells in it")
    dimension = max(CELLS[kind].dimension for kind, _ in blocks)
    kinds = sorted({kind for kind, _ in blocks if CELLS[kind].dimension == dimension})
    if dimension < 2:
        raise InputError(f"{path}: has points and lines only; a body needs triangles, quadrilaterals or solid cells")
    if len(kinds) > 1:
        raise InputError(f"{path}: has {' and '.join(kinds)} cells; a body must be of one kind of cells")
    cell = kinds[0]
    if order == 2 and cell == "prism":
        raise InputError(f"{path}: body.order = 2: prisms are of first order only")
    corners = [(kind, np.asarray(data, np.int64)[:, :CELLS[kind].corners]) for kind, data in blocks]
    cells = np.concatenate([data for kind, data in corners if kind == cell])
    if len(cells) and (cells.min() < 0 or cells.max() >= len(raw.points)):
        raise InputError(f"{path}: a cell names a node that is not there")

    used = np.unique(cells)
    number = np.full(len(raw.points), -1, np.int64)
    number[used] = np.arange(len(used))
    points = np.zeros((len(used), 3))
    given = np.asarray(raw.points, np.float64)[used]
    points[:, :given.shape[1]] = given
    if not np.isfinite(points).all():
        raise InputError(f"{path}: node coordinates that are not finite")
    extent = np.ptp(points, axis=0)
    if dimension == 2 and extent[2] > 1e-9 * extent.max():
        raise InputError(f"{path}: a surface in space, from z = {points[:, 2].min():g} to {points[:, 2].max():g}; "
                         "a body must be solid, or plane at one z")
    remarks = []
    if any(data.shape[1] > CELLS[kind].corners for kind, data in blocks):
        remarks.append("cells of second order: their sides are taken as straight")

    places: dict[str, Integers] = {}
    parts: dict[str, Parts] = {}
    for name, members in _groups(raw, corners).items():
        kept = [(kind, moved[(moved >= 0).all(axis=1)]) for kind, moved in ((k, number[c]) for k, c in members)]
        kept = [(kind, data) for kind, data in kept if len(data)]
        if kept:
            parts[name] = kept
            places[name] = np.unique(np.concatenate([data.ravel() for _, data in kept]))
        else:
            remarks.append(f"no node of {name!r} belongs to the body")
    for name, nodes in raw.point_sets.items():
        inside = number[np.asarray(nodes, np.int64).ravel()]
        if name not in places and (inside >= 0).any():
            places[name] = np.unique(inside[inside >= 0])
    return Mesh(points, _upright(points, number[cells], cell, path), cell, places, parts, tuple(remarks))


def write_mesh(path: str | Path, mesh: Mesh, fields: dict[str, Floats]) -> None:
    """Write a mesh and its nodal fields (N,) or (N, 3) to a file of any kind that meshio knows by its ending; its folder is made."""
    import meshio

    Path(path).parent.mkdir(parents=True, exist_ok=True)
    meshio.Mesh(mesh.points, [(CELLS[mesh.cell].meshio, mesh.cells)], point_data=fields).write(path)


def _read(path: Path) -> Any:
    import meshio

    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):  # meshio prints, and ends the program
            return meshio.read(path)
    except (Exception, SystemExit) as error:  # its readers raise whatever a damaged file leads them to
        words = str(error).splitlines()
        reason = f": {words[0]}" if words and not isinstance(error, SystemExit) else ""
        raise InputError(f"{path}: not a mesh file that meshio can read{reason}") from None


def _kind(name: str) -> str | None:
    """The kind of cell behind one of meshio's names, whatever its order."""
    known = OF_MESHIO.get(name.rstrip("0123456789"))
    return known.name if known else None


def _groups(raw: Any, corners: Parts) -> dict[str, Parts]:
    """The named groups of cells of a file, of any dimension."""
    groups: dict[str, Parts] = {}
    names = {(int(tag), int(dim)): name for name, (tag, dim) in _pairs(raw.field_data)}
    for key in TAGS:
        for (kind, cells), tags in zip(corners, raw.cell_data.get(key, []), strict=False):
            tags = np.asarray(tags).ravel()
            for tag in np.unique(tags[tags != 0]):
                name = names.get((int(tag), CELLS[kind].dimension), f"{int(tag)}")
                groups.setdefault(name, []).append((kind, cells[tags == tag]))
    for name, members in raw.cell_sets.items():
        if not name.startswith("gmsh:"):
            for (kind, cells), chosen in zip(corners, members, strict=False):
                if chosen is not None and len(chosen):
                    groups.setdefault(name, []).append((kind, cells[np.asarray(chosen, np.int64)]))
    return groups


def _pairs(field_data: dict[str, Any]) -> list[tuple[str, Any]]:
    """The entries of meshio's field_data that are (tag, dimension), as gmsh's are."""
    return [(name, np.ravel(value)) for name, value in field_data.items() if np.size(value) == 2]


def _upright(points: Floats, cells: Integers, cell: str, path: str | Path) -> Integers:
    """The cells with positive volume. Raises `InputError` for one without any."""
    x = points[cells]  # (C, k, 3)
    if cell in ("triangle", "tetrahedron"):
        sides = x[:, 1:] - x[:, :1]
    elif cell == "quadrilateral":
        sides = np.stack([x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]], axis=1)  # the diagonals
    else:
        half = x.shape[1] // 2
        across = (1, 2) if cell == "prism" else (1, 3)
        flat = (x[:, :half] + x[:, half:]) / 2
        sides = np.stack([flat[:, across[0]] - flat[:, 0], flat[:, across[1]] - flat[:, 0],
                          x[:, half:].mean(axis=1) - x[:, :half].mean(axis=1)], axis=1)
    volume = np.linalg.det(sides[..., :2]) if sides.shape[1] == 2 else np.linalg.det(sides)
    scale = np.linalg.norm(sides, axis=2).prod(axis=1)
    missing = "area" if sides.shape[1] == 2 else "volume"
    flat_cells = np.flatnonzero(abs(volume) <= 1e-12 * scale)
    if len(flat_cells):
        raise InputError(f"{path}: cell {flat_cells[0]} of {len(cells)} has no {missing}")
    return np.where((volume < 0)[:, None], cells[:, CELLS[cell].mirrored], cells)
