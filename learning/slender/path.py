"""All frames of a scene from a few poses: cubic splines in time, and sections spread over the nodes.

The obstacle moves on a straight line, and while the body stays on one branch what it does is a smooth function of where the obstacle is.
So poses are predicted at a few fractions s of the way from the first touch to the end, closer at the beginning, and

    u(t) = sum over poses k of W_k(t) u_k,    W the cubic spline through the poses (not-a-knot), 0 before the touch

is one product of matrices. The error bar of a frame is that of the poses beside it, straight lines between them; a frame is unlike those
of the training where a pose beside it is.

Legend: T frames, K poses, N nodes, S sections.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from learning.slender.beam import Beam, see
from learning.slender.features import shown
from learning.slender.model import Slender
from physics.scene import Scene
from physics.schema import InputError

Floats = NDArray[np.floating[Any]]
CLOSER = 1.2  # power by which poses crowd at the first touch


@dataclass(frozen=True)
class Path:
    """displacement (T, N, 3) [m] of the body; bar (T,) [m] within which the root mean square distance of free nodes from the truth is
    expected, in the share of frames that the config calls coverage; unsure (T,) True where that cannot be relied on or is too long."""

    displacement: NDArray[np.float32]
    bar: Floats
    unsure: NDArray[np.bool_]


def predict(model: Slender, scene: Scene, points: Floats) -> Path:
    """The path of a scene's body, whose mesh has its nodes at points (N, 3).

    Raises:
        InputError: the scene is not one of a beam that an obstacle presses, or the points are not those of its mesh
    """
    beam, count = see(scene), scene.steps.count
    check_points(beam, points)
    frames = np.linspace(0.0, 1.0, count + 1)
    path = Path(np.zeros((count + 1, len(points), 3), np.float32), np.zeros(count + 1), np.zeros(count + 1, bool))
    first = int(np.searchsorted(frames, beam.first_touch, side="right"))
    if first > count:
        return path
    poses = knots(beam.first_touch, model.config.poses)
    with torch.inference_mode():
        seen = shown(beam, poses)
        seen = replace(seen, jumps=seen.jumps.cumsum(0) > 0)  # past a jump theory may be in another groove than the body
        coefficients, doubt = model.answer(seen)
    nodes = beam.nodes(coefficients.numpy()).reshape(len(poses), -1)
    weights = CubicSpline(poses, np.eye(len(poses)))(frames[first:]).astype(np.float32)
    np.matmul(weights, nodes, out=path.displacement.reshape(count + 1, -1)[first:])
    factor = model.scales.bar.item()
    path.bar[first:] = factor * np.interp(frames[first:], poses, doubt.numpy()) if np.isfinite(factor) else np.inf
    strange = np.interp(frames[first:], poses, model.strange(seen).numpy()) > 0
    path.unsure[first:] = strange | (path.bar[first:] > model.config.unsure_above)
    return path


def knots(start: float, count: int) -> Floats:
    """(K,) fractions of a path, from the first touch to the end."""
    return start + (1 - start) * np.linspace(0.0, 1.0, count) ** CLOSER


def check_points(beam: Beam, points: Floats) -> None:
    """Raise `InputError` unless the points (N, 3) are those of the beam's grid."""
    place = np.argsort([0, beam.side, beam.up])
    extent, cells = (np.array(each)[place] for each in (beam.extent, beam.cells))
    grid = points.reshape(*(cells + 1), 3) if len(points) == np.prod(cells + 1) else None
    sides = None if grid is None else (grid[:, 0, 0, 0], grid[0, :, 0, 1], grid[0, 0, :, 2])
    if sides is None or not all(np.allclose(side, np.linspace(0, length, n + 1), atol=1e-9 * extent[0])
                                for side, length, n in zip(sides, extent, cells, strict=True)):
        raise InputError("the mesh is not the one that its scene builds")
