"""Real schedulers: one that wants certificates, and one that dies in the middle, which ends in one line and nothing before it."""

import json
import os
import shutil
import subprocess
import sys
import time

import pytest

from tests.pages import ROOT

pytest.importorskip("distributed")
pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="needs the command openssl")
# Jobs that take a second each, given to the scheduler of the first argument; what it ends in, in one line, as the command line says it.
ASK = """
import sys, time
from pathlib import Path
from datagen.sets.workers import on_cluster
from physics.schema import InputError
try:
    for job, result in on_cluster(time.sleep, [1.0] * 60, sys.argv[1], prepare=(len, "x"), folder=Path.cwd(), tls=sys.argv[2:]):
        print("done", flush=True)
        if len(sys.argv) > 2:
            break
except (InputError, RuntimeError) as error:
    print(f"{type(error).__name__}: {error}", file=sys.stderr)
"""


def openssl(folder, *words):
    subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)


def certificates(folder, name):
    """An authority, and a certificate of it with its key."""
    openssl(folder, "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", f"{name}-ca.key", "-out", f"{name}-ca.pem", "-days", "2",
            "-subj", f"/CN={name}")
    openssl(folder, "req", "-newkey", "rsa:2048", "-nodes", "-keyout", f"{name}.key", "-out", f"{name}.csr", "-subj", "/CN=localhost")
    openssl(folder, "x509", "-req", "-in", f"{name}.csr", "-CA", f"{name}-ca.pem", "-CAkey", f"{name}-ca.key", "-CAcreateserial",
            "-days", "2", "-out", f"{name}.pem")
    return [str(folder / f"{name}{end}") for end in ("-ca.pem", ".pem", ".key")]


@pytest.fixture
def start(tmp_path):
    """Starts a scheduler and a worker, with certificates or without; gives the address and the scheduler's process."""
    started = []

    def of(tls=()):
        options = [word for pair in zip(("--tls-ca-file", "--tls-cert", "--tls-key"), tls, strict=False) for word in pair]
        quiet = {"env": {**os.environ, "PYTHONPATH": str(ROOT), "DASK_DISTRIBUTED__WORKER__DAEMON": "False"}, "cwd": tmp_path,
                 "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        where = tmp_path / "scheduler.json"
        started.append(subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "tls://127.0.0.1" if tls else
                                         "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", where, *options], **quiet))
        end = time.monotonic() + 60
        while not (where.exists() and where.stat().st_size) and time.monotonic() < end:
            time.sleep(0.1)
        address = json.loads(where.read_text())["address"]
        started.append(subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard",
                                         "--no-nanny", *options], **quiet))
        return address, started[-2]

    yield of
    for process in reversed(started):
        process.kill()
        process.wait()


def asked(tmp_path, *words):
    return subprocess.Popen([sys.executable, "-c", ASK, *words], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def until_a_worker_is_there(tmp_path, *words):
    """Asks until a worker has come; what was said then."""
    for _ in range(60):
        out, err = asked(tmp_path, *words).communicate(timeout=60)
        if "no workers" not in err:
            return out, err
        time.sleep(0.5)
    raise AssertionError("no worker came")


@pytest.mark.slow
def test_a_cluster_at_tls_takes_certificates_of_its_authority_and_no_others(start, tmp_path):
    own, others = certificates(tmp_path, "own"), certificates(tmp_path, "others")
    address, _ = start(own)
    assert address.startswith("tls://")
    assert until_a_worker_is_there(tmp_path, address, *own) == ("done\n", "")
    missing = (address, own[0], own[1], str(tmp_path / "none.key"))
    for wrong, words in (((address, *others), "no Dask scheduler"), ((address,), "needs certificates"), (missing, "no such file")):
        out, err = asked(tmp_path, *wrong).communicate(timeout=60)
        assert out == "" and err.count("\n") == 1 and err.startswith("InputError: --") and words in err, err


@pytest.mark.slow
def test_a_scheduler_that_dies_ends_in_one_line(start, tmp_path):
    address, scheduler = start()
    for _ in range(60):
        asking = asked(tmp_path, address)
        if asking.stdout.readline() == "done\n":
            break
        assert "no workers" in asking.communicate(timeout=60)[1]
        time.sleep(0.5)
    scheduler.kill()
    _, err = asking.communicate(timeout=60)
    assert err == f"RuntimeError: the scheduler at {address} is gone. What is finished is kept: run the same again to go on\n"
