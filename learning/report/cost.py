"""What a trained predictor has cost before its first scene, and after how many scenes that is paid back against finite elements.

    n = (training + data) / (a scene by the reference - a scene predicted)

in seconds. Those of the training are its processor's; those of the data are what the training's and validation's trajectories took one by
one, as their files tell. A predictor that is slower than the reference is never paid back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from learning.networks.stored import read_stored
from learning.report.table import Row


def called(runs: dict[str, Any]) -> dict[str, str]:
    """What each run's predictor is called in a report, by its folder: by its kind, where several are of one kind by the folder's name
    too."""
    kinds = [model.title for model in runs.values()]
    return {run: model.title if kinds.count(model.title) == 1 else f"{model.title} {Path(run).name}" for run, model in runs.items()}


def paid_back(rows: Sequence[Row], runs: dict[str, Any]) -> list[Row]:
    """The rows, those of learned predictors with the number of scenes after which they are paid back; runs: models by their folders."""
    headers = {name: read_stored(Path(run) / "model.safetensors")[0] for run, name in called(runs).items()}
    return counted(rows, headers)


def counted(rows: Sequence[Row], headers: dict[str, dict[str, Any]]) -> list[Row]:
    """The same from the headers of the checkpoints, by the names of their predictors."""
    reference = next((row.scores["seconds"] for row in rows if row.kind == "reference"), math.nan)
    return [replace(row, scores=row.scores | {"paid_back": _scenes(headers.get(row.name, {}), reference - row.scores["seconds"])})
            if row.kind == "learned" else row for row in rows]


def _scenes(about: dict[str, Any], saved: float) -> float:
    """n of the module; not a number where it is not known what the data took."""
    if not about.get("data_seconds") or math.isnan(saved):
        return math.nan
    return math.ceil((about["seconds"] + about["data_seconds"]) / saved) if saved > 0 else math.inf


def data_said(about: dict[str, Any]) -> str:
    """What a run's data took, in words that follow the seconds of its training; empty where that is not known."""
    data = about.get("data_seconds")
    return f" on data that took {data:.0f} s" if data else ""


def payback_said(rows: Sequence[Row]) -> list[str]:
    """After how many scenes each learned predictor is paid back, where that is known: a sentence each."""
    known = [(row, row.scores.get("paid_back", math.nan)) for row in rows]
    return [f"{row.name} has paid back the time of its training and data after {scenes:.0f} scenes that finite elements need not solve."
            for row, scenes in known if math.isfinite(scenes)]
