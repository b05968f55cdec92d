"""How long do segments take, and does it grow with the nodes? The best of several, every size in one run.

    .venv/bin/python -m benchmarks.segments            1.5 k to 100 k nodes

Beams of prisms under a plate of obstacle nodes, with two bending modes, cut by slic-mdod-e into segments of some 78 nodes, as
19 segments of a beam of the data set are: all of it, METIS alone, the silhouette, and the Laplacian modes that fluids need.
The exponent p is the slope of log(time) against log(nodes) over all sizes, least squares: time ~ nodes^p.
"""

import numpy as np

from benchmarks import footing
from benchmarks.footing import least
from datagen.files.trajectory import HANDLE, NORMAL, OBSTACLE, Trajectory
from learning.segments.cut import _metis, body_graph, ends, segment
from learning.segments.features import features
from learning.segments.harmonics import harmonics
from learning.segments.quality import silhouette
from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS
from physics.scene import Body

SIZES = ((40, 5, 5), (57, 7, 7), (84, 10, 10), (115, 14, 14), (160, 20, 20), (220, 20, 20))
LAPLACIAN_UP_TO = 20_000  # nodes; beyond, its factor fills up


def scene(cells):
    """A beam at rest with the modes (1 - cos(pi x / 2 L)) in y and in z, and a plate of 20 x 20 obstacle nodes 1 mm above."""
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


def measure(cells, repeats: int) -> dict[str, int | float]:
    """A row of the table for one mesh."""
    trajectory = scene(cells)
    nodes = int(trajectory.body.sum())
    count = round(nodes / 78)
    graph = body_graph(trajectory)
    label = segment(trajectory, count=count)[trajectory.body]
    feature = features(trajectory, ends(graph), count=count, method="slic-mdod-e", tau=0.5)
    whole, metis = (least(run, repeats) for run in (lambda: segment(trajectory, count=count), lambda: _metis(graph, count)))
    few = max(1, repeats // 5)
    return {"nodes": nodes, "segments": count, "segment [ms]": 1e3 * whole, "of it METIS [ms]": 1e3 * metis,
            "the rest [ms]": 1e3 * (whole - metis), "silhouette [ms]": 1e3 * least(lambda: silhouette(label, feature), few),
            "6 Laplacian modes [ms]": 1e3 * least(lambda: harmonics(trajectory, count=6), few) if nodes <= LAPLACIAN_UP_TO else None}


def main() -> None:
    footing.parser(__doc__).parse_args()
    table = footing.Table()
    for cells in SIZES:
        table.add(measure(cells, max(3, round(30_000 / np.prod(cells)))))
    table.fit("segment [ms]", "of it METIS [ms]", "the rest [ms]")


if __name__ == "__main__":
    main()
