"""A trained predictor of bodies by shapes: a network, the scales of what it sees and says, its shapes, and how far off it may be.

    RUN/model.safetensors   weights.*, scales.*; the header has config, step, seconds, best error, fingerprint, versions

Legend: P poses, A features, r shapes, M functions.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from learning.config import BodiesConfig
from learning.networks.shapes import Shapes
from learning.networks.stored import put_into, read_stored, under
from learning.slender.model import MARGIN, scaled
from physics.schema import InputError, read_table


@dataclass(frozen=True)
class Scales:
    """pose (2, A): mean and standard deviation of features; answer (r,): root mean square of amounts over depth; low, high (A,): range of
    the training's features; degrees (M, 4), shapes (r, M, 3): as in shapes.py; bar (1,): by how much the expected error is multiplied
    for an error bar."""

    pose: Tensor
    answer: Tensor
    low: Tensor
    high: Tensor
    degrees: Tensor
    shapes: Tensor
    bar: Tensor

    def tensors(self) -> dict[str, Tensor]:
        """By name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


@dataclass(frozen=True)
class Bodies:
    """A network ready to predict, and where it came from."""

    config: BodiesConfig
    network: Shapes
    scales: Scales
    name: str

    title = "body shapes"  # in reports

    def answer(self, feature: Tensor, depth: Tensor) -> tuple[Tensor, Tensor]:
        """Amounts (P, r) [m] of shapes and expected root mean square distances (P,) [m] from features (P, A) and depths (P,) [m]."""
        with torch.inference_mode():
            said, doubt = self.network(scaled(feature, self.scales.pose))
            return said * self.scales.answer * depth[:, None], doubt.exp() * depth

    def strange(self, feature: Tensor) -> Tensor:
        """(P,) True where a feature lies outside of what the training saw."""
        low, high = self.scales.low, self.scales.high
        margin = MARGIN * (high - low) + 1e-4
        return ((feature < low - margin) | (feature > high + margin)).any(dim=1)

    def basis(self, values: np.ndarray) -> np.ndarray:
        """(r, N, 3) the shapes at nodes where the functions have values (N, M)."""
        return np.matmul(values.astype(np.float32), self.scales.shapes.numpy())


def load_bodies(run: str | Path, name: str = "model") -> Bodies:
    """The best predictor of a run folder. Raises `InputError` when the folder holds no whole one."""
    path = Path(run) / f"{name}.safetensors"
    about, tensors = read_stored(path)
    config = read_table(BodiesConfig, about.get("config"), f"{path}: config")
    try:
        scales = Scales(**{field.name: tensors[f"scales.{field.name}"] for field in fields(Scales)})
        network = Shapes(config.network, scales.pose.shape[1], len(scales.shapes))
    except KeyError as error:
        raise InputError(f"{path}: not a whole checkpoint: {error}") from None
    if scales.degrees.shape != (scales.shapes.shape[1], 4):
        raise InputError(f"{path}: was trained by an earlier version, in other functions: train it anew")
    put_into(network, under("weights.", tensors), path)
    return Bodies(config, network.eval(), scales, str(run))
