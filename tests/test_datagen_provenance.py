"""Versions, commit and machine are what the system itself says."""

import importlib.metadata
import os
import platform
import subprocess
from pathlib import Path

import h5py
import numpy
import pytest

from datagen.files import provenance
from datagen.files.provenance import commit, machine, processor, versions


@pytest.fixture(autouse=True)
def anew():
    for function in (commit, machine, provenance._versions):
        function.cache_clear()
    yield
    for function in (commit, machine, provenance._versions):
        function.cache_clear()


def test_versions_are_those_of_what_is_installed():
    found = versions()
    assert list(found) == ["python", "dolfinx", "ufl", "ffcx", "basix", "petsc4py", "slepc4py", "mpi4py", "numpy", "scipy", "h5py"]
    assert (found["python"], found["numpy"], found["h5py"]) == (platform.python_version(), numpy.__version__, h5py.__version__)
    for name in ("dolfinx", "ufl", "ffcx", "basix"):
        assert found[name] == importlib.metadata.version(f"fenics-{name}")
    found["numpy"] = "0"
    assert versions()["numpy"] == numpy.__version__  # a copy


def test_the_commit_is_that_of_git(tmp_path, monkeypatch):
    """Of a repository made here: 40 digits, with a tag too, and -dirty once a file differs."""
    folder = tmp_path / "datagen"
    folder.mkdir()
    (folder / "provenance.py").write_text("1")
    monkeypatch.setattr(provenance, "__file__", str(folder / "provenance.py"))
    assert commit() == ""  # no checkout
    git = ["git", "-C", tmp_path, "-c", "user.name=x", "-c", "user.email=x"]
    for command in (["init", "-q"], ["add", "."], ["commit", "-qm", "x"], ["tag", "-m", "v", "v1"]):
        subprocess.run([*git, *command], check=True, capture_output=True)
    head = subprocess.run([*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True).stdout.strip()
    commit.cache_clear()
    assert commit() == head and len(head) == 40
    (folder / "provenance.py").write_text("2")
    assert commit() == head  # asked once
    commit.cache_clear()
    assert commit() == f"{head}-dirty"
    monkeypatch.setenv("PATH", "")
    commit.cache_clear()
    assert commit() == ""  # no git


def test_the_processor_is_the_first_that_linux_names(monkeypatch):
    texts = {"cpu": "processor : 0\nmodel name\t: Fast: 3 GHz \nmodel name\t: second\n", "none": "processor : 0\n"}
    for text, name in ((texts["cpu"], "Fast: 3 GHz"), (texts["none"], "x86")):
        monkeypatch.setattr(Path, "read_text", lambda self, text=text: text)
        monkeypatch.setattr(platform, "machine", lambda: "x86")
        assert processor() == name


def test_the_machine_is_its_processor_its_cores_and_its_system(monkeypatch):
    cores = f"{len(os.sched_getaffinity(0))} cores, {platform.system()} {platform.release()}"
    monkeypatch.setattr(Path, "read_text", lambda self: "processor : 0\nmodel name\t: Some: Chip \nmodel name : Other")
    assert machine() == f"Some: Chip, {cores}"
    monkeypatch.setattr(Path, "read_text", lambda self: "processor : 0")
    machine.cache_clear()
    assert machine() == f"{platform.machine()}, {cores}"

    def none(self):
        raise OSError

    monkeypatch.setattr(Path, "read_text", none)
    machine.cache_clear()
    assert machine() == f"{platform.machine()}, {cores}"
