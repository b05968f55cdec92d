"""A plane channel with a round hole in triangles that grow away from the hole, its rim curved.

Size of the cells at distance d from the hole and w from the nearer wall:

    h = min(cell_size, hole_cell_size + GROWTH d, (d + w) / ACROSS)

so that ACROSS cells fit in a gap beside the hole. Nodes on the boundary are set first, spaced by h, two of the rim's foremost and
rearmost. Those inside begin where a sequence of low discrepancy puts them (Halton's, thinned by h), and then push one another
along the edges of their Delaunay triangulation like springs that are shorter than they want to be (Persson and Strang, SIAM Review
46, 2004), until the triangles are nearly equilateral. There is nothing random in it.

    places: x-min = inlet, x-max = outlet, y-min and y-max together = walls, hole
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import Delaunay

from physics.mesh.mesh import Floats, Integers, Mesh
from physics.mesh.shapes.boxes import faces
from physics.mesh.sound.curved import complete
from physics.scene import Body
from physics.schema import InputError

GROWTH, ACROSS = 0.2, 2.5
ROUNDS, STRETCH, PUSH = 60, 1.2, 0.2  # of the springs: how often they push, what they want to be of h, the share of a push
LEAST = 0.2  # quality of a triangle, 2 r / R of its circles
MOST = 400_000  # nodes
DRAWS = 50_000  # at a time

Size = Callable[[Floats], Floats]


def graded_channel(body: Body) -> Mesh:
    """The mesh of a channel with a `hole_cell_size`. Raises `InputError` when its cells would be too flat or too many."""
    length, height, _ = body.extent
    assert body.hole_centre is not None and body.hole_radius is not None
    extent, centre, radius = np.array([length, height]), np.array(body.hole_centre), body.hole_radius
    size = _size(body)
    rim = centre + radius * _directions(_rim(size, centre, radius))
    nodes = np.concatenate([rim, _sides(size, extent)])
    inner = _inside(size, extent, centre, radius, len(nodes))
    points, cells = _relaxed(nodes, inner, size, extent, centre, radius)
    if (worst := float(quality(points, cells).min())) < LEAST:
        raise InputError(f"body.hole_cell_size = {body.hole_cell_size:g}: leads to cells that are too flat (quality {worst:.2g}, "
                         f"{LEAST} at least); take another one")
    points = np.pad(points, ((0, 0), (0, 1)))
    places = faces(points, body.extent)
    places |= {"inlet": places["x-min"], "outlet": places["x-max"], "walls": np.union1d(places["y-min"], places["y-max"]),
               "hole": np.arange(len(rim))}
    edges = np.sort(np.stack([np.arange(len(rim)), np.roll(np.arange(len(rim)), 1)], axis=1), axis=1)
    middle = points[edges].mean(axis=1)[:, :2] - centre
    arcs = centre + radius * middle / np.hypot(*middle.T)[:, None]
    rim_middles = {2: (edges, np.pad(arcs, ((0, 0), (0, 1))))}
    return Mesh(points, cells, "triangle", places, middles=complete(points, cells, "triangle", rim_middles))


def _size(body: Body) -> Size:
    assert body.hole_centre is not None and body.hole_radius is not None and body.cell_size is not None
    assert body.hole_cell_size is not None and body.height is not None
    coarse, fine, centre, radius, height = body.cell_size, body.hole_cell_size, np.array(body.hole_centre), body.hole_radius, body.height

    def size(points: Floats) -> Floats:
        """(n,) at points (n, 2)."""
        away = np.maximum(np.hypot(*(points - centre).T) - radius, 0.0)
        wall = np.maximum(np.minimum(points[:, 1], height - points[:, 1]), 0.0)
        found: Floats = np.minimum(np.minimum(coarse, fine + GROWTH * away), (away + wall) / ACROSS + 1e-9 * height)
        return found

    return size


def _spaced(size: Size, points: Floats) -> Floats:
    """Shares of a line through points (n, 2), 0 and 1 among them, that are spaced by a size."""
    lengths, rates = np.hypot(*np.diff(points, axis=0).T), 1 / size(points)
    passed = np.concatenate([[0.0], np.cumsum(lengths * (rates[1:] + rates[:-1]) / 2)])
    count = max(1, round(float(passed[-1])))
    return np.interp(np.linspace(0, passed[-1], count + 1), passed, np.linspace(0, 1, len(points)))


def _rim(size: Size, centre: Floats, radius: float) -> Floats:
    """The angles of the nodes on the hole, from 0 on, pi among them."""
    halves = []
    for start in (0.0, np.pi):
        shares = _spaced(size, centre + radius * _directions(start + np.pi * np.linspace(0, 1, 1001)))
        shares = shares if len(shares) > 4 else np.linspace(0, 1, 5)
        halves.append(start + np.pi * shares[:-1])
    return np.concatenate(halves)


def _directions(angles: Floats) -> Floats:
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _sides(size: Size, extent: Floats) -> Floats:
    """The nodes on the sides, the corners once."""
    found, share = [], np.linspace(0, 1, 2001)[:, None]
    for axis in (0, 1):
        for end in (0.0, extent[1 - axis]):
            line = np.full((len(share), 2), end)
            line[:, axis] = share[:, 0] * extent[axis]
            at = _spaced(size, line) * extent[axis]
            side = np.full((len(at), 2), end)
            side[:, axis] = at
            found.append(side if axis == 0 else side[1:-1])
    return np.concatenate(found)


def _inside(size: Size, extent: Floats, centre: Floats, radius: float, boundary: int) -> Floats:
    """Where the nodes inside begin."""
    columns, rows = (int(n) for n in np.minimum(np.ceil(8 * extent / extent.min()), 2000) * 8)
    grid = (np.stack(np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5, indexing="ij"), axis=-1) / [columns, rows]).reshape(-1, 2)
    grid = grid * extent
    grid = grid[np.hypot(*(grid - centre).T) > radius]
    sizes = size(grid)
    # A node of equilateral triangles has the area sqrt(3) / 2 h^2, one on the boundary half of it.
    wanted = max(1, round(float((2 / np.sqrt(3) / sizes**2).sum()) * float(np.prod(extent)) / (columns * rows) - boundary / 2))
    if wanted + boundary > MOST:
        raise InputError(f"body.cell_size: {wanted + boundary} nodes; at most {MOST}")
    least, found, start = float(sizes.min()), np.empty((0, 2)), 1
    while len(found) < wanted:
        draws = np.stack([_halton(base, 1 + DRAWS * (start - 1)) for base in (2, 3, 5)], axis=1)
        points = draws[:, :2] * extent
        sizes = size(points)
        clear = np.minimum.reduce([*points.T, *(extent - points).T, np.hypot(*(points - centre).T) - radius])
        found = np.concatenate([found, points[(draws[:, 2] < (least / sizes) ** 2) & (clear > 0.5 * sizes)]])
        start += 1
        if start > 200:
            raise InputError("body.hole_cell_size: too small beside cell_size")
    return found[:wanted]


def _halton(base: int, start: int) -> Floats:
    """(DRAWS,) of Halton's sequence from a number on: sum_k d_k base^-(k+1) of the digits d_k of each number."""
    left, share, found = start + np.arange(DRAWS), 1 / base, np.zeros(DRAWS)
    while left.any():
        left, digit = np.divmod(left, base)
        found, share = found + share * digit, share / base
    return found


def _relaxed(fixed: Floats, inner: Floats, size: Size, extent: Floats, centre: Floats, radius: float) -> tuple[Floats, Integers]:
    """Points (N, 2) and triangles (C, 3) when the springs have pushed."""
    points = np.concatenate([fixed, inner])
    before = np.full_like(points, np.inf)
    for _ in range(ROUNDS):
        sizes = size(points)
        if (np.hypot(*(points - before).T) > 0.1 * sizes).any():
            cells = _triangles(points, centre, radius)
            sides = np.sort(np.concatenate([cells[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), axis=1)
            edges = np.stack(np.divmod(np.unique(sides[:, 0] * len(points) + sides[:, 1]), len(points)), axis=1)
            before = points.copy()
        along = points[edges[:, 0]] - points[edges[:, 1]]
        length = np.hypot(*along.T)
        wanted = sizes[edges].mean(axis=1)
        wanted *= STRETCH * np.sqrt((length**2).sum() / (wanted**2).sum())
        push = (PUSH * np.maximum(wanted - length, 0.0) / length)[:, None] * along
        for axis in (0, 1):
            points[len(fixed):, axis] += sum(sign * np.bincount(edges[:, end], push[:, axis], len(points))[len(fixed):]
                                             for end, sign in ((0, 1), (1, -1)))
        near = 0.5 * sizes[len(fixed):, None]
        moved = np.clip(points[len(fixed):], 0.8 * near, extent - 0.8 * near)
        away = moved - centre
        reach = np.hypot(*away.T)[:, None]
        points[len(fixed):] = np.where(reach < radius + near, centre + away / reach * (radius + near), moved)
    return points, _triangles(points, centre, radius)


def _triangles(points: Floats, centre: Floats, radius: float) -> Integers:
    """Delaunay's triangles outside of the hole, counter-clockwise as SciPy gives them."""
    cells = Delaunay(points).simplices.astype(np.int64)
    on_rim = abs(np.hypot(*(points - centre).T) - radius) < 1e-9 * radius
    cells = cells[~on_rim[cells].all(axis=1)]
    a, b, c = (points[cells[:, i]] for i in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return cells[area > 1e-12 * radius**2]


def quality(points: Floats, cells: Integers) -> Floats:
    """(C,) twice the radius of each triangle's inner circle over that of its outer one: 1 for an equilateral one."""
    a, b, c = (np.hypot(*(points[cells[:, i]] - points[cells[:, j]]).T) for i, j in ((1, 2), (2, 0), (0, 1)))
    return (b + c - a) * (c + a - b) * (a + b - c) / (a * b * c)
