"""The error bar, counted by hand."""

import math

import pytest
import torch

from learning.slender.calibration import covered, stretch


def test_the_bar_is_stretched_to_the_order_statistic_of_split_conformal_prediction():
    errors, expected = torch.tensor([2.0, 9.0, 4.0, 1.0]), torch.tensor([1.0, 3.0, 4.0, 0.25])  # ratios 2, 3, 1, 4
    assert stretch(errors, expected, 0.5) == 3.0  # ceil(5 x 0.5) = 3rd of 1, 2, 3, 4
    assert stretch(errors, expected, 0.2) == 1.0
    assert stretch(errors, expected, 0.8) == 4.0
    assert stretch(errors, expected, 0.81) == math.inf  # a fifth one would be needed


def test_new_frames_are_covered_as_often_as_asked():
    dice = torch.Generator().manual_seed(3)
    errors, expected = torch.rand(2, 4000, generator=dice).double() + 0.01
    factor = stretch(errors[:2000], expected[:2000], 0.9)
    assert float((errors[2000:] <= factor * expected[2000:]).double().mean()) == pytest.approx(0.9, abs=0.025)  # 3 standard errors


def test_every_trajectory_counts_alike_however_many_frames_it_has():
    errors = [torch.tensor([1.0, 1.0, 1.0, 3.0]), torch.tensor([5.0])]
    assert covered(errors, [torch.full((4,), 1.0), torch.tensor([4.0])]) == (0.75 + 0) / 2
