"""A trained predictor of bodies by shapes: a network, the scales of what it sees and says, its shapes, and how far off it may be.

    RUN/model.safetensors   weights.*, scales.*; the header has config, step, seconds, best error, fingerprint, versions

Legend: P poses, A features, r shapes, M functions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from learning.bodies.body import shown_signs
from learning.bodies.shapes import mirror_signs, mirrors
from learning.config import BodiesConfig
from learning.networks.shapes import Shapes
from learning.networks.stored import StoredScales, put_into, read_stored, under
from learning.slender.model import MARGIN, scaled
from physics.schema import InputError, read_table


@dataclass(frozen=True)
class Scales(StoredScales):
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


@dataclass(frozen=True)
class Bodies:
    """A network ready to predict, and where it came from."""

    config: BodiesConfig
    network: Shapes
    scales: Scales
    name: str

    title = "body shapes"  # in reports

    def answer(self, feature: Tensor, depth: Tensor) -> tuple[Tensor, Tensor]:
        """Amounts (P, r) [m] of shapes and expected root mean square distances (P,) [m] from features (P, A) and depths (P,) [m]: the means
        of what is said of the body and of its copies in those mirrors that the training showed, turned back."""
        with torch.inference_mode():
            every = [self.network(scaled(feature * seen, self.scales.pose)) for seen, _ in self._mirrors]
            amounts = torch.stack([said * turned for (said, _), (_, turned) in zip(every, self._mirrors, strict=True)]).mean(dim=0)
            return amounts * self.scales.answer * depth[:, None], torch.stack([doubt for _, doubt in every]).mean(dim=0).exp() * depth

    @cached_property
    def _mirrors(self) -> list[tuple[Tensor, Tensor]]:
        """Of each mirror the signs of features (A,) and of amounts (r,): shapes found in copies in all mirrors are even or odd."""
        found = []
        for mirror in mirrors(self.config.mirrored):
            seen, turned = torch.ones(1), self.scales.shapes
            for axis in mirror:
                seen = seen * torch.from_numpy(shown_signs(axis)).float()
                turned = turned * torch.from_numpy(mirror_signs(self.scales.degrees.numpy(), axis)).float()
            found.append((seen, (turned * self.scales.shapes).sum(dim=(1, 2)).sign()))
        return found

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
    scales = Scales.of(tensors, path)
    network = Shapes(config.network, scales.pose.shape[1], len(scales.shapes))
    if scales.degrees.shape != (scales.shapes.shape[1], 4):
        raise InputError(f"{path}: was trained by an earlier version, in other functions: train it anew")
    put_into(network, under("weights.", tensors), path)
    return Bodies(config, network.eval(), scales, str(run))
