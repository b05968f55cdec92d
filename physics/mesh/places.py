"""What is a place called, and which nodes does it have? Groups of a file by name, and places by coordinates.

A name may stand for groups of several dimensions, or for a set of nodes as well. Then none of them goes by that name alone:
they are "face-1" and "region-1", and "1" is refused with these words. Legend: N nodes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physics.scene import Where
from physics.schema import InputError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Parts = list[tuple[str, Integers]]
NODES = -1


def called(groups: dict[tuple[str, int], Parts], node_sets: dict[str, Integers],
           dimension: int) -> tuple[dict[str, Integers], dict[str, Parts], dict[str, tuple[str, ...]]]:
    """Nodes and parts of each place by the name that it goes by, and names that stand for several with what these are called.

    Args:
        groups: (name, dimension) to cells; node_sets: name to nodes
        dimension: of the body
    """
    alike: dict[str, dict[int, Integers]] = {}
    for (name, d), parts in groups.items():
        alike.setdefault(name, {})[d] = np.unique(np.concatenate([cells.ravel() for _, cells in parts]))
    for name, nodes in node_sets.items():
        alike.setdefault(name, {})[NODES] = np.unique(nodes)
    places: dict[str, Integers] = {}
    of: dict[str, Parts] = {}
    mixed: dict[str, tuple[str, ...]] = {}
    for name, kinds in alike.items():
        first = next(iter(kinds.values()))
        if all(np.array_equal(first, nodes) for nodes in kinds.values()):
            names = {max(kinds): name}  # the same nodes whatever it is: the cells say most
        else:
            names = {d: f"{_kind(d, dimension)}-{name}" for d in sorted(kinds)}
            mixed[name] = tuple(names.values())
        for d, own in names.items():
            places[own] = kinds[d]
            if d != NODES:
                of[own] = groups[name, d]
    return places, of, mixed


def _kind(d: int, dimension: int) -> str:
    return "nodes" if d == NODES else "region" if d == dimension else ("point", "edge", "face")[d]


def nodes_at(points: Floats, where: Where) -> Integers:
    """The nodes at a place by coordinates. Raises `InputError` when there are none."""
    found = np.flatnonzero(inside(points, where))
    if not len(found):
        ends = [f"({', '.join(f'{c:.4g}' for c in end)})" for end in (points.min(axis=0), points.max(axis=0))]
        raise InputError(f"no node at where = {where}; the body lies from {ends[0]} to {ends[1]} m")
    return found


def inside(points: Floats, where: Where) -> NDArray[np.bool_]:
    """(N,) which points lie at a place by coordinates."""
    if where.near is not None:
        return np.asarray(np.linalg.norm(points - where.near, axis=1) <= (where.within or 0.0))
    if where.plane is not None and where.normal is not None:
        return np.asarray(abs((points - where.plane) @ np.array(where.normal)) <= (where.within or 0.0) * np.linalg.norm(where.normal))
    assert where.box is not None
    slack = 1e-9 * np.ptp(points, axis=0).max()
    return np.asarray(((points >= np.array(where.box[0]) - slack) & (points <= np.array(where.box[1]) + slack)).all(axis=1))
