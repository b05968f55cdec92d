"""The error bar, counted by hand."""

import math

import pytest
import torch

from learning.slender.calibration import covered, stretch


def test_the_bar_is_stretched_until_the_mean_share_of_the_trajectories_is_covered():
    """Four trajectories, of which the last has one frame: ratios 2 and 3, 1 and 4, 5 and 6, 1.5; in order each frame counts an eighth,
    but the last one, second in order, a quarter: 1/8, 3/8, 4/8, 5/8, 6/8, .."""
    errors = [torch.tensor([2.0, 9.0]), torch.tensor([4.0, 1.0]), torch.tensor([5.0, 12.0]), torch.tensor([3.0])]
    expected = [torch.tensor([1.0, 3.0]), torch.tensor([4.0, 0.25]), torch.tensor([1.0, 2.0]), torch.tensor([2.0])]
    assert [stretch(errors, expected, c) for c in (0.1, 0.125, 0.13, 0.375, 0.38, 0.5, 0.7, 0.75)] == [1, 1, 1.5, 1.5, 2, 2, 4, 4]
    assert stretch(errors, expected, 0.76) == math.inf  # one of four is more than a quarter may be


def test_new_trajectories_are_covered_as_often_as_asked():
    """Frames of one trajectory share a factor, as they do in truth; 400 trajectories tell the share within 2 %."""
    dice = torch.Generator().manual_seed(3)
    errors = list((0.2 + torch.rand(800, 25, generator=dice)) * (0.2 + torch.rand(800, 1, generator=dice)))
    expected = [torch.ones(25)] * 800
    factor = stretch(errors[:400], expected[:400], 0.9)
    assert covered(errors[400:], [factor * bar for bar in expected[400:]]) == pytest.approx(0.9, abs=0.04)  # 3 standard errors


def test_every_trajectory_counts_alike_however_many_frames_it_has():
    errors = [torch.tensor([1.0, 1.0, 1.0, 3.0]), torch.tensor([5.0])]
    assert covered(errors, [torch.full((4,), 1.0), torch.tensor([4.0])]) == (0.75 + 0) / 2
