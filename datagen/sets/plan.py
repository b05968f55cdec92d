"""What a family's draws will be like, known before anything is solved.

The graph of a trajectory is that of its mesh's edges; its diameter is the largest number of edges that the shortest way
between two nodes of the body takes. The obstacle is a graph of its own and plays no part in it, its nodes are counted.

Legend: N nodes, E edges.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.csgraph import connected_components, dijkstra

from datagen.family.family import Family, draw
from datagen.sets.generate import jobs_of
from physics.contact.obstacles import Rigid
from physics.equilibrium.balance import cell_size
from physics.flow.space import FlowSpace
from physics.flow.stored import computed_mesh, stored
from physics.mesh.build import build_mesh
from physics.scene import FlowScene


def graph_diameter(edges: NDArray[np.int64], nodes: int) -> int:
    """The exact diameter of a graph of edges (E, 2), of its widest piece where it is in several, by searches from a few nodes only.

    From a node v at distance d of w, with eccentricity e(v) known, max(d, e(v) - d) <= e(w) <= e(v) + d. Nodes whose upper
    bound does not exceed the largest lower one cannot raise the diameter; the rest are searched from, alternately the
    one with the largest upper and the one with the smallest lower bound (Takes and Kosters, Algorithms 6, 2013).
    """
    graph = scipy.sparse.csr_matrix((np.ones(len(edges), np.int8), edges.T), shape=(nodes, nodes))
    graph = graph + graph.T
    pieces, piece = connected_components(graph, directed=False)
    if pieces > 1:
        return max(_diameter(graph[piece == i][:, piece == i]) for i in range(pieces))
    return _diameter(graph)


def _diameter(graph: scipy.sparse.csr_matrix) -> int:
    """The diameter of a connected graph (N, N)."""
    nodes = graph.shape[0]
    lower, upper = np.zeros(nodes), np.full(nodes, np.inf)
    open_ = np.ones(nodes, bool)
    peripheral = True
    while open_.any():
        index = np.flatnonzero(open_)
        v = index[np.argmax(upper[index] + 1e-6 * lower[index])] if peripheral else index[np.argmin(lower[index])]
        distance = dijkstra(graph, indices=int(v), unweighted=True)
        far = distance.max()
        lower = np.maximum(lower, np.maximum(distance, far - distance))
        upper = np.minimum(upper, far + distance)
        open_ &= (upper > lower.max()) & (lower < upper)
        open_[v] = False
        peripheral = not peripheral
    return int(lower.max())


def figures(scene: Any) -> dict[str, Any]:
    """What is known of one scene before it is solved."""
    if isinstance(scene, FlowScene):
        space = FlowSpace(computed_mesh(scene), scene.order)
        mesh = stored(scene, space).mesh
        return {"nodes": len(mesh.points), "cells": len(mesh.cells), "graph_diameter": graph_diameter(mesh.edges, len(mesh.points)),
                "steps": scene.steps.count, "reynolds_number": scene.reynolds_number or 0.0}
    held = {"obstacle": scene.pressed_by, "support": " and ".join(str(support.where) for support in scene.support) or "none"}
    if scene.steps.error is not None:  # its mesh is chosen when it is solved
        return {"steps": scene.steps.count, "error": scene.steps.error, **held}
    mesh = build_mesh(scene.body)
    around = [Rigid(obstacle).surface_mesh(mesh.points, size=cell_size(mesh), plane=mesh.dimension == 2) for obstacle in scene.obstacles]
    nodes = len(mesh.points) + sum(len(points) for points, _ in around)
    length, width = np.ptp(mesh.points[:, :2], axis=0)
    return {"nodes": nodes, "cells": len(mesh.cells), "graph_diameter": graph_diameter(mesh.edges, len(mesh.points)),
            "steps": scene.steps.count, "xy_extent": float(length * width), **held}


def spread(values: ArrayLike) -> dict[str, float]:
    """Mean, standard deviation (of the sample itself, 1/n), smallest and largest of some numbers."""
    array = np.asarray(values, np.float64)
    return {"mean": float(array.mean()), "std": float(array.std()), "min": float(array.min()), "max": float(array.max())}


def summary(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The figures of several scenes together: `spread` of numbers, counts of words."""
    together: dict[str, Any] = {"count": len(rows)}
    for name, first in rows[0].items():
        values = [row[name] for row in rows]
        together[name] = dict(sorted(Counter(values).items())) if isinstance(first, str) else spread(values)
    return together


def planned(family: Family, splits: dict[str, int], *, seed: int = 0) -> dict[str, Any]:
    """The `summary` of what `generate` would make if every first draw had a solution."""
    jobs = jobs_of(family, splits, Path(), seed)
    return summary([{**figures(draw(family, seed, job.index)), "split": job.file.split("/")[0]} for job in jobs])
