"""A data set of frames is what a training sees, and a network of one's own predicts as any other does."""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from datagen.files.trajectory import write_trajectory
from learning import Frames, Model, collate, rollout, to_pyg
from learning.samples.samples import build_example, fit_normaliser, sample
from physics.schema import InputError
from tests.networks import SMALL, training
from tests.synthetic import bending

CONFIG = training(SMALL["gcn"])


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("frames")
    for name, scene in {"a": dict(at=0.06, steps=4), "b": dict(cells=(6, 2, 2), steps=3)}.items():
        write_trajectory(folder / f"{name}.vtkhdf", bending(**scene))
    return sorted(folder.glob("*.vtkhdf"))


def test_a_frame_is_the_sample_of_a_training_scaled_by_its_normaliser(files):
    frames, case = Frames(files, CONFIG), build_example(bending(cells=(6, 2, 2), steps=3), CONFIG)
    assert len(frames) == 4 + 3
    graph, target, asked = frames[5]  # the second of the second file
    plain, velocity = sample(case, 1, CONFIG, torch.Generator())
    scales = fit_normaliser([build_example(bending(at=0.06, steps=4), CONFIG), case], CONFIG)
    assert torch.equal(graph.node, (plain.node - scales.node[0]) / scales.node[1]) and torch.equal(graph.mesh_pair, plain.mesh_pair)
    assert torch.equal(target, velocity / scales.velocity) and asked.tolist() == [[free] * 3 for free in case.skeleton.free.tolist()]
    others = Frames(files[:1], CONFIG, frames.normaliser)
    assert len(others) == 4 and others.normaliser is frames.normaliser


def test_one_file_need_not_stand_in_a_list(files):
    assert len(Frames(str(files[0]))) == len(Frames(files[0])) == len(Frames(files[:1]))


def test_noise_falls_as_torchs_dice_do(files):
    frames = Frames(files, training(SMALL["gcn"], noise=1e-4))
    torch.manual_seed(3)
    first, second = frames[0][1], frames[0][1]
    torch.manual_seed(3)
    assert torch.equal(frames[0][1], first) and not torch.equal(first, second)


def test_a_loader_puts_frames_side_by_side(files):
    frames = Frames(files, CONFIG)
    graph, target, asked = next(iter(DataLoader(frames, batch_size=6, collate_fn=collate)))
    assert graph.count == 6 and len(target) == len(asked) == len(graph.node) == sum(len(frames[i][1]) for i in range(6))
    assert torch.equal(target[-len(frames[5][1]):], frames[5][1]) and graph.mesh_pair.max() == len(target) - 1


def test_a_network_of_ones_own_rolls_out_under_its_name(files):
    class Still(torch.nn.Module):
        def forward(self, graph):
            return torch.full((len(graph.node), 3), 2.0)

    frames = Frames(files, CONFIG)
    model = Model(CONFIG, Still(), frames.normaliser, "mine")
    truth = bending(steps=4)
    path = rollout(model, truth).displacement
    step = 2 * float(frames.normaliser.velocity)
    assert model.title == "Still" and path[3, truth.free] == pytest.approx(np.full((int(truth.free.sum()), 3), 3 * step), rel=1e-5)


def test_a_frame_as_data_of_torch_geometric(files, monkeypatch):
    frame = Frames(files, CONFIG)[2]
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "torch_geometric", None)
        with pytest.raises(InputError, match="torch_geometric is not installed"):
            to_pyg(frame)
    module, data = ModuleType("torch_geometric"), ModuleType("torch_geometric.data")
    data.Data = lambda **named: SimpleNamespace(**named)  # its Data keeps what it is given under these names
    monkeypatch.setitem(sys.modules, "torch_geometric", module)
    monkeypatch.setitem(sys.modules, "torch_geometric.data", data)
    given, (graph, target, asked) = to_pyg(frame), frame
    assert given.x is graph.node and given.y is target and given.asked is asked
    assert given.edge_index is graph.mesh_pair and given.edge_attr is graph.mesh_edge
    assert given.contact_edge_index is graph.contact_pair and given.contact_edge_attr is graph.contact_edge
    case = bending(at=0.06, steps=4)
    held = case.points[case.node_kind == 3].mean(axis=0)
    assert given.pos.numpy() == pytest.approx(case.points + case.displacement[2] - held, abs=1e-7)
