"""All trainings of a study, spread over processes or a cluster, that can be stopped at any instant and gone on with.

    OUT/study.json       what the folder holds: of another study, size or data it is refused
    OUT/sets/NAME        the data, made as `generate` makes it; OUT/sets/NAME.toml the family
    OUT/runs/ROW/SEED    one training each (work.py)
    OUT/table.md, table.csv, report.html    what is found, written anew after each training

First seeds of all rows come first, so that a study that is not done yet has a whole table of few seeds. What is found of all trainings
(trained.json, on-TEST.json, run/curve.jsonl, runs/still-DATA.json) makes the table again without data and networks.
"""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from tqdm import tqdm

from datagen.sets.dataset import files, read_manifest
from datagen.sets.generate import generate
from datagen.sets.workers import on_cluster, on_this_machine
from learning.study.page import write_page
from learning.study.plan import Plan, Trial, family_of, load_plan, slug
from learning.study.table import Result, check_published, gathered, write_tables
from learning.study.work import Training, carried_out, still, write_json
from learning.training.curve import read_curve
from physics.schema import InputError, to_table

LOOK = 2.0  # [s] between two looks at how far trainings are


def run_study(path: str | Path, out: str | Path, *, size: str = "small", data: str | Path | None = None,
              workers: int | None = None, cluster: str = "", tls: Sequence[str] = (), device: str = "cpu",
              say: Callable[[str], None] = lambda _: None) -> dict[str, Any]:
    """Carry a study out, or what is missing of it, and write its tables and page.

    Args:
        path: a study file, or the short name of one of the package's (plan.py)
        out: the folder; when it holds a study, then this one at this size
        size: check, small or paper
        data: a data set in place of the one that would be made for training
        workers: processes on this machine, by default one for each core
        cluster, tls: a Dask scheduler whose workers do it instead, and its certificates, as `generate` takes them
        device: where networks run

    Returns:
        {"title", "size", "trainings", "new", "rows": figures of each row, "out"}

    Raises:
        InputError: the study, the folder or the data is wrong
        RuntimeError: data could not be made, or a worker was lost; what is there is kept, and another call goes on from there
    """
    plan, out = load_plan(path, size), Path(out).absolute()
    check_published(plan)
    _claim(plan, out, data)
    folders = {name: Path(data).absolute() if name == "data" and data is not None else out / "sets" / name for name in plan.sets}
    tests = tuple((test, folders[test.data]) for test in plan.tests)
    jobs = _trainings(plan, out, folders["data"], tests, device)
    missing = [job for job in jobs.values() if not job.done]
    if missing or not all(_still(out, test).exists() for test in plan.tests):
        _make_sets(plan, out, folders, workers, say)
    idle = _idle(out, tests)
    with _watched(list(jobs.values())):
        for _ in _spread(missing, workers, cluster, tls, out):
            write_tables(out, gathered(plan, jobs, idle))
    result = gathered(plan, jobs, idle)
    write_tables(out, result)
    write_page(out, result)
    for line in result.lines():
        say(line)
    say(f"table: {out / 'table.md'}, page: {out / 'report.html'}")
    return {"title": plan.title, "size": size, "trainings": len(jobs), "new": len(missing), "rows": _rows(result), "out": str(out)}


def read_study(path: str | Path, out: str | Path, *, size: str = "small", data: str | Path | None = None) -> Result:
    """What a study's folder holds so far; nothing is made or trained. Raises `InputError` for a folder of anything else."""
    plan, out = load_plan(path, size), Path(out).absolute()
    check_published(plan)
    if not (out / "study.json").exists():
        raise InputError(f"{out}: holds no study")
    _claim(plan, out, data)
    tests = tuple((test, out / "sets" / test.data) for test in plan.tests)
    missing = [_still(out, test) for test in plan.tests if not _still(out, test).exists()]
    if missing:
        raise InputError(f"{missing[0]}: not there; the study has not begun")
    return gathered(plan, _trainings(plan, out, out / "sets" / "data", tests, "cpu"), _idle(out, tests))


def _trainings(plan: Plan, out: Path, data: Path, tests: tuple[tuple[Trial, Path], ...], device: str) -> dict[tuple[str, int], Training]:
    """All of a study, by row and seed, first seeds first."""
    return {(row.name, seed): Training(out / "runs" / slug(row.name) / str(seed), replace(row.config, seed=seed), data, tests, device)
            for seed in range(plan.seeds) for row in plan.rows}


def _spread(jobs: list[Training], workers: int | None, cluster: str, tls: Sequence[str], out: Path) -> Iterator[Any]:
    """The jobs, each when it is done."""
    if not jobs:
        return iter(())
    if cluster:
        return on_cluster(carried_out, jobs, cluster, prepare=(_nothing, None), folder=out, tls=tls, unit="")
    return on_this_machine(carried_out, jobs, min(workers or len(os.sched_getaffinity(0)), len(jobs)), unit="")


def _nothing(_: Any) -> None:
    """There is nothing to be compiled before."""


def _claim(plan: Plan, out: Path, data: str | Path | None) -> None:
    """Write down what the folder holds. Raises `InputError` when it is something else."""
    told = {"title": plan.title, "size": plan.size, "data": None if data is None else str(Path(data).absolute()),
            "sets": {name: [table, to_table(made)] for name, (table, made) in plan.sets.items()},
            "tests": [[test.name, test.data, test.change] for test in plan.tests],
            "rows": {row.name: to_table(row.config) for row in plan.rows}}
    path = out / "study.json"
    if path.exists():
        try:
            there = json.loads(path.read_text())
        except ValueError:
            raise InputError(f"{path}: not a study's") from None
        apart = [key for key, value in json.loads(json.dumps(told)).items() if not isinstance(there, dict) or there.get(key) != value]
        if apart:
            raise InputError(f"--out {out}: holds a study with other {apart[0]}; choose another folder")
    elif out.exists() and any(out.iterdir()):
        raise InputError(f"--out {out}: holds something that is no study; choose another folder")
    write_json(path, told)


def _make_sets(plan: Plan, out: Path, folders: dict[str, Path], workers: int | None, say: Callable[[str], None]) -> None:
    """Make the data where it is not there, but for a folder that is not the study's own."""
    stress = any({"stress", "von_mises"} & set(row.config.outputs.fields) for row in plan.rows)
    for name, (table, made) in plan.sets.items():
        if folders[name].parent != out / "sets":
            read_manifest(folders[name])
            for split in ("train", "test"):
                files(folders[name], split)
            continue
        family = family_of(table, out / "sets" / f"{name}.toml")
        found = generate(family, made.splits, folders[name], seed=made.seed, workers=workers, stress=stress)
        if found["new"]:
            say(f"{found['new']} trajectories of {made.family} made in {found['seconds']:.0f} s: {folders[name]}")


def _still(out: Path, test: Trial) -> Path:
    """Where the figures of a body that never moves are."""
    return out / "runs" / f"still-{slug(test.data)}.json"


def _idle(out: Path, tests: Sequence[tuple[Trial, Path]]) -> dict[str, dict[str, Any]]:
    """Figures of a body that never moves, by test; kept."""
    for test, folder in tests:
        if not _still(out, test).exists():
            write_json(_still(out, test), still(files(folder, "test")))
    return {test.name: json.loads(_still(out, test).read_text()) for test, _ in tests}


def _rows(result: Result) -> dict[str, Any]:
    return {name: {test: {key: {"mean": cell.mean, "deviation": cell.deviation, "seeds": cell.count} for key, cell in cells.items()}
                   for test, cells in tests.items()} for name, tests in result.cells.items()}


@contextmanager
def _watched(jobs: Sequence[Training]) -> Iterator[None]:
    """A bar on a terminal: how far all trainings are together, and the time left."""
    ended, total = threading.Event(), sum(job.config.steps for job in jobs)
    with tqdm(total=total, desc="study", unit="step", disable=None, smoothing=0.05) as bar:
        if bar.disable:
            yield
            return

        def look() -> None:
            while not ended.wait(LOOK):
                steps = [job.config.steps if (job.folder / "trained.json").exists() else _step(job) for job in jobs]
                bar.set_postfix_str(f"{sum(job.done for job in jobs)} of {len(jobs)} trainings done", refresh=False)
                bar.update(sum(steps) - bar.n)

        bar.initial = bar.n = sum(_step(job) for job in jobs)
        watcher = threading.Thread(target=look, daemon=True)
        watcher.start()
        try:
            yield
        finally:
            ended.set()
            watcher.join()


def _step(job: Training) -> int:
    """The last step that a training's curve tells."""
    lines = read_curve(job.folder / "run")
    return int(lines[-1]["step"]) if lines else 0
