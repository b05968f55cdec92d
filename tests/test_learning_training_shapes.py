"""The training of a predictor of bodies by shapes, and its error bar found anew: on four tiny trajectories."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import fidelity
from datagen.files.trajectory import read_trajectory
from learning import load_model, rollout
from learning.bodies.at_once import predict
from learning.bodies.body import see
from learning.config import BodiesConfig, load_config
from learning.networks.shapes import ShapesConfig
from learning.networks.stored import read_stored
from learning.samples.seen import read_seen
from learning.training.calibrate import calibrate
from learning.training.kinds import train
from physics.mesh.build import build_mesh
from physics.scene import Scene
from physics.schema import InputError
from tests.small_set import FILES

CONFIG = BodiesConfig(frames=4, poses=5, steps=6, batch_size=5, validate_every=3, coverage=0.5, mirrored="y",
                      network=ShapesConfig(degree=3, shapes=3, hidden=6, layers=1))


@pytest.fixture
def paths(folder):
    return [folder / name for name in FILES]


def test_a_training_that_was_stopped_goes_on_to_the_same_bits(paths, tmp_path):
    train(CONFIG, paths[:2], paths[2:3], tmp_path / "whole")
    train(CONFIG, paths[:2], paths[2:3], tmp_path / "halves", steps=3)
    train(CONFIG, paths[:2], paths[2:3], tmp_path / "halves", resume=True)
    told = read_seen(tmp_path / "whole")
    assert told is not None and "steps" not in told.numbers and "extent along x [m]" in told.numbers  # poses know of no steps
    whole, halves = (read_stored(tmp_path / name / "last.safetensors")[1] for name in ("whole", "halves"))
    assert whole.keys() == halves.keys() and all(torch.equal(whole[name], halves[name]) for name in whole)
    with pytest.raises(InputError, match="with another config"):
        train(replace(CONFIG, mirrored=""), paths[:2], [], tmp_path / "whole", resume=True)


def test_what_was_trained_on_is_predicted_and_held_nodes_and_frames_before_the_touch_stay(paths, tmp_path):
    """Two bodies are learned by heart; what is left over is what three shapes leave, and little of the motion."""
    config = replace(CONFIG, steps=800, validate_every=800, frames=6, learning_rate=1e-2, unsure_above=1.0,
                     network=ShapesConfig(degree=4, shapes=6, hidden=24, layers=2))
    result = train(config, paths[:2], paths[:2], tmp_path)
    truth = read_trajectory(paths[0])
    found = rollout(load_model(tmp_path), truth)
    motion = np.sqrt((truth.displacement[1:, truth.free] ** 2).sum(axis=2).mean())
    error = np.sqrt(((found.displacement - truth.displacement)[1:, truth.free] ** 2).sum(axis=2).mean(axis=1))
    assert np.sqrt((error**2).mean()) < 0.05 * motion and result["best_error"] < 0.05 * motion
    still = truth.body & ~truth.free
    assert not found.displacement[:, still].any() and still.any()
    scene = Scene.from_toml(truth.scene)
    touch = see(scene, build_mesh(scene.body)).first_touch
    before = np.arange(7) / 6 <= touch
    assert before.sum() >= 1 and not found.displacement[before][:, truth.body].any() and not found.per_frame["error_bar"][before].any()
    assert (found.per_frame["error_bar"][~before] > 0).all() and found.displacement[~before][:, truth.free].any()
    assert not found.per_frame["unsure"][2:].any()  # of what was seen: frame 1 lies between the touch and the first pose that was


def test_a_material_or_support_that_no_training_saw_is_unsure(paths, tmp_path):
    train(replace(CONFIG, unsure_above=1.0), paths[:2], paths[2:4], tmp_path)
    model, scene = load_model(tmp_path), Scene.from_toml(read_trajectory(paths[0]).scene)
    softer = replace(scene, material=replace(scene.material, poisson_ratio=0.2))
    both = replace(scene, support=(*scene.support, replace(scene.support[0], where="x-max")))
    young = replace(scene, material=replace(scene.material, young_modulus=5e7))
    unsure = [predict(model, each, build_mesh(scene.body)).unsure[2:].any() for each in (scene, young, softer, both)]
    assert unsure == [False, False, True, True]


def test_the_bar_is_found_anew_from_other_trajectories_and_weights_stay(paths, folder, tmp_path, capsys):
    """Nothing else of the checkpoint changes; half of the frames of these trajectories then lie within."""
    out = tmp_path / "run"
    train(CONFIG, paths[:2], paths[2:4], out)
    about, before = read_stored(out / "model.safetensors")
    assert fidelity.main(["calibrate", str(out), "--data", str(folder), "--split", "train"]) == 0
    assert "of 2 trajectories" in capsys.readouterr().out
    now, after = read_stored(out / "model.safetensors")
    assert now == about | {"calibrated_on": 2} and before.keys() == after.keys()
    assert [name for name in before if not torch.equal(before[name], after[name])] == ["scales.bar"]
    assert calibrate(out, paths[:2])["before"] == float(after["scales.bar"])
    with pytest.raises(InputError, match="too few to tell what 50 % of them would be: 2 at the least"):
        calibrate(out, paths[:1])
    with pytest.raises(InputError, match="says nothing of its own error"):
        calibrate("assets/m4gn-beam", paths[:2])


def test_wrong_keys_are_refused(tmp_path):
    (tmp_path / "c.toml").write_text('mirrored = "yw"\n[network]\nkind = "shapes"\n')
    with pytest.raises(InputError, match="must be some of the letters x, y, z"):
        load_config(tmp_path / "c.toml")
    (tmp_path / "c.toml").write_text('mirrored = "xz"\n[network]\nkind = "shapes"\ndegree = 5\n')
    found = load_config(tmp_path / "c.toml")
    assert isinstance(found, BodiesConfig) and found.network.degree == 5
