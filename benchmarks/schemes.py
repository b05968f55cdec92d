"""Ways to predict, trained alike: the same beams, the same network, the same seconds on one core.

    .venv/bin/python -m benchmarks.schemes --data DIR --seconds 120                       all of them
    .venv/bin/python -m benchmarks.schemes --data DIR --seconds 120 --scheme step pose+estimate

Estimates are made before the clock of a training starts, as segments are.
"""

import tempfile
from dataclasses import replace

from benchmarks import footing
from benchmarks.accuracy import ERRORS, means
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
    parser = footing.parser(__doc__)
    parser.add_argument("--data", required=True)
    parser.add_argument("--scheme", nargs="*", choices=SCHEMES, default=list(SCHEMES))
    parser.add_argument("--beams", type=int, default=40)
    parser.add_argument("--tests", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=120.0)
    options = parser.parse_args()
    paths, tests = files(options.data, "train")[:options.beams], files(options.data, "test")[:options.tests]
    table, rest = footing.Table(), {}
    for name in options.scheme:
        with tempfile.TemporaryDirectory() as folder:
            config = replace(BASE, **SCHEMES[name], budget_seconds=options.seconds)
            trained = train(config, paths, [], folder)
            rows = means(load_model(folder), tests, every=8)
        table.add({"scheme": name, "seconds": round(trained["seconds"]), "samples": trained["steps"] * config.batch_size}
                  | {f"{error} [m]": f"{rows['network'][error]:.1e}" for error in ERRORS})
        rest |= {name: row for name, row in rows.items() if name != "network"}
    for name in sorted(rest):
        table.add({"scheme": name} | {f"{error} [m]": f"{rest[name][error]:.1e}" for error in ERRORS})


if __name__ == "__main__":
    main()
