"""Cells of second order: where their middle nodes lie, whether their sides are curved, and whether that turns a cell over.

A cell's place is a sum of functions of its own coordinates (r, s, t), one for each corner, edge, face and the inside. With

    triangle, tetrahedron      corners lambda_i,   edges 4 lambda_i lambda_j
    quadrilateral, hexahedron  products over the coordinates of 1 - r or r where all corners of the entity agree in r, else 4 r (1 - r)

the factor of a corner is where it lies, and that of anything else is how far its middle node lies from where the functions of what
bounds it put it: nothing, where an edge is straight, or where a file has no node on a face (Zienkiewicz and Taylor, hierarchic
shape functions). Legend: N nodes, C cells, E entities of k corners, P sample points.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from physics.mesh.cell import CELLS, CORNERS, GAUSS, Corners
from physics.mesh.formats.raw import VTK_MIDDLES, Raw
from physics.mesh.sound.rows import keyed, row_in
from physics.schema import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Middles = dict[int, tuple[Integers, Floats]]  # number of corners k to sorted corners (E, k) and the middle nodes (E, 3) [m]

STRAIGHT = 3e-5  # of an edge's length: files with few digits


def curved(raw: Raw, number: Integers, points: Floats, cells: Integers, kind: str, scale: float, order: int) -> tuple[Middles, list[str]]:
    """The middle nodes of a body whose sides are curved, if they are asked for, and what should be said.

    Args:
        number: (nodes of the file,) the body's numbers of them, -1 outside of it

    Raises:
        InputError: with order 2, middle nodes that disagree, lie nowhere, or turn a cell inside out
    """
    given: dict[int, list[tuple[Integers, Floats]]] = {}
    further, order_of_cells = False, "second order"
    for block in raw.blocks:
        corners = CELLS[block.kind].corners
        if CELLS[block.kind].dimension < CELLS[kind].dimension or block.nodes.shape[1] == corners:
            continue
        further = True
        if block.nodes.shape[1] - corners > len(VTK_MIDDLES.get(block.kind, block.nodes[0])):
            order_of_cells = "third order or more"
        for i, local in enumerate(block.middles if block.kind == kind else ()):
            at = np.zeros((len(block.nodes), 3))
            at[:, :raw.points.shape[1]] = raw.points[block.nodes[:, corners + i]] * scale
            given.setdefault(len(local), []).append((np.sort(number[block.nodes[:, list(local)]], axis=1), at))
    straight = f"cells of {order_of_cells}: their sides are taken as straight"
    if not given:
        return {}, [straight] if further else []
    middles: Middles = {}
    bent = False
    for k, pairs in given.items():
        rows, at = np.concatenate([pair[0] for pair in pairs]), np.concatenate([pair[1] for pair in pairs])
        if not np.isfinite(at).all():
            raise InputError("node coordinates that are not finite")
        _, first, which = np.unique(keyed(rows), return_index=True, return_inverse=True)
        rows = rows[first]
        size = np.ptp(points[rows], axis=1).max(axis=1)
        if order == 2 and (abs(at - at[first][which]).max(axis=1) > STRAIGHT * size[which]).any():
            raise InputError("two cells have different middle nodes on a side that they share")
        middles[k] = rows, at[first]
        bent |= bool((np.linalg.norm(at[first] - points[rows].mean(axis=1), axis=1) > STRAIGHT * size).any())
    if not bent:
        return {}, []
    if order == 1:
        return {}, [f"{straight}; order = 2 keeps them curved"]
    middles = complete(points, cells, kind, middles)
    least = smallest_jacobian(points, cells, kind, middles)
    if (wrong := np.flatnonzero(~(least > 0))).size:
        raise InputError(f"{len(wrong)} of {len(cells)} curved cells are inside out somewhere, the first one at "
                         f"({', '.join(f'{x:.4g}' for x in points[cells[wrong[0]]].mean(axis=0))}) m: its middle nodes lie in wrong places")
    return middles, []


def entities(kind: str) -> list[Corners]:
    """The local corners of what has a middle node, in the order in which each builds on those before: edges, faces, the inside."""
    found: list[Corners] = [CELLS[kind].edges]
    if kind == "hexahedron":
        found.append(CELLS[kind].facets)
    if kind in ("quadrilateral", "hexahedron"):
        found.append((tuple(range(CELLS[kind].corners)),))
    return found


def complete(points: Floats, cells: Integers, kind: str, given: Middles) -> Middles:
    """The middle nodes of all edges, faces and insides; where none is given, where the entities that bound it put it."""
    found: Middles = {}
    for locals_ in entities(kind):
        k = len(locals_[0])
        rows = np.concatenate([cells[:, list(local)] for local in locals_])  # in order, for the edges of a face
        ends = np.sort(rows, axis=1)
        first = np.unique(keyed(ends), return_index=True)[1]
        key = ends[first]
        at = points[key].mean(axis=1)
        for smaller, share in ((2, {4: 0.5, 8: 0.25}), (4, {8: 0.5})):
            if k in share and smaller in found:
                for local in _bounding(kind, locals_[0], smaller):
                    # The same local corners serve every entity, for rows go round faces as the first one does.
                    inside = rows[first][:, [locals_[0].index(corner) for corner in local]]
                    at = at + share[k] * _surplus(points, found, inside)
        if k in given:
            row = row_in(given[k][0], key)
            at = np.where((row >= 0)[:, None], given[k][1][row], at)
        found[k] = key, at
    return found


def _bounding(kind: str, corners: tuple[int, ...], smaller: int) -> list[tuple[int, ...]]:
    pool = CELLS[kind].edges if smaller == 2 else CELLS[kind].facets
    return [entity for entity in pool if set(entity) <= set(corners)]


def _surplus(points: Floats, found: Middles, rows: Integers) -> Floats:
    """(m, 3) how far the middle nodes of edges or faces (m, k) lie from where what bounds them puts them."""
    key, at = found[rows.shape[1]]
    row = row_in(key, np.sort(rows, axis=1))
    off = at[row] - points[rows].mean(axis=1)
    if rows.shape[1] == 4:
        for i in range(4):
            off = off - 0.5 * _surplus(points, found, rows[:, [i, (i + 1) % 4]])
    return off


def smallest_jacobian(points: Floats, cells: Integers, kind: str, middles: Middles) -> Floats:
    """(C,) smallest determinant of the map from a cell's coordinates at its corners, middles and points of integration."""
    d = CELLS[kind].dimension
    local = [(c,) for c in range(CELLS[kind].corners)] + [entity for group in entities(kind) for entity in group]
    factor = np.empty((len(cells), len(local), 3))
    for i, entity in enumerate(local):
        factor[:, i] = points[cells[:, entity[0]]] if len(entity) == 1 else _surplus(points, middles, cells[:, list(entity)])
        if len(entity) == 8:
            factor[:, i] = middles[8][1][row_in(middles[8][0], np.sort(cells, axis=1))] - points[cells].mean(axis=1)
            for share, group in ((0.25, CELLS[kind].edges), (0.5, CELLS[kind].facets)):
                for part in group:
                    factor[:, i] -= share * _surplus(points, middles, cells[:, list(part)])
    slopes = _slopes(kind, local, _samples(kind))  # (P, n, d)
    jacobian = np.einsum("pne,cnd->cped", slopes[..., :d], factor[..., :d])
    return np.linalg.det(jacobian).min(axis=1)


def _samples(kind: str) -> Floats:
    d = CELLS[kind].dimension
    places = [place for place in product((0.0, 0.5, 1.0, *GAUSS), repeat=d) if kind not in ("triangle", "tetrahedron") or sum(place) <= 1]
    return np.array([(*place, 0.0)[:3] for place in places])


def _slopes(kind: str, local: list[tuple[int, ...]], at: Floats) -> Floats:
    """(P, n, 3) gradients of the functions of some entities at places (P, 3)."""
    found = np.zeros((len(at), len(local), 3))
    if kind in ("triangle", "tetrahedron"):
        d = CELLS[kind].dimension
        value = np.column_stack([1 - at[:, :d].sum(axis=1), at[:, :d]])
        slope = np.concatenate([-np.ones((1, d)), np.eye(d)])
        for i, entity in enumerate(local):
            a, b = entity[0], entity[-1]
            found[:, i, :d] = slope[a] if a == b else 4 * (value[:, [a]] * slope[b] + value[:, [b]] * slope[a])
        return found
    for i, entity in enumerate(local):
        values, slopes = np.ones((len(at), 3)), np.zeros((len(at), 3))
        for axis in range(CELLS[kind].dimension):
            ends, x = CORNERS[kind][list(entity), axis], at[:, axis]
            if (ends == ends[0]).all():
                values[:, axis], slopes[:, axis] = (x, 1.0) if ends[0] else (1 - x, -1.0)
            else:
                values[:, axis], slopes[:, axis] = 4 * x * (1 - x), 4 - 8 * x
        for axis in range(3):
            found[:, i, axis] = slopes[:, axis] * np.prod(np.delete(values, axis, axis=1), axis=1)
    return found


def table(points: Floats, cells: Integers, middles: Middles, local: list[tuple[int, ...]]) -> tuple[Floats, Integers]:
    """Nodes (all, 3) of a curved mesh, its corners first, and for each cell (C, len(local)) which lie inside of some local entities."""
    offset, all_points, start = {}, [points], len(points)
    for k, (_, at) in middles.items():
        offset[k] = start
        all_points.append(at)
        start += len(at)
    columns = [offset[len(entity)] + row_in(middles[len(entity)][0], np.sort(cells[:, list(entity)], axis=1)) for entity in local]
    return np.concatenate(all_points), np.stack(columns, axis=1)
