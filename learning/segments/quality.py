"""How well segments separate, and how many of them there should be: conductance, edge-cut ratio, silhouette.

On the body's mesh graph, with S a segment, vol(S) the sum of its nodes' degrees, and means over all segments or nodes:

    conductance(S)    edges between S and the rest / min(vol S, vol of the rest)
    edge-cut ratio    edges between segments / all edges
    silhouette(i)     (b - a) / max(a, b), with a the mean of d(i, j) over the other nodes j of i's segment, and b the least
                      of the means over the nodes of another segment; 0 where i is alone in its segment, or a = b = 0

The paper leaves d(i, j) open. `segment_quality` takes the distance in place, which compares methods; `auto_segment`, which
compares numbers of segments, takes the distance by which they were cut (features.py). Its unit, the segment size, cancels out
of place and modes but not out of exp(-d / S): near the obstacle "near" means within a segment's size.

Over all K the silhouette of a beam is best at two or three segments, which say too little. The paper tries K from sqrt(N) / 2
to 2 sqrt(N) (its best for DeformingBeam, 19, is sqrt(1542) / 2); `auto_segment` takes the best silhouette in that range.

Legend: N nodes of the body, K segments, R rows of nodes at a time.
Source: Lei et al., M4GN, appendices "Segmentation Quality Metrics" and "Mesh Segment Hyperparameter Selection"; Rousseeuw 1987.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from datagen.files.trajectory import Trajectory
from learning.segments.cut import body_graph, ends, segment
from learning.segments.features import Features, features

SAMPLED = 2000  # nodes, evenly spaced, of which the silhouette is taken in larger meshes
TABLE = 1_000_000  # distances in memory at once
CANDIDATES = 8


def segment_quality(trajectory: Trajectory, segments: NDArray[np.integer]) -> dict[str, float]:
    """Conductance (mean over segments), edge-cut ratio and silhouette in place of segments (N + obstacle nodes,)."""
    label = segments[trajectory.body]
    node, other = ends(body_graph(trajectory))
    cut = label[node] != label[other]
    volume = np.bincount(label[node])  # (K,)
    rest = np.minimum(volume, volume.sum() - volume)
    crossing = np.bincount(label[node], weights=cut)
    conductance = np.divide(crossing, rest, out=np.zeros(len(rest)), where=rest > 0)
    place = Features(np.pad(trajectory.points[trajectory.body], ((0, 0), (1, 0))), 1.0)
    return {"conductance": float(conductance.mean()), "edge_cut_ratio": float(cut.mean()), "silhouette": silhouette(label, place)}


def silhouette(label: NDArray[np.integer], feature: Features) -> float:
    """Mean silhouette of the nodes of segments (N,), each with at least one node; 0 for a single segment."""
    count = np.bincount(label)
    if len(count) == 1:
        return 0.0
    order = np.argsort(label, kind="stable")
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    chosen = order if len(label) <= SAMPLED else order[np.linspace(0, len(label) - 1, SAMPLED).astype(int)]
    columns, total = np.split(feature.table[order], (1, feature.table.shape[1] - 3), axis=1), 0.0
    rows = max(1, TABLE // len(label))
    for first in range(0, len(chosen), rows):
        some = chosen[first:first + rows]
        parts = np.split(feature.table[some], (1, feature.table.shape[1] - 3), axis=1)
        distance = sum(weight * cdist(part, column) for weight, part, column in zip((1, 1, feature.tau), parts, columns, strict=True)
                       if part.shape[1])  # (R, N)
        sums = np.add.reduceat(distance, start, axis=1)  # (R, K)
        own, row = label[some], np.arange(len(some))
        near = sums[row, own] / np.maximum(count[own] - 1, 1)
        means = sums / count
        means[row, own] = np.inf
        far = means.min(axis=1)
        top = np.maximum(near, far)
        total += np.divide(far - near, top, out=np.zeros(len(some)), where=(count[own] > 1) & (top > 0)).sum()
    return float(total / len(chosen))


def auto_segment(trajectory: Trajectory, *, method: str = "slic-mdod-e", tau: float = 0.5, modes: str = "elastic",
                 mode_count: int = 1) -> tuple[NDArray[np.int32], dict[int, float]]:
    """The segments of the best silhouette among eight numbers of them, spaced evenly in the logarithm.

    Returns:
        segments as `segment` gives them, and the silhouette of each number that was tried; of equal ones the lowest wins

    Raises:
        InputError: as `segment`
    """
    edges, nodes = ends(body_graph(trajectory)), int(trajectory.body.sum())
    scores: dict[int, float] = {}
    top, best = -np.inf, np.zeros(0, np.int32)
    tried = np.geomspace(nodes**0.5 / 2, min(2 * nodes**0.5, nodes), CANDIDATES).round().clip(1)
    for count in np.unique(tried.astype(int)).tolist():
        found = segment(trajectory, count=count, method=method, tau=tau, modes=modes, mode_count=mode_count)
        feature = features(trajectory, edges, count=count, method=method, tau=tau, modes=modes, mode_count=mode_count)
        scores[count] = silhouette(found[trajectory.body], feature)
        if scores[count] > top:
            top, best = scores[count], found
    return best, scores
