"""Workers: one thread each, ended with what they were told; a cluster's are asked once a machine. No solver takes part."""

import asyncio
import logging
import os
import sys
from pathlib import Path
from typing import ClassVar

import pytest

from datagen.files.provenance import commit
from datagen.sets import workers
from datagen.sets.workers import _bar, _one_thread, _ready, _without_main, on_cluster, on_this_machine, progress
from physics.schema import InputError


def test_each_job_comes_with_its_result_from_a_process_of_one_thread(monkeypatch):
    """The functions are the standard library's: what the variables of its environment are there."""
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    monkeypatch.setenv("OTHER", "x")
    main = sys.modules["__main__"].__dict__.copy()
    jobs = ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OTHER", "NONE"]
    found = dict(on_this_machine(os.getenv, jobs, 2))
    assert found == {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OTHER": "x", "NONE": None}
    assert os.environ["OMP_NUM_THREADS"] == "7" and "OPENBLAS_NUM_THREADS" not in os.environ
    assert {name: sys.modules["__main__"].__dict__.get(name) for name in ("__file__", "__spec__")} == {
        name: main.get(name) for name in ("__file__", "__spec__")}


def test_a_worker_that_is_killed_and_one_that_fails(monkeypatch):
    with pytest.raises(RuntimeError, match="a worker process was killed"):
        list(on_this_machine(os._exit, [1], 1))
    with pytest.raises(TypeError):
        list(on_this_machine(os.getenv, [3], 1))


def test_the_environment_is_as_it_was_after_an_error(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "5")
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    main = sys.modules["__main__"]
    before = main.__dict__.get("__file__"), main.__dict__.get("__spec__")
    for scope in (_one_thread, _without_main):
        with pytest.raises(ZeroDivisionError), scope():
            if scope is _one_thread:
                assert os.environ["OMP_NUM_THREADS"] == os.environ["OPENBLAS_NUM_THREADS"] == "1"
            else:
                assert main.__dict__["__file__"] is None and main.__dict__["__spec__"] is None
            raise ZeroDivisionError
    assert os.environ["OPENBLAS_NUM_THREADS"] == "5" and "OMP_NUM_THREADS" not in os.environ
    assert (main.__dict__.get("__file__"), main.__dict__.get("__spec__")) == before


def test_bars_are_for_terminals_and_start_where_the_run_before_ended(capsys, monkeypatch):
    assert list(progress([3, 1, 2], "looking")) == [3, 1, 2] and capsys.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with _bar(3, 5) as bar:
        assert (bar.n, bar.total, bar.initial) == (3, 8, 3)
        bar.update()
        assert bar.n == 4 and bar.unit == " trajectories" and not bar.disable
    with _bar(3, 5, "") as bar:  # who shows how far things are himself
        assert bar.disable
    assert list(progress([1], "looking")) == [1] and "looking" in capsys.readouterr().err


def test_a_worker_whose_parent_is_gone_ends(monkeypatch):
    """`prctl` is told to send SIGKILL (9) when the parent dies (1); one that is gone already is seen by another parent's number."""
    told, ended = [], []
    monkeypatch.setattr(workers.ctypes, "CDLL", lambda _: type("C", (), {"prctl": staticmethod(lambda *args: told.append(args))}))
    monkeypatch.setattr(workers.os, "_exit", ended.append)
    for parent, ends in ((os.getppid(), []), (os.getppid() + 1, [1])):
        monkeypatch.setattr(workers.multiprocessing, "parent_process", lambda parent=parent: type("P", (), {"pid": parent}))
        workers._die_with_parent()
        assert ended == ends and told[-1] == (1, 9)
    monkeypatch.setattr(workers.multiprocessing, "parent_process", lambda: None)
    workers._die_with_parent()
    assert ended == [1, 1] and len(told) == 3


# ---- a cluster


def test_a_machine_must_see_the_folder_and_run_the_same_program(tmp_path):
    done = []
    _ready(done.append, "scenes", tmp_path, commit())
    assert done == ["scenes"]
    with pytest.raises(RuntimeError, match=f"does not see the folder {tmp_path}/none"):
        _ready(done.append, "scenes", tmp_path / "none", commit())
    with pytest.raises(RuntimeError, match="of this program, not another"):
        _ready(done.append, "scenes", tmp_path, "another")
    assert done == ["scenes"]


class Future:
    def __init__(self, result):
        self._result = result

    def result(self):
        if isinstance(self._result, BaseException):
            raise self._result
        return self._result


class Client:
    """A Dask client whose workers compute at once."""

    threads: ClassVar = {"tcp://10.0.0.1:1": 1, "tcp://10.0.0.1:2": 1, "tcp://10.0.0.2:1": 1}
    loop, status, fault = None, "running", None

    def __init__(self, address, timeout, set_as_default):
        assert (timeout, set_as_default) == (10, False)
        if address == "nowhere:1":
            raise OSError("nobody")
        self.submitted, self.cancelled = [], []
        Client.last = self

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.closed = True

    def nthreads(self):
        return self.threads

    def submit(self, function, *arguments, workers, pure):
        self.submitted.append((workers, pure, arguments[2:]))
        return Future(function(*arguments))

    def map(self, function, jobs, pure):
        assert pure is False
        return [Future(self.fault or function(job)) for job in jobs]

    def cancel(self, futures):
        self.cancelled.append(len(futures))


@pytest.fixture
def cluster(monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(distributed, "Client", Client)
    monkeypatch.setattr(distributed, "as_completed", lambda futures, loop: reversed(list(futures)))
    return distributed


def ask(folder, address="there:1", function=str):
    return list(on_cluster(function, [1, 2, 3], address, prepare=(len, "scenes"), folder=folder))


def test_a_cluster_is_prepared_once_a_machine_and_each_job_keeps_its_result(cluster, tmp_path):
    assert ask(tmp_path) == [(3, "3"), (2, "2"), (1, "1")]
    assert Client.last.submitted == [([worker], False, (tmp_path, commit())) for worker in ("tcp://10.0.0.1:2", "tcp://10.0.0.2:1")]
    assert Client.last.cancelled == [3] and Client.last.closed


def test_a_cluster_without_workers_or_with_threads_is_refused(cluster, tmp_path, monkeypatch):
    with pytest.raises(InputError, match="--cluster nowhere:1: no Dask scheduler there: nobody"):
        ask(tmp_path, "nowhere:1")
    for address in ("nowhere", "nowhere:1x"):  # Dask tries such a one for 20 s, and ends in a traceback of its own
        with pytest.raises(InputError, match=f"--cluster {address}: must be the address of a Dask scheduler, such as tcp://host:8786"):
            ask(tmp_path, address)
    for threads, words in (({}, "no workers"), ({"tcp://a:1": 1, "tcp://b:1": 2}, "several threads")):
        monkeypatch.setattr(Client, "threads", threads)
        with pytest.raises(InputError, match=words):
            ask(tmp_path)
    monkeypatch.setattr(Client, "threads", {"tcp://a:1": 1})
    with pytest.raises(RuntimeError, match="does not see"):
        ask(Path("/none"))


def test_certificates_are_for_addresses_at_tls_and_are_files(cluster, tmp_path):
    """What is shown to a real scheduler is tested beside one (test_datagen_workers_tls.py)."""
    how = {"prepare": (len, "scenes"), "folder": tmp_path, "tls": (str(tmp_path / "ca.pem"),) * 3}
    with pytest.raises(InputError, match="begins with tls://"):
        list(on_cluster(str, [1], "tcp://there", **how))
    with pytest.raises(InputError, match=r"--tls .*ca\.pem: no such file"):
        list(on_cluster(str, [1], "tls://there", **how))
    with pytest.raises(InputError, match="needs certificates: --tls CA CERT KEY"):
        ask(tmp_path, "tls://there")
    assert logging.root.manager.disable == 0  # what was quiet may speak again


def test_a_cluster_that_is_lost_says_that_what_is_finished_is_kept(cluster, tmp_path, monkeypatch):
    from distributed.comm import CommClosedError
    from distributed.scheduler import KilledWorker

    for fault, words in ((KilledWorker.__new__(KilledWorker), "lost again and again"), (asyncio.CancelledError(), "at there:1 is gone"),
                         (CommClosedError(), "at there:1 is gone"), (ValueError("own"), "own")):
        monkeypatch.setattr(Client, "fault", fault)
        with pytest.raises(ValueError if words == "own" else RuntimeError, match=words):
            ask(tmp_path)
        assert Client.last.cancelled == [3]
    monkeypatch.setattr(Client, "status", "closed")
    with pytest.raises(ValueError):
        ask(tmp_path)
    assert Client.last.cancelled == []


def test_without_dask_a_cluster_is_refused(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match="needs the package distributed"):
        ask(tmp_path)
