"""A plane channel with a round hole: rings of cells around the hole up to a box as high as the channel, then a grid.

The rings run along straight rays from the centre of the hole to the boundary of the box, so no cell turns over wherever the
hole lies; their thickness grows geometrically from the size of the cells on the hole to that on the box.

    places: x-min = inlet, x-max = outlet, y-min and y-max together = walls, hole

The hole is a polygon: its area, and with it every eigenvalue, converges with the square of the cell size.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physics.mesh.mesh import Floats, Integers, Mesh
from physics.mesh.shapes.boxes import faces
from physics.scene import Body

Block = tuple[Floats, Integers]  # points (N, 2), quadrilaterals (C, 4)


def channel(body: Body) -> Mesh:
    """The mesh of a body of shape "channel", in triangles or quadrilaterals of about `cell_size`."""
    length, height, _ = body.extent
    assert body.hole_centre is not None and body.hole_radius is not None and body.cell_size is not None
    x, y = body.hole_centre
    size, half = body.cell_size, max(y, height - y)
    left = x - half if x - half > size / 2 else 0.0
    right = x + half if x + half < length - size / 2 else length
    rows = max(2, round(height / size))
    blocks = [_rings(left, right, height, np.array([x, y]), body.hole_radius, rows, max(2, round((right - left) / size)))]
    for start, end in ((0.0, left), (right, length)):
        if end > start:
            blocks.append(_grid(start, end, height, max(1, round((end - start) / size)), rows))
    points, cells = _merge(blocks, 1e-9 * length)
    if body.cell == "triangle":
        cells = _triangles(points, cells)
    points = np.pad(points, ((0, 0), (0, 1)))
    places = faces(points, body.extent)
    distance = np.hypot(*(points[:, :2] - (x, y)).T)
    places |= {"inlet": places["x-min"], "outlet": places["x-max"], "walls": np.union1d(places["y-min"], places["y-max"]),
               "hole": np.flatnonzero(abs(distance - body.hole_radius) < 1e-9 * length)}
    return Mesh(points, cells, body.cell, places)


def _grid(start: float, end: float, height: float, columns: int, rows: int) -> Block:
    """A rectangle of columns x rows."""
    x, y = np.linspace(start, end, columns + 1), np.linspace(0.0, height, rows + 1)
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    node = np.arange(len(points)).reshape(columns + 1, rows + 1)
    return points, np.stack([node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]], axis=-1).reshape(-1, 4)


def _rings(left: float, right: float, height: float, centre: Floats, radius: float, rows: int, columns: int) -> Block:
    """The box from x = left to right, of all the height, with a round hole in it."""
    x, y = np.linspace(left, right, columns + 1), np.linspace(0.0, height, rows + 1)
    outer = np.concatenate([np.stack(np.broadcast_arrays(a, b), axis=-1) for a, b in (
        (x[:-1], 0.0), (right, y[:-1]), (x[:0:-1], height), (left, y[:0:-1]))])  # (P, 2) counter-clockwise
    ray = outer - centre
    reach = np.hypot(*ray.T)[:, None]
    inner = centre + radius * ray / reach
    # Thickness of the rings: from the spacing on the hole to that on the box.
    fine, coarse = 2 * np.pi * radius / len(outer), 2 * (right - left + height) / len(outer)
    growth = coarse / fine  # 4 / pi at least: the box holds the hole
    depth = float((reach - radius).mean())
    count = max(2, round(depth * np.log(growth) / (growth - 1) / fine))
    ratio = growth ** (1 / count)
    steps = ratio ** np.arange(count)
    t = np.concatenate([[0.0], np.cumsum(steps) / steps.sum()])[:, None, None]
    points = ((1 - t) * inner + t * outer).reshape(-1, 2)
    points[-len(outer):] = outer  # to the last bit, so that it meets the grid
    node = np.arange(len(points)).reshape(count + 1, len(outer))
    turn = np.roll(node, -1, axis=1)
    return points, np.stack([node[:-1], node[1:], turn[1:], turn[:-1]], axis=-1).reshape(-1, 4)


def _merge(blocks: list[Block], tolerance: float) -> Block:
    """One mesh of several blocks, nodes at the same place made one."""
    points = np.concatenate([block[0] for block in blocks])
    first = np.cumsum([0] + [len(block[0]) for block in blocks[:-1]])
    cells = np.concatenate([block[1] + start for start, block in zip(first, blocks, strict=True)])
    _, kept, number = np.unique(np.round(points / tolerance), axis=0, return_index=True, return_inverse=True)
    return points[kept], number.reshape(-1)[cells].astype(np.int64)


def _triangles(points: Floats, cells: Integers) -> NDArray[np.int64]:
    """Each quadrilateral cut along its shorter diagonal; of equal ones, in turns."""
    a, b, c, d = cells.T
    first, second = (np.hypot(*(points[i] - points[j]).T) for i, j in ((a, c), (b, d)))
    equal = abs(first - second) < 1e-9 * first
    along = np.where(equal, np.arange(len(cells)) % 2 == 0, first < second)[:, None]
    one = np.where(along, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    two = np.where(along, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    return np.stack([one, two], axis=1).reshape(-1, 3)
