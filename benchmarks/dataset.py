"""Time and memory of a data set: what generation costs besides the solver, checking, packing, and what single parts save.

    .venv/bin/python -m benchmarks.dataset                 the family beam, 8 trajectories, about a minute on a quiet core
    .venv/bin/python -m benchmarks.dataset --count 40

Each scene is solved alone and then made as a worker makes it (solved again, with its mode, obstacle, file and checks), in turn, so
the machine's mood is in both. The memory is that of a process of its own for either, at its peak.
"""

import tempfile
from pathlib import Path

import numpy as np

from benchmarks import footing
from benchmarks.footing import cost
from datagen.family.family import counts, draw, load_family
from datagen.sets import dataset, generate
from datagen.sets.check import check
from datagen.sets.pack import pack, unpack
from physics.fem import release
from physics.solution import solve

PUBLISHED = 3261.0  # ms a step of the original set, Lei et al. 2025


def work(name, count, alone):
    """Peak memory [MB] of solving the first scenes of a family, alone or as a worker does."""
    family = load_family(name)
    with tempfile.TemporaryDirectory() as folder:
        for index in range(count):
            if alone:
                release()
                solve(draw(family, 0, index))
            else:
                generate._make(generate.Job(family, Path(folder), dataset.file_name("train", index), 0, index))
    return footing.peak_memory()


def main():
    parser = footing.parser(__doc__)
    parser.add_argument("--family", default="beam")
    parser.add_argument("--count", type=int, default=8)
    options = parser.parse_args()
    family = load_family(options.family)
    generate.compile_forms([draw(family, 0, 0)])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        alone, whole, steps = [], [], 0
        for index in range(options.count):
            job = generate.Job(family, folder, dataset.file_name("train", index), 0, index)
            scene = draw(family, 0, index)
            release()
            seconds, solution = cost(lambda of: solve(of, partial=True), scene)
            both, (_, reasons) = cost(generate._make, job)
            if solution.failure or reasons:
                continue
            alone.append(seconds)
            whole.append(both)
            steps += scene.steps.count
        seconds, report = cost(generate.generate, family, counts(family, count=options.count, split="train"), folder, workers=1)
        size = sum(path.stat().st_size for path in folder.rglob("*.vtkhdf"))
        checking, problems = cost(check, folder)
        packing, packed = cost(pack, folder, folder / "set.pack")
        unpacking, _ = cost(unpack, folder / "set.pack", folder / "again")
    number = report["trajectories"]
    table, step = footing.Table(), 1e3 * sum(alone) / steps
    memory = [footing.child(work, options.family, options.count, alone) for alone in (False, True)]
    for figure, value in {
            "trajectories": number, "solver [s]": np.mean(alone), "solver [ms a step]": step, "published over that": PUBLISHED / step,
            "besides the solver [s]": np.mean(np.subtract(whole, alone)), "besides the solver [MB]": memory[0] - memory[1],
            "to find it made [s]": seconds / number, "check [s]": checking / number, "problems": len(problems),
            "file [MB]": size / number / 1e6, "packed [kB]": packed["bytes"] / number / 1e3, "pack [s]": packing / number,
            "unpack [s]": unpacking / number}.items():
        table.add({"for each trajectory": figure, "": value})


if __name__ == "__main__":
    main()
