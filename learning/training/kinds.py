"""A training of whatever kind its config asks for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from learning.config import SlenderConfig, TrainConfig
from learning.training import train as of_graphs
from learning.training.sections import train_sections


def train(config: TrainConfig | SlenderConfig, files_train: Sequence[str | Path], files_valid: Sequence[str | Path], out: str | Path, *,
          steps: int | None = None, resume: bool = False, device: str = "cpu") -> dict[str, Any]:
    """See `training.train.train` and `training.sections.train_sections`; the latter runs on the processor."""
    if isinstance(config, SlenderConfig):
        return train_sections(config, files_train, files_valid, out, steps=steps, resume=resume)
    return of_graphs.train(config, files_train, files_valid, out, steps=steps, resume=resume, device=device)
