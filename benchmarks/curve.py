"""The curve of a training: error in validation against seconds and samples, beside the estimate that the network corrects.

    .venv/bin/python -m benchmarks.curve RUN --data DIR --out curve.png
"""

import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from benchmarks import footing
from datagen.sets.dataset import files
from learning.prediction.checkpoint import load_model
from learning.samples.samples import load_examples
from physics.mesh.quality import rmsd


def main():
    parser = footing.parser(__doc__)
    parser.add_argument("run")
    parser.add_argument("--data", required=True)
    parser.add_argument("--out", required=True)
    options = parser.parse_args()
    config = load_model(options.run).config
    lines = [json.loads(line) for line in Path(options.run, "curve.jsonl").read_text().splitlines()]
    errors = [(line["seconds"], line["step"] * config.batch_size, line["error"]) for line in lines if line.get("error") is not None]
    level = None
    if config.estimate:
        cases = load_examples(files(options.data, "valid"), config, walk=True)
        level = np.mean([rmsd(case.estimate.displacement, case.trajectory.displacement[case.targets], case.trajectory.free)
                         for case in cases])
        errors.insert(0, (0.0, 0, level))  # training begins with the estimate as it is
    seconds, samples, error = np.array(errors).T
    figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
    axes.plot(seconds, 1e6 * error, "o-", color="C0", label="network")
    if level is not None:
        axes.axhline(1e6 * level, color="C1", linestyle="--", label="estimate alone")
    axes.set(xlabel="training [s], one core", ylabel="RMSD of all steps, validation [µm]", xlim=(0, None), ylim=(0, None))
    axes.legend(frameon=False)
    per_second = samples[-1] / seconds[-1]
    above = axes.secondary_xaxis("top", functions=(lambda s: s * per_second / 1e3, lambda n: n / per_second * 1e3))
    above.set_xlabel("samples [thousands]")
    figure.savefig(options.out, dpi=150)
    footing.Table().add({"seconds": seconds[-1], "samples": int(samples[-1]), "best error [m]": error.min(), "estimate alone [m]": level})


if __name__ == "__main__":
    main()
