"""What does a part of the network or of its segments gain? Trainings that differ in one thing, on equal processor time.

    .venv/bin/python -m benchmarks.ablation --vary method --seconds 60
    .venv/bin/python -m benchmarks.ablation --vary segments --seconds 60 --seeds 3 --json segments.json

--vary is method, segments, overlap, encoding, message_steps or scheme. All but the last predict straight from the obstacle's pose,
which a minute already teaches something (stepwise takes several before its rollouts hold). Each training gets so many steps as
take the given processor seconds, by the fastest of ten steps made before, or, where rows differ in segments alone, as many as the
first row; reading the data, segments and estimates come on top. The beams are those of assets/beam-small.pack, or a data set
(--data). Errors as in benchmarks/accuracy.py, means over the test trajectories, in mm; with several seeds their mean and
standard deviation, which short trainings need before two rows may be told apart.
"""

import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks import footing
from benchmarks.accuracy import ERRORS, means
from benchmarks.schemes import BASE, SCHEMES
from datagen.files.trajectory import read_trajectory
from datagen.sets.dataset import files
from datagen.sets.pack import unpack
from learning.config import TrainConfig
from learning.graphs.graph import join
from learning.networks.m4gn import M4GN
from learning.prediction.checkpoint import load_model
from learning.samples.samples import build_example, load_examples, sample
from learning.segments.features import METHODS
from learning.segments.quality import segment_quality
from learning.training.train import train

PACK = footing.ROOT / "assets" / "beam-small.pack"
TIMED = 10  # steps
ALIKE = ("method", "segments")  # differ in nothing that a step costs


def variants(name: str) -> dict[str, TrainConfig]:
    """The configs to compare, by what to call them."""
    base = BASE if name == "scheme" else replace(BASE, **SCHEMES["pose"])
    network = base.network
    choices: dict[str, dict[str, dict[str, Any]]] = {
        "method": {method: {"method": method} for method in METHODS},
        "segments": {str(count): {"segments": count} for count in (3, 6, 12, 24, 48, "auto")},
        "overlap": {str(overlap): {"overlap": overlap} for overlap in (0, 1)},
        "encoding": {f"{walk} steps" if walk else "none": {"network": replace(network, walk=walk)} for walk in (0, 8, 16)},
        "message_steps": {str(steps): {"network": replace(network, message_steps=steps)} for steps in (1, 2, 4, 7)},
        "scheme": SCHEMES,
    }
    return {label: replace(base, **change) for label, change in choices[name].items()}


def step_seconds(config: TrainConfig, path: Path) -> float:
    """[s] of processor time of one training step: samples, forward and backward pass."""
    case, generator = load_examples([path], config)[0], torch.Generator().manual_seed(0)
    frames = case.targets[np.linspace(0, len(case.targets) - 1, config.batch_size).astype(int)] - 1
    network = M4GN(config.network)

    def step() -> None:
        drawn = [sample(case, int(frame), config, generator) for frame in frames]
        (network(join([graph for graph, _ in drawn])) - torch.cat([target for _, target in drawn])).square().mean().backward()

    return footing.least(step, TIMED)


def trained(config: TrainConfig, paths: list[Path], tests: list[Path]) -> dict[str, dict[str, float]]:
    """Errors [m] of one training, and of what knows nothing."""
    with tempfile.TemporaryDirectory() as folder:
        train(config, paths, [], folder)
        return means(load_model(folder), tests, every=4)


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("--vary", required=True, choices=("method", "segments", "overlap", "encoding", "message_steps", "scheme"))
    parser.add_argument("--seconds", type=float, default=60.0, help="processor seconds of each training (60)")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--only", nargs="*", help="only these rows")
    parser.add_argument("--data", help="folder of a data set (assets/beam-small.pack)")
    parser.add_argument("--json", help="write the numbers to this file")
    options = parser.parse_args()
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
        rows: dict[str, Any] = {}
        each, printed = 0.0, footing.Table()
        for label, config in compared.items():
            if not each or options.vary not in ALIKE:
                each = step_seconds(config, paths[0])
            steps = max(1, round(options.seconds / each))
            found = [trained(replace(config, seed=seed, steps=steps), paths, tests) for seed in range(options.seeds)]
            runs = [run["network"] for run in found]
            quality, count = [], []
            for path in tests:
                case = build_example(read_trajectory(path), replace(config, estimate=False))
                count.append(len(np.unique(case.skeleton.segment[case.trajectory.body])))
                quality.append(segment_quality(case.trajectory, case.skeleton.segment)["silhouette"])
            rows[label] = {"runs": runs, "steps": steps, "ms_per_step": 1e3 * each, "segments": float(np.mean(count)),
                           "silhouette": float(np.mean(quality))}
            errors = {name: [1e3 * run[name] for run in runs] for name in ERRORS}
            printed.add({options.vary: label, "segments": rows[label]["segments"], "silhouette": f"{rows[label]['silhouette']:.3f}",
                         "steps": steps, "ms a step": f"{1e3 * each:.1f}"}
                        | {f"{name} [mm]": f"{np.mean(mm):.3g}" + (f" ± {np.std(mm, ddof=1):.2g}" if len(mm) > 1 else "")
                           for name, mm in errors.items()})
        rows["nothing moves"] = still = found[0]["nothing moves"]
        printed.add({options.vary: "nothing moves"} | {f"{name} [mm]": 1e3 * still[name] for name in ERRORS})
    if options.json:
        Path(options.json).write_text(json.dumps({"vary": options.vary, "seconds": options.seconds, "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
