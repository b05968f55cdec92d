"""Batches of a training: which frames are drawn, the same whoever makes them, and filled up to few sizes without a change."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
import torch

import learning.samples.batches as module
from learning.graphs.alike import alike
from learning.graphs.graph import join, mapped
from learning.networks.blocks import told_by_sizes
from learning.processes import Processes
from learning.samples.batches import Batches, ahead, batch_of
from learning.samples.samples import build_example, fit_normaliser
from learning.training.train import descend
from tests.networks import SMALL, graph, made, training
from tests.synthetic import bending

CONFIG = replace(training(SMALL["m4gn"], batch_size=3, overlap=1), noise=3e-4, seed=5)
SCENES = (dict(cells=(4, 2, 2), steps=4), dict(cells=(6, 2, 2), steps=4, at=0.08))
ELSEWHERE = torch.device("meta")  # any that is not the processor


@pytest.fixture(scope="module")
def cases():
    return [build_example(bending(**scene), CONFIG) for scene in SCENES]


def tensors(value):
    found = []
    mapped(value, lambda tensor: found.append(tensor) or tensor)
    return found


def same(one, other):
    return all(torch.equal(a, b) for a, b in zip(tensors(one), tensors(other), strict=True))


def test_frames_are_drawn_evenly_or_by_their_chance(cases, monkeypatch):
    def shares(chance):
        counts, batches = np.zeros((2, 4)), Batches(cases, replace(CONFIG, batch_size=4000, noise=0.0))
        batches.chance = chance

        def drawn(case, frame, config, dice, now):
            counts[int(case is cases[1]), frame] += 1
            return ()

        with monkeypatch.context() as patch:
            patch.setattr(module, "sample", drawn)
            patch.setattr(module, "batch_of", lambda samples, **rest: samples)
            assert len(batches[7]) == 4000
        return counts.ravel() / 4000

    # 4000 draws: a share of 1/8 scatters by 0.005, one of 1/2 by 0.008
    np.testing.assert_allclose(shares(None), 1 / 8, atol=0.02)
    np.testing.assert_allclose(shares(torch.tensor([0.0, 0, 1, 0, 0, 4, 0, 3])), [0, 0, 1 / 8, 0, 0, 1 / 2, 0, 3 / 8], atol=0.03)


def test_every_number_and_every_sample_has_dice_of_its_own(cases):
    """One case with one frame to draw: what differs is noise alone."""
    one = replace(cases[0], targets=cases[0].targets[:1])
    batches, free = Batches([one], CONFIG), one.skeleton.free
    noises = torch.cat([batches[number].target.view(3, len(free), 3)[:, free] for number in (0, 1, 10**12)])  # (9, n, 3)
    # nine draws of the same size, none of them another one again
    assert all(((a - b).square().mean() / (6e-4**2 / 2)).sqrt() == pytest.approx(1, abs=0.25)
               for i, a in enumerate(noises) for b in noises[:i])
    assert same(batches[1], Batches([one], CONFIG)[1]) and not same(batches[1], Batches([one], replace(CONFIG, seed=6))[1])


def test_a_batch_carries_the_masks_of_its_own_cases(cases):
    batch = Batches(cases, replace(CONFIG, batch_size=8))[0]
    assert len({len(case.skeleton.free) for case in cases}) == 2 and len(batch) == 8
    assert torch.equal(batch.asked, (batch.graph.node[:, :1] > 0).expand(-1, 3))  # the kind of a free node
    assert float(batch.numbers) == int(batch.asked.sum())


def test_processes_share_a_batch_and_know_how_many_numbers_it_has(cases):
    whole, parts = Batches(cases, CONFIG)[2], [Batches(cases, CONFIG, group=Processes(rank, 3))[2] for rank in range(3)]
    assert all(len(part) == 3 and part.graph.count == 1 and float(part.numbers) == float(whole.numbers) for part in parts)
    assert same(whole.graph, join([part.graph for part in parts]))
    assert torch.equal(whole.target, torch.cat([part.target for part in parts]))


def test_other_processes_make_the_same_batches_in_the_same_order(cases, monkeypatch):
    monkeypatch.setattr(module.os, "sched_getaffinity", lambda pid: range(3))
    for fill in (False, True):
        batches = Batches(cases, CONFIG, fill=fill)
        made_ahead = list(islice(ahead(batches, 4, ELSEWHERE), 7))
        assert len(made_ahead) == 7 and all(same(batch, batches[4 + i]) for i, batch in enumerate(made_ahead))


def test_on_the_processor_or_from_frames_that_a_network_has_reached_batches_are_made_when_they_are_asked_for(cases, monkeypatch):
    monkeypatch.setattr(module, "DataLoader", lambda *given, **rest: pytest.fail("ahead of time"))
    batches = Batches(cases, CONFIG)
    assert same(next(ahead(batches, 3, torch.device("cpu"))), batches[3])
    next(ahead(Batches(cases, CONFIG, type("Walks", (), {"next": lambda self, which, frame, dice: (0, cases[which].states[0])})()),
               1, ELSEWHERE))
    monkeypatch.setattr(module.os, "sched_getaffinity", lambda pid: range(1))
    assert same(next(ahead(batches, 3, ELSEWHERE)), batches[3])


# filled up to few sizes

RECORDED = [kind for kind in SMALL if told_by_sizes(made(SMALL[kind]))]


def test_a_gpu_replays_these_kinds():
    assert RECORDED == ["m4gn", "mgn", "gcn"]


@pytest.mark.parametrize("kind, overlap", [("m4gn", 0), ("m4gn", 1), ("mgn", 0), ("gcn", 0)])
def test_a_batch_that_is_filled_up_teaches_the_same(kind, overlap):
    config = training(SMALL[kind], overlap=overlap, batch_size=3)
    cases = [build_example(bending(**scene), config) for scene in SCENES]
    scales, found = fit_normaliser(cases, config), []
    for fill in (False, True):
        batch, network = Batches(cases, config, fill=fill)[1], made(SMALL[kind])
        loss = descend(network, torch.optim.SGD(network.parameters(), lr=1.0), scales, replace(config, clip_norm=1e6), batch)
        found.append((float(loss), list(network.parameters()), len(batch.graph.node)))
    (loss, weights, nodes), (filled, others, more) = found
    assert filled == pytest.approx(loss, rel=1e-5) and more > nodes
    for old, one, other in zip(made(SMALL[kind]).parameters(), weights, others, strict=True):
        one, other, old = one.detach(), other.detach(), old.detach()
        assert torch.allclose(one - old, other - old, rtol=1e-4, atol=1e-5 * max(1.0, (one - old).abs().max().item()))


@pytest.mark.parametrize("kind", RECORDED)
def test_what_fills_up_is_finite_and_changes_no_answer(kind):
    config = replace(SMALL[kind], walk=3) if kind == "m4gn" else SMALL[kind]
    network = made(config)
    for beams in ([4], [4, 6], [6, 6, 4, 8]):
        batch = join([graph(config, trajectory=bending(cells=(cells, 2, 2))) for cells in beams])
        with torch.inference_mode():
            plain, filled = network(batch), network(alike(batch))
        assert torch.isfinite(filled).all() and len(filled) > len(plain)
        assert torch.allclose(filled[:len(plain)], plain, rtol=1e-4, atol=1e-5)


def test_batches_of_many_trajectories_have_few_sizes(cases):
    graphs = [graph(SMALL["m4gn"], trajectory=bending(cells=(cells, 2, 2))) for cells in range(4, 12)]
    dice, sizes, plain = np.random.default_rng(0), set(), set()
    for _ in range(200):
        batch = join([graphs[i] for i in dice.integers(8, size=8)])
        filled = alike(batch)
        plain.add(len(batch.node))
        sizes.add((tuple(tensor.shape for tensor in tensors(filled)), filled.most))
        assert len(filled.node) <= 1.2 * len(batch.node) + 8
    assert len(plain) > 25 and len(sizes) <= 8


def test_a_batch_moves_with_all_that_it_has(cases):
    batch = Batches(cases, CONFIG, fill=True)[0].to(torch.device("meta"))
    assert all(tensor.is_meta for tensor in tensors(batch)) and len(batch) == 3 and batch.graph.most > 0
    assert same(batch_of([(graph(SMALL["mgn"]), torch.zeros(1, 3), torch.ones(1, 3, dtype=torch.bool))]).numbers, torch.tensor(3.0))
