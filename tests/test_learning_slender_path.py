"""A whole path: exact symmetry, rest before the touch, splines through the poses, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from datagen.files.trajectory import at_rest
from learning.bodies.at_once import path_of
from learning.prediction.rollout import predict_step, rollout
from learning.slender.beam import see
from learning.slender.features import shown
from learning.slender.path import knots, predict
from physics.mesh.build import build_mesh
from physics.schema import InputError
from tests.slender import predictor, scene
from tests.test_learning_slender_beam import everywhere

PATH = ((0.08, 0.012, 0.036), (0.081, 0.0125, 0.022))  # touches after a seventh


def points(of):
    return build_mesh(of.body).points


def in_a_file(of):
    """A trajectory of a scene in which nothing moved."""
    mesh, frames = build_mesh(of.body), of.steps.count + 1
    kind = np.where(mesh.points[:, 0] == 0, 3, 0).astype(np.uint8)
    rest = at_rest(mesh, np.zeros((0, len(mesh.points), 3)), scene=of.to_toml())
    return replace(rest, node_kind=kind, displacement=np.zeros((frames, len(mesh.points), 3), np.float32))


def test_before_the_touch_nothing_moves_and_held_nodes_never_do():
    one = scene(path=PATH)
    path = predict(predictor([one]), one, points(one))
    moved = abs(path.displacement).max(axis=(1, 2))
    assert path.displacement.shape == (21, 525, 3) and path.displacement.dtype == np.float32
    assert not moved[:3].any() and (moved[3:] > 0).all()  # 2 / 20 is before 1 / 7, 3 / 20 after
    assert not path.displacement[:, points(one)[:, 0] == 0].any()
    assert not path.bar[:3].any() and (path.bar[3:] > 0).all()
    never = scene(path=((0.08, 0.012, 0.04), (0.081, 0.0125, 0.035)))
    path = predict(predictor([one]), never, points(never))
    assert not path.displacement.any() and not path.bar.any() and not path.unsure.any()


def test_scenes_that_are_one_another_turned_or_mirrored_get_the_same_answer_turned_or_mirrored():
    scenes = list(everywhere())
    model, answers = predictor(scenes[:1]), []
    for each in scenes:
        beam, found = see(each), predict(predictor(scenes[:1]), each, points(each)).displacement
        answers.append(beam.project(found.astype(np.float64)))
    assert abs(answers[0]).max() > 1e-3 and model.name == "drawn"
    for other in answers[1:]:
        assert np.allclose(other, answers[0], atol=1e-8)  # single precision of 1e-2 m


def test_at_the_poses_a_path_is_what_the_network_says_of_them():
    one = scene(path=((0.08, 0.012, 0.033), (0.081, 0.0125, 0.022)), steps=400)  # touches near frame 36
    model = predictor([one])
    beam = see(one)
    poses = knots(beam.first_touch, model.config.poses)
    answer, _ = model.answer(shown(beam, poses))
    path = predict(model, one, points(one)).displacement
    nearest = np.round(poses * 400).astype(int)
    there = beam.nodes(answer.numpy())
    for frame, pose, nodes in zip(nearest[1:], poses[1:], there[1:], strict=True):
        assert abs(path[frame] - nodes).max() < 0.03 * abs(there).max() * (abs(frame / 400 - pose) * 40 + 1e-4)  # half a frame apart
    assert abs(path[-1] - there[-1]).max() < 1e-8  # the last frame is a pose


def test_poses_begin_at_the_touch_end_at_the_end_and_are_closer_at_the_beginning():
    found = knots(0.25, 7)
    assert found[0] == 0.25 and found[-1] == 1 and (np.diff(found, 2) > 0).all()


def test_frames_are_unsure_where_the_error_bar_is_long_or_a_pose_is_unlike_those_of_the_training():
    one = scene(path=PATH)
    model = predictor([one])
    sure = predict(replace(model, config=replace(model.config, unsure_above=1.0)), one, points(one))
    assert not sure.unsure[8:].any()  # the training's poses begin at a fifth of the path
    limit = float(np.median(sure.bar[3:]))
    some = predict(replace(model, config=replace(model.config, unsure_above=limit)), one, points(one))
    assert some.unsure[np.argmax(some.bar)] and np.array_equal(some.bar, sure.bar)
    harder = scene(path=PATH, material={"young_modulus": 1e7})
    assert np.array_equal(predict(model, harder, points(harder)).displacement, sure.displacement)  # the path prescribes displacements
    for other in (scene(path=PATH, material={"poisson_ratio": 0.3}), scene(path=PATH, material={"law": "linear"}),
                  scene(path=PATH, sides=(0.2, 0.022, 0.024)), scene(path=PATH, obstacle={"radius": 0.02})):
        assert predict(model, other, points(other)).unsure[4:].all()


def test_a_rollout_moves_free_nodes_alone_and_tells_its_error_bar():
    one = scene(path=PATH)
    model, given = predictor([one]), in_a_file(one)
    found = rollout(model, given)
    path = path_of(model, given)
    assert np.array_equal(found.displacement, path.displacement) and np.array_equal(found.per_frame["error_bar"], path.bar)
    assert found.per_frame["unsure"].tolist() == path.unsure.tolist() and found.extra["unsure_frames"] == path.unsure.sum()
    steps = predict_step(model, given)  # each from a true state, in which nothing has moved
    assert np.allclose(steps, np.diff(path.displacement, axis=0), atol=1e-9)
    corrected = rollout(model, given, correct=lambda u, frame: u + frame)
    assert np.array_equal(corrected.displacement[5], (path.displacement[5].astype(np.float64) + 5).astype(np.float32))


def test_other_meshes_frames_and_files_without_a_scene_are_refused():
    one = scene(path=PATH)
    model, given = predictor([one]), in_a_file(one)
    with pytest.raises(InputError, match="not the one that its scene builds"):
        predict(model, one, points(one) * 1.01)
    with pytest.raises(InputError, match="not the one that its scene builds"):
        predict(model, one, points(one)[:-1])
    with pytest.raises(InputError, match="holds no scene"):
        rollout(model, replace(given, scene=""))
    with pytest.raises(InputError, match="has 20 frames, its scene 21"):
        rollout(model, replace(given, displacement=given.displacement[:-1]))


def test_the_same_scene_gives_the_same_bits():
    one = scene(path=PATH)
    model = predictor([one])
    assert np.array_equal(predict(model, one, points(one)).displacement, predict(model, one, points(one)).displacement)
