"""The network: exact about its definition, and blind to numbering, origin and company."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from learning.graphs.graph import Graph, build_graph, build_skeleton, join
from learning.networks.blocks import MLP, products, sum_at
from learning.networks.m4gn import M4GN, M4GNConfig, TransformerBlock, mean_of_own, mean_of_segments
from learning.segments.cut import segment
from physics.schema import InputError
from tests import plain_m4gn
from tests.plain_m4gn import attend, mlp
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
    network = M4GN(replace(SMALL, walk=variant.get("walk", 0))).eval()
    for name, weight in network.named_parameters():
        if "norm" in name:  # begin as ones and zeros, which leave no trace
            torch.nn.init.normal_(weight, mean=0.7 if name.endswith("weight") else 0.1, std=0.3)
    return network


def graph(count=7, step=3, *, shift=(0.0, 0.0, 0.0), variant=None, **scene):
    trajectory = bending(**scene)
    u = trajectory.displacement.astype(np.float64)
    skeleton = build_skeleton(trajectory, segment(trajectory, count=count), **variant or {})
    skeleton = replace(skeleton, rest=skeleton.rest + shift)
    plain = build_graph(skeleton, skeleton.rest + u[step], u[step + 1] - u[step], 0.006)
    return replace(plain, mesh_edge=100 * plain.mesh_edge, contact_edge=100 * plain.contact_edge)  # lengths near 1


@torch.no_grad()
def naive(network: Any, graph: Graph):
    """The module's equations written down literally from the bare weights, for a single graph."""
    weights = dict(network.named_parameters())
    coded = graph.node_code is not None
    h = mlp(weights, "encode_node", graph.node + (mlp(weights, "place_node", graph.node_code) if coded else 0))
    e, w = mlp(weights, "encode_mesh", graph.mesh_edge), mlp(weights, "encode_contact", graph.contact_edge)
    for step in (f"process.{i}" for i in range(SMALL.message_steps)):
        (s, r), (a, b) = graph.mesh_pair, graph.contact_pair
        e = e + mlp(weights, f"{step}.mesh", torch.cat([e, h[s], h[r]], 1))
        w = w + mlp(weights, f"{step}.contact", torch.cat([w, h[a], h[b]], 1))
        sums = [torch.stack([latent[to == i].sum(0) for i in range(len(h))]) for latent, to in ((e, r), (w, b))]
        h = h + mlp(weights, f"{step}.node", torch.cat([h, *sums], 1))
    member = torch.stack([graph.segment == k for k in range(len(graph.graph_of_segment))])  # (K, N)
    if graph.shared is not None:
        (sender, receiver), ring = graph.mesh_pair, member.clone()
        for a, b in zip(sender.tolist(), receiver.tolist(), strict=True):
            ring[:, b] |= member[:, a]
        member = ring
    s = mlp(weights, "encode_segment", torch.stack([h[inside].mean(0) for inside in member]))
    if coded:
        s = s + mlp(weights, "place_segment", graph.segment_code)
    for block in range(SMALL.transformer_layers):
        s = attend(weights, f"transform.{block}", s[None], SMALL.heads)[0]
    return mlp(weights, "decode", torch.cat([h, torch.stack([s[inside].mean(0) for inside in member.T])], 1), norm=False)


@torch.no_grad()
@pytest.mark.parametrize("variant", VARIANTS.values(), ids=VARIANTS)
def test_the_fast_network_is_the_plain_one(variant):
    network = made(variant)
    for case in (graph(variant=variant), graph(gap=0.05, travel=0.001, variant=variant)):
        assert torch.allclose(network(case), naive(network, case), **TOLERANCE)


@torch.no_grad()
def test_the_network_of_the_benchmark_is_the_same(network):
    assert torch.allclose(plain_m4gn.forward(network, graph(), SMALL.heads), naive(network, graph()), **TOLERANCE)


def of_a_product(config):
    """How far one product of float32 matrices is off in a network's precision: 2e-7, or 2e-3 where the processor rounds to bfloat16."""
    left, right = torch.randn(2, 128, 128, generator=torch.Generator().manual_seed(0))
    with products(config):
        found = left @ right
    exact = left.double() @ right.double()
    return float((found - exact).norm() / exact.norm())


@pytest.mark.parametrize("precision", ["medium", "bfloat16"])
def test_reduced_precision_gives_about_the_same(network, precision):
    case, config = graph(), replace(SMALL, precision=precision)
    # Some 50 products one after the other and as many on the way back, whose errors add up as random ones do; the layers of "bfloat16"
    # round to 2^-9 what goes in and what comes out. In float32 a ReLU that turns the other way makes more than that of a gradient.
    error = max(10 * of_a_product(config), 1e-4) if precision == "medium" else 4e-2
    network.zero_grad()
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


def test_an_mlp_by_hand():
    net = MLP(2, 2, 2)
    with torch.no_grad():
        for layer, weight, bias in ((net.first, [[1, 2], [-3, 1]], [1, 0]), (net.second, [[1, 1], [2, -1]], [-1, -20]),
                                    (net.third, [[1, 5], [-2, 7]], [3, 1])):
            layer.weight[:], layer.bias[:] = torch.tensor(weight), torch.tensor(bias)
        net.norm.weight[:], net.norm.bias[:] = torch.tensor([2.0, 3.0]), torch.tensor([0.5, -1.0])
    # (1, 2): 1 + 4 + 1 = 6 and -3 + 2 = -1, cut to 0; 6 - 1 = 5 and 12 - 20 = -8, cut to 0; 5 + 3 = 8 and -10 + 1 = -9. Of two
    # numbers LayerNorm leaves the signs (1e-5 under a root of 8.5^2 = 72 takes 7e-8 off): 2 + 0.5 and -3 - 1
    x = torch.tensor([[1.0, 2.0]])
    assert net(x).tolist()[0] == pytest.approx([2.5, -4.0], rel=1e-6)
    bare = MLP(2, 2, 2, norm=False)
    bare.load_state_dict({name: value for name, value in net.state_dict().items() if "norm" not in name})
    assert bare(x).tolist() == [[8.0, -9.0]]


@torch.no_grad()
def test_attention_by_hand():
    """Two heads of two components, three segments of which the last is padding; the feed-forward net says nothing."""
    block, generator = TransformerBlock(4, 2), np.random.default_rng(0)
    table = {name: generator.normal(size=value.shape) for name, value in block.state_dict().items()}
    table["feed.2.weight"][:] = table["feed.2.bias"][:] = 0
    block.load_state_dict({name: torch.from_numpy(value).float() for name, value in table.items()})
    s = generator.normal(size=(3, 4)) * 3 + 1
    normed = (s - s.mean(1, keepdims=True)) / np.sqrt(s.var(1, keepdims=True) + 1e-5) * table["norm_attention.weight"]
    triple = (normed + table["norm_attention.bias"]) @ table["query_key_value.weight"].T + table["query_key_value.bias"]
    q, k, v = triple[:, :4], triple[:, 4:8], triple[:, 8:]
    mixed = np.zeros((3, 4))
    for head in (slice(0, 2), slice(2, 4)):
        for i in range(3):
            share = np.array([np.exp(q[i, head] @ k[j, head] / np.sqrt(2)) for j in range(2)])  # the first two are there
            mixed[i, head] = share / share.sum() @ v[:2, head]
    expected = s + mixed @ table["out.weight"].T + table["out.bias"]
    found = block(torch.from_numpy(s).float()[None], torch.tensor([[True, True, False]]))[0]
    np.testing.assert_allclose(found, expected, atol=1e-5)  # float32, numbers near 10


def test_sums_are_taken_in_float32():
    ones = torch.ones(1000, 2, dtype=torch.bfloat16)  # whose own sum stops at 256
    assert sum_at(torch.ones(1000, dtype=torch.int64), ones, 3).tolist() == [[0, 0], [1000, 1000], [0, 0]]


def test_segment_means():
    h = torch.tensor([[1.0], [3.0], [10.0]])
    assert mean_of_segments(h, torch.tensor([0, 0, 1]), 2).tolist() == [[2.0], [10.0]]
    shared = torch.tensor([[0, 2, 2], [1, 0, 2]])  # node 0 also in segment 1, node 2 also in 0 and 2
    assert mean_of_segments(h, torch.tensor([0, 0, 1]), 3, shared).tolist() == [[pytest.approx(14 / 3)], [5.5], [10.0]]
    s = torch.tensor([[1.0], [5.0], [12.0]])
    assert mean_of_own(s, torch.tensor([0, 0, 1])).tolist() == [[1], [1], [5]]
    assert mean_of_own(s, torch.tensor([0, 0, 1]), shared).tolist() == [[3], [1], [6]]


def test_the_paper_sizes_are_the_defaults():
    config = M4GNConfig()
    assert (config.hidden, config.message_steps, config.transformer_layers, config.heads) == (128, 7, 4, 8)
    assert config.walk == 0 and config.precision == "float32"


def test_the_number_of_weights_follows_from_the_sizes():
    def mlp_of(inputs, outputs, h=6):  # three layers with biases, two numbers an output for LayerNorm
        return h * (inputs + 1) + h * (h + 1) + outputs * (h + 1) + 2 * outputs

    # node features: 3 kinds, 3 of velocity, 3 of place, 3 of displacement; mesh edges: 2 vectors with norms; contact edges: one
    encoders = mlp_of(12, 6) + mlp_of(8, 6) + mlp_of(4, 6)
    block = (6 * 18 + 18) + (6 * 6 + 6) + 2 * (6 + 6) + (6 * 24 + 24) + (24 * 6 + 6)
    codes = mlp_of(4, 12) + mlp_of(4, 6)
    expected = encoders + 2 * 3 * mlp_of(18, 6) + mlp_of(6, 6) + 3 * block + (mlp_of(12, 3) - 6) + codes
    network = M4GN(M4GNConfig(hidden=6, message_steps=2, transformer_layers=3, heads=3, walk=4))
    assert sum(weight.numel() for weight in network.parameters()) == expected


def test_products_are_rounded_for_the_time_of_the_block_alone():
    def within(precision):
        with products(M4GNConfig(precision=precision)):
            return torch.get_float32_matmul_precision()

    torch.set_float32_matmul_precision("high")
    try:
        assert [within(precision) for precision in ("float32", "medium", "bfloat16")] == ["highest", "medium", "highest"]
        with pytest.raises(ZeroDivisionError), products(M4GNConfig(precision="medium")):
            1 / 0
        assert torch.get_float32_matmul_precision() == "high"
    finally:
        torch.set_float32_matmul_precision("highest")


@torch.no_grad()
def test_only_bfloat16_rounds_layers(network):
    said = {}
    for precision in ("float32", "medium", "bfloat16"):
        said[precision] = M4GN(replace(SMALL, precision=precision))
        said[precision].load_state_dict(network.state_dict())
    case = graph()
    exact = said["float32"](case)
    assert torch.equal(said["medium"](case), exact)
    off = (said["bfloat16"](case) - exact).norm() / exact.norm()
    assert 1e-4 < off < 4e-2  # 8 bits of mantissa: a rounding is 2e-3


def test_heads_must_divide_the_hidden_size():
    with pytest.raises(InputError, match=r"multiple of network\.heads = 5"):
        M4GN(M4GNConfig(hidden=16, heads=5))
