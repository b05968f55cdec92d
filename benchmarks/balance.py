"""How far the stored frames of a data set of second-order bodies are from balance, worked out anew from every one of them.

    .venv/bin/python -m benchmarks.balance FOLDER

The held balance of a frame is what is missing to equilibrium on the free components, contact forces found to fit (physics/fidelity/
verify.py), over the reaction of that frame; the largest of all frames in which something is touched. Once from what the file knows of the
displacements, and once from their single precision alone.
"""

from pathlib import Path

import h5py
import numpy as np

from benchmarks import footing
from datagen.files.solved import as_solved, solved_on
from datagen.files.trajectory import read_trajectory
from physics.fidelity.verify import Checker
from physics.scene import Scene


def of_file(path: Path) -> dict[str, str | int | float]:
    """The row of one file."""
    trajectory = read_trajectory(path)
    scene, body, frames = Scene.from_toml(trajectory.scene), trajectory.body, len(trajectory.displacement)
    mesh, reaction = solved_on(scene, trajectory), np.linalg.norm(trajectory.per_frame["reaction"], axis=1)
    pressed, checkers, missing = np.flatnonzero(reaction), dict[Scene, Checker](), []
    exactly = trajectory.exact
    for t in pressed:
        solved = as_solved(scene, trajectory, int(t))
        checker = checkers[solved] = checkers.get(solved) or Checker(solved, mesh)
        missing.append([checker.frame(u[t, body].astype(np.float64), t / (frames - 1)).residual / reaction[t]
                        for u in (exactly, trajectory.displacement)])
    exact, single = np.array(missing).max(axis=0)
    with h5py.File(path) as file:
        of_it = file["VTKHDF/PointData/remainder"].id.get_storage_size()
    return {"file": f"{path.parent.name}/{path.stem}", "nodes": len(trajectory.points), "pressed frames": len(pressed),
            "MB": path.stat().st_size / 1e6, "of these remainder": of_it / 1e6, "balance over reaction": float(exact),
            "in single precision": float(single)}


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("folder", type=Path)
    table = footing.Table()
    for path in sorted(parser.parse_args().folder.rglob("*.vtkhdf")):
        table.add(of_file(path))


if __name__ == "__main__":
    main()
