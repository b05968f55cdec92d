"""Ways to predict, trained alike: the same beams, the same network, the same seconds on one core.

    .venv/bin/python benchmarks/schemes.py --data DIR --seconds 120                       all of them
    .venv/bin/python benchmarks/schemes.py --data DIR --seconds 120 --scheme step pose+estimate

Estimates are made before the clock of a training starts, as segments are; what they cost stands beside ("ms" a frame).
"""

import argparse
import json
import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent.parent))

from benchmarks.accuracy import table
from datagen.sets.dataset import files
from learning.config import TrainConfig
from learning.networks.m4gn import M4GNConfig
from learning.prediction.checkpoint import load_model
from learning.training.train import train

BASE = TrainConfig(segments=12, contact_radius=0.006, batch_size=2, learning_rate=1e-3, final_learning_rate=1e-5, noise=1e-4,
                   validate_every=1_000_000, network=M4GNConfig(hidden=32, message_steps=4, transformer_layers=2, heads=4))
SCHEMES = {
    "step": {},
    "step+history": {"history": 1},
    "step+estimate": {"estimate": True, "frames": 20},
    "pose": {"scheme": "pose", "frames": 20},
    "pose+estimate": {"scheme": "pose", "estimate": True, "frames": 20},
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--data", required=True)
    parser.add_argument("--scheme", nargs="*", choices=SCHEMES, default=list(SCHEMES))
    parser.add_argument("--beams", type=int, default=40)
    parser.add_argument("--tests", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=120.0)
    options = parser.parse_args()
    paths, tests = files(options.data, "train")[:options.beams], files(options.data, "test")[:options.tests]
    for name in options.scheme:
        with tempfile.TemporaryDirectory() as folder:
            config = replace(BASE, **SCHEMES[name], budget_seconds=options.seconds)
            trained = train(config, paths, [], folder)
            rows, _ = table(load_model(folder), tests, every=8)
        print(json.dumps({"scheme": name, "seconds": trained["seconds"], "steps": trained["steps"],
                          "samples": trained["steps"] * config.batch_size, "frames": trained["samples"], "m": rows}), flush=True)


if __name__ == "__main__":
    main()
