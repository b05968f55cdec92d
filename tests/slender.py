"""Scenes of beams, and a predictor of them whose weights are drawn rather than trained, for tests."""

import torch

from learning.config import SlenderConfig
from learning.networks.sections import Sections, SectionsConfig
from learning.slender.beam import see
from learning.slender.features import shown
from learning.slender.model import Scales, Slender
from physics.scene import read_scene

SMALL = SectionsConfig(pose_hidden=8, pose_layers=1, hidden=6, layers=1)


def scene(*, cells=(20, 4, 4), sides=(0.1, 0.022, 0.024), support=("x-min",), path=((0.08, 0.012, 0.036), (0.081, 0.0125, 0.022)),
          steps=20, **changes):
    """A beam under a sphere of 1 cm that presses on z-max, unless told otherwise; other tables are laid over those."""
    table = {"body": {"length": sides[0], "width": sides[1], "height": sides[2], "cells": list(cells)},
             "material": {"young_modulus": 1e6, "poisson_ratio": 0.4}, "support": [{"where": where} for where in support],
             "obstacle": {"shape": "sphere", "radius": 0.01, "path": [list(place) for place in path]}, "steps": {"count": steps}}
    for name, value in changes.items():
        table[name] = {**table.get(name, {}), **value} if isinstance(value, dict) else value
    return read_scene(table)


def predictor(like, seed=0, **config):
    """A predictor of beams with drawn weights that has seen the poses of some scenes."""
    torch.manual_seed(seed)
    seen = [shown(see(each), torch.linspace(0.15, 1, 80).double().numpy()) for each in like]
    pose = torch.cat([each.pose for each in seen]).float()
    section = torch.cat([each.section.flatten(0, 1) for each in seen]).float()
    moments = [torch.stack([values.mean(0), torch.where(values.std(0) > 1e-5, values.std(0), 1.0)]) for values in (pose, section)]
    network = Sections(SMALL, pose.shape[1], section.shape[1]).eval()
    scales = Scales(*moments, torch.full((18,), 0.1), pose.amin(0), pose.amax(0), torch.tensor([2.0]))
    return Slender(SlenderConfig(network=SMALL, poses=9, **config), network, scales, "drawn")
