"""What a path of a sweep costs, and how far the force that it tells is from that of finite elements.

    .venv/bin/python -m benchmarks.sweep            10 000 paths of one body, processor time a path, all included
    .venv/bin/python -m benchmarks.sweep --force    twelve beams of the family beam-60, in 30 steps, two minutes

The paths differ in where the obstacle touches, how deep it goes and in its radius. The force is beam theory's, over the reaction of
the elements, halfway and at the end of the path, and the difference of displacement beside it.
"""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks import footing
from datagen.family.family import draw, load_family
from learning.prediction.sweep import sweep
from physics.scene import Steps
from physics.solution import solve

RUN = Path(__file__).parents[1] / "assets" / "m4gn-fast"
VARY = ["obstacle.place.along=0.6:0.85", "obstacle.place.depth=0.005:0.02", "obstacle.radius=0.01:0.024"]


def press(length: float) -> dict[str, object]:
    """A cantilever under a cylinder, 400 steps."""
    return {"body": {"length": length, "width": 0.025, "height": 0.025, "cell_size": 0.0053}, "material": footing.MATERIAL,
            "support": [{"where": "x-min"}], "steps": {"count": 400},
            "obstacle": {"shape": "cylinder", "radius": 0.012, "place": {"gap": 0.001, "depth": 0.01}}}


def cost(length: float, frames: list[int] | None, nodes: str | None, count: int) -> dict[str, object]:
    """One row."""
    seconds, found = footing.cost(sweep, press(length), RUN, vary=VARY, count=count, frames=frames, nodes=nodes)
    body = found.variation.first.body
    return {"nodes of the body": int(np.prod(np.array(body.divisions) + 1)), "frames kept": "last" if frames is None else len(found.frames),
            "nodes kept": nodes or "all", "paths": count, "a path [ms]": 1e3 * seconds / count, "seconds": seconds}


def force(index: int) -> dict[str, object]:
    """One beam."""
    scene = replace(draw(load_family("beam-60"), 99, index), steps=Steps(count=30))
    assert scene.obstacle is not None
    truth, table = solve(scene), tomllib.loads(scene.to_toml())
    radius = scene.obstacle.radius
    found = sweep(table, RUN, vary=[f"obstacle.radius={radius},{radius}"], count=1, frames=[15, 30])
    reaction = np.linalg.norm(truth.reaction[[15, 30]], axis=1)
    off = found.rows.displacement[0] - truth.displacement[[15, 30]]
    half, end = found.rows.force[0] / reaction
    return {"beam": index, "obstacle": scene.obstacle.shape, "held at": "one end" if len(scene.support) == 1 else "both ends",
            "force, halfway": float(half), "force, at the end": float(end),
            "RMSD of displacement at the end [m]": float(np.sqrt((off[1] ** 2).sum(axis=1).mean()))}


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("--force", action="store_true")
    parser.add_argument("--count", type=int, default=10_000)
    asked = parser.parse_args()
    table = footing.Table()
    if asked.force:
        for index in range(12):
            table.add(force(index))
        ratios = np.array([[row["force, halfway"], row["force, at the end"]] for row in table.rows])
        footing.say(f"force over reaction: mean {ratios.mean():.3f}, from {ratios.min():.3f} to {ratios.max():.3f}")
        return
    for length, frames, nodes in ((0.1, None, None), (0.2, None, None), (0.2, None, "x-max"), (0.2, [100, 200, 300, 400], "x-max")):
        table.add(cost(length, frames, nodes, asked.count))


if __name__ == "__main__":
    main()
