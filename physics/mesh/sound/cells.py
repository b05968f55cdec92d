"""Is each cell a cell? What is beyond doubt is put right, the rest is refused in a line that names the cell.

A cell may be listed once for each group that it is in; it is taken once. A hexahedron whose corners are named twice in the way
of a prism is a prism, as other programs mean it. A cell with its corners in the mirrored order is turned. One that is inside out at
some corners and not at others crosses itself, and no order of numbers is beyond doubt there.

Legend: C cells, n corners of a cell.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from physics.mesh.cell import CELLS, CORNERS
from physics.mesh.sound.rows import keyed
from physics.schema import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Called = Callable[[int], str]  # what a file calls a cell, or a node

FLAT = 1e-12  # of the product of the sides
ROW_BY_ROW = {"quadrilateral": [0, 1, 3, 2], "hexahedron": [0, 1, 3, 2, 4, 5, 7, 6]}


def once(cells: Integers) -> Integers:
    """The numbers of the cells that are no repetition of an earlier one, whatever the order of its corners."""
    return np.sort(np.unique(keyed(np.sort(cells, axis=1)), return_index=True)[1])


def by_shape(kind: str, cells: Integers) -> list[tuple[str, Integers, Integers]]:
    """Cells of one kind sorted by what they are when corners that are named twice are one: kind, which (c,), corners (c, k).

    The kind is "" for what is no cell at all, as a triangle with two corners.
    """
    if (np.diff(np.sort(cells, axis=1), axis=1) != 0).all():
        return [(kind, np.arange(len(cells)), cells)]
    first = (cells[:, :, None] == cells[:, None, :]).argmax(axis=2)  # (C, n) where each corner is named first
    shapes, which = np.unique(first, axis=0, return_inverse=True)
    found = []
    for number, shape in enumerate(shapes):
        rows = np.flatnonzero(which.ravel() == number)
        name, corners = _shape(kind, tuple(int(i) for i in shape))
        found.append((name, rows, cells[rows][:, list(corners)]))
    return found


def _shape(kind: str, first: tuple[int, ...]) -> tuple[str, tuple[int, ...]]:
    """What a cell is whose corner i is the same as corner first[i], and its corners in order."""
    if first == tuple(range(len(first))):
        return kind, first
    left = sorted(set(first))
    if CELLS[kind].dimension == 2:
        ring = [corner for i, corner in enumerate(first) if corner != first[i - 1]]
        return ("triangle", tuple(ring)) if len(ring) == len(left) == 3 else ("", tuple(left))
    sides = []
    for facet in CELLS[kind].facets:
        ring = [first[corner] for corner in facet]
        ring = [corner for i, corner in enumerate(ring) if corner != ring[i - 1]]
        if len(set(ring)) != len(ring):
            return "", tuple(left)
        if len(ring) > 2:
            sides.append(ring)
    triangles = [side for side in sides if len(side) == 3]
    if len(left) == len(sides) == 4 and {frozenset(side) for side in sides} == {frozenset(three) for three in combinations(left, 3)}:
        base, apex = triangles[0], next(corner for corner in left if corner not in triangles[0])
        return "tetrahedron", (base[0], base[2], base[1], apex)
    if len(left) == 6 and len(triangles) == 2 and len(sides) == 5 and not set(triangles[0]) & set(triangles[1]):
        a = triangles[0][::-1]  # inward
        edges = {frozenset(pair) for side in sides for pair in zip(side, side[1:] + side[:1], strict=True)}
        return "prism", (*a, *(next(other for other in triangles[1] if frozenset((corner, other)) in edges) for corner in a))
    return "", tuple(left)


def upright(points: Floats, cells: Integers, kind: str, cell: Called, node: Called) -> tuple[Integers, int, Integers]:
    """The cells with positive volume, how many had to be turned for that, and which have a flat corner.

    A corner is flat where its edges lie in one plane, as where two sides of a quadrilateral form one line.

    Raises:
        InputError: one has a side without length or no volume, crosses itself, or is inside out at a corner
    """
    for i, j in CELLS[kind].edges:
        if (same := np.flatnonzero((points[cells[:, i]] == points[cells[:, j]]).all(axis=1))).size:
            pair = f"{node(cells[same[0], i])} and {node(cells[same[0], j])}"
            raise InputError(f"{cell(same[0])} has two corners in one place, nodes {pair}: a side without length")
    corner = corners(points, cells, kind)
    crossed = (corner < -FLAT).any(axis=1) & (corner > FLAT).any(axis=1)
    measure = "area" if CELLS[kind].dimension == 2 else "volume"
    size, scale = _volume(points, cells, kind)
    if (flat := np.flatnonzero((abs(size) <= FLAT * scale) & ~crossed)).size:
        raise InputError(f"{cell(flat[0])} has no {measure}")
    if (wrong := np.flatnonzero(crossed)).size:
        first = wrong[0]
        at = int(np.argmin(corner[first] * np.sign(size[first] or 1)))
        other = ROW_BY_ROW.get(kind)
        order = other is not None and _sound(corners(points, cells[wrong][:, other], kind)).all()
        why = ("its corners seem to be listed row by row and must go round" if order
               else "its corners are in a wrong order, or one of them is in a wrong place")
        more = f" ({len(wrong)} of {len(cells)} cells are)" if len(wrong) > 1 else ""
        raise InputError(f"{cell(first)} is inside out at node {node(cells[first, at])}{more}: {why}")
    turned = size < 0
    cells = np.where(turned[:, None], cells[:, CELLS[kind].mirrored], cells)
    inner = _inside(points, cells, kind)
    if (wrong := np.flatnonzero(~(inner > 0))).size:
        raise InputError(f"{cell(wrong[0])} is inside out in its middle: one of its corners is in a wrong place")
    return cells, int(turned.sum()), np.flatnonzero((abs(corner) <= FLAT).any(axis=1))


def _sound(corner: Floats) -> NDArray[np.bool_]:
    return (corner > FLAT).all(axis=1) | (corner < -FLAT).all(axis=1)


def corners(points: Floats, cells: Integers, kind: str) -> Floats:
    """(C, n) at each corner the volume (area) spanned by its edges over the product of their lengths, from -1 to 1."""
    x = points[cells]
    if CELLS[kind].dimension == 2:
        after, before = np.roll(x, -1, axis=1) - x, np.roll(x, 1, axis=1) - x
        spanned = after[..., 0] * before[..., 1] - after[..., 1] * before[..., 0]
        lengths = np.linalg.norm(after, axis=2) * np.linalg.norm(before, axis=2)
    else:
        ways = np.array([WAYS[kind][i] for i in range(cells.shape[1])])  # (n, 3)
        edges = x[:, ways] - x[:, :, None]  # (C, n, 3, 3)
        spanned, lengths = _triple(edges), np.linalg.norm(edges, axis=3).prod(axis=2)
    return np.divide(spanned, lengths, out=np.zeros_like(spanned), where=lengths > 0)


def _ways(kind: str) -> list[tuple[int, ...]]:
    """For each corner of a solid cell the other ends of its edges, so that they form a right-handed system in a sound cell."""
    found = []
    for i in range(CELLS[kind].corners):
        ends = [a + b - i for a, b in CELLS[kind].edges if i in (a, b)]
        ways = CORNERS[kind][ends] - CORNERS[kind][i]
        found.append(tuple(ends if np.linalg.det(ways) > 0 else [ends[0], ends[2], ends[1]]))
    return found


WAYS = {name: _ways(name) for name, cell in CELLS.items() if cell.dimension == 3 and not cell.middles}


def _triple(rows: Floats) -> Floats:
    """(...) determinants of (..., 3, 3)."""
    a, b, c = rows[..., 0, :], rows[..., 1, :], rows[..., 2, :]
    return (a[..., 0] * (b[..., 1] * c[..., 2] - b[..., 2] * c[..., 1]) + a[..., 1] * (b[..., 2] * c[..., 0] - b[..., 0] * c[..., 2])
            + a[..., 2] * (b[..., 0] * c[..., 1] - b[..., 1] * c[..., 0]))


def _inside(points: Floats, cells: Integers, kind: str) -> Floats:
    """(C,) smallest Jacobian determinant over the points at which a cell is sampled."""
    d = CELLS[kind].dimension
    jacobian = np.einsum("qne,cnd->cqed", CELLS[kind].shapes(CELLS[kind].points)[1][..., :d], points[cells][..., :d])
    return (np.linalg.det(jacobian) if d == 2 else _triple(jacobian)).min(axis=1)


def _volume(points: Floats, cells: Integers, kind: str) -> tuple[Floats, Floats]:
    """(C,) about the volume, or area, and the product of the sides."""
    x = points[cells]
    if kind in ("triangle", "tetrahedron"):
        sides = x[:, 1:] - x[:, :1]
    elif kind == "quadrilateral":
        sides = np.stack([x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]], axis=1)  # the diagonals
    else:
        half = x.shape[1] // 2
        across = (1, 2) if kind == "prism" else (1, 3)
        flat = (x[:, :half] + x[:, half:]) / 2
        sides = np.stack([flat[:, across[0]] - flat[:, 0], flat[:, across[1]] - flat[:, 0],
                          x[:, half:].mean(axis=1) - x[:, :half].mean(axis=1)], axis=1)
    volume = np.linalg.det(sides[..., :2]) if sides.shape[1] == 2 else np.linalg.det(sides)
    return volume, np.linalg.norm(sides, axis=2).prod(axis=1)
