"""Importing physics settles the number of threads of the linear algebra, before and after numpy has come; the environment goes first."""

import subprocess
import sys

import pytest

from physics import threads
from tests.pages import ROOT

# What OpenBLAS itself says of its threads, asked through every library of that name that numpy and scipy have loaded.
ASK = """
import ctypes, os
def threads():
    found = set()
    for line in open("/proc/self/maps"):
        path = line.split()[-1]
        if "openblas" in path.rsplit("/", 1)[-1] and ".so" in path:
            for name in ("openblas_get_num_threads", "openblas_get_num_threads64_", "scipy_openblas_get_num_threads64_"):
                get = getattr(ctypes.CDLL(path), name, None)
                if get is not None:
                    found.add(get())
    return sorted(found)
"""


def asked(program: str, **environment: str) -> str:
    clean = {"PATH": "/usr/bin:/bin", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", ASK + program]
    return subprocess.run(command, cwd=ROOT, env=clean | environment, capture_output=True, text=True, check=True).stdout.strip()


@pytest.mark.parametrize("order", ["import numpy, scipy.linalg, physics", "import physics, numpy, scipy.linalg"])
def test_one_thread_whether_numpy_comes_before_or_after(order):
    assert asked(f"{order}; print(os.environ['OMP_NUM_THREADS'], os.environ['OPENBLAS_NUM_THREADS'], threads())") == "1 1 [1]"


@pytest.mark.parametrize("name", ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"])
def test_a_number_of_the_user_is_kept(name):
    program = "import numpy; before = threads(); import physics; print(threads() == before, [k for k in os.environ if 'THREADS' in k])"
    assert asked(program, **{name: "3"}) == f"True ['{name}']"


@pytest.mark.parametrize("given, expected", [(None, 1), ("", 1), ("0", 1), ("3", 3), (" 2 ", 2), ("4,2", 4), ("many", 1), ("-2", 1)])
def test_the_number_is_the_first_of_the_environment(monkeypatch, given, expected):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    if given is not None:
        monkeypatch.setenv("OMP_NUM_THREADS", given)
    assert threads.count() == expected
