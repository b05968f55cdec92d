"""A trained predictor of beams: a network, the scales of what it sees and says, what it has seen, and how far off it may be.

    RUN/model.safetensors   weights.*, scales.*; the header has config, step, seconds, best error, fingerprint, versions

Legend: P poses, S sections, A and B features of a pose and of a section.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from learning.config import SlenderConfig
from learning.networks.sections import Sections
from learning.networks.stored import StoredScales, put_into, read_stored, under
from learning.slender.beam import FUNCTIONS
from learning.slender.features import Seen
from physics.schema import read_table

FARTHEST = 5.0  # standard deviations at which a feature is cut off
MARGIN = 0.1  # of a range's width by which a feature may leave it and still count as seen


@dataclass(frozen=True)
class Scales(StoredScales):
    """pose (2, A), section (2, B): mean and standard deviation; answer (18,) root mean square of (target / unit);
    low, high (A,): range of the training's poses; bar (1,): by how much the expected error is multiplied for an error bar."""

    pose: Tensor
    section: Tensor
    answer: Tensor
    low: Tensor
    high: Tensor
    bar: Tensor


@dataclass(frozen=True)
class Slender:
    """A network ready to predict, and where it came from."""

    config: SlenderConfig
    network: Sections
    scales: Scales
    name: str

    title = "beam sections"  # in reports

    def answer(self, seen: Seen) -> tuple[Tensor, Tensor]:
        """Coefficients (P, S, 3, 6) [m] and expected root mean square distances (P,) [m] of some poses, float32."""
        with torch.inference_mode():
            return self.answer_with_slope(seen)

    def answer_with_slope(self, seen: Seen) -> tuple[Tensor, Tensor]:
        """The same, differentiable."""
        said, doubt = self.network(scaled(seen.pose.float(), self.scales.pose), scaled(seen.section.float(), self.scales.section))
        answer = said * self.scales.answer * seen.unit.float()[..., None]
        return seen.base.float() + answer.unflatten(-1, (3, FUNCTIONS)), doubt.exp() * seen.depth.float()

    def strange(self, seen: Seen) -> Tensor:
        """(P,) True where a feature of a pose lies outside of what the training saw, or a sphere has left its groove at a jump."""
        low, high = self.scales.low, self.scales.high
        margin = MARGIN * (high - low) + 1e-5
        pose = seen.pose.float()
        return ((pose < low - margin) | (pose > high + margin)).any(dim=1) | seen.jumps


def scaled(features: Tensor, scale: Tensor) -> Tensor:
    """Features less their mean over their deviation, cut off where they are far from all that was seen."""
    return ((features - scale[0]) / scale[1]).clamp(-FARTHEST, FARTHEST)


def load_slender(run: str | Path, name: str = "model") -> Slender:
    """The best predictor of a run folder. Raises `InputError` when the folder holds no whole one."""
    path = Path(run) / f"{name}.safetensors"
    about, tensors = read_stored(path)
    config = read_table(SlenderConfig, about.get("config"), f"{path}: config")
    scales = Scales.of(tensors, path)
    network = Sections(config.network, scales.pose.shape[1], scales.section.shape[1])
    put_into(network, under("weights.", tensors), path)
    return Slender(config, network.eval(), scales, str(run))
