"""The training of a predictor by shapes, number by number: its scales, its loss, what is judged."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from learning.bodies.samples import Read, fingerprint, fitted, sample_of
from learning.bodies.shapes import powers, principal
from learning.config import BodiesConfig
from learning.networks.shapes import Shapes, ShapesConfig
from learning.training import shapes as module
from tests.test_learning_bodies_body import PLATE, seen

CONFIG = BodiesConfig(frames=4, poses=5, coverage=0.5, mirrored="yx", seed=3, network=ShapesConfig(degree=3, shapes=3, hidden=6, layers=1))


def read(seed, frames, **changes):
    """A trajectory of random numbers."""
    dice, body = np.random.default_rng(seed), seen(**changes)
    moved = 1e-3 * (1 + 3 * seed) * dice.normal(size=(frames, *body.points.shape))
    moved[:, body.held] = 0
    return Read(body, np.linspace(0.4, 1, frames), moved, {}, f"d{seed}", seconds=1.5 + seed)


FOUND = [read(0, 3), read(1, 2, body=PLATE | {"length": 0.12, "height": 0.012})]
LEARNER = module._OfShapes(CONFIG, FOUND, [read(2, 2)], "run")


def expected():
    """Of each trajectory and each of its mirrored copies a sample: as it is, in y, in x, in both."""
    degrees = powers(np.array([0.11, 0.08, 0.011]), 3)
    every = [fitted(one, degrees, mirror) for one in FOUND for mirror in ((), (1,), (0,), (1, 0))]
    weight = np.concatenate([[1 / np.sqrt((one.square).mean())] * len(one.depth) for one in every])
    shapes = principal(np.concatenate([one.coefficients for one in every]), weight, 3)
    return degrees, shapes, [sample_of(one, shapes) for one in every]


def test_it_learns_from_every_trajectory_and_all_its_mirrored_copies():
    degrees, shapes, samples = expected()
    scales, table = LEARNER.scales, LEARNER.table
    assert torch.equal(scales.degrees, torch.from_numpy(degrees)) and torch.equal(scales.shapes, torch.from_numpy(shapes).float())
    assert LEARNER.poses == 4 * 5 and LEARNER.data_seconds == 1.5 + 2.5 + 3.5 and LEARNER.fingerprint == fingerprint(FOUND)
    feature = np.concatenate([each.feature.numpy() for each in samples]).astype(float)
    assert table.feature.numpy() == pytest.approx(feature, abs=1e-6)
    deviation = feature.std(axis=0, ddof=1)
    assert scales.pose[0].tolist() == pytest.approx(feature.mean(axis=0), abs=1e-5)
    assert scales.pose[1].tolist() == pytest.approx(np.where(deviation > 1e-5, deviation, 1.0), rel=1e-4, abs=1e-6)
    assert scales.low.tolist() == pytest.approx(feature.min(axis=0)) and scales.high.tolist() == pytest.approx(feature.max(axis=0))
    best, depth = (np.concatenate([getattr(each, name).numpy() for each in samples]) for name in ("best", "depth"))
    assert scales.answer.tolist() == pytest.approx(np.sqrt((best**2).mean(axis=0) / (depth**2).mean()), rel=1e-5)
    assert scales.bar.tolist() == [math.inf] and LEARNER.state(2.5)["scales.bar"].tolist() == [2.5]
    torch.manual_seed(3)
    plain = Shapes(CONFIG.network, feature.shape[1], 3).state_dict()
    assert all(torch.equal(value, plain[name]) for name, value in LEARNER.network.state_dict().items())


def test_the_loss_is_the_weighted_square_of_displacements_over_that_of_none_and_what_doubt_costs():
    _, _, samples = expected()
    every = [(s, p) for s in samples for p in range(len(s.depth))]
    weight = np.array([s.motion**-2 for s, _ in every])
    weight /= weight.mean()
    motion = np.mean([w * float(s.best[p] @ s.gram @ s.best[p]) for w, (s, p) in zip(weight, every, strict=True)])
    draw = torch.Generator().manual_seed(5)
    picked, total, doubts = torch.randint(20, (7,), generator=torch.Generator().manual_seed(5)).tolist(), 0.0, 0.0
    assert len(set(picked)) > 4
    for number in picked:
        s, p = every[number]
        pose = ((s.feature[p] - LEARNER.scales.pose[0]) / LEARNER.scales.pose[1]).clamp(-5, 5)
        said, doubt = LEARNER.network(pose[None])
        off = (said[0] * LEARNER.scales.answer * s.depth[p] - s.best[p]).detach()
        square = float(off @ s.gram @ off)
        total += weight[number] * square / 7
        doubts += (math.log(math.sqrt(square) / float(s.depth[p])) - float(doubt.detach())) ** 2 / 7
    assert float(LEARNER.loss(draw, 7).detach()) == pytest.approx(total / motion + 0.01 * doubts, rel=1e-4)


def test_what_is_nearly_right_or_hardly_touches_costs_a_finite_number(monkeypatch):
    """An error below 1e-10 m counts as that, a depth below 1e-9 m as that: the logarithm is of 0.1."""
    still = replace(LEARNER.table, best=0 * LEARNER.table.best, depth=0 * LEARNER.table.depth)
    monkeypatch.setattr(LEARNER, "table", still)
    monkeypatch.setattr(LEARNER, "network", lambda pose: (torch.zeros(len(pose), 3), torch.full((len(pose),), math.log(0.1))))
    assert float(LEARNER.loss(torch.Generator().manual_seed(5), 4)) == pytest.approx(0, abs=1e-9)


def test_a_network_is_judged_by_the_mean_over_trajectories_of_their_root_mean_squares():
    class Model:
        config = CONFIG

        def answer(self, feature, depth):
            return torch.zeros(len(depth), 3), torch.arange(1.0, 1 + len(depth))

    samples = expected()[2][::4]  # as they are: three poses and two
    errors = [np.sqrt([float(s.best[p] @ s.gram @ s.best[p]) + float(s.left[p]) for p in range(len(s.depth))]) for s in samples]
    mean, factor = module.judge(Model(), samples)
    assert mean == pytest.approx(np.mean([math.sqrt((each**2).mean()) for each in errors]), rel=1e-5)
    ratios = sorted((e / (1 + p), 1 / len(each)) for each in errors for p, e in enumerate(each))
    share = np.cumsum([weight for _, weight in ratios]) / 2
    assert factor == pytest.approx(ratios[int((share >= 0.5 - 1e-12).argmax())][0], rel=1e-5)
    assert LEARNER.judged()[0] > 0 and module._OfShapes(CONFIG, FOUND, [], "run").judged() == (None, math.inf)
