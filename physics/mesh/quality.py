"""How good a deformed mesh is: against a true one, and by itself.

Against the truth: rmse, rmsd, Hausdorff GF_h, Chamfer GF_c, and the errors of mesh continuity MC and aspect ratio AR. By itself:
cell volumes, det F (F the deformation gradient of the isoparametric map), scaled Jacobian. GF_h, GF_c, MC
and AR follow the M4GN paper (appendix "Metrics for Mesh Quality Measure"), which takes them at every step and averages.

Legend: N nodes, C cells, n nodes of a cell, Q sample points of a cell; "..." any leading axes, usually the T frames.
Coordinates are Cartesian [m]. Cells are in gmsh's order, which at rest gives positive volume.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from physics.mesh.cell import CELLS, CORNERS, CURVED_TETRAHEDRON, GAUSS
from physics.schema import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Volume of the ideal cell with edges of length 1, and what makes its scaled Jacobian 1.
IDEAL_VOLUME = {"prism": 3**0.5 / 4, "hexahedron": 1.0}
IDEAL_CORNER = {"triangle": 2 / 3**0.5, "quadrilateral": 1.0, "tetrahedron": 2**0.5, "prism": 2 / 3**0.5, "hexahedron": 1.0}
FLAT = 1e-12  # of a cell's largest Jacobian determinant
CHUNK = 4_000_000  # floats held at once while the frames are worked through


def rmsd(prediction: ArrayLike, reference: ArrayLike, nodes: ArrayLike | slice = slice(None)) -> float:
    """Root mean square distance, sqrt(mean over frames and nodes of |prediction - reference|^2) [m], |.| the length of the vector.

    Args:
        prediction, reference: (..., N, D)
        nodes: (N,) bool or node numbers, those that count
    """
    return float(np.sqrt(np.mean(np.sum(_squares(prediction, reference, nodes), axis=-1))))


def rmse(prediction: ArrayLike, reference: ArrayLike, nodes: ArrayLike | slice = slice(None), *, by_step: bool = False,
         space: int = 3) -> float:
    """Root mean square error of a coordinate [m], as DeepMind's evaluation of MeshGraphNets counts, and papers after it.

    sqrt(mean over frames, nodes and components of (prediction - reference)^2), which is rmsd / sqrt(space).

    Args:
        prediction, reference, nodes: as of rmsd, with frames in front
        by_step: the mean over frames of each frame's own root, which is never more
        space: how many components count: 2 for a body in a plane, whose third is always zero
    """
    squares = np.sum(_squares(prediction, reference, nodes), axis=-1) / space
    return float(np.mean(np.sqrt(np.mean(squares, axis=-1))) if by_step else np.sqrt(np.mean(squares)))


def _squares(prediction: ArrayLike, reference: ArrayLike, nodes: ArrayLike | slice) -> Floats:
    """(..., n, D) squared errors of the chosen nodes."""
    # Only the chosen nodes are copied; in float64, because the square of a float32 error of 1e-20 m would be lost.
    chosen = nodes if isinstance(nodes, slice) else np.asarray(nodes)
    error = np.asarray(prediction)[..., chosen, :].astype(np.float64) - np.asarray(reference)[..., chosen, :]
    squares: Floats = error**2
    return squares


def set_distances(a: ArrayLike, b: ArrayLike) -> tuple[float, float]:
    """GF_h [m] and GF_c [m^2] of two sets of nodes a (N, 3) and b (M, 3).

    GF_h, Hausdorff: the largest distance from a node of one set to the nearest node of the other.
    GF_c, Chamfer: the mean over a of the squared distance to the nearest node of b, plus the same from b to a.
    """
    there, back = _gaps(a, b)
    return float(max(there.max(), back.max())), float(np.mean(there**2) + np.mean(back**2))


def _gaps(a: ArrayLike, b: ArrayLike) -> tuple[Floats, Floats]:
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        gap = np.full(1, np.inf)  # a prediction that blew up is infinitely far away
        return gap, gap
    # Nodes of a structured mesh lie in planes, where splitting at the middle of the box is much faster than at the median.
    trees = [cKDTree(nodes, balanced_tree=False, compact_nodes=False) for nodes in (a, b)]
    return trees[1].query(a)[0], trees[0].query(b)[0]


def cell_volumes(points: ArrayLike, cells: Integers, cell: str) -> Floats:
    """(..., C) volume [m^3], negative where a cell is turned inside out; of plane cells the area [m^2], which has no sign.

    The volume of the isoparametric map, integrated exactly: det J is of degree 2 at most in each coordinate, of second order 5.
    """
    positions = np.asarray(points, np.float64)
    if CELLS[cell].dimension == 2 and not CELLS[cell].middles:
        corners = positions[..., cells, :]  # (..., C, n, 3)
        one, other = (corners[..., 1, :], corners[..., 2, :]) if cell == "triangle" else (corners[..., 2, :], corners[..., 3, :])
        return np.linalg.norm(np.cross(one - corners[..., 0, :], other - corners[..., cells.shape[1] - 3, :]), axis=-1) / 2
    weights = _samples(cell)[1]
    kept = np.flatnonzero(weights)
    chunks = [np.tensordot(weights[kept], part, 1) for part in _jacobians(positions, cells, cell, kept)]  # each (C, t)
    volumes = _by_frame(chunks, positions)
    return volumes if CELLS[cell].dimension == 3 else abs(volumes)


def det_f(points: ArrayLike, displacement: ArrayLike, cells: Integers, cell: str) -> Floats:
    """(..., C) smallest det F = det J(x) / det J(X) in each cell, over its vertices and its quadrature points.

    J is the Jacobian of the isoparametric map, X = points (N, 3) the rest positions, x = X + displacement (..., N, 3) [m]. Plane
    cells are looked at from z: J is that of x and y.
    The quadrature points are those of degree 2; of cells of second order, where all nodes count, those of degree 3 in a tetrahedron,
    4 in a triangle and 5 in the others: in a hexahedron of first order 2 x 2 x 2 Gauss points, in a prism the heights of the two
    Gauss points at the triangle's vertices (det J is linear across the triangle, so this bounds all points at that height).
    """
    x = np.asarray(points, np.float64) + np.asarray(displacement, np.float64)
    rest = rest_jacobians(points, cells, cell)[:, :, None]
    flat = np.isnan(rest)
    ratios = (part / np.where(flat, 1.0, rest) for part in _jacobians(x, cells, cell))
    return _by_frame([np.where(flat, np.inf, ratio).min(axis=0) for ratio in ratios], x)


def rest_jacobians(points: ArrayLike, cells: Integers, cell: str) -> Floats:
    """(Q, C) det J of rest positions (N, 3), nan where no ratio to it says anything. Raises `InputError` where cells are inverted."""
    rest: Floats = np.concatenate(list(_jacobians(np.asarray(points, np.float64), cells, cell)), axis=2)[:, :, 0]
    flat = abs(rest) <= FLAT * rest.max(axis=0)  # as at a corner where two sides form one line
    if (wrong := ((rest <= 0) & ~flat).any(axis=0) | (rest.max(axis=0) <= 0)).any():
        raise InputError(f"{int(wrong.sum())} of {len(cells)} cells are inverted in the rest state")
    return np.where(flat, np.nan, rest)


def slopes(cell: str) -> Floats:
    """(Q, n, 3) gradients of the shape functions in the cell's coordinates, at the points that det F is looked at."""
    return _samples(cell)[0]


def centre_gradients(cell: str) -> Floats:
    """(n, 3) gradients of the shape functions at a cell's centre in its coordinates: of first order linear, so the vertices' mean."""
    if CELLS[cell].middles:
        return CELLS[cell].shapes(CELLS[cell].places[:CELLS[cell].corners].mean(axis=0))[1]
    gradients = _samples(cell)[0]
    return gradients[:gradients.shape[1]].mean(axis=0)


def smallest_det_f(points: ArrayLike, displacement: ArrayLike, cells: Integers, cell: str) -> Floats:
    """(...) smallest det F of the whole mesh, as in `det_f`."""
    return det_f(points, displacement, cells, cell).min(axis=-1)


def mesh_continuity(points: ArrayLike, cells: Integers, cell: str) -> Floats:
    """(...) MC: mean over the cells of (largest / smallest volume of the cell's neighbours), at least 1.

    Neighbours share a facet (triangles: an edge). As the paper's formula stands, the cell itself is not among its
    neighbours, and one with a single neighbour counts 1. Volumes enter by their size: inversion is counted elsewhere.
    """
    cells, cell = _corners(cells, cell)
    size = abs(cell_volumes(points, cells, cell))
    beside = _neighbours(cells, cell)
    largest, smallest = size[..., beside[:, 0]], size[..., beside[:, 0]]
    for column in beside.T[1:]:
        largest, smallest = np.maximum(largest, size[..., column]), np.minimum(smallest, size[..., column])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.mean(largest / smallest, axis=-1)


def aspect_ratio(points: ArrayLike, cells: Integers, cell: str) -> Floats:
    """(..., C) longest edge over a length made of the area A or volume V.

    triangle     L / (2 sqrt(sqrt(3) A))         as the paper prints it: 1/sqrt(3) = 0.577 for the equilateral one
    tetrahedron  sqrt(6) L / V^(1/3)             as the paper prints it: 4.996 for the regular one
    prism        L (sqrt(3) / (4 V))^(1/3)       own: 1 for the prism whose edges are all equal and normal to its triangles
    hexahedron   L / V^(1/3)                     own: 1 for the cube
    quadrilateral  L / A^(1/2)                   own: 1 for the square
    """
    cells, cell = _corners(cells, cell)
    longest = np.sqrt(_squared_edges(np.asarray(points, np.float64), cells, cell).max(axis=0))
    size = abs(cell_volumes(points, cells, cell))
    with np.errstate(divide="ignore"):
        if cell == "triangle":
            return longest / (2 * np.sqrt(3**0.5 * size))
        if cell == "tetrahedron":
            return 6**0.5 * longest / np.cbrt(size)
        if cell == "quadrilateral":
            return longest / np.sqrt(size)
        return longest / np.cbrt(size / IDEAL_VOLUME[cell])


def scaled_jacobian(points: ArrayLike, cells: Integers, cell: str) -> Floats:
    """(..., C) smallest over the vertices of det(three edges) / product of their lengths: 1 in the ideal cell, 0 when flat.

    As VTK's and Verdict's (Stimpson et al. 2007), which for a hexahedron look at its centre as well.
    """
    positions = np.asarray(points, np.float64)
    cells, cell = _corners(cells, cell)
    even = cell in ("triangle", "tetrahedron")  # det J is the same everywhere
    vertices = np.zeros(cells.shape[1], int) if even else np.arange(cells.shape[1])
    corners = _by_frame(list(_jacobians(positions, cells, cell, vertices)), positions)  # (n, ..., C)
    squared = _squared_edges(positions, cells, cell)
    lengths = [np.sqrt(np.prod([squared[e] for e, edge in enumerate(CELLS[cell].edges) if vertex in edge], axis=0))
               for vertex in range(cells.shape[1])]
    return IDEAL_CORNER[cell] * np.min([corner / length for corner, length in zip(corners, lengths, strict=True)], axis=0)


def _corners(cells: Integers, cell: str) -> tuple[Integers, str]:
    """Of cells of second order those of first order with the same corners, whose shape is what is judged."""
    return (cells[:, :CELLS[cell].corners], CELLS[cell].first) if CELLS[cell].first else (cells, cell)


def _squared_edges(points: Floats, cells: Integers, cell: str) -> Floats:
    """(edges of a cell, ..., C) squared lengths."""
    pairs = [(cells[:, i], cells[:, j]) for i, j in CELLS[cell].edges]
    return np.stack([np.sum((points[..., j, :] - points[..., i, :])**2, axis=-1) for i, j in pairs])


def _neighbours(cells: Integers, cell: str) -> Integers:
    """(C, most neighbours) the cells that share a facet; short rows repeat the first one, a lone cell names itself."""
    facets = CELLS[cell].facets
    keys = np.concatenate([np.pad(np.sort(cells[:, list(facet)], axis=1), ((0, 0), (4 - len(facet), 0)), constant_values=-1)
                           for facet in facets])
    owner = np.tile(np.arange(len(cells)), len(facets))
    order = np.lexsort(keys.T)
    keys, owner = keys[order], owner[order]
    shared = np.flatnonzero((keys[1:] == keys[:-1]).all(axis=1))
    pairs = np.stack([owner[shared], owner[shared + 1]], axis=1)
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    pairs = pairs[np.argsort(pairs[:, 0], kind="stable")]
    count = np.bincount(pairs[:, 0], minlength=len(cells))
    first = np.cumsum(count) - count
    table = np.repeat(np.arange(len(cells))[:, None], max(1, count.max(initial=0)), axis=1)
    known = count > 0
    column = np.arange(table.shape[1])
    table[known] = pairs[first[known, None] + np.where(column < count[known, None], column, 0), 1]
    return table


@cache
def _samples(cell: str) -> tuple[Floats, Floats]:
    """(Q, n, 3) gradients of the shape functions in the cell's coordinates, vertices first; (Q,) weights of the volume."""
    points, weights = CELLS[cell].points, CELLS[cell].weights
    if cell not in ("triangle", "tetrahedron"):  # whose gradients are the same everywhere
        nodes = CELLS[cell].places if CELLS[cell].middles else CORNERS[cell]
        if cell == "tetrahedron10":
            points, weights = CURVED_TETRAHEDRON
        elif cell == "prism":
            points = np.array([(r, s, GAUSS[int(t)]) for r, s, t in nodes])
        points, weights = np.concatenate([nodes, points]), np.concatenate([np.zeros(len(nodes)), weights])
    return CELLS[cell].shapes(points)[1], weights


def _jacobians(points: Floats, cells: Integers, cell: str, kept: Integers | slice = slice(None)) -> Iterator[Floats]:
    """(Q, C, t) det J at the kept sample points, some frames at a time."""
    gradients = _samples(cell)[0][kept].transpose(0, 2, 1)  # (Q, 3, n)
    frames = points.reshape(-1, *points.shape[-2:])  # (T, N, 3)
    step = max(1, CHUNK // (9 * len(gradients) * len(cells)))
    for start in range(0, len(frames), step):
        nodes = frames[start:start + step].transpose(2, 1, 0)[:, cells.T]  # (3, n, C, t)
        x, y, z = (np.tensordot(gradients, part, 1) for part in nodes)  # each (Q, 3, C, t)
        if CELLS[cell].dimension == 2:
            yield x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]
            continue
        yield (x[:, 0] * (y[:, 1] * z[:, 2] - y[:, 2] * z[:, 1]) + x[:, 1] * (y[:, 2] * z[:, 0] - y[:, 0] * z[:, 2])
               + x[:, 2] * (y[:, 0] * z[:, 1] - y[:, 1] * z[:, 0]))


def _by_frame(chunks: list[Floats], points: Floats) -> Floats:
    """(leading, ..., C) from chunks (leading, C, t), where ... are the leading axes of the points."""
    whole = np.concatenate(chunks, axis=-1)
    return np.moveaxis(whole, -1, -2).reshape(*whole.shape[:-2], *points.shape[:-2], whole.shape[-2])
