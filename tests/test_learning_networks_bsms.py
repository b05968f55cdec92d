"""BSMS-GNN and g-U-Net: what their equations say, node by node, on levels that are worked out from their definition."""

import math

import numpy as np
import pytest
import torch

from learning.networks.rivals.bsms import BSMSConfig, pool, unpool
from learning.networks.rivals.g_u_net import GUNetConfig, best_half, two_hops
from learning.networks.rivals.geometry import contact_features, mesh_features, scale_of
from tests.literal import case_of, messages, mlp, plain
from tests.networks import SMALL, graph, made
from tests.test_learning_networks import TOLERANCE


def described(case, place, s, r):
    """Scaled features of an edge as a mesh edge and as a contact edge has them."""
    rest, moved = place[s, :3] - place[r, :3], place[s] - place[r]
    now = rest + moved[3:]
    mesh = torch.cat([rest, rest.norm()[None], moved[3:], (now.norm() - rest.norm())[None]])
    contact = torch.cat([now, now.norm()[None]])
    return [(features - scale[0]) / scale[1] for features, scale in ((mesh, case.scale[0]), (contact, case.scale[1]))]


def bsms_block(weights, name, case, h, place, pair, contact):
    rows = [[plain(weights, f"{name}.{kind}", torch.cat([described(case, place, s, r)[k], h[s], h[r]])) for s, r in edges.T.tolist()]
            for k, (kind, edges) in enumerate((("mesh", pair), ("contact", contact)))]
    sums = [messages(len(h), edges, of, 8) for edges, of in zip((pair, contact), rows, strict=True)]
    return h + plain(weights, f"{name}.node", torch.cat([h, *sums], dim=1))


@torch.no_grad()
def test_bi_stride_message_passing_is_what_the_equations_say():
    network, case = made(SMALL["bsms"]), graph(SMALL["bsms"], cells=(6, 1, 1))
    weights, h, place = dict(network.named_parameters()), plain(dict(network.named_parameters()), "encode", case.node), case.place
    first, second = case.levels
    assert len(first.pair[0]) and len(first.contact_pair[0]) and len(second.pair[0])
    graphs = [(case.mesh_pair, case.contact_pair), (first.pair, first.contact_pair), (second.pair, second.contact_pair)]
    tables, places, skips = [], [place], []
    for level, nodes in ((first, len(h)), (second, first.nodes)):
        table = torch.zeros(level.nodes, nodes)
        table[level.give[1], level.give[0]] = level.weight[:, 0]
        tables.append(table)
        places.append(table @ places[-1])
    for number in (0, 1):
        for _ in range(2 - number):  # twice on the mesh
            h = bsms_block(weights, f"down.{number}", case, h, places[number], *graphs[number])
        skips.append(h)
        h = tables[number] @ h
    for _ in range(2):
        h = bsms_block(weights, "bottom", case, h, places[2], *graphs[2])
    for number in (1, 0):
        h = tables[number].T @ h
        for _ in range(2 - number):
            h = bsms_block(weights, f"up.{number}", case, h, places[number], *graphs[number])
        h = h + skips[number]
    assert torch.allclose(network(case), mlp(weights, "decode", h, norm=False), **TOLERANCE)


def test_pooling_there_and_back_is_a_matrix_and_its_transpose():
    level = graph(SMALL["bsms"]).levels[0]
    x, y = torch.randn(int(level.give[0].max()) + 1, 2), torch.randn(level.nodes, 2)
    assert torch.allclose((pool(x, level) * y).sum(), (x * unpool(y, level, len(x))).sum(), rtol=1e-4)
    assert torch.allclose(pool(torch.ones(len(x), 1), level), torch.ones(level.nodes, 1))  # a mean


def test_edges_of_levels_are_described_as_those_of_the_mesh_are():
    case = graph(SMALL["bsms"])
    # places are float32 near 0.1 m and changes of length 1e-5 m, so that these have three digits
    assert torch.allclose(mesh_features(case.place, case.mesh_pair, case.scale), case.mesh_edge, rtol=0, atol=5e-3)
    assert torch.allclose(contact_features(case.place, case.contact_pair, case.scale)[:, 3], case.contact_edge[:, 3], rtol=0, atol=30)
    with pytest.raises(ValueError, match="normaliser"):
        scale_of(None)


@torch.no_grad()
def test_a_u_of_message_passing_is_what_the_equations_say():
    network, case = made(SMALL["g-u-net"]), case_of(SMALL["g-u-net"])
    weights, nodes = dict(network.named_parameters()), len(case.node)
    mesh, contact = np.zeros((nodes, nodes), bool), np.zeros((nodes, nodes), bool)
    mesh[tuple(case.mesh_pair)], contact[tuple(case.contact_pair)] = True, True

    def edges_of(matrix):
        return torch.tensor(np.array(np.nonzero(matrix)).reshape(2, -1))

    def block(name, h, e, pair, w, touching):
        e = [row + mlp(weights, f"{name}.mesh", torch.cat([row, h[s], h[r]])) for row, (s, r) in zip(e, pair.T.tolist(), strict=True)]
        w = [row + mlp(weights, f"{name}.contact", torch.cat([row, h[s], h[r]]))
             for row, (s, r) in zip(w, touching.T.tolist(), strict=True)]
        sums = [messages(len(h), pairs, rows, 8) for pairs, rows in ((pair, e), (touching, w))]
        return h + mlp(weights, f"{name}.node", torch.cat([h, *sums], 1)), e, w

    h, place, stack = mlp(weights, "encode_node", case.node), case.place, []
    pair, touching = case.mesh_pair, case.contact_pair
    e, w = list(mlp(weights, "encode_mesh", case.mesh_edge)), list(mlp(weights, "encode_contact", case.contact_edge))
    h, e, w = block("down.0", h, e, pair, w, touching)
    for level in (1, 2):
        p = weights[f"score.{level - 1}"]
        y = [math.tanh(float(row @ p) / float(p.norm())) for row in h]
        kept = sorted(sorted(range(len(y)), key=lambda i: -y[i])[:math.ceil(len(y) / 2)])
        stack.append((h, e, w, pair, touching, kept))
        h, place = torch.stack([y[i] * h[i] for i in kept]), place[kept]
        near = mesh | np.eye(len(mesh), dtype=bool)
        mesh, contact = ((near @ middle @ near)[np.ix_(kept, kept)] & ~np.eye(len(kept), dtype=bool) for middle in (near, contact))
        pair, touching = edges_of(mesh), edges_of(contact)
        e = [mlp(weights, "encode_mesh", described(case, place, s, r)[0]) for s, r in pair.T.tolist()]
        w = [mlp(weights, "encode_contact", described(case, place, s, r)[1]) for s, r in touching.T.tolist()]
        h, e, w = block(f"down.{level}", h, e, pair, w, touching)
    for up in (0, 1):
        skip, e, w, pair, touching, kept = stack.pop()
        raised = torch.zeros_like(skip)
        raised[kept] = h
        h, _, _ = block(f"up.{up}", skip + raised, e, pair, w, touching)
    assert torch.allclose(network(case), mlp(weights, "decode", h, norm=False), **TOLERANCE)


def test_the_best_half_of_each_graph_is_kept_rounded_up():
    score, owner = torch.tensor([0.1, 0.9, 0.5, -1.0, -2.0, -3.0, 7.0]), torch.tensor([0, 0, 0, 1, 1, 1, 2])
    assert best_half(score, owner, 3).tolist() == [1, 2, 3, 4, 6]


def test_two_hops_become_one_among_kept_nodes():
    line = torch.tensor([[0, 1, 1, 2, 2, 3, 3, 4], [1, 0, 2, 1, 3, 2, 4, 3]])
    mesh, contact = two_hops(line, torch.tensor([[1, 4], [4, 1]]), torch.tensor([0, 2, 4]), 5)
    assert mesh.T.tolist() == [[1, 0], [0, 1], [2, 1], [1, 2]]
    # 1 and 4 touch: 0 and 2 feel it by 1, and 4 itself
    assert sorted(contact.T.tolist()) == [[0, 2], [1, 2], [2, 0], [2, 1]]
    assert all(len(each[0]) == 0 for each in two_hops(line[:, :0], line[:, :0], torch.tensor([3]), 5))


def test_the_paper_levels_are_the_defaults():
    # Lei et al., appendix "Baselines": 4 for DeformingBeam in both
    assert BSMSConfig().levels == GUNetConfig().levels == 4
