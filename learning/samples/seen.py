"""What a run was trained on, as ranges, and how far outside of them a scene lies.

A network interpolates between the scenes it has seen; of others it knows nothing, and says nothing about that itself. So
the training leaves RUN/range.json: for each quantity of `description` the smallest and largest value of the training
trajectories, or the choices that occurred. A value v outside of [low, high] lies outside by max(low - v, v - high) /
(high - low); where all training trajectories share one value, by its relative difference from that. A choice that never
occurred lies outside by infinity.

Each quantity is looked at by itself: a scene inside of every range may still combine values as no training scene did.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from datagen.files.trajectory import INFLOW, Trajectory
from physics.scene import FlowScene, Scene, read_any
from physics.schema import InputError, parse_toml
from physics.whole import write_whole

FILE = "range.json"
ALARM = 0.2  # of the range's width: eight values drawn uniformly leave gaps of a ninth of it on average
Value = float | str


@dataclass(frozen=True)
class SeenRange:
    """Ranges of numbers, choices of words, and how many trajectories they are of."""

    numbers: dict[str, tuple[float, float]]
    choices: dict[str, tuple[str, ...]]
    trajectories: int


def description(trajectory: Trajectory) -> dict[str, Value]:
    """What tells one scene from another: geometry and motion of the obstacle, and with a scene in the file material and supports."""
    body, mesh = trajectory.body, trajectory.mesh
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    edges = np.linalg.norm(np.diff(mesh.points[mesh.edges], axis=1), axis=2)
    told: dict[str, Value] = {f"extent along {axis} [m]": float(side) for axis, side in zip("xyz", high - low, strict=True)}
    told |= {"cell size [m]": float(np.median(edges)), "nodes of the body": float(len(mesh.points)),
             "steps": float(len(trajectory.displacement) - 1), "cells": mesh.cell}
    known = read_any(parse_toml(trajectory.scene)) if trajectory.scene else None
    scene = known if isinstance(known, Scene) else None
    if "velocity" in trajectory.fields:
        speed = np.linalg.norm(trajectory.fields["velocity"].astype(np.float64), axis=2)
        told["fastest inflow [m/s]"] = float(speed[:, trajectory.node_kind == INFLOW].max(initial=0.0))
    if isinstance(known, FlowScene) and known.reynolds_number is not None:
        told["Reynolds number"] = known.reynolds_number
    if not body.all() and (scene is None or len(scene.obstacles) == 1):  # several have no path in common
        path = trajectory.displacement[:, ~body].astype(np.float64).mean(axis=1)  # (T, 3)
        size = np.ptp(trajectory.points[~body], axis=0).min()
        end = trajectory.points[~body].mean(axis=0) + path[-1]
        stride = np.linalg.norm(np.diff(path, axis=0), axis=1)
        axis = int(np.argmax(abs(path[-1])))
        told |= {"smallest extent of the obstacle [m]": float(size), "way of the obstacle [m]": float(stride.sum()),
                 "way of the obstacle in one step [m]": float(stride.max(initial=0)),
                 "end of the obstacle's path along x, in lengths of the body": float((end[0] - low[0]) / (high[0] - low[0])),
                 "direction of the obstacle": f"{'-' if path[-1, axis] < 0 else '+'}{'xyz'[axis]}"}
    if scene is not None:
        told |= {"Young's modulus [Pa]": scene.stiffest, "Poisson's ratio": max(material.poisson_ratio for material in scene.materials),
                 "density [kg/m3]": max(material.density for material in scene.materials),
                 "material law": " and ".join(material.law for material in scene.materials), "shape of the body": scene.body.shape,
                 "supports": ", ".join(sorted(f"{support.where} ({support.fixed})" for support in scene.support)) or "none",
                 "loads": ", ".join(sorted(str(load.where or "acceleration") for load in scene.load)) or "none",
                 "obstacle": scene.pressed_by}
    return told


def seen(trajectories: Iterable[Trajectory]) -> SeenRange:
    """The ranges of some trajectories; of quantities that not all of them have, those of the ones that do."""
    return ranges([description(trajectory) for trajectory in trajectories])


def ranges(told: Sequence[dict[str, Value]]) -> SeenRange:
    """The ranges of some trajectories' descriptions."""
    names = dict.fromkeys(name for each in told for name in each)
    values = {name: [each[name] for each in told if name in each] for name in names}
    numbers = {name: (float(min(v)), float(max(v))) for name, v in values.items() if not isinstance(v[0], str)}
    choices = {name: tuple(sorted(set(map(str, v)))) for name, v in values.items() if isinstance(v[0], str)}
    return SeenRange(numbers, choices, len(told))


def write_seen(run: str | Path, found: SeenRange) -> None:
    """Leave the ranges in a run's folder. Raises OSError."""
    write_whole(Path(run) / FILE, (json.dumps(vars(found), indent=1) + "\n").encode())


def read_seen(run: str | Path) -> SeenRange | None:
    """The ranges of a run; None when it has none. Raises `InputError` for a damaged file."""
    path = Path(run) / FILE
    try:
        table = json.loads(path.read_text())
        return SeenRange({name: (float(low), float(high)) for name, (low, high) in table["numbers"].items()},
                         {name: tuple(words) for name, words in table["choices"].items()}, int(table["trajectories"]))
    except FileNotFoundError:
        return None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: not the ranges of a run: {error}") from None


def outside(trajectory: Trajectory, known: SeenRange) -> dict[str, float]:
    """By how much each quantity of a trajectory lies outside of the ranges; only those that do, the farthest first."""
    found = {}
    for name, value in description(trajectory).items():
        if isinstance(value, str):
            if value not in known.choices.get(name, (value,)):
                found[name] = math.inf
        elif name in known.numbers:
            low, high = known.numbers[name]
            width = high - low if high - low > 1e-6 * max(abs(high), abs(low)) else max(abs(high), abs(low)) or 1.0
            beyond = max(low - value, value - high) / width
            if beyond > 1e-6:
                found[name] = beyond
    return dict(sorted(found.items(), key=lambda entry: -entry[1]))
