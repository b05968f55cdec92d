"""A training of whatever kind its config asks for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

from learning.config import BodiesConfig, PosesConfig, SlenderConfig, TrainConfig
from learning.training import train as of_graphs
from learning.training.sections import train_sections
from learning.training.shapes import train_shapes


def train(config: TrainConfig | PosesConfig, files_train: Sequence[str | Path], files_valid: Sequence[str | Path], out: str | Path, *,
          steps: int | None = None, resume: bool = False, device: str = "cpu") -> dict[str, Any]:
    """See `training.train.train`, and `training.sections.train_sections` and `training.shapes.train_shapes`, which run on the processor."""
    if isinstance(config, SlenderConfig):
        return train_sections(config, files_train, files_valid, out, steps=steps, resume=resume)
    if isinstance(config, BodiesConfig):
        return train_shapes(config, files_train, files_valid, out, steps=steps, resume=resume)
    return of_graphs.train(cast(TrainConfig, config), files_train, files_valid, out, steps=steps, resume=resume, device=device)
