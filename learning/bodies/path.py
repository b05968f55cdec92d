"""Frames of a scene from a few poses: amounts of shapes at the poses, cubic splines in time, shapes spread over the nodes.

    u(t) = sum over shapes i and poses k of W_k(t) a_ki s_i,    W the cubic spline through the poses, 0 before the touch

Poses, splines, error bars and doubt are as in slender/path.py. Legend: T frames, N nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from learning.bodies.body import PressedBody, see
from learning.bodies.model import Bodies
from learning.bodies.shapes import functions
from learning.slender.many import PathFrames
from learning.slender.path import Path, knots
from physics.mesh.mesh import Mesh
from physics.scene import Scene

Floats = NDArray[np.floating[Any]]


def predict(model: Bodies, scene: Scene, mesh: Mesh) -> Path:
    """The path of a scene's body. Raises `InputError` for a scene that is not of this kind."""
    return path_of(model, see(scene, mesh), np.linspace(0.0, 1.0, scene.steps.count + 1))


def predict_many(model: Bodies, bodies: Sequence[PressedBody], frames: Floats) -> PathFrames:
    """What the predictor says of some frames of several paths, given as fractions (F,) of each; their forces are unknown: nan."""
    order = np.argsort(frames, kind="stable")
    paths = [path_of(model, body, frames[order]) for body in bodies]
    displacement, bar, unsure = (np.stack([getattr(path, name)[np.argsort(order)] for path in paths])
                                 for name in ("displacement", "bar", "unsure"))
    return PathFrames(displacement, bar, unsure, np.full(bar.shape, np.nan))


def path_of(model: Bodies, body: PressedBody, frames: Floats) -> Path:
    """Frames of a body's path, given as rising fractions (T,) of it."""
    count = len(frames)
    path = Path(np.zeros((count, len(body.points), 3), np.float32), np.zeros(count), np.zeros(count, bool))
    first = int(np.searchsorted(frames, body.first_touch, side="right"))
    if first == count:
        return path
    poses = knots(body.first_touch, model.config.poses)
    feature, depth = (torch.from_numpy(each).float() for each in body.shown(poses))
    amount, doubt = model.answer(feature, depth.clamp(min=0))
    basis = model.basis(functions(body, model.scales.degrees.numpy()))
    basis[:, body.held] = 0
    weights = CubicSpline(poses, amount.numpy())(frames[first:]).astype(np.float32)  # (T, r)
    np.matmul(weights, basis.reshape(len(basis), -1), out=path.displacement.reshape(count, -1)[first:])
    factor = model.scales.bar.item()
    path.bar[first:] = factor * np.interp(frames[first:], poses, doubt.numpy()) if np.isfinite(factor) else np.inf
    strange = np.interp(frames[first:], poses, model.strange(feature).numpy()) > 0
    path.unsure[first:] = strange | (path.bar[first:] > model.config.unsure_above)
    return path
