"""Samples by their definition: the table of schemes, noise, the scale of everything, and how often each frame is drawn."""

import hashlib
import struct
from dataclasses import replace

import numpy as np
import pytest
import torch

from datagen.files.trajectory import write_trajectory
from learning.config import TrainConfig
from learning.graphs.graph import build_skeleton
from learning.samples import samples as data
from learning.samples.estimate import Estimate
from learning.samples.samples import (
    Example,
    Moments,
    all_frames,
    build_example,
    chances,
    describe,
    fit_normaliser,
    load_examples,
    sample,
    unit_of,
)
from learning.training.run import fingerprint
from physics.schema import InputError
from tests.graph_by_hand import KIND, REST, assert_graph_is, contacts_by_hand, edges_by_hand, mesh_edge_by_hand, node_by_hand, tiny

RADIUS = 2.0
STEP = TrainConfig(segments=2, method="metis", contact_radius=RADIUS, noise=0.25)
SCHEMES = {"step": STEP, "history": replace(STEP, history=1), "step+estimate": replace(STEP, estimate=True),
           "pose": replace(STEP, scheme="pose"), "pose+estimate": replace(STEP, scheme="pose", estimate=True)}
FREE = [1, 3, 4]


def case_of(config, steps=4, seed=0):
    """A case of tiny trajectory, with an estimate of every frame that is nothing but dice: errors of some 0.3 m, no two alike."""
    trajectory = tiny(steps, seed)
    skeleton = build_skeleton(trajectory, np.array([0, 1, 0, 1, 1, 2, 2, 2, 2]))
    dice = np.random.default_rng(seed + 100).normal(size=(2, steps, 9, 3)).astype(np.float32) * [[[[0.3]]], [[[0.5]]]]
    found = np.array(dice, np.float32)
    found[0] += trajectory.displacement[1:]
    found[0, :, 5:], found[1, :, 5:] = trajectory.displacement[1:, 5:], 0
    targets = np.arange(1, steps + 1)
    return Example(trajectory, skeleton, targets, Estimate(targets, *found) if config.estimate else None)


def by_hand(case, config, f, now, before):
    """What the table says of frame f: the body's displacements that are shown, what free nodes know, base and unit."""
    given = case.trajectory.displacement[f].astype(np.float64)
    unit = 1.0
    if config.estimate:
        e, a = (array[f - 1].astype(np.float64) for array in (case.estimate.displacement, case.estimate.answer))
        unit = (sum(x * x for i in FREE for x in a[i]) / len(FREE)) ** 0.5
    if config.scheme == "step":
        shown = np.array(now)
        known, base = {(False, 0): (0 * shown, shown), (False, 1): (shown - before, shown + (shown - before))}.get(
            (config.estimate, config.history)) or (e - shown, e)
        return shown, given - shown, known, base, unit
    shown = np.zeros((9, 3)) if not config.estimate else np.array(e)
    for i in range(9):
        if i not in FREE:
            shown[i] = given[i]
    return shown, np.zeros((9, 3)), a / unit if config.estimate else np.zeros((9, 3)), e if config.estimate else np.zeros((9, 3)), unit


# the table of schemes

@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("f", [1, 3])
def test_a_sample_is_what_its_row_of_the_table_says(name, f):
    config = SCHEMES[name]
    case = case_of(config)
    u = case.trajectory.displacement.astype(np.float64)
    now, before = u[f - 1] + 0.125, u[max(f - 2, 0)]
    found = describe(case, f, now, before, config)
    shown, velocity, known, base, unit = by_hand(case, config, f, now, before)
    assert_graph_is(found.graph, REST, REST + shown, velocity, known, KIND, RADIUS)
    assert found.graph.contact_pair.shape[1] > 0
    assert found.unit == pytest.approx(unit, rel=1e-12) and (unit == 1) != config.estimate
    assert np.allclose(found.base[FREE], base[FREE], rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("frame", [0, 1, 3])
def test_noise_is_on_free_nodes_of_steps_and_the_target_leads_to_the_truth(name, frame):
    config = SCHEMES[name]
    case = case_of(config)
    u = case.trajectory.displacement.astype(np.float64)
    generator = torch.Generator().manual_seed(5)
    for dice in (torch.Generator().manual_seed(5), None):  # the second time it is drawn afresh
        now = u[frame].copy()
        if config.scheme == "step":
            noise = 0.25 * torch.randn((9, 3), generator=dice).numpy() if dice else None
            if noise is None:
                dice = torch.Generator().manual_seed(5)
                torch.randn((9, 3), generator=dice)
                noise = 0.25 * torch.randn((9, 3), generator=dice).numpy()
            now[FREE] += noise[FREE]
        shown, velocity, known, base, unit = by_hand(case, config, frame + 1, now, u[max(frame - 1, 0)])
        graph, target = sample(case, frame, config, generator)
        assert_graph_is(graph, REST, REST + shown, velocity, known, KIND, RADIUS)
        assert target.dtype == torch.float32
        # float32 of a few units
        assert np.allclose(target.numpy()[FREE], ((u[frame + 1] - base) / unit)[FREE], rtol=0, atol=1e-6)
    assert (config.scheme == "pose") == torch.equal(generator.get_state(), torch.Generator().manual_seed(5).get_state())


def test_noise_is_as_large_as_it_says_and_the_same_along_all_axes():
    case, generator = case_of(STEP), torch.Generator().manual_seed(0)
    shown = np.array([sample(case, 2, STEP, generator)[0].node[FREE, 9:].numpy() for _ in range(400)])
    drawn = shown - case.trajectory.displacement[2, FREE]
    # 1200 normal numbers for each axis: means scatter by 2.9 % and deviations by 2 % of 0.25; four of those
    assert abs(drawn.mean(axis=(0, 1))).max() < 0.029 and abs(drawn.std(axis=(0, 1)) - 0.25).max() < 0.02
    assert abs(np.corrcoef(drawn.reshape(400, 9).T) - np.eye(9)).max() < 0.2  # four times 400^-1/2


def test_without_noise_the_frame_and_the_dice_are_left_alone():
    case, generator = case_of(STEP), torch.Generator().manual_seed(3)
    graph, target = sample(case, 2, replace(STEP, noise=0.0), generator)
    u = case.trajectory.displacement
    assert np.array_equal(graph.node[:, 9:].numpy(), u[2]) and np.array_equal(target.numpy(), u[3] - u[2])
    assert torch.equal(generator.get_state(), torch.Generator().manual_seed(3).get_state())


def test_the_unit_of_an_estimate_without_forces_left_over_is_ten_nanometres():
    case = case_of(SCHEMES["pose+estimate"])
    answer = 0 * case.estimate.answer
    answer[1, FREE] = [3e-9, 4e-9, 12e-9]  # 13 nm each
    answer[2, FREE] = [3e-9, 0, 4e-9]  # 5 nm
    answer[3, [0, 2]] = 1.0  # on held nodes it counts for nothing
    case = replace(case, estimate=replace(case.estimate, answer=answer))
    units = [unit_of(case.estimate.at(frame)[1], case.skeleton.free) for frame in (1, 2, 3, 4)]
    assert units == pytest.approx([1e-8, 13e-9, 1e-8, 1e-8], rel=1e-6, abs=0)
    rest = np.zeros((9, 3))
    assert [describe(case, frame, rest, rest, SCHEMES["pose+estimate"]).unit for frame in (1, 2, 3, 4)] == units
    assert describe(case_of(STEP), 1, rest, rest, STEP).unit == 1


# the normaliser

def features_by_hand(cases, config, picked):
    """Features and targets of samples as the training sees them, noise included, from `by_hand` and dice of seed 0."""
    dice, rows, targets = torch.Generator().manual_seed(0), {"node": [], "mesh_edge": [], "contact_edge": []}, []
    for which, frame in picked:
        case = cases[which]
        u = case.trajectory.displacement.astype(np.float64)
        now = u[frame].copy()
        if config.scheme == "step":
            now[FREE] += config.noise * torch.randn((9, 3), generator=dice).numpy()[FREE]
        shown, velocity, known, base, unit = by_hand(case, config, frame + 1, now, u[max(frame - 1, 0)])
        x = REST + shown
        rows["node"] += [node_by_hand(REST, x, velocity, known, KIND, i) for i in range(9)]
        rows["mesh_edge"] += [mesh_edge_by_hand(REST, x, s, r) for s, r in edges_by_hand()]
        rows["contact_edge"] += contacts_by_hand(x, KIND, RADIUS)[1]
        targets += [(u[frame + 1] - base)[i] / unit for i in FREE]
    return {name: np.array(value) for name, value in rows.items()}, np.array(targets)


@pytest.mark.parametrize("name", SCHEMES)
def test_the_scales_are_means_and_deviations_over_noisy_samples(name):
    config = SCHEMES[name]
    cases = [case_of(config), case_of(config, steps=3, seed=7)]
    rows, targets = features_by_hand(cases, config, [(0, 0), (0, 1), (0, 2), (0, 3), (1, 0), (1, 1), (1, 2)])
    found = fit_normaliser(cases, config)
    assert list(found.tensors()) == ["node", "mesh_edge", "contact_edge", "velocity"]
    for name, values in rows.items():
        deviation = np.sqrt(((values - values.mean(axis=0)) ** 2).mean(axis=0))
        assert found.tensors()[name].dtype == torch.float32 and found.tensors()[name].shape == (2, values.shape[1])
        # float32 features of up to 4, in float32 tables
        assert np.allclose(found.tensors()[name][0], values.mean(axis=0), rtol=1e-6, atol=1e-6)
        assert np.allclose(found.tensors()[name][1], np.where(deviation > 1e-6, deviation, 1), rtol=2e-6, atol=0)
    assert (found.mesh_edge[1, :3] < 0.9).all() and found.node[1, 2] == pytest.approx((2 / 9 * 7 / 9) ** 0.5)
    # one scale for the three components of free nodes; about zero, not about a mean
    assert found.velocity.tolist() == pytest.approx([np.sqrt((targets**2).mean())], rel=1e-6)


def test_noise_widens_the_scale_of_changes():
    quiet, loud = (fit_normaliser([case_of(STEP)], replace(STEP, noise=noise)) for noise in (0.0, 10.0))
    # 3 free nodes of 5 on 9 edges of the body: differences of 10 m and more. With 12 x 3 numbers, a spread of 12 % a deviation
    assert loud.mesh_edge[1, 4:7].min() > 5 > quiet.mesh_edge[1, 4:7].max() and torch.equal(loud.mesh_edge[:, :4], quiet.mesh_edge[:, :4])
    assert loud.velocity.item() == pytest.approx(10, rel=0.4) and quiet.velocity.item() < 1


def test_many_frames_are_thinned_evenly(monkeypatch):
    cases = [case_of(STEP), case_of(STEP, steps=5, seed=7)]  # 9 samples; 4 of them are 0, 2.67, 5.33 and 8, rounded down
    monkeypatch.setattr(data, "FIT_FRAMES", 4)
    rows, targets = features_by_hand(cases, STEP, [(0, 0), (0, 2), (1, 1), (1, 4)])
    found = fit_normaliser(cases, STEP)
    assert np.allclose(found.node[0], rows["node"].mean(axis=0), rtol=0, atol=1e-6)
    assert found.velocity.item() == pytest.approx(np.sqrt((targets**2).mean()), rel=1e-6)


def test_a_thousand_frames_are_enough(monkeypatch):
    one, seen = sample(case_of(STEP), 2, STEP, torch.Generator()), []
    monkeypatch.setattr(data, "sample", lambda case, frame, config, generator: seen.append(frame) or one)
    fit_normaliser([replace(case_of(STEP), targets=np.arange(1, 1502))], STEP)
    assert len(seen) == 1000 and seen[0] == 0 and seen[-1] == 1500 and max(np.diff(seen)) == 2


@pytest.mark.parametrize("size, scale", [(1e-7, 1.0), (1.6e-6, 1.6e-6)])
def test_a_motion_below_a_millionth_of_an_edge_is_rounding(size, scale):
    # the 14 edges of `tiny` are 0.84 m long on average
    case, quiet = case_of(STEP), replace(STEP, noise=0.0)
    moving = np.zeros((5, 9, 3), np.float32)
    moving[2::2, FREE], moving[:, 5:] = size, 0.0  # there and back again: every step but the first is +- size
    case = replace(case, trajectory=replace(case.trajectory, displacement=moving))
    expected = 1.0 if scale == 1 else size * (3 / 4) ** 0.5
    assert fit_normaliser([case], quiet).velocity.item() == pytest.approx(expected, rel=1e-6)
    mean = np.mean([np.linalg.norm(REST[a] - REST[b]) for a, b in zip(*case.skeleton.pair, strict=True)])
    assert mean == pytest.approx(0.84, abs=0.01) and 1e-7 < 1e-6 * mean < 1.6e-6 * (3 / 4) ** 0.5


def test_moments_by_hand():
    moments = Moments()
    assert moments.mean.tolist() == moments.mean_square.tolist() == [0] and moments.table(1e-6).tolist() == [[0], [1]]
    for rows in ([[1.0, 2.0, 3.0]], [], [[3.0, 2.0, 3.02], [5.0, 2.0, 3.04]]):
        moments.add(torch.tensor(rows).reshape(-1, 3))
    assert moments.count == 3 and moments.mean.tolist() == pytest.approx([3, 2, 3.02], rel=1e-7)
    assert moments.mean_square.tolist() == pytest.approx([35 / 3, 4, 27.362 / 3], rel=1e-6)
    third = 0.02 * (2 / 3) ** 0.5
    assert moments.table(0.01)[1].tolist() == pytest.approx([(8 / 3) ** 0.5, 1, third], rel=1e-4)
    assert moments.table(0.02)[1].tolist() == pytest.approx([(8 / 3) ** 0.5, 1, 1], rel=1e-4)


def test_a_normaliser_takes_the_mean_off_and_divides():
    normaliser = fit_normaliser([case_of(STEP)], STEP)
    graph = sample(case_of(STEP), 2, STEP, torch.Generator())[0]
    scaled = normaliser.graph(graph)
    for name in ("node", "mesh_edge", "contact_edge"):
        mean, deviation = getattr(normaliser, name).numpy()
        assert np.allclose(getattr(scaled, name).numpy(), (getattr(graph, name).numpy() - mean) / deviation, rtol=1e-6, atol=1e-6)
    assert torch.equal(scaled.mesh_pair, graph.mesh_pair) and torch.equal(scaled.segment, graph.segment)


# which frames, and how often

def test_every_frame_before_a_target_is_a_sample():
    cases = [replace(case_of(STEP), targets=np.array([2, 4])), case_of(STEP, steps=3)]
    assert all_frames(cases).tolist() == [[0, 1], [0, 3], [1, 0], [1, 1], [1, 2]]


def test_frames_are_drawn_by_what_their_error_counts():
    # units of 1, 2, 2 and 4 with a root mean square of 2.5: 0.4, 1.6, 1.6, 6.4; and 0.1 eight times: 0.1 each
    def case(units):
        answer = np.zeros((len(units), 9, 3), np.float32)
        for frame, unit in enumerate(units):
            answer[frame, FREE] = np.array([2, 3, 6]) * unit / 7
            answer[frame, 0] = 100.0
        frames = np.arange(1, len(units) + 1)
        return replace(case_of(STEP), targets=frames, estimate=Estimate(frames, answer, answer))

    share = np.array([0.4, 1.6, 1.6, 6.4] + [0.1] * 8)
    ratio = share / (10.8 / 12)
    assert ratio[3] > 5 > ratio[2]  # the limit is reached by one
    ratio[3] = 5
    assert chances([case([1, 2, 2, 4]), case([0.1] * 8)]).tolist() == pytest.approx((ratio + 1).tolist(), rel=1e-6)
    assert chances([case([1, 2]), case_of(STEP)]) is None


@pytest.mark.parametrize("change, targets", [
    (dict(), [1, 2, 3, 4, 5, 6]), (dict(frames=2), [3, 6]), (dict(frames=4), [2, 3, 4, 6]), (dict(frames=1), [6]),
    (dict(frames=99), [1, 2, 3, 4, 5, 6])])
def test_frames_to_learn_from_are_spread_evenly_and_end_with_the_last(change, targets, tmp_path):
    write_trajectory(tmp_path / "a.vtkhdf", tiny(6))  # of 4: 1.5, 3, 4.5 and 6, halves to the even one
    for scheme in ("step", "pose"):
        config = replace(STEP, scheme=scheme, **change)
        found = load_examples([tmp_path / "a.vtkhdf"] * 2, config)
        assert [case.targets.tolist() for case in found] == [targets] * 2
        walked = load_examples([tmp_path / "a.vtkhdf"], config, walk=True)[0].targets.tolist()
        assert walked == (targets if scheme == "pose" else [1, 2, 3, 4, 5, 6])  # a step starts from the frame before


def test_a_case_is_segmented_and_estimated_as_its_config_says(monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr(data, "estimate", lambda trajectory, targets, cache: asked.append((targets.tolist(), cache)) or "found")
    config = replace(STEP, estimate=True, scheme="pose", overlap=1, network=replace(STEP.network, walk=3), segments=3, frames=1)
    case = build_example(tiny(), config, cache=tmp_path)
    assert case.estimate == "found" and asked == [([1, 2, 3, 4], tmp_path)] and case.targets.tolist() == [1, 2, 3, 4]
    assert case.skeleton.segment[5:].tolist() == [3] * 4 and len(set(case.skeleton.segment[:5])) == 3
    assert case.skeleton.shared is not None and case.skeleton.node_code.shape == (9, 3)
    write_trajectory(tmp_path / "a.vtkhdf", tiny())
    monkeypatch.setattr(data, "CACHE", tmp_path / "kept")
    assert load_examples([tmp_path / "a.vtkhdf"], config)[0].estimate == "found" and asked[1] == ([4], tmp_path / "kept")
    plain = build_example(tiny(), STEP, targets=np.array([2]))
    assert plain.estimate is None and len(asked) == 2 and plain.targets.tolist() == [2]
    assert plain.skeleton.shared is plain.skeleton.node_code is None and plain.skeleton.segment.max() == 2


def test_files_that_teach_nothing_are_refused_by_name(tmp_path):
    with pytest.raises(InputError, match="no trajectory files given"):
        load_examples([], STEP)
    short, broken, sound = (tmp_path / f"{name}.vtkhdf" for name in ("short", "broken", "sound"))
    write_trajectory(short, tiny(0))
    write_trajectory(broken, replace(tiny(), complete=False))
    write_trajectory(sound, tiny(1))  # two frames are enough
    assert load_examples([sound], STEP)[0].targets.tolist() == [1]
    for path, config, words in ((short, STEP, "single frame"), (broken, STEP, "stopped before the last step"),
                                (sound, replace(STEP, segments=6), "6 segments")):
        with pytest.raises(InputError, match=f"{path.name}: .*{words}"):
            load_examples([sound, path], config)


def test_the_fingerprint_is_a_hash_of_rest_and_motion():
    cases = [case_of(STEP), case_of(STEP, steps=1, seed=7)]
    raw = b"".join(struct.pack(f"<{case.trajectory.points.size}d", *case.trajectory.points.ravel())
                   + struct.pack(f"<{case.trajectory.displacement.size}f", *case.trajectory.displacement.ravel()) for case in cases)
    assert fingerprint(cases) == hashlib.sha256(raw).hexdigest() != fingerprint(cases[::-1])
