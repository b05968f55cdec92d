"""Trajectories of bodies as tables of poses, for a network to be trained on and tested with.

With s_i the shapes at the free nodes of a body and u its true displacement, a mean over these nodes of |sum_i a_i s_i - u|^2 is

    (a - b)^T G (a - b) + left,    G_ij = <s_i . s_j>,    b = G^-1 <s . u>,    left = <|u|^2> - b^T G b

so that errors are known without nodes. The shapes are found when all bodies have been read; before, their functions stand in their place.

Legend: P poses, A features, M functions, r shapes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from datagen.files.solved import solved_on
from datagen.files.trajectory import Trajectory
from learning.bodies.body import PressedBody, see
from learning.bodies.shapes import Powers, fit, functions, mirror_signs, principal, solved
from learning.samples.seen import Value, description
from learning.slender.samples import since_touch, taken
from physics.scene import Scene

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Read:
    """Some frames of one trajectory: its body, fractions (P,) of the path, displacement (P, N, 3), description, SHA-256, and the
    seconds that it took to be made, where they are known."""

    body: PressedBody
    fraction: Floats
    displacement: Floats
    told: dict[str, Value]
    digest: str
    seconds: float


@dataclass(frozen=True)
class Fitted:
    """Poses by functions: features (P, A), depth (P,) [m], coefficients (P, S, 3) of the S functions of the box, which come first, and over
    the free nodes products (M, M) of functions, moments (P, M, 3) <f u> and square (P,) <|u|^2>; motion [m], the root of the mean of
    that."""

    feature: Floats
    depth: Floats
    coefficients: Floats
    products: Floats
    moments: Floats
    square: Floats

    @property
    def motion(self) -> float:
        return float(np.sqrt(self.square.mean()))


@dataclass(frozen=True)
class Sample:
    """Poses by shapes: feature (P, A), depth (P,) [m], gram (r, r), best (P, r), left (P,) as G, b, left of the module; motion [m]."""

    feature: Tensor
    depth: Tensor
    gram: Tensor
    best: Tensor
    left: Tensor
    motion: float

    def error(self, amount: Tensor) -> Tensor:
        """(P,) [m] root mean square distance of the free nodes for amounts (P, r)."""
        off = amount - self.best
        return (((off @ self.gram) * off).sum(dim=1) + self.left).sqrt()


def read(files: Sequence[str | Path], frames: int) -> list[Read]:
    """At most so many frames of each trajectory, evenly spaced since the first touch; those without a touch left out.

    Raises:
        InputError: there are none, one is damaged, or its scene is not of this kind
    """
    return taken(files, lambda trajectory: _picked(trajectory, frames), "body")


def _picked(trajectory: Trajectory, frames: int) -> Read | None:
    scene, last = Scene.from_toml(trajectory.scene), len(trajectory.displacement) - 1
    body = see(scene, solved_on(scene, trajectory))
    picked = since_touch(body.first_touch, last, frames)
    if not len(picked):
        return None
    digest = hashlib.sha256(np.ascontiguousarray(trajectory.displacement, "<f4").tobytes()).hexdigest()
    truth = trajectory.displacement[picked][:, trajectory.body].astype(np.float64)
    return Read(body, picked / last, truth, description(trajectory), digest, float(trajectory.extra.get("seconds", 0.0)))


def fitted(one: Read, degrees: Powers, mirror: Sequence[int] = ()) -> Fitted:
    """A trajectory by functions, seen in mirrors normal to some axes."""
    body, values, smooth = one.body, functions(one.body, degrees), degrees[:, 3] == 0
    coefficients, free = fit(values[:, smooth], one.displacement), one.body.free
    products = values[free].T @ values[free] / free.sum()
    moments = np.einsum("nm,tnk->tmk", values[free], one.displacement[:, free], optimize=True) / free.sum()
    for axis in mirror:
        signs, body = mirror_signs(degrees, axis), body.mirrored(axis)
        coefficients, moments = coefficients * signs[smooth], moments * signs
        odd = np.where(degrees[:, axis] % 2, -1.0, 1.0)
        products = products * odd[:, None] * odd
    feature, depth = body.shown(one.fraction)
    return Fitted(feature, np.maximum(depth, 0.0), coefficients, products, moments,
                  (one.displacement[:, free] ** 2).sum(axis=2).mean(axis=1))


def shapes_of(every: Sequence[Fitted], count: int, touched: int) -> Floats:
    """(r, M, 3) the principal combinations of the functions of the box, and of those about the touch so many of what these leave over."""
    weight = np.concatenate([np.full(len(one.depth), 1 / one.motion) for one in every])
    smooth = principal(np.concatenate([one.coefficients for one in every]), weight, count)
    first = smooth.shape[1]
    if not touched:
        return smooth
    smooth = np.pad(smooth, ((0, 0), (0, len(every[0].products) - first), (0, 0)))
    left, mean = [], np.mean([one.products[first:, first:] for one in every], axis=0)
    for one in every:
        *_, best = _amounts(one, smooth)
        rest = one.moments[:, first:] - np.einsum("lm,imk,pi->plk", one.products[first:], smooth, best, optimize=True)
        left.append(solved(one.products[first:, first:], rest.swapaxes(0, 1)).swapaxes(0, 1))
    about = principal(np.concatenate(left), weight, touched, mean)
    return np.concatenate([smooth, np.pad(about, ((0, 0), (first, 0), (0, 0)))])


def _amounts(one: Fitted, shapes: Floats) -> tuple[Floats, Floats, Floats]:
    """G, <s . u> (P, r) and b of the module."""
    gram = np.einsum("imk,mn,jnk->ij", shapes, one.products, shapes, optimize=True)
    work = np.einsum("imk,pmk->pi", shapes, one.moments, optimize=True)
    return gram, work, np.linalg.solve(gram + 1e-9 * np.trace(gram) / len(gram) * np.eye(len(gram)), work.T).T


def sample_of(one: Fitted, shapes: Floats) -> Sample:
    """The same by shapes (r, M, 3)."""
    gram, work, best = _amounts(one, shapes)
    left = np.maximum(one.square - 2 * (best * work).sum(axis=1) + ((best @ gram) * best).sum(axis=1), 0.0)
    feature, depth, products, amounts, rest = (torch.from_numpy(np.ascontiguousarray(each)).float()
                                               for each in (one.feature, one.depth, gram, best, left))
    return Sample(feature, depth, products, amounts, rest, one.motion)


@dataclass(frozen=True)
class Table:
    """Samples one after another: feature (P, A), depth, owner, weight (P,), best (P, r), gram (samples, r, r); a weight is 1 over the
    square of the motion of its trajectory, so that relative errors count alike, their mean 1."""

    feature: Tensor
    depth: Tensor
    best: Tensor
    gram: Tensor
    owner: Tensor
    weight: Tensor


def table_of(samples: Sequence[Sample]) -> Table:
    """All of them in one."""
    owner = torch.cat([torch.full((len(s.depth),), i) for i, s in enumerate(samples)])
    weight = torch.tensor([s.motion**-2 for s in samples])[owner]
    return Table(torch.cat([s.feature for s in samples]), torch.cat([s.depth for s in samples]), torch.cat([s.best for s in samples]),
                 torch.stack([s.gram for s in samples]), owner, weight / weight.mean())


def fingerprint(found: Sequence[Read]) -> str:
    """SHA-256 over their displacements: tells whether two trainings saw the same data."""
    return hashlib.sha256("".join(one.digest for one in found).encode()).hexdigest()
