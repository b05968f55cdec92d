"""Where numbers come from: the versions of all that computed them, the commit of this program, and the machine."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import subprocess
import tomllib
from functools import cache
from pathlib import Path

import h5py


@cache
def _versions() -> tuple[tuple[str, str], ...]:
    names = {"dolfinx": "fenics-dolfinx", "ufl": "fenics-ufl", "ffcx": "fenics-ffcx", "basix": "fenics-basix"}
    names |= {name: name for name in ("petsc4py", "slepc4py", "mpi4py", "numpy", "scipy")}
    found = {name: importlib.metadata.version(package) for name, package in names.items()}
    return tuple({"python": platform.python_version(), **found, "h5py": h5py.__version__}.items())


def versions() -> dict[str, str]:
    """The versions of Python and of every library that a trajectory's numbers come from."""
    return dict(_versions())


def release() -> str:
    """The version of this program: of its checkout, or as it was installed."""
    about = Path(__file__).parents[2] / "pyproject.toml"
    return str(tomllib.loads(about.read_text())["project"]["version"]) if about.exists() else importlib.metadata.version("fidelity")


@cache
def commit() -> str:
    """The git commit of this program, "-dirty" when changed since; empty when it does not run from a checkout."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def processor() -> str:
    """The processor's name where Linux tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.machine()


@cache
def machine() -> str:
    """The processor and the cores that this process may use, and the system, in one line."""
    return f"{processor()}, {len(os.sched_getaffinity(0))} cores, {platform.system()} {platform.release()}"
