"""One step of a training of sections, in loops: scales, draws, loss, clipping, AdamW and its rate; what is kept, and until when."""

import copy
import json
import math
from itertools import pairwise

import numpy as np
import pytest
import torch

from learning.config import SlenderConfig
from learning.networks.sections import SectionsConfig
from learning.networks.stored import read_stored
from learning.slender.samples import Sample, mirror_signs, seen_of, table_of
from learning.training import poses as loop
from learning.training import sections as module
from learning.training.sections import fit_scales, judge

CONFIG = SlenderConfig(frames=4, poses=5, steps=600, batch_size=7, validate_every=2, coverage=0.5, seed=3, learning_rate=0.02,
                       weight_decay=0.1, clip_norm=0.1, network=SectionsConfig(pose_hidden=6, pose_layers=1, hidden=5, layers=1))


def sample(seed, poses, sections, motion):
    """A trajectory of random numbers; its third feature never changes."""
    draw = torch.Generator().manual_seed(seed)

    def random(*shape):
        return torch.randn(*shape, generator=draw)

    pose, mirrored = random(poses, 3), random(poses, 3)
    pose[:, 2] = mirrored[:, 2] = 7.0
    return Sample(pose, mirrored, random(poses, sections, 2), random(poses, sections).abs() * 1e-3, random(poses).abs() * 1e-2 + 1e-3,
                  random(poses, sections, 18) * 1e-3, random(poses) ** 2 * 1e-8, 1.25, motion, {}, f"d{seed}")


SAMPLES = [sample(0, 4, 3, 2e-3), sample(1, 3, 5, 5e-4)]


def begun(out, config=CONFIG, valid=()):
    """A training of these samples before its first step."""
    return loop._Run(config, module._OfSections(config, SAMPLES, valid, "run"), len(SAMPLES), out)


def test_scales_are_moments_of_all_poses_mirrored_ones_too_and_of_targets_in_units():
    table = table_of(SAMPLES)
    scales = fit_scales(table)
    poses = np.concatenate([each.numpy() for s in SAMPLES for each in (s.pose, s.mirrored)]).astype(float)
    rows = np.concatenate([s.section.flatten(0, 1).numpy() for s in SAMPLES]).astype(float)
    for found, values in ((scales.pose, poses), (scales.section, rows)):
        deviation = values.std(axis=0, ddof=1)
        assert found[0].tolist() == pytest.approx(values.mean(axis=0), abs=1e-6)
        assert found[1].tolist() == pytest.approx([d if d > 1e-5 else 1.0 for d in deviation], rel=1e-5)
    targets = np.concatenate([s.target.flatten(0, 1).numpy() for s in SAMPLES]).astype(float)
    units = np.concatenate([s.unit.flatten().numpy() for s in SAMPLES]).astype(float)
    assert scales.answer.tolist() == pytest.approx(np.sqrt((targets**2).mean(axis=0) / (units**2).mean()), rel=1e-5)
    assert scales.low.tolist() == pytest.approx(poses.min(axis=0)) and scales.high.tolist() == pytest.approx(poses.max(axis=0))
    assert scales.bar.tolist() == [math.inf]


def literal_loss(network, run, poses, flip):
    """From the formula at the head of the module, pose by pose."""
    every = [(s, p) for s in SAMPLES for p in range(len(s.pose))]
    weight = np.array([1 / s.motion for s, _ in every])
    weight /= weight.mean()
    signs, scales = mirror_signs(), run.learner.scales
    motion = np.mean([w * float((s.target[p] ** 2).sum(dim=1).mean()) for w, (s, p) in zip(weight, every, strict=True)])
    total, doubts = 0.0, 0.0
    for number, turned in zip(poses.tolist(), flip.tolist(), strict=True):
        s, p = every[number]
        pose = ((s.mirrored if turned else s.pose)[p] - scales.pose[0]) / scales.pose[1]
        section = (s.section[p] - scales.section[0]) / scales.section[1]
        answer, doubt = network(pose.clamp(-5, 5)[None], section.clamp(-5, 5)[None])
        square = 0.0
        for k in range(s.section.shape[1]):
            target = s.target[p, k] * (signs if turned else 1)
            square = square + ((answer[0, k] * scales.answer * s.unit[p, k] - target) ** 2).sum() / s.section.shape[1]
        total = total + float(weight[number]) * square / len(poses)
        doubts = doubts + (torch.log(square.detach().sqrt() / s.depth[p]) - doubt[0]) ** 2 / len(poses)
    return total / motion + 0.01 * doubts


@pytest.mark.parametrize("step, rate", [(0, 0.02 / 100), (9, 0.02 * 0.1 * (1 + math.cos(math.pi * 9 / 600)) / 2),
                                        (150, 0.02 * (1 + 0.5**0.5) / 2), (450, 0.02 * (1 - 0.5**0.5) / 2)])
def test_a_step_is_that_of_adamw_on_the_clipped_gradient_of_the_loss(tmp_path, step, rate):
    run = begun(tmp_path)
    run.about["step"] = step
    draw = torch.Generator().manual_seed(3)
    poses, flip = torch.randint(7, (7,), generator=draw), torch.randint(2, (7,), generator=draw)
    plain = copy.deepcopy(run.learner.network)
    loss = literal_loss(plain, run, poses, flip)
    loss.backward()
    norm = math.sqrt(sum(float((p.grad**2).sum()) for p in plain.parameters()))
    assert norm > 0.1 and 0 < int(flip.sum()) < 7
    assert run.step() == pytest.approx(float(loss.detach()), rel=1e-5)
    for new, old in zip(run.learner.network.parameters(), plain.parameters(), strict=True):
        g = old.grad * (0.1 / norm)
        assert torch.allclose(new.grad, g, rtol=1e-4, atol=1e-7)
        wanted = old * (1 - rate * 0.1) - rate * g / (g.abs() + 1e-8)  # both of Adam's means are those of the first gradient
        assert torch.allclose(new, wanted, rtol=1e-4, atol=2e-7)


def test_the_weights_are_drawn_by_the_seed_of_the_config(tmp_path):
    run = begun(tmp_path)
    torch.manual_seed(3)
    plain = module.Sections(CONFIG.network, 3, 2).state_dict()
    assert all(torch.equal(value, plain[name]) for name, value in run.learner.network.state_dict().items())
    assert run.about["trajectories"] == 2 and run.about["step"] == 0 and run.about["seconds"] == 0.0 and run.about["loss"] is None


def test_a_network_is_judged_by_the_mean_over_trajectories_of_their_root_mean_squares(tmp_path):
    class Model:
        config = CONFIG

        def answer(self, seen):
            return torch.zeros(*seen.unit.shape, 3, 6), torch.arange(1.0, 1 + len(seen.depth))

    errors = [s.error(torch.zeros_like(s.target)).numpy() for s in SAMPLES]
    for s, found in zip(SAMPLES, errors, strict=True):
        plain = [math.sqrt(1.25 * float((s.target[p] ** 2).sum(dim=1).mean()) + float(s.left[p])) for p in range(len(s.pose))]
        assert found.tolist() == pytest.approx(plain, rel=1e-5)
    mean, factor = judge(Model(), SAMPLES)
    assert mean == pytest.approx(np.mean([math.sqrt((e**2).mean()) for e in errors]), rel=1e-6)
    ratios = np.sort(np.concatenate([e / np.arange(1.0, 1 + len(e)) for e in errors]))
    assert factor == pytest.approx(ratios[3], rel=1e-6)  # the fourth of seven: ceil(8 / 2)
    assert seen_of(SAMPLES[0]).unit is SAMPLES[0].unit


def test_a_training_is_done_by_steps_or_by_seconds_whichever_is_first(tmp_path):
    run = begun(tmp_path)
    run.about |= {"step": 150, "seconds": 8.0}
    assert run.done() == 0.25
    run.config = SlenderConfig(**(vars(CONFIG) | {"budget_seconds": 10.0}))
    assert run.done() == 0.8
    run.config = SlenderConfig(**(vars(CONFIG) | {"budget_seconds": 80.0}))
    assert run.done() == 0.25


@pytest.mark.parametrize("budget, last, reports", [(None, 5, [2, 4, 5]), (None, 4, [2, 4]), (3.5, 9, [2, 4]), (2.5, 9, [2, 3])])
def test_it_reports_every_so_many_steps_and_at_its_end_and_keeps_the_best(tmp_path, monkeypatch, budget, last, reports):
    """The clock is looked at once when it starts and runs on by a second with each step; losses 1, 2, 3, .. ; errors fall and rise."""
    run = begun(tmp_path, SlenderConfig(**(vars(CONFIG) | {"budget_seconds": budget})), SAMPLES)
    taken = []
    monkeypatch.setattr(run, "step", lambda: taken.append(0) or float(len(taken)))
    monkeypatch.setattr(loop.time, "process_time", lambda: 100.0 + len(taken))
    errors = iter([3e-3, 2e-3, 4e-3])
    monkeypatch.setattr(module, "judge", lambda model, valid: (next(errors), 1.5))
    run.loop(last)
    lines = [json.loads(line) for line in (tmp_path / "curve.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines] == reports and len(taken) == reports[-1] == run.about["step"]
    assert [line["seconds"] for line in lines] == [float(step) for step in reports]
    bounds = [0, *reports]
    assert [line["loss"] for line in lines] == [np.mean(range(a + 1, b + 1)) for a, b in pairwise(bounds)]
    assert [line["error"] for line in lines] == [3e-3, 2e-3, 4e-3][:len(reports)]
    best, tensors = read_stored(tmp_path / "model.safetensors")
    assert (best["best_step"], best["best_error"], best["step"]) == (reports[1], 2e-3, reports[1])
    assert tensors["scales.bar"].tolist() == [1.5]
    assert run.about["best_step"] == reports[1] and run.about["last_error"] == lines[-1]["error"]
    assert read_stored(tmp_path / "last.safetensors")[1]["scales.bar"].tolist() == [math.inf]


def test_a_loss_that_is_not_finite_ends_it_and_without_validation_the_last_is_the_best(tmp_path, monkeypatch):
    run = begun(tmp_path)
    losses = iter([1.0, 2.0, 3.0, 4.0, math.nan])
    monkeypatch.setattr(run, "step", lambda: next(losses))
    with pytest.raises(FloatingPointError, match="the loss is nan at step 5: choose a lower learning rate"):
        run.loop(600)
    about, tensors = read_stored(tmp_path / "model.safetensors")
    assert (about["step"], about["best_step"], about["best_error"], about["last_error"]) == (4, 4, None, None)
    assert tensors["scales.bar"].tolist() == [math.inf]
