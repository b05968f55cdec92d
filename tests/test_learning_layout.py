"""What a network sees and predicts of a set: plane bodies in two coordinates, further fields, flows."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from datagen.files.prediction import lines, verify_files
from datagen.files.trajectory import HANDLE, INFLOW, NORMAL, OBSTACLE, OUTFLOW, WALL, Trajectory, read_trajectory, write_trajectory
from learning.config import Outputs
from learning.graphs.layout import Layout, in_plane, layout_of
from learning.graphs.wants import Widths
from learning.networks.kinds import build
from learning.networks.rivals.eagle import EagleConfig
from learning.prediction.checkpoint import Model, load_model, read_checkpoint
from learning.prediction.rollout import predict_step, rollout
from learning.samples.samples import build_example, describe, fit_normaliser, load_examples, sample
from learning.training.train import train
from physics.schema import InputError
from tests.networks import SMALL, training
from tests.synthetic import bending

CONFIG = training(SMALL["mgn"], batch_size=2, steps=3)
PLANE = SMALL | {"eagle": EagleConfig(hidden=8, width=12, message_steps=2, transformer_layers=2, heads=4, cluster_size=10)}
REST = np.array([[0.0, 1, 0], [2, 1, 0], [2, 3, 0], [0, 3, 0], [5, 1, 0], [1, 8, 0], [3, 8, 0], [2, 9, 0]])
KIND = np.array([HANDLE, NORMAL, NORMAL, HANDLE, NORMAL, OBSTACLE, OBSTACLE, OBSTACLE], np.uint8)


def slab(frames=5, **changes) -> Trajectory:
    """Two triangles and one more of a plane body, and an obstacle of one; every coordinate moves as its own dice fell."""
    motion = np.random.default_rng(3).normal(size=(frames, 8, 3)).astype(np.float32)
    motion[..., 2] = motion[0] = motion[:, KIND == HANDLE] = 0
    motion[:, 5:] = motion[:, 5:6]
    made = dict(points=REST, connectivity=np.array([0, 1, 2, 0, 2, 3, 1, 4, 2, 5, 6, 7]), offsets=3 * np.arange(5),
                types=np.full(4, 5, np.uint8), node_kind=KIND, displacement=motion, modes=np.zeros((0, 8, 3), np.float32))
    return Trajectory(**made | changes)


def channel(frames=5, **changes) -> Trajectory:
    """The body above as a fluid: two nodes inside, an inflow that changes, an outflow, a wall."""
    kind = np.array([INFLOW, NORMAL, NORMAL, WALL, OUTFLOW], np.uint8)
    dice = np.random.default_rng(5)
    velocity = dice.normal(size=(frames, 5, 3)).astype(np.float32) * [1, 0.5, 0]
    velocity[:, 3] = 0
    fields = {"velocity": velocity.astype(np.float32), "pressure": dice.normal(7, 2, size=(frames, 5, 1)).astype(np.float32)}
    return slab(frames, points=REST[:5], connectivity=np.array([0, 1, 2, 0, 2, 3, 1, 4, 2]), offsets=3 * np.arange(4),
                types=np.full(3, 5, np.uint8), node_kind=kind, displacement=np.zeros((frames, 5, 3), np.float32),
                modes=np.zeros((0, 5, 3), np.float32), fields=fields, **changes)


def test_a_plane_body_is_seen_and_asked_for_in_two_coordinates():
    case = build_example(slab(), CONFIG)
    u = case.trajectory.displacement.astype(np.float64)
    graph = describe(case, 3, u[2, :, :2], u[1, :, :2], CONFIG).graph
    assert case.layout == Layout(space=2) and Widths(node=9, mesh_edge=6, contact_edge=3, space=2) == case.layout.widths
    origin = np.array([0.0, 2.0])  # the mean of the held nodes
    for i in range(8):
        v = (u[3] - u[2])[i, :2] if KIND[i] != NORMAL else np.zeros(2)
        one_hot = np.eye(3)[[NORMAL, OBSTACLE, HANDLE].index(KIND[i])]
        assert graph.node[i].numpy() == pytest.approx([*one_hot, *v, *(REST[i, :2] - origin), *u[2, i, :2]], abs=1e-6)
    s, r = graph.mesh_pair[:, 4].tolist()
    before, after = (REST[s] - REST[r])[:2], (REST[s] + u[2, s] - REST[r] - u[2, r])[:2]
    change = np.hypot(*after) - np.hypot(*before)
    assert graph.mesh_edge[4].numpy() == pytest.approx([*before, np.hypot(*before), *(after - before), change], abs=1e-6)
    target = sample(case, 2, CONFIG, torch.Generator())[1]
    assert target.numpy() == pytest.approx((u[3] - u[2])[:, :2], abs=1e-6) and case.asked.sum() == 2 * 3


def test_what_leaves_the_plane_is_seen_in_space():
    flat = slab()
    up = replace(flat, displacement=flat.displacement + np.float32([0, 0, 1]) * (np.arange(8) == 1)[:, None])
    tilted = replace(flat, points=flat.points + np.eye(3)[2] * flat.points[:, :1])
    assert in_plane(flat) and in_plane(replace(flat, points=flat.points + [0, 0, 3]))
    assert not (in_plane(up) or in_plane(tilted) or in_plane(bending()))
    assert layout_of([flat, up]) == layout_of([bending()]) == Layout() and layout_of([flat, flat]).space == 2
    with pytest.raises(InputError, match="^a body in space, where the network has learned from bodies in a plane alone$"):
        build_example(up, CONFIG, layout=Layout(space=2))


@pytest.mark.parametrize("kind", PLANE)
def test_a_network_trained_on_plane_bodies_keeps_them_in_their_plane(kind, tmp_path):
    write_trajectory(tmp_path / "a.vtkhdf", slab(points=REST + [0, 0, 0.25]))
    config = training(PLANE[kind], batch_size=2, steps=2, noise=0.1, segments=2, method="metis")
    train(config, [tmp_path / "a.vtkhdf"], [tmp_path / "a.vtkhdf"], tmp_path / "run")
    model = load_model(tmp_path / "run")
    assert model.normaliser.layout == Layout(space=2) and model.normaliser.node.shape == (2, 9)
    found = rollout(model, slab(points=REST + [0, 0, 0.25]))
    assert not found.displacement[..., 2].any() and found.displacement[1:, [1, 2, 4], :2].all()
    assert np.array_equal(found.displacement[:, KIND != NORMAL], slab().displacement[:, KIND != NORMAL])
    steps = predict_step(model, slab())
    assert steps.shape == (4, 8, 3) and np.array_equal(steps[:, KIND != NORMAL], slab().displacement[1:, KIND != NORMAL])


def test_a_checkpoint_of_before_is_one_of_a_solid_body(tmp_path):
    from learning.networks.stored import read_stored, write_stored

    write_trajectory(tmp_path / "a.vtkhdf", bending(cells=(4, 2, 2), steps=3))
    train(CONFIG, [tmp_path / "a.vtkhdf"], [], tmp_path / "run")
    about, tensors = read_stored(tmp_path / "run" / "model.safetensors")
    assert about.pop("layout") == {"space": 3, "state": "displacement", "fields": [], "sizes": [], "material": False, "lengths": "m"}
    write_stored(tmp_path / "run" / "model.safetensors", about, tensors)
    assert read_checkpoint(tmp_path / "run" / "model.safetensors").normaliser.layout == Layout()


def stressed(frames=5) -> Trajectory:
    stress = np.random.default_rng(9).normal(2e5, 1e4, size=(frames, 8, 1)).astype(np.float32)
    return slab(frames, fields={"stress": stress, "other": np.ones((frames, 8, 2), np.float32)})


def test_a_further_field_is_asked_for_on_all_nodes_of_the_body_as_it_is_in_the_next_frame():
    config = replace(CONFIG, outputs=Outputs(fields=("stress",)))
    case = build_example(stressed(), config)
    target = sample(case, 2, config, torch.Generator())[1]
    assert case.layout == Layout(space=2, fields=("stress",), sizes=(1,)) and case.layout.widths.outputs == 3
    assert np.array_equal(target[:, 2], case.trajectory.fields["stress"][3, :, 0])
    assert case.asked[:, 2].tolist() == [True] * 5 + [False] * 3 and case.asked[:, 0].tolist() == (KIND == NORMAL).tolist()
    scales = fit_normaliser([case], config)
    values = case.trajectory.fields["stress"][1:, :5]
    assert scales.fields[:, 0].tolist() == pytest.approx([values.mean(), values.std()], rel=1e-4)
    plain = fit_normaliser([build_example(stressed(), CONFIG)], CONFIG)
    assert torch.equal(scales.velocity, plain.velocity) and plain.fields.shape == (2, 0)
    assert scales.values(scales.target(target)).numpy() == pytest.approx(target.numpy(), rel=1e-4)
    assert scales.target(target)[:, 2].numpy() == pytest.approx((target[:, 2].numpy() - values.mean()) / values.std(), abs=1e-2)


def test_a_constant_field_has_no_scale_to_divide_by():
    config = replace(CONFIG, outputs=Outputs(fields=("other",)))
    assert fit_normaliser([build_example(stressed(), config)], config).fields.tolist() == [[1, 1], [1, 1]]


@pytest.mark.parametrize("fields, said", [(("strain",), "outputs.fields: not every trajectory holds 'strain' with as many numbers"),
                                          (("stress", "strain"), "the first one's fields: stress, other$")])
def test_a_field_that_is_not_there_is_refused_in_one_line(fields, said, tmp_path):
    write_trajectory(tmp_path / "a.vtkhdf", stressed())
    with pytest.raises(InputError, match=said):
        load_examples([tmp_path / "a.vtkhdf"], replace(CONFIG, outputs=Outputs(fields=fields)))


def test_a_field_that_is_told_stands_in_the_prediction_and_beside_its_truth(tmp_path):
    truth = stressed()
    write_trajectory(tmp_path / "a.vtkhdf", truth)
    config = replace(CONFIG, outputs=Outputs(fields=("other", "stress")))
    train(config, [tmp_path / "a.vtkhdf"], [tmp_path / "a.vtkhdf"], tmp_path / "run")
    model = load_model(tmp_path / "run")

    class Told(torch.nn.Module):
        def forward(self, graph):
            return torch.tensor([0.0, 0.0, 5.0, 6.0, 2.0]).repeat(len(graph.node), 1)

    found = rollout(replace(model, network=Told()), truth)
    mean, deviation = model.normaliser.fields[:, 2].tolist()
    assert not found.displacement[:, KIND == NORMAL].any() and list(found.fields) == ["other", "stress"]
    assert found.fields["stress"][1:, :5].ravel() == pytest.approx([mean + 2 * deviation] * 20) and not found.fields["stress"][:, 5:].any()
    assert found.fields["other"][2, 0].tolist() == [6, 7]  # 1 + 5 and 1 + 6: it never changes
    write_trajectory(tmp_path / "p.vtkhdf", found)
    said = verify_files(tmp_path / "p.vtkhdf", tmp_path / "a.vtkhdf")
    true = truth.fields["stress"][:, :5].astype(np.float64)
    expected = np.sqrt(((mean + 2 * deviation - true[1:]) ** 2).mean())
    assert said["rmse_all:stress"] == pytest.approx(expected, rel=1e-6) and said["units"]["rmse_all:stress"] == "Pa"
    assert said["nothing_moves"]["rmse_all:stress"] == pytest.approx(np.sqrt(((true[:1] - true[1:]) ** 2).mean()), rel=1e-6)
    assert any(line.startswith("RMSE-all of stress [Pa]") and f"{expected:.3g}" in line for line in lines(said))
    write_trajectory(tmp_path / "b.vtkhdf", read_trajectory(tmp_path / "a.vtkhdf"))
    (tmp_path / "truth").mkdir()
    (tmp_path / "told").mkdir()
    for name, told in (("1", found), ("2", truth)):
        write_trajectory(tmp_path / "truth" / f"{name}.vtkhdf", truth)
        write_trajectory(tmp_path / "told" / f"{name}.vtkhdf", told)
    both = verify_files(tmp_path / "told", tmp_path / "truth")
    assert both["rmse_all:stress"] == pytest.approx(expected / 2**0.5, rel=1e-6)  # pooled over two, of which one is right


def test_a_flow_is_stepped_by_its_velocity_at_nodes_that_stay(tmp_path):
    config = replace(CONFIG, outputs=Outputs(fields=("pressure",)), noise=0.5)
    case = build_example(channel(), config)
    w, free = case.trajectory.fields["velocity"][..., :2].astype(np.float64), np.array([False, True, True, False, True])
    assert case.layout == Layout(space=2, state="velocity", fields=("pressure",), sizes=(1,))
    graph, target = sample(case, 2, replace(config, noise=0.0), torch.Generator())
    kinds = np.eye(5)[[2, 0, 0, 3, 1]]  # inside, outflow, inflow, wall, airfoil
    assert graph.node.numpy() == pytest.approx(np.concatenate([kinds, np.where(free[:, None], w[2], w[3])], axis=1), abs=1e-6)
    assert graph.mesh_edge.shape[1] == 3 and graph.contact_edge.shape == (0, 3) and not graph.place[:, 2:].any()
    assert target[:, :2].numpy() == pytest.approx(w[3] - w[2], abs=1e-6)
    assert np.array_equal(target[:, 2], case.trajectory.fields["pressure"][3, :, 0])
    assert case.asked.tolist() == [[f, f, True] for f in free.tolist()]
    noisy = sample(case, 2, config, torch.Generator().manual_seed(0))[0].node
    assert (noisy[free, 5:] != graph.node[free, 5:]).all() and torch.equal(noisy[~free], graph.node[~free])
    with pytest.raises(InputError, match="^a flow is predicted step by step"):
        build_example(channel(), replace(config, history=1))


def test_the_rollout_of_a_flow_knows_its_first_frame_and_what_is_prescribed():
    config = replace(CONFIG, outputs=Outputs(fields=("pressure",)))
    truth, seen = channel(), []
    scales = replace(fit_normaliser([build_example(truth, config)], config), velocity=torch.tensor([0.5]))

    class Told(torch.nn.Module):
        def forward(self, graph):
            seen.append(graph.node[:, 5:] * scales.node[1, 5:] + scales.node[0, 5:])
            return torch.tensor([1.0, 2.0, 0.0]).repeat(len(graph.node), 1)

    model, free = Model(config, Told(), scales, "told"), [1, 2, 4]
    found = rollout(model, truth)
    w, true = found.fields["velocity"], truth.fields["velocity"]
    assert not found.displacement.any() and np.array_equal(w[:, [0, 3]], true[:, [0, 3]]) and np.array_equal(w[0], true[0])
    for t in range(1, 5):
        assert w[t, free] == pytest.approx(true[0, free] + t * np.array([0.5, 1.0, 0.0]), abs=1e-5)
    assert found.fields["pressure"][2].ravel() == pytest.approx([float(scales.fields[0, 0])] * 5)
    assert seen[2][0].numpy() == pytest.approx(true[3, 0, :2], abs=1e-5)  # the inflow of the frame to come
    late = replace(truth, fields={name: np.where(np.arange(5)[:, None, None] > 0, 99, values).astype(np.float32)
                                  if name == "pressure" else values for name, values in truth.fields.items()})
    assert np.array_equal(rollout(model, late).fields["pressure"], found.fields["pressure"])
    assert predict_step(model, truth)[2, free] == pytest.approx(true[2, free] + [0.5, 1.0, 0.0], abs=1e-5)


def test_every_kind_of_network_learns_a_flow(tmp_path):
    write_trajectory(tmp_path / "a.vtkhdf", channel())
    for kind, network in PLANE.items():
        config = training(network, batch_size=2, steps=2, segments=2, method="metis", outputs=Outputs(fields=("pressure",)))
        assert train(config, [tmp_path / "a.vtkhdf"], [tmp_path / "a.vtkhdf"], tmp_path / kind)["last_error"] > 0
        assert build(network, Layout(space=2, state="velocity").widths).last.out_features == 2
        assert load_model(tmp_path / kind).network.last.out_features == 3
