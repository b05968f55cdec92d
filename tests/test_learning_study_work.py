"""One training of a study: where its files are, what is measured, and when it is done; trainings and measures stand in here."""

import json
import math
from types import SimpleNamespace

import pytest

from learning.config import TrainConfig
from learning.graphs.layout import Layout
from learning.networks.m4gn import M4GNConfig
from learning.study import work
from learning.study.plan import Trial
from learning.study.work import Training, carried_out, figures, spent, step_ms, still, write_json
from tests.five_nodes import write_set
from tests.networks import SMALL
from tests.synthetic import bending


@pytest.fixture
def job(tmp_path):
    tests = ((Trial("as trained / on", "data"), tmp_path / "data"), (Trial("far", "far", {"segments": 4}), tmp_path / "far"))
    for folder in ("data/train", "data/valid", "data/test", "far/test"):
        (tmp_path / folder).mkdir(parents=True)
    return Training(tmp_path / "job", TrainConfig(segments=9, network=M4GNConfig()), tmp_path / "data", tests, "a device")


@pytest.fixture
def calls(monkeypatch):
    """What is asked for, in place of being done; folders are listed by their names."""
    made = []

    def trained(config, train, valid, run, **named):
        made.append(("train", config, train, valid, run, named))
        return {"seconds": 6.0, "steps": 3, "memory": -1}

    def loaded(run, device):
        made.append(("load", run, device))
        return "a model"

    monkeypatch.setattr(work, "train", trained)
    monkeypatch.setattr(work, "files", lambda folder, split: [folder / split / "0"])
    monkeypatch.setattr(work, "step_memory", lambda job: 77)
    monkeypatch.setattr(work, "load_model", loaded)
    monkeypatch.setattr(work, "tested", lambda model, test, paths: {"of": test.name, "on": str(paths[0]), "x": math.nan})
    return made


def test_a_training_leaves_what_it_took_and_a_file_of_each_test(job, calls):
    assert job.found(job.tests[0][0]) == job.folder / "on-as-trained-on.json" and not job.done
    job.folder.mkdir()
    carried_out(job)
    data, run = job.data, job.folder / "run"
    assert calls[0] == ("train", job.config, [data / "train" / "0"], [data / "valid" / "0"], run, {"resume": True, "device": "a device"})
    assert calls[1:] == [("load", run, "a device")] * 2
    assert json.loads((job.folder / "trained.json").read_text()) == {"seconds": 6.0, "steps": 3, "memory": 77, "step_ms": 2000.0}
    for test, folder in job.tests:
        assert json.loads(job.found(test).read_text()) == {"of": test.name, "on": str(folder / "test" / "0"), "x": None}
    assert job.done


def test_what_is_there_is_not_done_again(job, calls):
    job.folder.mkdir()
    write_json(job.folder / "trained.json", {"a": 1})
    write_json(job.found(job.tests[0][0]), {"b": 2})
    assert not job.done
    carried_out(job)
    assert [call[0] for call in calls] == ["load"] and job.done
    assert (job.folder / "trained.json").read_text() == '{\n "a": 1\n}\n'
    (job.folder / "trained.json").unlink()
    assert not job.done


def test_without_a_validation_split_there_is_none(job, calls):
    (job.data / "valid").rmdir()
    job.folder.mkdir()
    carried_out(job)
    assert calls[0][3] == []


def test_figures_are_those_of_the_first_row_on_fifty_frames_and_none_where_there_is_none(tmp_path, monkeypatch):
    write_set(tmp_path, {"test/0004.vtkhdf": bending(cells=(3, 1, 1), steps=2)})
    asked = []
    rows = [SimpleNamespace(scores={"mc": 1.0})]

    def measured(predictors, cases, **named):
        asked.append((predictors, [(case.name, case.file) for case in cases], named))
        return SimpleNamespace(rows=rows)

    monkeypatch.setattr(work, "measure", measured)
    path = tmp_path / "test" / "0004.vtkhdf"
    assert figures("a predictor", [path]) == {"mc": 1.0}
    assert asked == [(["a predictor"], [("0004", path)], {"sample": 50})]
    rows.clear()
    assert figures("a predictor", [path]) == {}


def test_a_body_that_never_moves_is_measured_as_a_network_is(tmp_path):
    """Its error over both steps is what the body moves, of the coordinates of free nodes."""
    made = bending(cells=(3, 1, 1), steps=2)
    write_set(tmp_path, {"test/0000.vtkhdf": made})
    moved = made.displacement[1:, made.node_kind == 0].astype(float)
    assert still([tmp_path / "test" / "0000.vtkhdf"])["rmse_all"] == pytest.approx(math.sqrt((moved**2).mean()), rel=1e-6)


def test_a_network_is_tested_under_the_config_that_a_test_changes(monkeypatch):
    seen = []
    monkeypatch.setattr(work, "figures", lambda predictor, paths: seen.append((predictor, paths)) or {"mc": 1.0})
    monkeypatch.setattr(work, "learned", lambda model, title: (model, title))
    bodies = SimpleNamespace(layout=Layout())
    model = work.Model(TrainConfig(segments=9, tau=0.5, network=SMALL["gcn"]), None, bodies, "name")
    assert work.tested(model, Trial("t", "data", {"segments": 4, "network": {"hidden": 16}}), ["a file"]) == {"mc": 1.0}
    ((changed, title), paths), = seen
    assert (changed.config.segments, changed.config.tau, changed.config.network.hidden, changed.config.network.layers) == (4, 0.5, 16, 3)
    assert title == model.title and paths == ["a file"] and changed.name == "name"


def test_what_was_spent_is_of_the_processor_and_on_a_gpu_of_the_clock():
    assert spent({"step": 3, "seconds": 9.0, "processor": 4.0}) == {"step": 3, "seconds": 4.0}
    assert spent({"seconds": 9.0, "processor": None}) == {"seconds": 9.0} == spent({"seconds": 9.0})


def line(step, seconds, **more):
    return {"step": step, "seconds": seconds, **more}


def test_the_time_of_a_step_is_the_median_between_reports_that_follow_each_other():
    """Steps of 1, 2 and 6 s over 1, 2 and 3 steps: rates 1, 1, 2; a report of the same step again says nothing."""
    curve = [line(1, 1.0, loss=1), line(2, 2.0, loss=1), line(4, 4.0, loss=1), line(7, 10.0, loss=1), line(7, 10.5, loss=1)]
    took = {"seconds": 50.0, "steps": 10}
    assert step_ms(curve, took) == 1000.0
    assert step_ms(curve[2:], took) == 2000.0
    assert step_ms([curve[0], line(1, 1.5, error=1), curve[3]], took) == 5000.0  # a validation between: the whole training
    assert step_ms([line(1, 1.5, error=1), curve[1]], took) == 5000.0
    assert step_ms([], took) == 5000.0 and step_ms([], {"seconds": 3.0, "steps": 1}) == 3000.0 == step_ms([], {"seconds": 3.0, "steps": 0})
