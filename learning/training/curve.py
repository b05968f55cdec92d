"""The curve of a training: one JSON object a line in RUN/curve.jsonl, and the same for TensorBoard where that is installed.

    .venv/bin/pip install tensorboard && .venv/bin/tensorboard --logdir RUN

A resumed training goes on with the curve of the steps that its checkpoint has seen; later lines, of a training that was killed
after it, are dropped. TensorBoard, which keeps them in its own files, is told to forget them.
"""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from types import TracebackType
from typing import Any

from physics.whole import write_whole


class Curve:
    """Where figures of a training go; use it as a context. Without a folder they go nowhere."""

    def __init__(self, folder: Path | None, step: int) -> None:
        """Args: folder: of the run; step: the last one whose lines are kept."""
        self._file, self._board = None, None
        if folder is None:
            return
        path = folder / "curve.jsonl"
        write_whole(path, "".join(_kept(path, step)).encode())
        self._file = open(path, "a")
        if importlib.util.find_spec("tensorboard") is not None:
            from torch.utils.tensorboard import SummaryWriter

            self._board = SummaryWriter(str(folder), purge_step=step + 1)

    def __enter__(self) -> Curve:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        for each in (self._file, self._board):
            if each is not None:
                each.close()

    def add(self, step: int, **values: float | None) -> None:
        """Figures of one training step; None is written down as such, and not drawn."""
        if self._file is not None:
            self._file.write(json.dumps({"step": step, **values}) + "\n")
            self._file.flush()
        if self._board is not None:
            for name, value in values.items():
                if value is not None:
                    self._board.add_scalar(name, value, step)


def read_curve(folder: Path) -> list[dict[str, Any]]:
    """The lines of a run's curve, as far as they are whole; none without one."""
    path = folder / "curve.jsonl"
    return [json.loads(line) for line in _kept(path, sys.maxsize)] if path.exists() else []


def _kept(path: Path, step: int) -> list[str]:
    """Lines of a curve up to a step, as far as they are whole."""
    kept: list[str] = []
    if step and path.exists():
        for line in path.read_text().splitlines():
            try:
                if json.loads(line)["step"] <= step:
                    kept.append(line + "\n")
            except json.JSONDecodeError:  # the line that was being written
                break
    return kept
