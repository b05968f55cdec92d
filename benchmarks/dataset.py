"""Time and memory of a data set: what generation costs besides the solver, checking, packing, and what single parts save.

    .venv/bin/python benchmarks/dataset.py                 the family beam, 8 trajectories, about a minute on a quiet core
    .venv/bin/python benchmarks/dataset.py --count 40

One process, one thread. Each scene is solved alone and then made as a worker makes it (solved again, with its mode, obstacle,
file and checks), in turn, so the machine's mood is in both; times are processor seconds. The memory is that of a process of its
own for either, at its peak.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent.parent))

import numpy as np

from datagen.family.family import counts, draw, load_family
from datagen.sets import dataset, generate
from datagen.sets.check import check
from datagen.sets.pack import pack, unpack
from physics.fem import release
from physics.solution import solve


def timed(function, *given, **named):
    """Processor seconds of a call, and what it returned."""
    started = time.process_time()
    found = function(*given, **named)
    return time.process_time() - started, found


def peak_memory(name, count, alone):
    """Peak memory [MB] of a process that solves the first scenes of a family, alone or as a worker does."""
    program = f"import sys; sys.path.insert(0, {sys.path[0]!r}); from benchmarks import dataset as b; b.work({name!r}, {count}, {alone})"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return float(done.stdout)


def work(name, count, alone):
    """What `peak_memory` measures; prints megabytes."""
    family = load_family(name)
    with tempfile.TemporaryDirectory() as folder:
        for index in range(count):
            if alone:
                release()
                solve(draw(family, 0, index))
            else:
                generate._make(generate.Job(family, Path(folder), dataset.file_name("train", index), 0, index))
    status = Path("/proc/self/status").read_text()  # not getrusage, whose peak counts the parent's too
    print(int(status.split("VmHWM:")[1].split()[0]) / 1024)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
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
            seconds, solution = timed(lambda of: solve(of, partial=True), scene)
            both, (_, reasons) = timed(generate._make, job)
            if solution.failure or reasons:
                continue
            alone.append(seconds)
            whole.append(both)
            steps += scene.steps.count
        seconds, report = timed(generate.generate, family, counts(family, count=options.count, split="train"), folder, workers=1)
        size = sum(path.stat().st_size for path in folder.rglob("*.vtkhdf"))
        checking, problems = timed(check, folder)
        packing, packed = timed(pack, folder, folder / "set.pack")
        unpacking, _ = timed(unpack, folder / "set.pack", folder / "again")
    number = report["trajectories"]
    print(json.dumps({
        "trajectories": number, "solver_s": float(np.mean(alone)), "solver_ms_per_step": 1e3 * sum(alone) / steps,
        "overhead_s": float(np.mean(np.subtract(whole, alone))), "ratio_to_3261_ms": 3.261 * steps / sum(alone),
        "overhead_mb": peak_memory(options.family, options.count, False) - peak_memory(options.family, options.count, True),
        "resume_s_each": seconds / number, "check_s_each": checking / number, "problems": len(problems),
        "megabytes_each": size / number / 1e6, "packed_kb_each": packed["bytes"] / number / 1e3, "pack_s_each": packing / number,
        "unpack_s_each": unpacking / number}, indent=1))


if __name__ == "__main__":
    main()
