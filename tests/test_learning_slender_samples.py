"""Trajectories as samples of beams and of bodies: which frames, what is left out, and which files are none."""

import hashlib
from dataclasses import replace

import numpy as np
import pytest
import torch

from datagen.files.trajectory import at_rest, write_trajectory
from learning.bodies import samples as bodies
from learning.bodies.model import load_bodies
from learning.networks.stored import read_stored, state_of, write_stored
from learning.slender.beam import see
from learning.slender.features import shown
from learning.slender.model import Slender, load_slender
from learning.slender.samples import fingerprint, load_samples, sample_of, seen_of, since_touch, table_of
from physics.mesh.build import build_mesh
from physics.schema import InputError, to_table
from tests.slender import predictor, scene
from tests.test_learning_slender_path import PATH, points


def moved(of, seconds=2.5, scale=1e-3):
    """A trajectory of a scene in which free nodes go anywhere."""
    mesh, frames = build_mesh(of.body), of.steps.count + 1
    kind = np.where(mesh.points[:, 0] == 0, 3, 0).astype(np.uint8)
    rest = at_rest(mesh, np.zeros((0, len(mesh.points), 3)), scene=of.to_toml())
    way = scale * np.random.default_rng(0).normal(size=(frames, len(mesh.points), 3)).astype(np.float32)
    way[:, kind == 3] = way[0] = 0
    return replace(rest, node_kind=kind, displacement=way, extra={"seconds": seconds} if seconds else {})


SCENE = scene(path=PATH, steps=20)  # touches after a seventh, between frames 2 and 3


@pytest.mark.parametrize("touch, last, frames, picked", [
    (1 / 7, 20, 4, [3, 9, 14, 20]), (1 / 7, 20, 99, [*range(3, 21)]), (0.15, 20, 2, [4, 20]), (0.1499, 20, 2, [3, 20]),
    (0.0, 4, 4, [1, 2, 3, 4]), (0.99, 20, 5, [20]), (1.0, 20, 5, []), (0.5, 2, 1, [2])])
def test_frames_begin_after_the_touch_and_end_with_the_last(touch, last, frames, picked):
    """In between they are evenly spaced and rounded: 3, 8.67, 14.33, 20."""
    assert since_touch(touch, last, frames).tolist() == picked


def test_a_sample_is_what_coefficients_say_of_the_body_and_what_they_leave_over():
    given = moved(SCENE)
    found, beam, free = sample_of(given, 4), see(SCENE), given.free
    truth = given.displacement[[3, 9, 14, 20]].astype(float)
    coefficients = beam.project(truth)
    left = [(((beam.nodes(coefficients) - truth)[t, free]) ** 2).sum(axis=1).mean() for t in range(4)]
    assert found.left.tolist() == pytest.approx(left, rel=1e-5)
    seen, mirrored = (shown(each, np.array([3, 9, 14, 20]) / 20) for each in (beam, beam.mirrored()))
    assert torch.equal(found.pose, seen.pose.float()) and torch.equal(found.mirrored, mirrored.pose.float())
    assert torch.equal(found.section, seen.section.float()) and torch.equal(found.unit, seen.unit.float())
    assert found.target.double().numpy() == pytest.approx((coefficients - seen.base.numpy()).reshape(4, 21, 18), abs=1e-9)
    assert found.share == 525 / 500 and found.motion == pytest.approx(np.sqrt((truth[:, free] ** 2).sum(axis=2).mean()))
    assert found.seconds == 2.5 and sample_of(moved(SCENE, seconds=None), 4).seconds == 0.0
    digest = hashlib.sha256(given.displacement.astype("<f4").tobytes()).hexdigest()
    assert found.digest == digest and fingerprint([found, found]) == hashlib.sha256(2 * digest.encode()).hexdigest()
    assert found.told["nodes of the body"] == 525
    again = seen_of(found)
    assert again.base.shape == (4, 21, 3, 6) and not again.base.any() and not again.jumps.any() and not again.force.any()
    table = table_of([found, replace(found, motion=found.motion / 3)])
    assert table.first.tolist() == [0, 21, 42, 63, 84, 105, 126, 147] and table.count.tolist() == [21] * 8
    assert table.weight.tolist() == pytest.approx([0.5] * 4 + [1.5] * 4)


@pytest.mark.parametrize("load, kind, kinds", [(load_samples, "beam", "beams"), (bodies.read, "body", "bodies")])
def test_files_that_teach_nothing_are_refused_by_name(load, kind, kinds, tmp_path):
    good, away, bare, plate = (tmp_path / f"{name}.vtkhdf" for name in ("good", "away", "bare", "plate"))
    write_trajectory(good, moved(SCENE))
    write_trajectory(away, moved(scene(path=((0.08, 0.012, 0.04), (0.08, 0.012, 0.035)), steps=20)))
    write_trajectory(bare, replace(moved(SCENE), scene=""))
    write_trajectory(plate, replace(moved(SCENE), scene=replace(SCENE, obstacle=None).to_toml()))
    assert len(load([good, away, good], 4)) == 2  # in which nothing touches, nothing is learned
    for files, words in (([away], f"no trajectory files given in which an obstacle touches a {kind}"), ([], "no trajectory files given"),
                         ([good, bare], f"bare.vtkhdf: holds no scene, which tells a predictor of {kinds} what presses on what"),
                         ([good, plate], "plate.vtkhdf: a predictor of")):
        with pytest.raises(InputError, match=words):
            load(files, 4)


def stored(run, model, drop=(), **config):
    """The checkpoint of a predictor, some of its tensors left out."""
    run.mkdir(exist_ok=True)
    tensors = {name: value for name, value in state_of(model.network, model.scales).items() if name not in drop}
    write_stored(run / "model.safetensors", {"config": to_table(replace(model.config, **config))}, tensors)


def test_a_stored_predictor_comes_back_ready_to_predict_and_one_in_pieces_is_refused(tmp_path):
    made = predictor([SCENE])
    stored(tmp_path / "run", made)
    found = load_slender(tmp_path / "run")
    assert isinstance(found, Slender) and not found.network.training and found.name == str(tmp_path / "run")
    given = shown(see(SCENE), np.array([0.3, 0.9]))
    assert all(torch.equal(a, b) for a, b in zip(found.answer(given), made.answer(given), strict=True))
    stored(tmp_path / "run", made, drop=("scales.low",))
    with pytest.raises(InputError, match="model.safetensors: not a whole checkpoint: 'scales.low'"):
        load_slender(tmp_path / "run")
    stored(tmp_path / "run", made, network=replace(made.config.network, hidden=7))
    with pytest.raises(InputError, match="its weights do not fit its config: size mismatch for"):
        load_slender(tmp_path / "run")
    about, tensors = read_stored(tmp_path / "run" / "model.safetensors")
    about["config"]["network"] = {"kind": "shapes"}
    write_stored(tmp_path / "run" / "model.safetensors", about, tensors)
    with pytest.raises(InputError, match="not a whole checkpoint: 'scales.degrees'"):
        load_bodies(tmp_path / "run")


def test_points_are_told_from_those_of_another_mesh():
    with pytest.raises(InputError, match="not the one that its scene builds"):
        sample_of(replace(moved(SCENE), points=points(SCENE) * 1.001), 4)

