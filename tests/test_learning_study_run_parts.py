"""What a study's folder holds, which data are made, how work is spread and watched; trainings and data stand in."""

import json
import os
import threading
from dataclasses import replace
from types import SimpleNamespace

import pytest

from learning.config import Outputs, TrainConfig
from learning.study import run
from learning.study.plan import Data, Line, Plan, Trial
from learning.study.table import Score
from physics.schema import InputError


def plan_of(**changes):
    parts = {"title": "T", "about": "", "source": "", "size": "check", "seeds": 1, "rows": (Line("a", TrainConfig(), {}),),
             "tests": (Trial("here", "data"), Trial("there", "far")),
             "sets": {"data": ({"k": 1}, Data(family="demo", train=2, seed=3)), "far": ({"k": 2}, Data(family="beam-small"))}}
    return Plan(**parts | changes)


def test_a_folder_is_claimed_once_and_by_one_study(tmp_path):
    out, plan = tmp_path / "out", plan_of()
    run._claim(plan, out, None)
    told = json.loads((out / "study.json").read_text())
    assert (told["title"], told["size"], told["data"], told["tests"][1]) == ("T", "check", None, ["there", "far", {}])
    assert told["sets"]["data"] == [{"k": 1}, {"family": "demo", "train": 2, "valid": 0, "test": 1, "seed": 3}]
    assert list(told["rows"]) == ["a"]
    run._claim(plan, out, None)
    for other, key in ((replace(plan, title="U"), "title"), (replace(plan, size="small"), "size"), (replace(plan, tests=()), "tests"),
                       (replace(plan, rows=()), "rows"), (replace(plan, sets={}), "sets")):
        with pytest.raises(InputError, match=rf"^--out .*: holds a study with other {key}; choose another folder$"):
            run._claim(other, out, None)
    with pytest.raises(InputError, match="holds a study with other data"):
        run._claim(plan, out, tmp_path)
    assert json.loads((out / "study.json").read_text()) == told
    run._claim(plan, tmp_path / "own", tmp_path / "d")
    assert json.loads((tmp_path / "own" / "study.json").read_text())["data"] == str(tmp_path / "d")


@pytest.mark.parametrize("content, said", [("no json", r"study\.json: not a study's$"), ("[1]", "holds a study with other title")])
def test_a_folder_of_something_else_is_refused_and_an_empty_one_is_not(tmp_path, content, said):
    (tmp_path / "study.json").write_text(content)
    with pytest.raises(InputError, match=said):
        run._claim(plan_of(), tmp_path, None)
    (tmp_path / "study.json").rename(tmp_path / "other.json")
    with pytest.raises(InputError, match="holds something that is no study"):
        run._claim(plan_of(), tmp_path, None)
    (tmp_path / "empty").mkdir()
    run._claim(plan_of(), tmp_path / "empty", None)


@pytest.fixture
def data(monkeypatch):
    """What is asked of data sets."""
    asked = []
    monkeypatch.setattr(run, "read_manifest", lambda folder: asked.append(("manifest", folder)))
    monkeypatch.setattr(run, "files", lambda folder, split: asked.append((folder, split)) or [folder / split])
    monkeypatch.setattr(run, "family_of", lambda table, path: (table, path))

    def generated(family, splits, folder, **named):
        asked.append((family, splits, folder, named))
        return {"new": 0 if family[0]["k"] == 1 else 4, "seconds": 2.4}

    monkeypatch.setattr(run, "generate", generated)
    return asked


def test_sets_are_made_but_for_that_which_is_given(tmp_path, data):
    said = []
    made = {"data": tmp_path / "sets" / "data", "far": tmp_path / "sets" / "far"}
    run._make_sets(plan_of(), tmp_path, made, 5, said.append)
    how = {"workers": 5, "stress": False}
    assert data == [(({"k": 1}, tmp_path / "sets" / "data.toml"), {"train": 2, "test": 1}, made["data"], {"seed": 3} | how),
                    (({"k": 2}, tmp_path / "sets" / "far.toml"), {"test": 1}, made["far"], {"seed": 0} | how)]
    assert said == [f"4 trajectories of beam-small made in 2 s: {made['far']}"]
    data.clear()
    given = tmp_path / "given"
    run._make_sets(plan_of(), tmp_path, made | {"data": given}, None, said.append)
    assert data[:3] == [("manifest", given), (given, "train"), (given, "test")] and len(data) == 4


def test_sets_have_stress_where_a_row_predicts_it(tmp_path, data):
    for name, stress in (("von_mises", True), ("stress", True), ("other", False)):
        row = Line("b", TrainConfig(outputs=Outputs(fields=(name,))), {})
        folders = {name: tmp_path / "sets" / name for name in ("data", "far")}
        run._make_sets(plan_of(rows=(*plan_of().rows, row)), tmp_path, folders, 1, str)
        assert [asked[3]["stress"] for asked in data[-2:]] == [stress, stress]


def test_figures_of_what_never_moves_are_worked_out_once_for_each_set(tmp_path, data, monkeypatch):
    calls = []
    monkeypatch.setattr(run, "still", lambda paths: calls.append(paths) or {"mc": len(calls)})
    tests = [(Trial("a", "data"), tmp_path / "d"), (Trial("b", "data"), tmp_path / "d"), (Trial("c", "far / set"), tmp_path / "f")]
    assert run._idle(tmp_path, tests) == {"a": {"mc": 1}, "b": {"mc": 1}, "c": {"mc": 2}}
    assert calls == [[tmp_path / "d" / "test"], [tmp_path / "f" / "test"]] and (tmp_path / "runs" / "still-far-set.json").exists()
    assert run._idle(tmp_path, tests)["c"] == {"mc": 2} and len(calls) == 2


def test_work_is_spread_over_processes_or_a_cluster(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(run, "on_this_machine", lambda *given, **named: asked.append((given, named)) or iter(given[1]))
    monkeypatch.setattr(run, "on_cluster", lambda *given, **named: asked.append((given, named)) or iter(given[1]))
    jobs = ["a", "b", "c"]
    assert list(run._spread([], 4, "scheduler", (), tmp_path)) == [] and not asked
    assert list(run._spread(jobs, 2, "", (), tmp_path)) == jobs and asked[-1] == ((run.carried_out, jobs, 2), {"unit": ""})
    list(run._spread(jobs, 9, "", (), tmp_path))
    assert asked[-1][0][2] == 3
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {5, 7} if process == 0 else {1})
    list(run._spread(jobs, None, "", (), tmp_path))
    assert asked[-1][0][2] == 2
    list(run._spread(jobs, 2, "tls://there", ("ca",), tmp_path))
    assert asked[-1] == ((run.carried_out, jobs, "tls://there"), {"prepare": (run._nothing, None), "folder": tmp_path, "tls": ("ca",),
                                                                   "unit": ""})


class Bar:
    """A bar that keeps what it is told."""

    disable = False

    def __init__(self, **named):
        self.named, self.n, self.initial, self.updates, self.told = named, 0, 0, [], []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def update(self, steps):
        self.n += steps
        self.updates.append(steps)

    def set_postfix_str(self, text, refresh):
        self.told.append(text)


def test_a_bar_tells_how_far_all_trainings_are(tmp_path, monkeypatch):
    """Ten steps each: one is done, one has told step 4 and then step 7, one nothing."""
    bars = []
    monkeypatch.setattr(run, "tqdm", lambda **named: bars.append(Bar(**named)) or bars[-1])
    looks, ends = [], []

    class Event:
        def wait(self, seconds):
            looks.append(seconds)
            if len(looks) == 2:
                (tmp_path / "b" / "run" / "curve.jsonl").write_text('{"step": 4}\n{"step": 7}\n')
            return len(looks) > 2

        def set(self):
            ends.append("set")

    monkeypatch.setattr(run, "threading", SimpleNamespace(Event=Event, Thread=threading.Thread))
    for name in "abc":
        (tmp_path / name / "run").mkdir(parents=True)
    (tmp_path / "a" / "trained.json").touch()
    (tmp_path / "b" / "run" / "curve.jsonl").write_text('{"step": 4}\n')
    jobs = [SimpleNamespace(folder=tmp_path / name, config=SimpleNamespace(steps=10), done=name == "a") for name in "abc"]
    with run._watched(jobs):
        pass
    (bar,) = bars
    assert bar.named["total"] == 30 and bar.named["disable"] is None and bar.initial == 4
    assert bar.updates[:2] == [10, 3] and bar.n == 17 and bar.told[0] == "1 of 3 trainings done"
    assert ends == ["set"] and looks == [run.LOOK] * 3
    monkeypatch.setattr(Bar, "disable", True)
    with run._watched(jobs):
        pass
    assert bars[1].updates == [] and bars[1].n == 0


def test_the_figures_of_each_row_are_given_as_numbers():
    cells = {"a": {"t": {"mc": Score(1.0, 2.0, 3)}}}
    assert run._rows(SimpleNamespace(cells=cells)) == {"a": {"t": {"mc": {"mean": 1.0, "deviation": 2.0, "seeds": 3}}}}


def test_a_study_has_a_training_for_each_seed_and_row_first_seeds_first(tmp_path, data, monkeypatch):
    rows = (Line("a / b", TrainConfig(steps=3), {}), Line("c", TrainConfig(steps=4), {}))
    plan, spread, written = plan_of(rows=rows, seeds=2), [], []
    monkeypatch.setattr(run, "load_plan", lambda path, size: plan)
    monkeypatch.setattr(run, "still", lambda paths: {})

    def spreading(missing, *given):
        spread.append((missing, given))
        return iter("xy")

    result = SimpleNamespace(lines=lambda: ["a line"], cells={})
    monkeypatch.setattr(run, "_spread", spreading)
    monkeypatch.setattr(run, "gathered", lambda plan, jobs, idle: result)
    monkeypatch.setattr(run, "write_tables", lambda out, found: written.append("tables"))
    monkeypatch.setattr(run, "write_page", lambda out, found: written.append("page"))
    said = []
    found = run.run_study("it", tmp_path / "out", size="check", workers=3, cluster="c", tls=["t"], device="d", say=said.append)
    (missing, given), = spread
    assert [(job.folder.relative_to(tmp_path / "out" / "runs").as_posix(), job.config.seed, job.config.steps) for job in missing] == [
        ("a-b/0", 0, 3), ("c/0", 0, 4), ("a-b/1", 1, 3), ("c/1", 1, 4)]
    sets = [tmp_path / "out" / "sets" / name for name in ("data", "far")]
    assert all((job.data, job.device, job.tests) == (sets[0], "d", tuple(zip(plan.tests, sets, strict=True))) for job in missing)
    assert given == (3, "c", ["t"], tmp_path / "out") and written == ["tables", "tables", "tables", "page"]
    assert found == {"title": "T", "size": "check", "trainings": 4, "new": 4, "rows": {}, "out": str(tmp_path / "out")}
    assert [asked[2] for asked in data if len(asked) == 4] == sets
    assert said[-2:] == ["a line", f"table: {tmp_path / 'out' / 'table.md'}, page: {tmp_path / 'out' / 'report.html'}"]
    data.clear()
    for job in missing:  # all is found: neither data nor networks are needed for the table
        job.folder.mkdir(parents=True)
        for path in (job.folder / "trained.json", *(job.found(test) for test, _ in job.tests)):
            path.write_text("{}")
    assert run.run_study("it", tmp_path / "out", size="check")["new"] == 0 and not spread[-1][0] and not data
