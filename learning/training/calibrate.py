"""The error bar of a trained predictor, found anew from trajectories that it was not trained on; its weights stay as they are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from learning.bodies.model import Bodies
from learning.bodies.samples import fitted, read, sample_of
from learning.networks.stored import read_stored, write_stored
from learning.prediction.checkpoint import load_model
from learning.slender.model import Slender
from learning.slender.samples import load_samples
from learning.training import sections, shapes
from physics.schema import InputError


def calibrate(run: str | Path, files: Sequence[str | Path]) -> dict[str, Any]:
    """Put the factor of the error bar that some trajectories ask for (slender/calibration.py) into RUN/model.safetensors.

    Returns:
        trajectories, coverage that is aimed at, factor and former factor of the expected errors, error [m] on these trajectories

    Raises:
        InputError: no run that says how far off it may be, too few or damaged trajectories, or scenes that are not of its kind
    """
    model = load_model(run)
    if isinstance(model, Slender):
        error, factor = sections.judge(model, load_samples(files, model.config.frames))
    elif isinstance(model, Bodies):
        degrees, found = (each.numpy() for each in (model.scales.degrees, model.scales.shapes))
        error, factor = shapes.judge(model, [sample_of(fitted(one, degrees), found.astype(np.float64))
                                             for one in read(files, model.config.frames)])
    else:
        raise InputError(f"{run}: is a network that says nothing of its own error")
    if not math.isfinite(factor):
        raise InputError(f"{len(files)} trajectories are too few to tell what {100 * model.config.coverage:.3g} % of them would be: "
                         f"{math.ceil(1 / (1 - model.config.coverage))} at the least")
    path = Path(run) / "model.safetensors"
    about, tensors = read_stored(path)
    before = tensors["scales.bar"].item()
    about.pop("schema")
    write_stored(path, about | {"calibrated_on": len(files)}, tensors | {"scales.bar": torch.tensor([factor])})
    return {"run": str(run), "trajectories": len(files), "coverage": model.config.coverage, "factor": factor, "before": before,
            "error": error}
