"""EAGLE and Transolver: what their equations say, cluster by cluster and slice by slice; clusters of equal size."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from learning.networks.kinds import build
from learning.networks.rivals import transolver
from learning.networks.rivals.eagle import EagleConfig, waves
from learning.networks.rivals.g_u_net import GUNetConfig
from learning.networks.rivals.transolver import TransolverConfig
from learning.segments.clusters import clusters_of, ranks, same_size
from tests.literal import affine, case_of, messages, mlp, normed, two
from tests.networks import SMALL, made
from tests.synthetic import bending
from tests.test_learning_networks import TOLERANCE


def f(x):
    """(cosines, then sines, of 2^k pi x, k = -3 .. 4) of each component."""
    return torch.tensor([wave(2.0**k * math.pi * float(a)) for a in x for wave in (math.cos, math.sin) for k in range(-3, 5)])


def gru(weights, rows):
    """The last state of a recurrent net that reads rows, begun at zero (Cho et al. 2014, as torch numbers its gates)."""
    h = torch.zeros(12)
    for x in rows:
        (xr, xz, xn), (hr, hz, hn) = (affine({"a.weight": weights[f"read.weight_{of}_l0"], "a.bias": weights[f"read.bias_{of}_l0"]}, "a",
                                             given).chunk(3) for of, given in (("ih", x), ("hh", h)))
        reset, update = torch.sigmoid(xr + hr), torch.sigmoid(xz + hz)
        h = (1 - update) * torch.tanh(xn + reset * hn) + update * h
    return h


def attended(weights, name, y, heads):
    """Multi-head attention of rows among themselves."""
    parts = affine({"a.weight": weights[f"{name}.in_proj_weight"], "a.bias": weights[f"{name}.in_proj_bias"]}, "a", y).chunk(3, dim=1)
    found = []
    for q, k, v in zip(*(part.chunk(heads, dim=1) for part in parts), strict=True):
        share = torch.softmax(q @ k.T / q.shape[1] ** 0.5, dim=1)
        found.append(share @ v)
    return affine(weights, f"{name}.out_proj", torch.cat(found, dim=1))


@torch.no_grad()
@pytest.mark.parametrize("contact", [True, False])
def test_clusters_are_read_and_attended_to_as_the_equations_say(contact):
    config = replace(SMALL["eagle"], contact=contact, cluster_size=3)
    network, case = made(config), case_of(config)
    weights, nodes, clusters = dict(network.named_parameters()), range(len(case.node)), range(len(case.graph_of_segment))
    assert len(clusters) == 4  # five nodes of the body, four of the obstacle
    x = (case.place[:, :3] + case.place[:, 3:]) / (16 * case.scale[0][0, 3])
    members = [sorted((i for i in nodes if case.segment[i] == k), key=lambda i: case.rank[i]) for k in clusters]
    centre = [x[own].mean(0) for own in members]
    code = [torch.cat([f(x[i]), f(x[i] - centre[case.segment[i]])]) for i in nodes]
    h, e, w = two(weights, "encode_node", case.node), list(two(weights, "encode_mesh", case.mesh_edge)), []
    if contact:
        w = list(two(weights, "encode_contact", case.contact_edge))

    def step(name, z, norm):
        sent = [mlp(weights, f"{name}.mesh", torch.cat([row, z[s], z[r]]), norm=norm)
                for row, (s, r) in zip(e, case.mesh_pair.T, strict=True)]
        sums, felt = [messages(len(z), case.mesh_pair, sent, 8)], []
        if contact:
            felt = [mlp(weights, f"{name}.contact", torch.cat([row, z[s], z[r]]), norm=norm)
                    for row, (s, r) in zip(w, case.contact_pair.T, strict=True)]
            sums.append(messages(len(z), case.contact_pair, felt, 8))
        return mlp(weights, f"{name}.node", torch.cat([torch.stack(z), *sums], 1), norm=norm), sent, felt

    for number in range(config.message_steps):
        more, sent, felt = step(f"process.{number}", [torch.cat([h[i], code[i]]) for i in nodes], True)
        h, e, w = h + more, [a + b for a, b in zip(e, sent, strict=True)], [a + b for a, b in zip(w, felt, strict=True)]
    s = torch.stack([two(weights, "encode_cluster", gru(weights, [torch.cat([h[i], code[i]]) for i in own])) for own in members])
    places = torch.stack([f(c) for c in centre])
    for block in (f"attend.{i}" for i in range(config.transformer_layers)):
        y = torch.cat([normed(weights, f"{block}.norm_attention", s), places], dim=1)
        s = s + affine(weights, f"{block}.out", attended(weights, f"{block}.attention", y, config.heads))
        s = s + two(weights, f"{block}.feed", normed(weights, f"{block}.norm_feed", s))
    s = normed(weights, "norm", s)
    z, _, _ = step("dispatch", [torch.cat([h[i], s[case.segment[i]], code[i]]) for i in nodes], False)
    said = affine(weights, "decode.4", affine(weights, "decode.2", affine(weights, "decode.0", z).tanh()).tanh())
    assert torch.allclose(network(case), said, **TOLERANCE)


@torch.no_grad()
def test_slices_are_attended_to_as_the_equations_say():
    network, case = made(SMALL["transolver"]), case_of(SMALL["transolver"])
    for block in network.process:
        torch.nn.init.uniform_(block.temperature, 0.3, 2.0)
    weights = dict(network.named_parameters())
    gelu = torch.nn.functional.gelu
    h = affine(weights, "encode.2", gelu(affine(weights, "encode.0", case.node))) + weights["shift"]
    for name in ("process.0", "process.1"):
        y, out = normed(weights, f"{name}.norm_attention", h), []
        a, told = (affine(weights, f"{name}.to_{which}", y) for which in ("share", "token"))
        for head in range(2):
            own = slice(4 * head, 4 * head + 4)
            tau = float(weights[f"{name}.temperature"][head])
            s = torch.stack([torch.softmax(affine(weights, f"{name}.share", a[i, own]) / tau, 0) for i in range(len(h))])  # (N, M)
            t = torch.stack([sum(s[i, m] * told[i, own] for i in range(len(h))) / (s[:, m].sum() + 1e-5) for m in range(5)])
            q, k, v = (t @ weights[f"{name}.{which}.weight"].T for which in ("query", "key", "value"))
            t = torch.softmax(q @ k.T / 2, dim=1) @ v
            out.append(torch.stack([sum(s[i, m] * t[m] for m in range(5)) for i in range(len(h))]))
        h = h + affine(weights, f"{name}.out", torch.cat(out, dim=1))
        h = h + affine(weights, f"{name}.feed.2", gelu(affine(weights, f"{name}.feed.0", normed(weights, f"{name}.norm_feed", h))))
    assert torch.allclose(network(case), affine(weights, "decode", normed(weights, "norm", h)), **TOLERANCE)


def test_a_place_code_is_waves_of_eight_octaves():
    assert torch.allclose(waves(torch.tensor([[0.3, -1.7]])), f([0.3, -1.7])[None], rtol=0, atol=1e-5)  # float32 of angles up to 85


def test_the_published_sizes_are_the_defaults():
    eagle, transolver = EagleConfig(), TransolverConfig()
    assert (eagle.hidden, eagle.width, eagle.message_steps, eagle.transformer_layers, eagle.heads, eagle.cluster_size, eagle.contact) == (
        128, 512, 4, 4, 4, 20, True)
    assert (transolver.hidden, transolver.layers, transolver.heads, transolver.slices) == (128, 8, 8, 64)


def test_weights_of_transolver_begin_as_small_numbers_cut_off():
    fresh = build(TransolverConfig(hidden=64, layers=1))
    values = torch.cat([weight.detach().flatten() for name, weight in fresh.named_parameters() if weight.dim() == 2])
    assert values.abs().max() <= 0.04 and values.std() == pytest.approx(0.02 * 0.88, rel=0.03)  # a normal one cut at two deviations
    assert fresh.process[0].temperature.flatten().tolist() == [0.5] * 8


# clusters

def test_clusters_of_a_row_of_points_are_its_pieces():
    x = np.array([[i, 0.0, 0.0] for i in (0, 1, 2, 10, 11, 12, 13)])
    label = same_size(x, 3)  # three clusters: sizes 2, 2 and 3 in some order along the row
    assert sorted(np.bincount(label).tolist()) == [2, 2, 3] and (np.diff(label) >= 0).all()


def test_no_single_swap_is_left_that_would_help():
    x = np.random.default_rng(0).uniform(size=(60, 3)) * [5, 1, 1]
    label = same_size(x, 7)
    assert np.ptp(np.bincount(label)) <= 1 and len(set(label)) == 9
    mean = np.array([x[label == k].mean(0) for k in range(9)])
    squared = ((x[:, None] - mean) ** 2).sum(2)
    for i in range(60):
        for j in range(i):
            before = squared[i, label[i]] + squared[j, label[j]]
            assert squared[i, label[j]] + squared[j, label[i]] > before - 1e-6


def test_neither_numbering_nor_origin_of_points_has_a_say():
    x = np.stack(np.meshgrid(np.arange(6.0), np.arange(3.0), np.arange(3.0)), axis=-1).reshape(-1, 3) / 7  # many ties
    order = np.random.default_rng(0).permutation(len(x))
    assert same_size(x, 10)[order].tolist() == same_size(x[order], 10).tolist()
    assert same_size(x + [0.3, -2.1, 7.7], 10).tolist() == same_size(x, 10).tolist()
    assert ranks(x[order]).tolist() == ranks(x)[order].tolist() and sorted(ranks(x)) == list(range(len(x)))
    assert x[np.argsort(ranks(x))].tolist() == sorted(x.tolist())


def test_body_and_obstacle_have_clusters_of_their_own():
    trajectory = bending()
    label, body = clusters_of(trajectory, 20), trajectory.body
    assert not set(label[body]) & set(label[~body]) and np.bincount(label).max() <= 20
    assert set(label) == set(range(-(-int(body.sum()) // 20) - (-int((~body).sum()) // 20)))


def test_one_cluster_holds_all_and_one_point_is_one():
    assert same_size(np.random.default_rng(0).normal(size=(5, 3)), 5).tolist() == [0] * 5
    assert same_size(np.zeros((1, 3)), 20).tolist() == [0]


@torch.no_grad()
def test_a_slice_that_hardly_any_node_is_of_has_a_small_token(monkeypatch):
    """Its share of all nodes is about a hundred-thousandth, and as much is added to it: half of what it would be."""
    network, case = made(SMALL["transolver"]), case_of(SMALL["transolver"])
    block = network.process[0]
    block.share.weight.zero_()
    block.temperature.fill_(1.0)
    block.share.bias.copy_(torch.tensor([-13.2, 0, 0, 0, 0]))
    tokens = []
    monkeypatch.setattr(transolver, "scaled_dot_product_attention", lambda query, key, value: tokens.append(value) or value)
    h = torch.randn(1, len(case.node), 8)
    block(h, torch.ones(1, len(case.node), dtype=torch.bool))
    share, told = math.exp(-13.2) / (4 + math.exp(-13.2)) * len(case.node), block.to_token(block.norm_attention(h))[0].mean(0)
    assert 2e-6 < share < 2e-5
    assert torch.allclose(tokens[0][0, 0, 0], block.value(told[:4] * share / (share + 1e-5)), rtol=1e-3)


def test_what_is_drawn_beside_the_weights_is_small_and_biases_are_zero():
    fresh = build(TransolverConfig(hidden=64, layers=1))
    shift = fresh.shift.detach()
    assert shift.min() >= 0 and shift.max() <= 1 / 64 and shift.std() == pytest.approx(1 / 64 / 12**0.5, rel=0.3)
    assert not any(bias.any() for name, bias in fresh.named_parameters() if name.endswith("bias") and "norm" not in name)
    assert fresh.encode[0].out_features == fresh.encode[2].in_features == 128
    scores = torch.stack(list(build(GUNetConfig(hidden=64)).score)).detach()
    assert scores.abs().max() <= 1 / 8 and scores.mean().abs() < 0.03 and scores.std() == pytest.approx(1 / 8 / 3**0.5, rel=0.15)
