"""How long do segments take, and does it grow with the nodes? Processor time, best of several, every size in one run.

    .venv/bin/python benchmarks/segments.py            1.5 k to 100 k nodes

Beams of prisms under a plate of obstacle nodes, with two bending modes, cut by slic-mdod-e into segments of some 78 nodes, as
19 segments of a beam of the data set are: all of it, METIS alone, the silhouette, and the Laplacian modes that fluids need.
The exponent p is the slope of log(time) against log(nodes) over all sizes, least squares: time ~ nodes^p. One thread.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent.parent))

CELLS = ((40, 5, 5), (57, 7, 7), (84, 10, 10), (115, 14, 14), (160, 20, 20), (220, 20, 20))
LAPLACIAN_UP_TO = 20_000  # nodes; beyond, its factor fills up


def scene(cells):
    """A beam at rest with the modes (1 - cos(pi x / 2 L)) in y and in z, and a plate of 20 x 20 obstacle nodes 1 mm above."""
    import numpy as np

    from datagen.files.trajectory import HANDLE, NORMAL, OBSTACLE, Trajectory
    from physics.mesh.build import build_mesh
    from physics.mesh.cell import CELLS
    from physics.scene import Body

    mesh = build_mesh(Body(length=0.1, width=0.02, height=0.02, cells=cells))
    plate = build_mesh(Body(shape="plate", length=0.02, width=0.02, height=0.0, cells=(19, 19), cell="triangle"))
    points = np.concatenate([mesh.points, plate.points + [0.06, 0, 0.021]])
    modes = np.zeros((2, len(points), 3), np.float32)
    modes[0, :len(mesh.points), 1] = modes[1, :len(mesh.points), 2] = 1 - np.cos(np.pi * mesh.points[:, 0] / 0.2)
    kind = np.repeat([NORMAL, OBSTACLE], [len(mesh.points), len(plate.points)]).astype(np.uint8)
    kind[mesh.places["x-min"]] = HANDLE
    corners = np.repeat([6, 3], [len(mesh.cells), len(plate.cells)])
    return Trajectory(points=points, connectivity=np.concatenate([mesh.cells.ravel(), len(mesh.points) + plate.cells.ravel()]),
                      offsets=np.concatenate([[0], np.cumsum(corners)]),
                      types=np.repeat([CELLS["prism"].vtk, 5], [len(mesh.cells), len(plate.cells)]).astype(np.uint8), node_kind=kind,
                      displacement=np.zeros((1, len(points), 3), np.float32), modes=modes, frequencies_hz=(10.0, 10.0))


def fastest(function, repeats: int) -> float:
    """[s] of processor time."""
    found = []
    for _ in range(repeats):
        started = time.process_time()
        function()
        found.append(time.process_time() - started)
    return min(found)


def measure(cells, repeats: int) -> dict[str, float]:
    """Seconds of each part for one mesh."""
    import numpy as np

    from learning.segments.cut import _metis, body_graph, ends, segment
    from learning.segments.features import features
    from learning.segments.harmonics import harmonics
    from learning.segments.quality import silhouette

    trajectory = scene(cells)
    nodes = int(trajectory.body.sum())
    count = round(nodes / 78)
    graph = body_graph(trajectory)
    label = segment(trajectory, count=count)[trajectory.body]
    feature = features(trajectory, ends(graph), count=count, method="slic-mdod-e", tau=0.5)
    row = {"nodes": nodes, "segments": count, "smallest": int(np.bincount(label).min()),
           "segment": fastest(lambda: segment(trajectory, count=count), repeats),
           "metis": fastest(lambda: _metis(graph, count), repeats),
           "silhouette": fastest(lambda: silhouette(label, feature), max(1, repeats // 5))}
    if nodes <= LAPLACIAN_UP_TO:
        row["laplacian"] = fastest(lambda: harmonics(trajectory, count=6), max(1, repeats // 5))
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", help="write the numbers to this file")
    options = parser.parse_args()
    import numpy as np

    rows = [measure(cells, max(3, round(30_000 / np.prod(cells)))) for cells in CELLS]
    print("| nodes | segments | segment [ms] | of it METIS [ms] | silhouette [ms] | 6 Laplacian modes [ms] |\n" + "| ---: " * 6 + "|")
    for row in rows:
        parts = [f"{1e3 * row[name]:.1f}" if name in row else "–" for name in ("segment", "metis", "silhouette", "laplacian")]
        print(f"| {row['nodes']} | {row['segments']} | " + " | ".join(parts) + " |")
    nodes = np.log([row["nodes"] for row in rows])
    times = {name: np.array([row[name] for row in rows]) for name in ("segment", "metis")}
    times["all but metis"] = times["segment"] - times["metis"]
    exponents = {name: float(np.polyfit(nodes, np.log(seconds), 1)[0]) for name, seconds in times.items()}
    print("time ~ nodes^p: " + ", ".join(f"p = {p:.2f} for {name}" for name, p in exponents.items()))
    if options.json:
        Path(options.json).write_text(json.dumps({"rows": rows, "exponents": exponents}, indent=1))


if __name__ == "__main__":
    main()
