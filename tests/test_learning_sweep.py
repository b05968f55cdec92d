"""Many paths of one body: each row is the rollout of its scene, whatever the order, the batch or the kill; finite elements where asked."""

import hashlib
import json
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

import fidelity
from learning.prediction import sweep as module
from learning.prediction.checkpoint import load_model
from learning.prediction.sweep import sweep, write_sweep
from learning.slender import many
from learning.slender.path import predict
from physics import build_mesh, solve
from physics.schema import InputError
from tests.test_datagen_vary import PRESS, VARY

RUN = Path(__file__).parent.parent / "assets" / "m4gn-fast"
ALONG = ["obstacle.place.along=0.6:0.85"]


def same(one, other):
    return all(np.array_equal(getattr(one.rows, name), getattr(other.rows, name)) for name in vars(one.rows)) and np.array_equal(
        one.path, other.path)


@pytest.mark.parametrize("frames", ([20], [3, 0, 11, 20]), ids=("the last frame", "some frames"))
def test_a_row_is_what_the_rollout_of_its_scene_says(frames, monkeypatch):
    monkeypatch.setattr(many, "POSES", 100)  # several batches of each kind
    found = sweep(PRESS, RUN, vary=VARY, count=24, seed=3, frames=frames)
    model, points = load_model(RUN), build_mesh(found.variation.first.body).points
    assert {scene.obstacle.shape for scene in map(found.scene, range(24))} == {"sphere", "cylinder"}
    for number in range(24):
        path = predict(model, found.scene(number), points)
        # single precision of 1e-2 m, in products of other shapes
        assert np.allclose(found.rows.displacement[number], path.displacement[frames], atol=2e-8)
        assert np.allclose(found.rows.bar[number], path.bar[frames], rtol=1e-4)
        assert np.array_equal(found.rows.unsure[number], path.unsure[frames])
        far = np.linalg.norm(path.displacement[frames], axis=2).max(axis=1)
        assert np.allclose(found.rows.largest[number], far, atol=2e-8)
        assert np.allclose(found.path[number], found.scene(number).obstacle.path, atol=0)
    assert found.rows.largest.max() > 5e-3 and (found.rows.state == 0).all()


def test_a_path_that_never_touches_moves_nothing_and_is_sure():
    table = PRESS | {"obstacle": {"shape": "sphere", "radius": 0.012, "path": [[0.07, 0.012, 0.05], [0.07, 0.012, 0.03]]}}
    found = sweep(table, RUN, vary=["obstacle.path[1][2]=0.03:0.042"], count=12, frames=[0, 10, 20])
    touches = found.varied["obstacle.path[1][2]"] < 0.036
    assert 0 < touches.sum() < 12 and np.array_equal(found.rows.largest[:, 2] > 0, touches)
    assert not found.rows.bar[~touches].any() and not found.rows.unsure[~touches].any()
    assert np.isfinite(found.rows.displacement).all() and not found.rows.displacement[:, 0].any()


def test_seed_and_number_alone_decide_a_row():
    some, more, other = (sweep(PRESS, RUN, vary=ALONG, count=count, seed=seed, nodes="x-max") for count, seed in ((5, 1), (9, 1), (5, 2)))
    for key, values in some.varied.items():
        assert np.array_equal(values, more.varied[key][:5]) and not np.array_equal(values, other.varied[key])
    assert np.allclose(some.rows.displacement, more.rows.displacement[:5], atol=2e-8)
    assert same(some, sweep(PRESS, RUN, vary=ALONG, count=5, seed=1, nodes="x-max"))


def test_after_a_kill_the_same_call_goes_on_and_ends_with_the_same_bits(tmp_path, monkeypatch):
    monkeypatch.setattr(many, "POSES", 4)
    whole, calls, real = sweep(PRESS, RUN, vary=ALONG, count=14), [], module.predict_many

    def counted(model, paths, frames, most=99):
        calls.append(len(paths))
        if len(calls) > most:
            raise KeyboardInterrupt
        return real(model, paths, frames)

    monkeypatch.setattr(module, "predict_many", lambda *given: counted(*given, most=2))
    with pytest.raises(KeyboardInterrupt):
        sweep(PRESS, RUN, vary=ALONG, count=14, journal=tmp_path / "part")
    calls.clear()
    monkeypatch.setattr(module, "predict_many", counted)
    assert same(whole, sweep(PRESS, RUN, vary=ALONG, count=14, journal=tmp_path / "part"))
    assert calls == [4, 2]  # 4 4 4 2 without the kill: what was found before it is kept
    with pytest.raises(InputError, match="unfinished run of another"):
        sweep(PRESS, RUN, vary=ALONG, count=14, seed=1, journal=tmp_path / "part")


def test_its_force_is_that_of_beam_theory_for_this_material():
    """A long cantilever hardly bent: F = 3 E I w / a^3 where it is pressed, at a = 0.9 of its length, but for shear and indentation."""
    table = PRESS | {"body": {"length": 0.25, "width": 0.024, "height": 0.024, "cells": [48, 4, 4]}, "material": {
        "young_modulus": 2e6, "poisson_ratio": 0.4}}
    table["obstacle"] = {"shape": "cylinder", "radius": 0.012, "path": [[0.225, 0.012, 0.037], [0.225, 0.012, 0.034]]}
    found = sweep(table, RUN, vary=["obstacle.path[1][2]=0.0339,0.0341"], frames=[20, 0])
    expected = 3 * 2e6 * 0.024**4 / 12 * np.array([2.1e-3, 1.9e-3]) / 0.225**3
    assert np.allclose(found.rows.force[:, 0], expected, rtol=0.03) and not found.rows.force[:, 1].any()


@pytest.mark.parametrize("frames", ([20], [7, 20]))
def test_where_the_predictor_is_unsure_finite_elements_answer_and_the_count_is_said_before(frames, tmp_path):
    told: list[str] = []
    asked = {"vary": ["obstacle.radius=0.012,0.06"], "changes": ["obstacle.place.turn=0", "obstacle.shape='cylinder'"], "frames": frames}
    alone = sweep(PRESS, RUN, **asked)  # a radius of 6 cm was never seen
    assert alone.rows.unsure.any(axis=1).tolist() == [False, True]
    found = sweep(PRESS, RUN, **asked, solve_unsure=True, say=told.append, journal=tmp_path / "part")
    assert told == ["1 of 2 paths have a frame of which the predictor is unsure: to be solved by finite elements"]
    assert found.rows.state.tolist() == [0, 1] and np.array_equal(found.rows.displacement[0], alone.rows.displacement[0])
    truth = solve(found.scene(1)).displacement[frames]
    assert np.allclose(found.rows.displacement[1], truth, atol=1e-6)  # fewer steps to the last frame: equilibria to the solver's tolerance
    assert np.allclose(found.rows.largest[1], np.linalg.norm(truth, axis=2).max(axis=1), atol=1e-6)
    assert np.allclose(found.rows.force[1], np.linalg.norm(solve(found.scene(1)).reaction[frames], axis=1), rtol=1e-3)
    assert abs(alone.rows.displacement[1] - truth).max() > 1e-5  # so it is not the prediction
    again = sweep(PRESS, RUN, **asked, solve_unsure=True, say=told.append, journal=tmp_path / "part")
    assert same(found, again) and told[1].startswith("0 of 2")


def test_the_file_holds_what_was_found_and_says_where_it_comes_from(tmp_path):
    found = sweep(PRESS, RUN, vary=VARY, count=6, nodes=[403, 301])
    whole = sweep(PRESS, RUN, vary=VARY, count=6)
    assert np.array_equal(found.rows.displacement, whole.rows.displacement[:, :, [403, 301]]) and whole.rows.displacement[:, :, 403].any()
    assert np.array_equal(found.rows.largest, whole.rows.largest)  # of the whole body
    write_sweep(tmp_path / "a.h5", found)
    write_sweep(tmp_path / "b.h5", found)
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["displacement"].shape == (6, 1, 2, 3) and file["displacement"].dtype == np.float32
        assert file["nodes"][:].tolist() == [403, 301] and file["frames"][:].tolist() == [20] and file["path"].shape == (6, 2, 3)
        assert [text.decode() for text in file["varied/obstacle.shape"]] == found.varied["obstacle.shape"].tolist()
        assert np.array_equal(file["varied/obstacle.place.along"], found.varied["obstacle.place.along"])
        assert file.attrs["seed"] == "0" and "uniform" in file.attrs["scene"] and len(file.attrs["weights"]) == 64


@pytest.mark.parametrize(("options", "words"), [
    (["--vary", "obstacle.place.along=0.3:0.9"], "--count: how many paths"),
    (["--count", "5", "--vary", "obstacle.place.along=0.3:0.9", "--frames", "21"], "--frames 21: must be from 0 to 20"),
    (["--count", "5", "--vary", "obstacle.place.along=0.3:0.9", "--frames", "a"], "--frames a: must be whole numbers"),
    (["--count", "5", "--vary", "obstacle.place.along=0.3:0.9", "--nodes", "475"], "--nodes 475: must be from 0 to 474"),
    (["--count", "5", "--vary", "obstacle.place.along=0.3:0.9", "--nodes", "tip"], "no place named 'tip'"),
    (["--count", "900000", "--vary", "obstacle.place.along=0.3:0.9"], "5.13 GB: at most 4 GB"),
    (["--count", "2000000", "--nodes", "1", "--vary", "obstacle.place.along=0.3:0.9"], "--count 2000000: must be from 1 to 1000000"),
    (["--count", "5", "--vary", "obstacle.place.face=z-max,x-max"], "number 1: a predictor of beams does not take this scene"),
    (["--count", "5", "--vary", "obstacle.place.along=0.3:0.9", "--set", "body.cell='tetrahedron'"], "not a beam of first-order prisms"),
    (["--count", "5", "--vary", "obstacle.place.along=0.3:0.9", "--predictor", "nowhere"], "nowhere"),
])
def test_wrong_input_is_one_line_and_leaves_nothing(options, words, tmp_path, monkeypatch, capsys):
    import tomli_w

    monkeypatch.chdir(tmp_path)
    Path("press.toml").write_text(tomli_w.dumps(PRESS))
    status = fidelity.main(["sweep", "press.toml", "--out", "new/s.h5", "--predictor", str(RUN), *options])
    out, err = capsys.readouterr()
    assert status == 2 and words in err and err.count("\n") == 1 and out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["press.toml"]


def test_the_verb_writes_its_file_and_says_what_is_in_it(tmp_path, monkeypatch, capsys):
    import tomli_w

    monkeypatch.chdir(tmp_path)
    Path("press.toml").write_text(tomli_w.dumps(PRESS))
    assert fidelity.main(["sweep", "press.toml", "--vary", *ALONG, "--count", "7", "--seed", "2", "--predictor", str(RUN),
                          "--nodes", "x-max", "--out", "s.h5", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["paths"] == 7 and told["frames"] == [20] and told["nodes"] == 25 and told["solved"] == 0
    with h5py.File("s.h5") as file:
        assert told["largest"] == file["largest"][:].max() and told["unsure"] == file["unsure"][:].sum()
        again = sweep(PRESS, RUN, vary=ALONG, count=7, seed=2, nodes="x-max")
        assert np.array_equal(file["displacement"], again.rows.displacement)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["press.toml", "s.h5"]


def test_a_path_without_an_equilibrium_keeps_its_prediction_and_is_told_by_its_state(monkeypatch):
    asked = {"vary": ["obstacle.radius=0.012,0.06"], "changes": ["obstacle.place.turn=0", "obstacle.shape='cylinder'"], "frames": [20, 20]}
    alone, given = sweep(PRESS, RUN, **asked), []
    monkeypatch.setattr(module, "solve", lambda scene, **how: given.append((scene, how)) or SimpleNamespace(failure="no equilibrium"))
    found = sweep(PRESS, RUN, **asked, solve_unsure=True)
    assert found.rows.state.tolist() == [0, -1] and found.rows.state.dtype == np.int8
    assert all(np.array_equal(getattr(found.rows, name), getattr(alone.rows, name)) for name in vars(alone.rows) if name != "state")
    (scene, how), = given
    assert scene == found.scene(1) and how["final"] is how["partial"] is True and len(how["mesh"].points) == 475
    sweep(PRESS, RUN, **asked | {"frames": [19, 20]}, solve_unsure=True)
    assert given[1][1]["final"] is False  # a frame on the way is asked for


def test_a_sweep_says_which_seed_and_which_weights_made_it():
    found = sweep(PRESS, RUN, vary=ALONG, count=1, seed=7, frames=[0], nodes=[0])
    assert found.about["seed"] == "7" and found.about["run"] == str(RUN) and found.rows.displacement.shape == (1, 1, 1, 3)
    assert found.about["weights"] == hashlib.sha256((RUN / "model.safetensors").read_bytes()).hexdigest()


@pytest.mark.parametrize(("wrong", "words"), [({"frames": []}, "--frames : must be from 0 to 20"), ({"nodes": []}, "--nodes : must be"),
                                              ({"frames": [-1]}, "--frames -1"), ({"nodes": [-1]}, "--nodes -1"),
                                              ({"count": 0}, "--count 0")])
def test_a_wrong_number_from_python_is_refused_too(wrong, words):
    with pytest.raises(InputError, match=words):
        sweep(PRESS, RUN, vary=ALONG, **{"count": 2} | wrong)


def test_as_many_paths_as_a_split_has_at_most_and_of_grids_all_points():
    variation = SimpleNamespace(points=6)
    assert [module._count(variation, count) for count in (None, 1, 6, 1_000_000)] == [6, 1, 6, 1_000_000]
    for points, count in ((1, None), (6, 1_000_001), (6, 0)):
        with pytest.raises(InputError, match="--count"):
            module._count(SimpleNamespace(points=points), count)


def test_an_obstacle_that_starts_inside_the_body_is_refused_before_anything_is_predicted(monkeypatch):
    """As `simulate` refuses it: 12 mm above a face, 13 mm of radius reach 1 mm into the body, at its nodes a little less."""
    table = PRESS | {"obstacle": {"shape": "sphere", "radius": 0.01, "path": [[0.07, 0.012, 0.036], [0.07, 0.012, 0.03]]}}
    assert sweep(table, RUN, vary=["obstacle.radius=0.011,0.012"]).rows.unsure.shape == (2, 1)
    monkeypatch.setattr(module, "predict_many", None)
    with pytest.raises(InputError, match=r"number 1: obstacle.path: the obstacle starts 0\.000\d+ m inside the body; start it outside"):
        sweep(table, RUN, vary=["obstacle.radius=0.012,0.013"])
