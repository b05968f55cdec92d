"""What does a part of the network or of its segments gain? Trainings that differ in one thing, on equal processor time.

    .venv/bin/python benchmarks/ablation.py --vary method --seconds 60
    .venv/bin/python benchmarks/ablation.py --vary segments --seconds 60 --seeds 3 --json segments.json

--vary is method, segments, overlap, encoding, message_steps or scheme. Each training gets so many steps as take the given
processor seconds, by the time of its first 20 steps; making segments and estimates comes on top. The beams are those of
assets/beam-small.pack, or a data set (--data). Errors as in benchmarks/accuracy.py, means over the test trajectories, in mm; with
several seeds their mean and standard deviation, which short trainings need before two rows may be told apart. One thread.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent.parent))

import numpy as np
import torch

from benchmarks.accuracy import table
from benchmarks.schemes import BASE, SCHEMES
from datagen.dataset import files
from datagen.pack import unpack
from datagen.trajectory import read_trajectory
from learning.checkpoint import load_model
from learning.config import TrainConfig
from learning.data import build_case
from learning.features import METHODS
from learning.segment_quality import segment_quality
from learning.train import train

PACK = Path(__file__).parent.parent / "assets" / "beam-small.pack"
FIRST = 20  # steps that are timed
ERRORS = ("rmse_1", "rmse_50", "rmse_all")


def variants(name: str) -> dict[str, TrainConfig]:
    """The configs to compare, by what to call them."""
    network = BASE.network
    choices: dict[str, dict[str, dict[str, Any]]] = {
        "method": {method: {"method": method} for method in METHODS},
        "segments": {str(count): {"segments": count} for count in (3, 6, 12, 24, 48, "auto")},
        "overlap": {str(overlap): {"overlap": overlap} for overlap in (0, 1)},
        "encoding": {f"{walk} steps" if walk else "none": {"network": replace(network, walk=walk)} for walk in (0, 8, 16)},
        "message_steps": {str(steps): {"network": replace(network, message_steps=steps)} for steps in (1, 2, 4, 7)},
        "scheme": SCHEMES,
    }
    return {label: replace(BASE, **change) for label, change in choices[name].items()}


def trained(config: TrainConfig, paths: list[Path], tests: list[Path], seconds: float) -> dict[str, float]:
    """Steps, processor seconds and errors [m] of one training."""
    with tempfile.TemporaryDirectory() as folder:
        wall, spent = time.perf_counter(), time.process_time()
        first = train(replace(config, steps=FIRST), paths, [], Path(folder, "first"))
        share = (time.process_time() - spent) / (time.perf_counter() - wall)  # of the core, on a machine that others use
        each = 1e-3 * first["ms_per_step"] * share
        config = replace(config, steps=max(1, round(seconds / each)))
        result = train(config, paths, [], Path(folder, "run"))
        rows, _ = table(load_model(Path(folder, "run")), tests, every=4)
    return {"steps": result["steps"], "ms_per_step": 1e3 * each} | {name: rows["network"][name] for name in ERRORS}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vary", required=True, choices=("method", "segments", "overlap", "encoding", "message_steps", "scheme"))
    parser.add_argument("--seconds", type=float, default=60.0, help="processor seconds of each training (60)")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--only", nargs="*", help="only these rows")
    parser.add_argument("--data", help="folder of a data set (assets/beam-small.pack)")
    parser.add_argument("--json", help="write the numbers to this file")
    options = parser.parse_args()
    torch.set_num_threads(1)
    compared = variants(options.vary)
    if options.only:
        compared = {label: config for label, config in compared.items() if label in options.only}
    if not compared:
        parser.error(f"--only: none of {', '.join(variants(options.vary))}")
    with tempfile.TemporaryDirectory() as folder:
        data = Path(options.data or folder)
        if not options.data:
            unpack(PACK, data := Path(folder, "data"))
        paths, tests = files(data, "train"), files(data, "test")
        rows = {}
        print(f"| {options.vary} | segments | silhouette | steps | ms a step | RMSE-1 [mm] | RMSE-50 [mm] | RMSE-all [mm] |")
        print("| --- " + "| ---: " * 7 + "|")
        for label, config in compared.items():
            runs = [trained(replace(config, seed=seed), paths, tests, options.seconds) for seed in range(options.seeds)]
            quality, count = [], []
            for path in tests:
                case = build_case(read_trajectory(path), replace(config, estimate=False))
                count.append(len(np.unique(case.skeleton.segment[case.trajectory.body])))
                quality.append(segment_quality(case.trajectory, case.skeleton.segment)["silhouette"])
            rows[label] = {"runs": runs, "segments": float(np.mean(count)), "silhouette": float(np.mean(quality))}
            mean = {name: float(np.mean([run[name] for run in runs])) for name in runs[0]}
            spread = {name: f" ± {1e3 * np.std([run[name] for run in runs], ddof=1):.2g}" if len(runs) > 1 else "" for name in ERRORS}
            cells = [label, f"{rows[label]['segments']:.3g}", f"{rows[label]['silhouette']:.3f}", f"{mean['steps']:.0f}",
                     f"{mean['ms_per_step']:.1f}", *(f"{1e3 * mean[name]:.3g}{spread[name]}" for name in ERRORS)]
            print("| " + " | ".join(cells) + " |", flush=True)
    if options.json:
        Path(options.json).write_text(json.dumps({"vary": options.vary, "seconds": options.seconds, "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
