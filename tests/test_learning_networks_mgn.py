"""MeshGraphNets and GCN: what their equations say, node by node; world edges between any two nodes that are near."""

from dataclasses import replace

import numpy as np
import torch

from learning.graphs.contact import world_edges
from learning.networks.rivals.mgn import MGNConfig
from tests.literal import case_of, messages, mlp
from tests.networks import SMALL, graph, made
from tests.test_learning_networks import TOLERANCE


@torch.no_grad()
def test_message_passing_is_what_the_equations_say():
    config = replace(SMALL["mgn"], world_radius=1.2)
    network, case = made(config), case_of(config)
    weights = dict(network.named_parameters())
    h = [mlp(weights, "encode_node", x) for x in case.node]
    e, w = ([mlp(weights, f"encode_{name}", x) for x in features]
            for name, features in (("mesh", case.mesh_edge), ("world", case.contact_edge)))
    for step in ("process.0", "process.1"):
        for name, latent, pair in (("mesh", e, case.mesh_pair), ("contact", w, case.contact_pair)):
            for k, (s, r) in enumerate(pair.T.tolist()):
                latent[k] = latent[k] + mlp(weights, f"{step}.{name}", torch.cat([latent[k], h[s], h[r]]))
        sums = [messages(len(h), pair, latent, 8) for pair, latent in ((case.mesh_pair, e), (case.contact_pair, w))]
        h = [h[i] + mlp(weights, f"{step}.node", torch.cat([h[i], sums[0][i], sums[1][i]])) for i in range(len(h))]
    assert torch.allclose(network(case), mlp(weights, "decode", torch.stack(h), norm=False), **TOLERANCE)


def test_world_edges_join_what_is_near_and_no_mesh_edge_joins():
    x = np.random.default_rng(0).normal(size=(30, 3))
    mesh = np.array([[0, 1], [1, 0]])
    assert np.linalg.norm(x[0] - x[1]) < 3
    near = {(s, r) for s in range(30) for r in range(30) if s != r and np.linalg.norm(x[s] - x[r]) <= 3}
    found = world_edges(x, mesh, 3.0)
    assert found.T.tolist() == [list(pair) for pair in sorted(near - set(map(tuple, mesh.T.tolist())), key=lambda pair: pair[::-1])]
    assert world_edges(x, mesh, 1e-6).shape == (2, 0)


def test_the_network_sees_world_edges_of_its_own_radius_or_contact_edges():
    world, contact = (graph(replace(SMALL["mgn"], world_radius=radius)) for radius in (0.015, 0.0))
    obstacle = world.node[:, 1] > 0
    ends = obstacle[world.contact_pair]
    assert (ends[0] != ends[1]).any() and (~ends[0] & ~ends[1]).any()
    ends = obstacle[contact.contact_pair]
    assert len(ends[0]) and (ends[0] != ends[1]).all()
    # Lei et al., appendix "Baselines": 15 steps, 0.003 for DeformingBeam
    assert MGNConfig() == MGNConfig(hidden=128, message_steps=15, world_radius=0.003)


@torch.no_grad()
def test_a_graph_convolution_is_the_symmetric_mean_with_loops():
    network, case = made(SMALL["gcn"]), case_of(SMALL["gcn"])
    weights, count = dict(network.named_parameters()), len(case.node)
    a = torch.eye(count, dtype=torch.float64)
    for s, r in [*case.mesh_pair.T.tolist(), *case.contact_pair.T.tolist()]:
        a[r, s] += 1
    assert set(a.unique().tolist()) == {0, 1}
    d = torch.diag(a.sum(1) ** -0.5)
    h = mlp(weights, "encode", case.node)
    for layer in range(3):
        weight, bias = (weights[f"process.{layer}.mix.{name}"] for name in ("weight", "bias"))
        h = ((d @ a @ d) @ h.double() @ weight.double().T + bias).relu().float()
    assert torch.allclose(network(case), mlp(weights, "decode", h, norm=False), **TOLERANCE)
