"""Do the cells fit together? Faces of three cells, cells over one another, nodes on sides of other cells, pieces that share no node.

Cells hang together at the nodes that they share and nowhere else. Where one ends in the middle of another's side, the body is torn
there without a word; so this is looked for, among the facets that only one cell has.

Legend: C cells, F facets, k corners of a facet.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from physics.mesh.cell import CELLS
from physics.mesh.sound.cells import Called
from physics.mesh.sound.rows import keyed
from physics.schema import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

NEAR = 1e-6  # of a facet's size: files with few digits


def fitting(points: Floats, cells: Integers, kind: str, cell: Called, node: Called) -> list[str]:
    """Remarks about pieces and nodes at the same place. Raises `InputError` where cells cannot be meant as they stand."""
    outer, owner = [], []
    for facets, cell_of in _facets(cells, kind):
        key = np.sort(facets, axis=1)
        order = np.lexsort(key.T)
        key, facets, cell_of = key[order], facets[order], cell_of[order]
        new = np.concatenate([[True], (key[1:] != key[:-1]).any(axis=1)])
        start = np.flatnonzero(new)
        count = np.diff(np.append(start, len(key)))
        if (many := start[count > 2]).size:
            three = sorted(cell_of[many[0]:many[0] + 3].tolist())
            side = "an edge" if facets.shape[1] == 2 else "a face"
            raise InputError(f"{', '.join(map(cell, three))} share one side; {side} has cells on two sides at most")
        two = start[count == 2]
        if (wrong := two[~_reversed(facets[two], facets[two + 1])]).size:
            pair = sorted(cell_of[wrong[0]:wrong[0] + 2].tolist())
            raise InputError(f"{' and '.join(map(cell, pair))} lie over one another: they are on the same side of a side that they share")
        outer.append(facets[start[count == 1]])
        owner.append(cell_of[start[count == 1]])
    label = piece_of(len(points), cells)
    hanging = _on_sides(points, cells, outer, owner)
    for place, at in hanging:
        if label[place] == label[cells[at, 0]]:
            raise InputError(f"node {node(place)} lies on a side of {cell(at)} and is none of its corners: "
                             "the cells do not fit together there")
    return _pieces_said(points, cells, label, len({place for place, _ in hanging}))


def piece_of(nodes: int, cells: Integers) -> Integers:
    """(N,) the number of the piece that each node belongs to: nodes of one cell are in one piece."""
    links = np.stack([np.repeat(cells[:, 0], cells.shape[1] - 1), cells[:, 1:].ravel()])
    graph = scipy.sparse.coo_matrix((np.ones(links.shape[1], np.int8), links), shape=(nodes, nodes))
    return scipy.sparse.csgraph.connected_components(graph, directed=False)[1].astype(np.int64)


def joined(cells: Integers, kind: str) -> Integers:
    """(C,) the number of the part that each cell belongs to: cells that share a facet are in one part, and cannot turn against it."""
    first, second = [], []
    for facets, cell_of in _facets(cells, kind):
        key = keyed(np.sort(facets, axis=1))
        order = key.argsort(kind="stable")
        alike = np.flatnonzero(np.diff(key[order]) == 0)
        first.append(cell_of[order][alike])
        second.append(cell_of[order][alike + 1])
    links = np.stack([np.concatenate(first), np.concatenate(second)])
    graph = scipy.sparse.coo_matrix((np.ones(links.shape[1], np.int8), links), shape=(len(cells), len(cells)))
    return scipy.sparse.csgraph.connected_components(graph, directed=False)[1].astype(np.int64)


def _facets(cells: Integers, kind: str) -> list[tuple[Integers, Integers]]:
    """Facets (F, k) with the cells that they belong to (F,), for each number of nodes k."""
    found = []
    for k in (2, 3, 4, 6, 9):
        local = [facet for facet in CELLS[kind].facets if len(facet) == k]
        if local:
            found.append((np.concatenate([cells[:, list(facet)] for facet in local]), np.tile(np.arange(len(cells)), len(local))))
    return found


def _reversed(one: Integers, other: Integers) -> NDArray[np.bool_]:
    """(F,) whether two facets of the same corners (F, k) go round them in opposite ways."""
    k = one.shape[1]
    if k == 2:  # a round of two is its own reverse
        return (other == one[:, ::-1]).all(axis=1)
    first = (other == one[:, :1]).argmax(axis=1)
    back = np.take_along_axis(other, (first[:, None] - np.arange(k)) % k, axis=1)
    return (back == one).all(axis=1)


def _on_sides(points: Floats, cells: Integers, outer: list[Integers], owner: list[Integers]) -> list[tuple[int, int]]:
    """Nodes of other cells that lie inside an outer facet, or on an edge of it, and at no corner: node and cell."""
    rim = np.unique(np.concatenate([facets.ravel() for facets in outer]))
    tree = cKDTree(points[rim])
    shortest = min(float(np.linalg.norm(points[facets] - points[np.roll(facets, 1, axis=1)], axis=2).min())
                   for facets in outer if len(facets))
    found = []
    for facets, cell_of in zip(outer, owner, strict=True):
        x = points[facets]
        centre = x.mean(axis=1)
        radius = np.linalg.norm(x - centre[:, None], axis=2).max(axis=1)
        near = tree.query_ball_point(centre, radius * (1 + NEAR)) if len(facets) else []
        number = np.repeat(np.arange(len(facets)), [len(some) for some in near])
        place = rim[np.concatenate([np.asarray(some, np.int64) for some in near])] if len(facets) else number
        other = (cells[cell_of[number]] != place[:, None]).all(axis=1)
        number, place = number[other], place[other]
        limit = np.minimum(NEAR * radius, 1e-3 * shortest)[number]
        apart = np.linalg.norm(x[number] - points[place][:, None], axis=2).min(axis=1) > limit  # at a corner it is another matter
        inside = _distance(x[number], points[place]) <= limit
        found += list(zip(place[apart & inside].tolist(), cell_of[number[apart & inside]].tolist(), strict=True))
    return found


def _distance(x: Floats, p: Floats) -> Floats:
    """(m,) distances of points (m, 3) from facets (m, k, 3); a quadrilateral counts as the triangles of either diagonal."""
    if x.shape[1] == 2:
        along = x[:, 1] - x[:, 0]
        share = np.clip(((p - x[:, 0]) * along).sum(axis=1) / (along**2).sum(axis=1), 0, 1)
        return np.linalg.norm(p - x[:, 0] - share[:, None] * along, axis=1)
    if x.shape[1] == 4:
        halves = ([0, 1, 2], [0, 2, 3], [0, 1, 3], [1, 2, 3])
        return np.minimum.reduce([_distance(x[:, half], p) for half in halves])
    a, b = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]
    normal = np.cross(a, b)
    size = np.maximum((normal**2).sum(axis=1), np.finfo(float).tiny)
    d = p - x[:, 0]
    s = (np.cross(d, b) * normal).sum(axis=1) / size
    t = (np.cross(a, d) * normal).sum(axis=1) / size
    within = (s >= 0) & (t >= 0) & (s + t <= 1)
    edges = np.minimum.reduce([_distance(x[:, [i, j]], p) for i, j in ((0, 1), (1, 2), (2, 0))])
    return np.where(within, abs((d * normal).sum(axis=1)) / np.sqrt(size), edges)


def _pieces_said(points: Floats, cells: Integers, label: Integers, on_sides: int) -> list[str]:
    """What should be said when a mesh is of several pieces: their sizes and places, and whether they touch."""
    count = int(label.max()) + 1
    if count == 1:
        return []
    said = [described(points, cells, label, piece) for piece in range(min(count, 5))] + ["..."] * (count > 5)
    near = NEAR * float(np.ptp(points, axis=0).max()) / len(points) ** (1 / 3)
    pairs = cKDTree(points).query_pairs(near, output_type="ndarray")
    touching = int((label[pairs[:, 0]] != label[pairs[:, 1]]).sum()) if len(pairs) else 0
    more = f"; {touching} nodes of one lie where another has one too: merge them if they belong together" if touching else ""
    if on_sides:
        more += f"; {on_sides} nodes of one lie on sides of another's cells, where they do not hang together"
    return [f"the body is of {count} pieces that share no node: {'; '.join(said)}{more}"]


def described(points: Floats, cells: Integers, label: Integers, piece: int) -> str:
    """A piece in words: its cells and its place."""
    x = points[label == piece]
    many = int((label[cells[:, 0]] == piece).sum())
    ends = [f"({', '.join(f'{c:.4g}' for c in end)})" for end in (x.min(axis=0), x.max(axis=0))]
    return f"piece {piece + 1} has {many} cell{'s' * (many != 1)} from {ends[0]} to {ends[1]} m"
