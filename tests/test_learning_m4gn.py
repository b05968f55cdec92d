"""The network: exact about its definition, and blind to numbering, origin and company."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from learning.graph import Graph, build_graph, build_skeleton, join
from learning.m4gn import M4GN, M4GNConfig, mean_of_segments, products
from learning.segments import segment
from physics.schema import InputError
from tests import plain_m4gn
from tests.synthetic import bending

SMALL = M4GNConfig(hidden=16, message_steps=3, transformer_layers=2, heads=4)
# float32 rounds at 6e-8; some 50 layers of sums of 16 to 100 terms on outputs near 1 gather a few 1e-6
TOLERANCE: dict[str, Any] = dict(rtol=0, atol=2e-5)


VARIANTS = {"plain": {}, "overlap": dict(overlap=1), "encodings": dict(walk=5), "both": dict(overlap=1, walk=5)}


@pytest.fixture(scope="module")
def network():
    return made({})


def made(variant):
    torch.manual_seed(1)
    return M4GN(replace(SMALL, walk=variant.get("walk", 0))).eval()


def graph(count=7, step=3, *, shift=(0.0, 0.0, 0.0), variant=None, **scene):
    trajectory = bending(**scene)
    u = trajectory.displacement.astype(np.float64)
    skeleton = build_skeleton(trajectory, segment(trajectory, count=count), **variant or {})
    skeleton = replace(skeleton, rest=skeleton.rest + shift)
    plain = build_graph(skeleton, skeleton.rest + u[step], u[step + 1] - u[step], 0.006)
    return replace(plain, mesh_edge=100 * plain.mesh_edge, contact_edge=100 * plain.contact_edge)  # lengths near 1


@torch.no_grad()
def naive(network: Any, graph: Graph):
    """The module's equations written down literally, for a single graph."""
    coded = graph.node_code is not None
    h, e = network.encode_node(graph.node + (network.place_node(graph.node_code) if coded else 0)), network.encode_mesh(graph.mesh_edge)
    w = network.encode_contact(graph.contact_edge)
    for step in network.process:
        (s, r), (a, b) = graph.mesh_pair, graph.contact_pair
        e, w = e + step.mesh(torch.cat([e, h[s], h[r]], 1)), w + step.contact(torch.cat([w, h[a], h[b]], 1))
        sums = [torch.stack([latent[to == i].sum(0) for i in range(len(h))]) for latent, to in ((e, r), (w, b))]
        h = h + step.node(torch.cat([h, *sums], 1))
    member = torch.stack([graph.segment == k for k in range(len(graph.graph_of_segment))])  # (K, N)
    if graph.shared is not None:
        (sender, receiver), ring = graph.mesh_pair, member.clone()
        for a, b in zip(sender.tolist(), receiver.tolist(), strict=True):
            ring[:, b] |= member[:, a]
        member = ring
    s = network.encode_segment(torch.stack([h[inside].mean(0) for inside in member]))
    if coded:
        s = s + network.place_segment(graph.segment_code)
    for block in network.transform:
        parts = block.query_key_value(block.norm_attention(s)).chunk(3, dim=1)
        q, k, v = (part.view(len(s), block.heads, -1).transpose(0, 1) for part in parts)
        weight = torch.softmax(q @ k.transpose(1, 2) / q.shape[-1] ** 0.5, dim=-1)
        s = s + block.out((weight @ v).transpose(0, 1).reshape(s.shape))
        s = s + block.feed(block.norm_feed(s))
    return network.decode(torch.cat([h, torch.stack([s[inside].mean(0) for inside in member.T])], 1))


@torch.no_grad()
@pytest.mark.parametrize("variant", VARIANTS.values(), ids=VARIANTS)
def test_the_fast_network_is_the_plain_one(variant):
    network = made(variant)
    for case in (graph(variant=variant), graph(gap=0.05, travel=0.001, variant=variant)):
        assert torch.allclose(network(case), naive(network, case), **TOLERANCE)


@torch.no_grad()
def test_the_network_of_the_benchmark_is_the_same(network):
    assert torch.allclose(plain_m4gn.forward(network, graph()), naive(network, graph()), **TOLERANCE)


@pytest.mark.parametrize("precision, error", [
    ("medium", 1e-2),  # as bfloat16 where the processor rounds products, 1e-6 elsewhere
    ("bfloat16", 4e-2),  # 2^-9 for each rounding, some 50 roundings one after the other
])
def test_reduced_precision_gives_about_the_same(network, precision, error):
    case, config = graph(), replace(SMALL, precision=precision)
    rough = M4GN(config)
    rough.load_state_dict(network.state_dict())
    with products(config):
        found = rough(case)
        found.square().sum().backward()
    assert found.dtype == torch.float32
    assert (found - network(case)).norm() < error * network(case).norm()
    network(case).square().sum().backward()
    pairs = list(zip(rough.parameters(), network.parameters(), strict=True))
    off = sum(float((mine.grad - exact.grad).square().sum()) for mine, exact in pairs)
    assert off < error**2 * sum(float(exact.grad.square().sum()) for _, exact in pairs)
    network.zero_grad()
    assert torch.get_float32_matmul_precision() == "highest"


@torch.no_grad()
def test_the_numbering_of_nodes_and_edges_makes_no_difference(network):
    case = graph()
    order = torch.randperm(len(case.node))
    place = order.argsort()  # new number of each old node
    mesh, contact = torch.randperm(len(case.mesh_edge)), torch.randperm(len(case.contact_edge))
    shuffled = replace(case, node=case.node[order], segment=case.segment[order], mesh_edge=case.mesh_edge[mesh],
                       mesh_pair=place[case.mesh_pair][:, mesh], contact_edge=case.contact_edge[contact],
                       contact_pair=place[case.contact_pair][:, contact])
    assert torch.allclose(network(shuffled), network(case)[order], **TOLERANCE)


@torch.no_grad()
@pytest.mark.parametrize("variant", VARIANTS.values(), ids=VARIANTS)
def test_the_numbering_of_segments_makes_no_difference(variant):
    network, case = made(variant), graph(variant=variant)
    order = torch.randperm(len(case.graph_of_segment))
    relabelled = replace(case, segment=order[case.segment])
    if case.shared is not None:
        relabelled = replace(relabelled, shared=torch.stack([case.shared[0], order[case.shared[1]]]))
    if case.segment_code is not None:
        relabelled = replace(relabelled, segment_code=case.segment_code[order.argsort()])
    assert torch.allclose(network(relabelled), network(case), **TOLERANCE)


@torch.no_grad()
def test_a_translation_makes_no_difference(network):
    assert torch.allclose(network(graph(shift=(3.0, -2.0, 1.0))), network(graph()), **TOLERANCE)


@torch.no_grad()
@pytest.mark.parametrize("variant", VARIANTS.values(), ids=VARIANTS)
def test_a_batch_gives_what_its_graphs_give_alone(variant):
    network = made(variant)
    cases = [graph(7, variant=variant), graph(19, step=5, variant=variant), graph(3, gap=0.05, travel=0.001, variant=variant),
             graph(2, cells=(6, 2, 2), variant=variant)]
    alone = torch.cat([network(case) for case in cases])
    assert torch.allclose(network(join(cases)), alone, **TOLERANCE)


@torch.no_grad()
def test_only_segments_carry_information_across_the_body(network):
    # 3 message-passing steps reach 3 edges, and the far end of the beam is 10 edges away
    case = graph()
    changed = replace(case, node=case.node.index_fill(0, torch.tensor([0]), 5.0))
    far = int(case.node[:, 0].nonzero()[-1])
    assert not torch.equal(network(changed)[far], network(case)[far])
    deaf = M4GN(replace(SMALL, transformer_layers=0)).eval()
    assert torch.equal(deaf(changed)[far], deaf(case)[far])


@pytest.mark.parametrize("variant", VARIANTS.values(), ids=VARIANTS)
def test_every_weight_learns(variant):
    network, case = made(variant), graph(variant=variant)
    network(case).square().sum().backward()
    assert all(weight.grad is not None and weight.grad.abs().sum() > 0 for weight in network.parameters())
    network.zero_grad()


def test_segment_means():
    h = torch.tensor([[1.0], [3.0], [10.0]])
    assert mean_of_segments(h, torch.tensor([0, 0, 1]), 2).tolist() == [[2.0], [10.0]]


def test_the_paper_sizes_are_the_defaults():
    assert M4GNConfig() == M4GNConfig(hidden=128, message_steps=7, transformer_layers=4, heads=8)


def test_heads_must_divide_the_hidden_size():
    with pytest.raises(InputError, match=r"multiple of network\.heads = 5"):
        M4GN(M4GNConfig(hidden=16, heads=5))
