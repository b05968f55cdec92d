"""Past a jump theory may be in another groove than the body: what is not sure there stays so to the end of the path.

The beam was drawn from the family `beam`: its sphere leaves its groove while the beam is stiff, theory has it back there when the beam
is soft, and finite elements stay in the other one: from then on theory, which sees no jump any more, is millimetres off.
"""

from dataclasses import replace

import numpy as np
import torch

from learning.slender.beam import see
from learning.slender.features import left, obstacle_of, shown
from learning.slender.many import alike, predict_many
from learning.slender.path import knots, predict
from physics.mesh.build import build_mesh
from tests.slender import predictor, scene

SLIDES = {"sides": (0.2295, 0.03125, 0.02528), "cells": (44, 6, 5), "obstacle": {"radius": 0.019423},
          "path": ((0.13995, 0.051976, 0.012716), (0.13171, 0.007424, 0.011595))}


def test_past_a_jump_every_pose_of_the_path_is_left():
    beam = see(scene(**SLIDES))
    at = np.array([0.2, 0.36, 0.6, 0.8])
    assert shown(beam, at).jumps.tolist() == [False, True, False, False]  # a pose by itself forgets
    centres = torch.as_tensor(beam.centre(at))[None]
    assert left(beam, centres, obstacle_of(beam)).tolist() == [[False, True, True, True]]
    assert left(beam, centres[:, ::2], obstacle_of(beam)).tolist() == [[False, False]]


def test_a_path_is_unsure_from_its_jump_on_and_so_is_its_last_frame_alone():
    one = scene(**SLIDES, steps=40)
    made = predictor([one])
    made = replace(made, config=replace(made.config, unsure_above=1.0, poses=32))
    free = replace(made.scales, low=torch.full_like(made.scales.low, -1e9), high=torch.full_like(made.scales.high, 1e9))
    made = replace(made, scales=free)  # nothing is outside of what it has seen
    alone = predict(made, one, build_mesh(one.body).points)
    first = int(alone.unsure.argmax())
    assert 0.25 * 40 < first < 0.36 * 40 and alone.unsure[first:].all()
    assert not shown(see(one), knots(see(one).first_touch, 32)).jumps[20]  # which is about half of the way
    (_, paths), = alike([see(one)])
    for frames in ([1.0], [0.2, 0.5, 1.0]):
        found = predict_many(made, paths, np.array(frames))
        assert found.unsure[0].tolist() == alone.unsure[np.round(40 * np.array(frames)).astype(int)].tolist()
