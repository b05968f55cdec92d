"""A flat panel of any outline with round holes, in tetrahedra or prisms: triangles in the plane, and layers of them.

Nodes of the boundary are set first, spaced by `cell_size`; those inside begin on a lattice of equilateral triangles, away from the
boundary, and then move to the middle of their neighbours in Delaunay's triangulation, again and again. There is nothing random in it.
Each layer of prisms stands on the one below, and a prism is cut into three tetrahedra (boxes.py). Of second order the sides of these on
a hole are curved, their middles as far from its axis as their ends, unless that turned their cell over.

    places: z-min and z-max, edge-1, edge-2, ... of the outline as it is given, hole-1, hole-2, ...
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import Delaunay

from physics.mesh.mesh import Floats, Integers, Mesh, unique_edges
from physics.mesh.shapes.boxes import tetrahedra
from physics.mesh.shapes.graded import quality
from physics.mesh.sound.curved import complete, smallest_jacobian
from physics.mesh.sound.rows import rows_in
from physics.scene import Body
from physics.schema import InputError

ROUNDS, ANEW = 40, 8  # moves to the middle of neighbours, after so many of which the triangles are found anew
CLEAR = 0.7  # of a cell's size between the boundary and the nodes inside, where they begin
FEWEST = 8  # nodes around a hole
LEAST = 0.15  # quality of a triangle, 2 r / R of its circles
MOST = 400_000  # nodes


def panel(body: Body) -> Mesh:
    """The mesh of a panel.

    Raises:
        InputError: the outline crosses itself, a hole is not within it or too near to it, or the cells would be too flat or too many
    """
    assert body.outline is not None and body.height is not None and body.cell_size is not None and body.layers is not None
    size, outline, holes = body.cell_size, np.array(body.outline), np.array(body.holes or ()).reshape(-1, 3)
    if _area(outline) < 0:
        outline = outline[::-1]
    rings = [*_sides(outline, size), *(_rim(hole, size) for hole in holes)]
    loops = [np.concatenate(rings[:len(outline)]), *rings[len(outline):]]
    fixed = np.concatenate(loops)
    _check(outline, holes)
    points, cells = _filled(fixed, _lattice(outline, holes, size), loops)
    wanted = abs(_area(loops[0])) - sum(abs(_area(loop)) for loop in loops[1:])
    found = float(_twice(points, cells).sum()) / 2
    worst = float(quality(points, cells).min()) if len(cells) else 0.0
    if not abs(found - wanted) < 1e-9 * wanted or worst < LEAST or len(np.unique(cells)) < len(points):
        raise InputError(f"body: cells of {size:g} m do not fit this outline and these holes (the flattest triangle has the quality "
                         f"{worst:.2g}, {LEAST} at least); take smaller ones, blunter corners, or holes further from the edges")
    starts = np.cumsum([0, *(len(ring) for ring in rings)])
    edges = [np.append(np.arange(starts[k], starts[k + 1]), starts[(k + 1) % len(outline)]) for k in range(len(outline))]
    if _area(np.array(body.outline)) < 0:  # edge-1 is the one from the first point given to the second
        edges = [edges[(len(outline) - 2 - k) % len(outline)] for k in range(len(outline))]
    rims = [np.arange(starts[k], starts[k + 1]) for k in range(len(outline), len(rings))]
    mesh = _layers(points, cells, body, {f"edge-{k + 1}": nodes for k, nodes in enumerate(edges)} |
                   {f"hole-{k + 1}": nodes for k, nodes in enumerate(rims)})
    return _rounded(mesh, holes, rims, len(points)) if rims and body.order == 2 else mesh


def _rounded(mesh: Mesh, holes: Floats, rims: list[Integers], n: int) -> Mesh:
    """The panel with the middles of its curved cells of second order, from the nodes around each hole among the n of a layer."""
    edges = mesh.edges
    straight = mesh.points[edges].mean(axis=1)
    middles = straight.copy()
    for (*axis, radius), rim in zip(holes, rims, strict=True):
        along = np.full(n, -len(mesh.points))
        along[rim] = np.arange(len(rim))
        a, b = along[edges % n].T
        beside = (np.minimum(a, b) >= 0) & np.isin((a - b) % len(rim), (1, len(rim) - 1))
        away = middles[beside, :2] - axis
        middles[beside, :2] = axis + radius * away / np.hypot(*away.T)[:, None]
    left = 0
    while True:
        found = complete(mesh.points, mesh.cells, mesh.cell, {2: (edges, middles)})
        over = smallest_jacobian(mesh.points, mesh.cells, mesh.cell, found) <= 0
        if not over.any():
            break
        flat = rows_in(edges, unique_edges(mesh.cells[over], mesh.cell)) & (middles != straight).any(axis=1)
        middles[flat], left = straight[flat], left + int(flat.sum())
    said = (f"{left} sides of cells on holes are left straight: curved they would turn cells over; take another cell_size",) if left else ()
    return replace(mesh, middles=found, remarks=(*mesh.remarks, *said))


def _layers(points: Floats, cells: Integers, body: Body, rims: dict[str, Integers]) -> Mesh:
    """The panel that stands on triangles (C, 3) of points (n, 2), and its places."""
    assert body.height is not None and body.layers is not None
    n, layers = len(points), body.layers
    if n * (layers + 1) > MOST:
        raise InputError(f"body.cell_size: {n * (layers + 1)} nodes; at most {MOST}")
    levels = np.linspace(0.0, body.height, layers + 1)
    solid = np.column_stack([np.tile(points, (layers + 1, 1)), np.repeat(levels, n)])
    prisms = np.concatenate([np.concatenate([cells + k * n, cells + (k + 1) * n], axis=1) for k in range(layers)]).astype(np.int64)
    places = {"z-min": np.arange(n), "z-max": layers * n + np.arange(n)}
    places |= {name: np.sort((nodes + n * np.arange(layers + 1)[:, None]).ravel()) for name, nodes in rims.items()}
    return Mesh(solid, tetrahedra(prisms) if body.cell == "tetrahedron" else prisms, body.cell, places)


def _area(loop: Floats) -> float:
    """Of a closed line (n, 2), positive when it runs counter-clockwise."""
    x, y = loop.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def _sides(outline: Floats, size: float) -> list[Floats]:
    """The nodes along each side, without its end."""
    found = []
    for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        parts = max(1, round(float(np.hypot(*(b - a))) / size))
        found.append(a + np.arange(parts)[:, None] / parts * (b - a))
    return found


def _rim(hole: Floats, size: float) -> Floats:
    """The nodes around a hole (x, y, radius)."""
    angle = 2 * np.pi * np.arange(parts := max(FEWEST, round(2 * np.pi * hole[2] / size))) / parts
    return np.asarray(hole[:2] + hole[2] * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def _check(outline: Floats, holes: Floats) -> None:
    """Sides that meet nowhere but at their ends, holes that lie within the outline and apart. Raises `InputError`."""
    ends = np.roll(outline, -1, axis=0)
    for i in range(len(outline)):
        for j in range(i + 2, len(outline) - (i == 0)):
            a, b, c, d = outline[i], ends[i], outline[j], ends[j]
            turns = [np.sign((q - p)[0] * (r - p)[1] - (q - p)[1] * (r - p)[0]) for p, q, r in ((a, b, c), (a, b, d), (c, d, a), (c, d, b))]
            beside = np.minimum(np.maximum(a, b), np.maximum(c, d)) < np.maximum(np.minimum(a, b), np.minimum(c, d))  # also on one line
            if turns[0] * turns[1] <= 0 and turns[2] * turns[3] <= 0 and not beside.any():
                raise InputError(f"body.outline: its sides {i + 1} and {j + 1} meet")
    for k, (x, y, radius) in enumerate(holes):
        if not _inside(np.array([[x, y]]), outline)[0] or _to_sides(np.array([[x, y]]), outline)[0] <= radius:
            raise InputError(f"body.holes[{k}]: does not lie within the outline")
        near = np.hypot(*(holes[:k, :2] - (x, y)).T) <= holes[:k, 2] + radius
        if near.any():
            raise InputError(f"body.holes[{k}]: meets holes[{int(near.argmax())}]")


def _inside(points: Floats, loop: Floats) -> np.ndarray:
    """(n,) which points (n, 2) a closed line goes round; of those on a box, the ones on its left and lower side."""
    (x, y), (ax, ay), (bx, by) = points.T[:, :, None], loop.T, np.roll(loop, -1, axis=0).T
    crosses = (ay > y) != (by > y)
    at = ax + (y - ay) * np.divide(bx - ax, by - ay, out=np.zeros_like(ax), where=by != ay)
    return np.asarray((crosses & (x < at)).sum(axis=1) % 2 == 1)


def _to_sides(points: Floats, loop: Floats) -> Floats:
    """(n,) [m] the distance of points (n, 2) from a closed line."""
    way, along = points[:, None] - loop, np.roll(loop, -1, axis=0) - loop
    share = np.clip((way * along).sum(axis=2) / (along * along).sum(axis=1), 0, 1)
    return np.asarray(np.sqrt(((way - share[:, :, None] * along) ** 2).sum(axis=2)).min(axis=1))


def _lattice(outline: Floats, holes: Floats, size: float) -> Floats:
    """Where the nodes inside begin: corners of equilateral triangles of a size, about the middle of the panel."""
    (x0, y0), (x1, y1) = outline.min(axis=0), outline.max(axis=0)
    rows, columns = int((y1 - y0) / size * 2 / np.sqrt(3)) + 2, int((x1 - x0) / size) + 2
    if rows * columns > MOST:
        raise InputError(f"body.cell_size: {rows * columns} nodes; at most {MOST}")
    j, i = np.meshgrid(np.arange(rows) - rows // 2, np.arange(columns) - columns // 2, indexing="ij")
    points = np.stack([(i + j % 2 / 2) * size + (x0 + x1) / 2, j * size * np.sqrt(3) / 2 + (y0 + y1) / 2], axis=-1).reshape(-1, 2)
    points = points[_inside(points, outline)]
    clear = np.minimum.reduce([_to_sides(points, outline), *(np.hypot(*(points - hole[:2]).T) - hole[2] for hole in holes)])
    return np.asarray(points[clear > CLEAR * size])


def _filled(fixed: Floats, inner: Floats, loops: list[Floats]) -> tuple[Floats, Integers]:
    """Points (n, 2), the fixed ones first, and triangles (C, 3) when those inside have moved to the middle of their neighbours."""
    points = np.concatenate([fixed, inner])
    cells = _triangles(points, loops)
    for turn in range(ROUNDS):
        if turn and turn % ANEW == 0:
            cells = _triangles(points, loops)
        start, end = np.unique(np.concatenate([cells[:, pair] for pair in ([0, 1], [1, 2], [2, 0], [1, 0], [2, 1], [0, 2])]), axis=0).T
        count = np.maximum(np.bincount(start, minlength=len(points)), 1)
        middle = np.stack([np.bincount(start, points[end, k], len(points)) / count for k in (0, 1)], axis=1)
        points[len(fixed):] = middle[len(fixed):]
    return points, _triangles(points, loops)


def _triangles(points: Floats, loops: list[Floats]) -> Integers:
    """Delaunay's triangles within the outline and outside of the holes, counter-clockwise as SciPy gives them."""
    cells = Delaunay(points).simplices.astype(np.int64)
    middle = points[cells].mean(axis=1)
    kept = _inside(middle, loops[0])
    for loop in loops[1:]:
        kept &= ~_inside(middle, loop)
    cells = cells[kept]
    return np.asarray(cells[_twice(points, cells) > 1e-12 * np.ptp(points) ** 2])


def _twice(points: Floats, cells: Integers) -> Floats:
    """(C,) twice the area of triangles."""
    a, b, c = (points[cells[:, i]] for i in range(3))
    return np.asarray((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
