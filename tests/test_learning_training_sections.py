"""The training of a predictor of beams: on four tiny trajectories, from one command."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

import fidelity
from datagen.files.trajectory import read_trajectory, write_trajectory
from learning import load_model, rollout
from learning.config import SlenderConfig, TrainConfig, load_config
from learning.networks.sections import SectionsConfig
from learning.networks.stored import read_stored
from learning.samples.seen import read_seen
from learning.slender.beam import see
from learning.slender.features import shown
from learning.slender.samples import load_samples, mirror_signs, seen_of, table_of
from learning.training.kinds import train
from learning.training.sections import judge
from physics.scene import Scene
from physics.schema import InputError
from tests.small_set import FILES

CONFIG = SlenderConfig(frames=4, poses=5, steps=6, batch_size=5, validate_every=3, coverage=0.5,
                       network=SectionsConfig(pose_hidden=6, pose_layers=1, hidden=5, layers=1))


@pytest.fixture
def paths(folder):
    return [folder / name for name in FILES]


def weights(run, name="last"):
    return read_stored(run / f"{name}.safetensors")[1]


def test_a_training_that_was_stopped_goes_on_to_the_same_bits(paths, tmp_path):
    result = train(CONFIG, paths[:2], paths[2:3], tmp_path / "whole")
    assert result["steps"] == 6 and result["samples"] == len(load_samples(paths[:2], 4)[0].pose) * 2
    train(CONFIG, paths[:2], paths[2:3], tmp_path / "halves", steps=3)
    train(CONFIG, paths[:2], paths[2:3], tmp_path / "halves", resume=True)
    whole, halves = weights(tmp_path / "whole"), weights(tmp_path / "halves")
    assert whole.keys() == halves.keys() and all(torch.equal(whole[name], halves[name]) for name in whole)
    lines = [json.loads(line) for line in (tmp_path / "halves" / "curve.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines] == [3, 6] and lines[-1]["error"] == result["last_error"]
    with pytest.raises(InputError, match="holds a training already"):
        train(CONFIG, paths[:2], [], tmp_path / "whole")
    with pytest.raises(InputError, match="on other data"):
        train(CONFIG, paths[:1], [], tmp_path / "whole", resume=True)
    with pytest.raises(InputError, match="with another config"):
        train(replace(CONFIG, batch_size=6), paths[:2], [], tmp_path / "whole", resume=True)


def test_the_best_network_comes_back_with_its_error_bar_and_its_ranges(paths, tmp_path):
    result = train(CONFIG, paths[:2], paths[2:4], tmp_path)
    model = load_model(tmp_path)
    error, bar = judge(model, load_samples(paths[2:4], 4))
    assert np.isfinite(bar)
    assert error == pytest.approx(result["best_error"], rel=1e-6) and float(model.scales.bar) == pytest.approx(bar, rel=1e-6)
    assert model.config == CONFIG and read_seen(tmp_path).trajectories == 2
    about, _ = read_stored(tmp_path / "model.safetensors")
    assert about["step"] == result["best_step"] and about["trajectories"] == 2 and len(about["fingerprint"]) == 64


def test_without_validation_the_bar_is_infinite_and_every_touched_frame_unsure(paths, tmp_path):
    train(CONFIG, paths[:2], [], tmp_path)
    found = rollout(load_model(tmp_path), read_trajectory(paths[3]))
    assert found.per_frame["unsure"][2:].all() and np.isinf(found.per_frame["error_bar"][2:]).all()


def test_the_error_of_a_sample_is_that_of_its_frames(paths, tmp_path):
    trajectory, (sample,) = read_trajectory(paths[0]), load_samples(paths[:1], 4)
    beam = see(Scene.from_toml(trajectory.scene))
    truth = trajectory.displacement[-1, trajectory.body].astype(np.float64)
    answer = torch.zeros_like(sample.target)  # the base alone
    base = beam.nodes(shown(beam, np.array([1.0])).base.numpy())[0]
    free = trajectory.free[trajectory.body]
    plain = np.sqrt(((base - truth)[free] ** 2).sum(axis=1).mean())
    assert sample.error(answer)[-1].item() == pytest.approx(plain, rel=1e-5)
    assert abs(seen_of(sample).base).max() == 0


def test_mirrored_rows_are_those_of_the_mirrored_beam(paths):
    for path in paths[:2]:
        trajectory, (sample,) = read_trajectory(path), load_samples([path], 4)
        beam = see(Scene.from_toml(trajectory.scene)).mirrored()
        truth = trajectory.displacement[-1:, trajectory.body].astype(np.float64)
        target = torch.from_numpy(beam.project(truth)) - shown(beam, np.array([1.0])).base
        assert torch.allclose(target.flatten(2).float()[0], sample.target[-1] * mirror_signs(), atol=1e-9)
        assert torch.allclose(shown(beam, np.array([1.0])).pose.float()[0], sample.mirrored[-1])


def test_the_rows_of_some_poses_are_theirs(paths):
    samples = load_samples(paths, 4)
    table = table_of(samples)
    rows, owner = table.rows(torch.tensor([5, 0]))
    sections = len(samples[0].section[0])
    assert owner.tolist() == [0] * sections + [1] * sections and rows.tolist() == [*range(5 * sections, 6 * sections), *range(sections)]
    assert torch.equal(table.target[rows[:sections]], torch.cat([s.target for s in samples])[5])
    assert table.weight.mean().item() == pytest.approx(1, rel=1e-6)
    assert (table.weight[0] / table.weight[-1]).item() == pytest.approx(samples[-1].motion / samples[0].motion, rel=1e-6)


def test_a_config_is_of_the_kind_that_its_network_is(tmp_path):
    (tmp_path / "a.toml").write_text('frames = 7\n[network]\nkind = "sections"\nhidden = 5\n')
    found = load_config(tmp_path / "a.toml")
    assert isinstance(found, SlenderConfig) and (found.frames, found.network.hidden) == (7, 5)
    (tmp_path / "b.toml").write_text("[network]\nhidden = 8\n")
    assert isinstance(load_config(tmp_path / "b.toml"), TrainConfig)
    for text, said in (('[network]\nkind = "sectoins"\n', "sections, shapes; did you mean 'sections'"),
                       ('segments = 3\n[network]\nkind = "sections"\n', "segments: unknown key")):
        (tmp_path / "c.toml").write_text(text)
        with pytest.raises(InputError, match=said):
            load_config(tmp_path / "c.toml")


def test_a_scene_that_is_none_of_a_beam_is_refused_in_one_line_and_with_status_2(paths, tmp_path, capsys):
    train(CONFIG, paths[:2], [], tmp_path / "run", steps=1)
    trajectory = read_trajectory(paths[3])
    write_trajectory(tmp_path / "plate.vtkhdf", replace(trajectory, scene=trajectory.scene.replace('shape = "beam"', 'shape = "plate"')))
    status = fidelity.main(["rollout", str(tmp_path / "run"), str(tmp_path / "plate.vtkhdf"), "--out", str(tmp_path / "p.vtkhdf")])
    said = capsys.readouterr()
    assert status == 2 and said.err.count("\n") == 1 and "the body is not a beam of first-order prisms" in said.err
    assert not (tmp_path / "p.vtkhdf").exists()
