"""Mesh files of any kind: read, looked at, and only then believed. What a format says is in formats/, what is sound in sound/.

The cells of highest dimension are the body; they must all be of one kind. Cells of second order keep their curved sides when `order` is
2, else their corners only. Places are groups of any dimension (points, lines, faces, regions) and sets of nodes, by their names or,
without one, by their numbers; see places.py for names that stand for several.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import ParseError

import numpy as np

from physics.mesh.cell import CELLS
from physics.mesh.formats import abaqus, drawing, gmsh, nastran, others, su2, xdmf
from physics.mesh.formats.drawing import Cut
from physics.mesh.formats.raw import Raw
from physics.mesh.mesh import Floats, Integers, Mesh, Parts
from physics.mesh.places import called
from physics.mesh.sound.cells import by_shape, once, upright
from physics.mesh.sound.curved import curved
from physics.mesh.sound.fit import fitting
from physics.scene import is_drawing
from physics.schema import InputError, missing
from physics.whole import written_whole

OWN = {".msh": gmsh.read, ".inp": abaqus.read, ".su2": su2.read, ".bdf": nastran.read, ".nas": nastran.read, ".fem": nastran.read}
SMALLEST, LARGEST = 1e-9, 1e9  # [m] a body
LONG = 20.0  # [m] past which a body of a file without a scale may be in millimetres


@dataclass(frozen=True)
class Found:
    """The cells of the body in a file. Legend: C cells.

    cells: (C, n) corners, in the file's numbers; labels: (C,) what the file calls them, or their positions among `count` cells
    """

    kind: str
    cells: Integers
    labels: Integers
    count: int | None
    remarks: tuple[str, ...]

    def name(self, i: int) -> str:
        """What a cell is called in a message."""
        return f"cell {self.labels[i]}" + ("" if self.count is None else f" of {self.count}")


def read_mesh(path: str | Path, *, order: int = 1, scale: float | None = None, cut: Cut | None = None) -> Mesh:
    """The body in a mesh file, with its groups as places.

    Args:
        scale: what the file's coordinates are multiplied by to be metres; 1 when left out, and a remark asks whether that was meant
            where the body is long
        cut: how a drawing is cut into cells

    Raises:
        InputError: no such file, a format that is not known, no cells, several kinds of cells in the body, a curved surface,
            cells that are none or do not fit together (sound/), or prisms where `order` is 2
    """
    try:
        if is_drawing(str(path)):
            raw = drawing.read(Path(path), (cut or Cut()).scaled(scale or 1.0), order)
        else:
            raw = _read(Path(path))
        mesh = _mesh(raw, order, scale or 1.0)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    extent = float(np.ptp(mesh.points, axis=0).max())
    if scale is None and extent > LONG:
        mesh = replace(mesh, remarks=(*mesh.remarks, f"the body is {extent:.3g} m long: is the file in mm? then body.scale = 0.001"))
    return mesh


def write_mesh(path: str | Path, mesh: Mesh, fields: dict[str, Floats]) -> None:
    """Write a mesh and its nodal fields (N,) or (N, 3) to one file of any kind that meshio knows by its ending, whole or not at all.

    Its folder is made. Raises OSError naming the file.
    """
    import meshio

    kind = meshio.extension_to_filetypes[Path(path).suffix.lower()][0]
    with written_whole(path) as part:
        meshio.Mesh(mesh.points, [(CELLS[mesh.cell].meshio, mesh.cells)], point_data=fields).write(part, file_format=kind)


def _read(path: Path) -> Raw:
    """What a file says. Raises `InputError`."""
    if why := missing(path):
        raise InputError(why)
    ending = path.suffix.lower()
    if ending == ".xdmf":
        try:
            several = len(xdmf.grids(path)) > 1
        except ParseError as error:
            raise InputError(f"not XML: {error}") from None
        if not several:
            return others.read(path)
    reader = xdmf.read if ending == ".xdmf" else OWN.get(ending, others.read)
    try:
        if ending == ".msh" and b"$MeshFormat" not in path.read_bytes():  # another program's
            return others.read(path)
        return reader(path)
    except InputError:
        raise
    except (ValueError, IndexError, KeyError, TypeError, OverflowError, OSError, MemoryError) as error:
        reason = (str(error).splitlines() or [""])[0][:200] or type(error).__name__
        raise InputError(f"not a sound {ending} file: {reason}") from None


def _mesh(raw: Raw, order: int, scale: float) -> Mesh:
    found = _body(raw)
    kind = found.kind
    if order == 2 and kind == "prism":
        raise InputError("body.order = 2: prisms are of first order only")
    used = np.unique(found.cells)
    number = np.full(len(raw.points), -1, np.int64)
    number[used] = np.arange(len(used))
    points = _placed(raw.points[used], scale, CELLS[kind].dimension)
    labels = used if raw.labels is None else raw.labels[used]
    cells, turned, flat = upright(points, number[found.cells], kind, found.name, lambda node: str(labels[node]))
    remarks = list(found.remarks)
    if turned:
        remarks.append(f"{turned} of {len(cells)} cells were inside out and have been turned")
    if len(flat):
        remarks.append(f"{found.name(flat[0])} has a flat corner" + (f", as {len(flat) - 1} others have" if len(flat) > 1 else ""))
    remarks += fitting(points, cells, kind, found.name, lambda node: str(labels[node]))
    middles, said = curved(raw, number, points, cells, kind, scale, order)
    groups, node_sets, lost = _groups(raw, number)
    places, parts, mixed = called(groups, node_sets, CELLS[kind].dimension)
    return Mesh(points, cells, kind, places, parts, (*remarks, *said, *lost), mixed, middles)


def _body(raw: Raw) -> Found:
    """The cells of highest dimension, each once, of one kind and with corners of their own."""
    blocks = [block for block in raw.blocks if len(block.nodes)]
    if not blocks:
        raise InputError("no cells in it")
    dimension = max(CELLS[block.kind].dimension for block in blocks)
    if dimension < 2:
        raise InputError("has points and lines only; a body needs triangles, quadrilaterals or solid cells")
    body = [block for block in blocks if CELLS[block.kind].dimension == dimension]
    total = sum(len(block.nodes) for block in body)
    known = all(block.labels is not None for block in body)
    start, parts, labels = 0, [], np.empty(total, np.int64)
    for block in body:
        count = len(block.nodes)
        labels[start:start + count] = block.labels if known and block.labels is not None else np.arange(start, start + count)
        parts.append((start, block))
        start += count

    def name(i: int) -> str:
        return f"cell {labels[i]}" + ("" if known else f" of {total}")

    tables: dict[str, list[tuple[Integers, Integers]]] = {}
    for block in raw.blocks:
        if len(block.nodes) and not (0 <= block.nodes.min() and block.nodes.max() < len(raw.points)):
            at = next((start for start, other in parts if other is block), None)
            row = int(np.argmax(((block.nodes < 0) | (block.nodes >= len(raw.points))).any(axis=1)))
            raise InputError(f"{f'a {block.kind}' if at is None else name(at + row)} names a node that is not there")
    for start, block in parts:
        for kind, rows, corners in by_shape(block.kind, block.nodes[:, :CELLS[block.kind].corners]):
            if not kind:
                raise InputError(f"{name(start + rows[0])} names a corner twice: it has no {'area' if dimension == 2 else 'volume'}, "
                                 "or is a pyramid, which is not known here")
            tables.setdefault(kind, []).append((start + rows, corners))
            if kind != block.kind and any(other.kind != kind and len(by_shape(other.kind, other.nodes[:, :CELLS[other.kind].corners])) > 1
                                          for other in body):
                raise InputError(f"{name(start + rows[0])} names a corner twice and is a {kind}; a body must be of one kind of cells")
    if len(tables) > 1:
        raise InputError(f"has {' and '.join(sorted(tables))} cells; a body must be of one kind of cells")
    (kind, pairs), = tables.items()
    where = np.concatenate([rows for rows, _ in pairs])
    order = np.argsort(where, kind="stable")
    cells, where = np.concatenate([corners for _, corners in pairs])[order], where[order]
    kept = once(cells)
    remarks = []
    if any(block.kind != kind for block in body):
        remarks.append(f"cells with corners named twice are taken as {CELLS[kind].plural}")
    if len(kept) < total:
        remarks.append(f"{total - len(kept)} cells are listed twice and taken once")
    idle = np.ones(len(raw.points), bool)
    for block in raw.blocks:
        idle[block.nodes] = False
    if many := int(idle.sum()):
        remarks.append(f"{many} node{'s' if many > 1 else ''} of no cell left out")
    return Found(kind, cells[kept], labels[where[kept]], None if known else total, tuple(remarks))


def _placed(given: Floats, scale: float, dimension: int) -> Floats:
    """(N, 3) the nodes in metres."""
    points = np.zeros((len(given), 3))
    if not np.isfinite(given).all():
        raise InputError("node coordinates that are not finite")
    if abs(given).max() > LARGEST / scale:
        raise InputError(f"a node lies {abs(given).max() * scale:.3g} m from the origin; at most {LARGEST:g} m")
    points[:, :given.shape[1]] = given if scale == 1.0 else given * scale
    extent = np.ptp(points, axis=0)
    if extent.max() < SMALLEST:
        raise InputError(f"a body of {extent.max():.3g} m; at least {SMALLEST:g} m")
    if dimension == 2 and extent[2] > 1e-9 * extent.max():
        raise InputError(f"a surface in space, from z = {points[:, 2].min():g} to {points[:, 2].max():g}; "
                         "a body must be solid, or plane at one z")
    return points


def _groups(raw: Raw, number: Integers) -> tuple[dict[tuple[str, int], Parts], dict[str, Integers], list[str]]:
    """The groups of cells and of nodes in the body's numbers, and what should be said of those outside of it."""
    groups: dict[tuple[str, int], Parts] = {}
    said = []
    for key, members in raw.groups.items():
        for block, rows in ((raw.blocks[which], rows) for which, rows in members):
            for kind, _, corners in by_shape(block.kind, block.nodes[rows][:, :CELLS[block.kind].corners]):
                moved = number[corners]
                moved = moved[(moved >= 0).all(axis=1)]
                if kind and len(moved):
                    groups.setdefault(key, []).append((kind, moved))
        if key not in groups:
            said.append(f"no node of {key[0]!r} belongs to the body" if members else f"no cell of the file is in {key[0]!r}; gmsh keeps "
                        "groups with Mesh.SaveAll = 0, or in version 4.1")
    node_sets = {}
    for name, nodes in raw.node_sets.items():
        if len(nodes) and not (0 <= nodes.min() and nodes.max() < len(number)):
            raise InputError(f"set {name!r} names a node that is not there")
        inside = number[np.unique(nodes)]
        outside = int((inside < 0).sum())
        if outside < len(inside):
            node_sets[name] = inside[inside >= 0]
        if outside:
            said.append(f"{f'{outside} of {len(inside)} nodes' if outside < len(inside) else 'no node'} of {name!r} "
                        f"belong{'s' if outside == len(inside) else ''} to {'no cell of ' if outside < len(inside) else ''}the body")
    return groups, node_sets, said
