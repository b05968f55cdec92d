"""Meshes of boxes and rectangles, of any cell, with their faces as places.

Cells are even, or graded to some faces: the k-th of n cells from such a face ends at

    x = L (k / n)^p,    p = 3/2          of two opposite faces each at its half of the side L

so that the first of 16 cells is a quarter of the mean and the last 1.5 times as long. Where strain grows like r^(l - 1) at distance r from
a clamped edge such meshes bring back the order of convergence that even ones lose (Babuska, Kellogg and Pitkaranta, Numer. Math. 33, 1979).

Where cells are to be shorter around places c along an axis as well, each over about w, there are

    1 + 3 sum 1 / (1 + (x - c)^2 / w^2)      of them in a length for one far away; a face that they are graded to counts as a place there,
                                             with w a tenth of the side

Legend: N nodes, C cells.
"""

from __future__ import annotations

import numpy as np

from physics.mesh.mesh import Floats, Integers, Mesh
from physics.scene import PLACES, Body

GRADING = 1.5  # p
DENSER, BESIDE, FINE = 3.0, 0.1, 10_000  # the factor of the sum; w of a face over the side; parts in which the sum is found


def box(body: Body) -> Mesh:
    """A box of solid cells.

    Prisms of a beam have their triangles normal to x, those of a plate normal to z. The diagonals alternate like a chess
    board: were they all parallel, a symmetric load would drive a beam sideways. Tetrahedra come from cutting each prism in
    three.
    """
    turn = 1 if body.shape == "plate" else 0  # how often the axes (x, y, z) go round to bring the layers' normal first
    nx, ny, nz = (int(n) for n in np.roll(body.divisions, turn))
    lines = _lines(body)
    x, y, z = lines[-turn:] + lines[:-turn]
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)

    a, b, c, d = _squares(ny, nz)
    layer = np.arange(nx)[:, None, None] * (ny + 1) * (nz + 1)
    above = (ny + 1) * (nz + 1)
    if body.cell == "hexahedron":
        base = np.stack([a, b, c, d], axis=1)
        cells = np.concatenate([base + layer, base + layer + above], axis=2).reshape(-1, 8)
    else:
        triangles = _halves(a, b, c, d, ny, nz)
        cells = np.concatenate([triangles + layer, triangles + layer + above], axis=2).reshape(-1, 6)
        if body.cell == "tetrahedron":
            cells = tetrahedra(cells)
    points = np.roll(points, -turn, axis=1)
    return Mesh(points, cells.astype(np.int64), body.cell, faces(points, body.extent))


def rectangle(body: Body) -> Mesh:
    """A plane rectangle of triangles, their diagonals alternating, or of quadrilaterals."""
    nx, ny = body.divisions
    x, y = _lines(body)
    points = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    corners = _squares(nx, ny)
    cells = np.stack(corners, axis=1) if body.cell == "quadrilateral" else _halves(*corners, nx, ny)
    return Mesh(points, cells.astype(np.int64), body.cell, faces(points, body.extent))


def _lines(body: Body) -> list[Floats]:
    """Where the cells of a box end along each axis."""
    sides = list(zip(body.extent, body.divisions, strict=False))
    if any(body.focus):
        return [_focused(side, n, [*spots, *((end * side, BESIDE * side) for end, face in enumerate(PLACES[2 * axis:2 * axis + 2])
                                             if face in (body.graded or ()))])
                for axis, ((side, n), spots) in enumerate(zip(sides, body.focus, strict=False))]
    even = [np.linspace(0.0, side, n + 1) for side, n in sides]
    if not body.graded:
        return even
    return [side * _graded(ends / side, body.graded, axis) for axis, (ends, (side, _)) in enumerate(zip(even, sides, strict=True))]


def _focused(side: float, n: int, spots: list[tuple[float, float]]) -> Floats:
    """Where n cells of a side end which are shorter around some places, each over about so far."""
    x = np.linspace(0.0, side, FINE + 1)
    cells = x + DENSER * sum(within * (np.arctan((x - place) / within) + np.arctan(place / within)) for place, within in spots)
    return np.interp(np.linspace(0.0, cells[-1], n + 1), cells, x)


def _graded(shares: Floats, to: tuple[str, ...], axis: int) -> Floats:
    """Shares of a side, 0 to 1, closer together towards the faces that they are graded to."""
    low, high = (face in to for face in PLACES[2 * axis:2 * axis + 2])
    if low and high:
        return np.where(shares < 0.5, (2 * shares) ** GRADING / 2, 1 - (2 - 2 * shares) ** GRADING / 2)
    return shares**GRADING if low else 1 - (1 - shares) ** GRADING if high else shares


def faces(points: Floats, extent: tuple[float, float, float]) -> dict[str, Integers]:
    """The nodes on the faces of a box of that extent from the origin; of a plane one on its sides."""
    tolerance = 1e-9 * max(extent)
    sides = [(axis, end) for axis, side in enumerate(extent) for end in (0.0, side) if side]
    near = [np.flatnonzero(abs(points[:, axis] - end) < tolerance) for axis, end in sides]
    return dict(zip(PLACES, near, strict=False))


def _squares(m: int, n: int) -> tuple[Integers, Integers, Integers, Integers]:
    """The corners of the squares of a grid of m x n, (m n,) each, going round; nodes are numbered along the second axis."""
    node = np.arange((m + 1) * (n + 1)).reshape(m + 1, n + 1)
    return node[:-1, :-1].ravel(), node[1:, :-1].ravel(), node[1:, 1:].ravel(), node[:-1, 1:].ravel()


def _halves(a: Integers, b: Integers, c: Integers, d: Integers, m: int, n: int) -> Integers:
    """(2 m n, 3) two triangles of each square, cut by alternating diagonals."""
    even = (np.add.outer(np.arange(m), np.arange(n)) % 2 == 0).ravel()[:, None]
    first = np.where(even, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    second = np.where(even, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    return np.stack([first, second], axis=1).reshape(-1, 3)


def tetrahedra(prisms: Integers) -> Integers:
    """Three tetrahedra for each prism; the diagonals of shared quadrilaterals start at the smaller node number, so they match."""
    # Turn every prism so that its smallest node comes first: the base is then cut from vertex 0 on both of its sides.
    turned = np.stack([np.roll(np.arange(3), -k) for k in range(3)])
    lowest = np.argmin(prisms[:, :3], axis=1)
    order = np.concatenate([turned[lowest], turned[lowest] + 3], axis=1)
    p = np.take_along_axis(prisms, order, axis=1)
    rising = (p[:, 1] < p[:, 2])[:, None]
    cut = np.where(rising[:, :, None], _pick(p, ((0, 1, 2, 5), (0, 1, 5, 4), (0, 4, 5, 3))),
                   _pick(p, ((0, 1, 2, 4), (0, 4, 2, 5), (0, 4, 5, 3))))
    return cut.reshape(-1, 4)


def _pick(prisms: Integers, vertices: tuple[tuple[int, ...], ...]) -> Integers:
    return prisms[:, np.array(vertices)]
