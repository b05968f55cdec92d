"""What all benchmarks stand on: the press scene, one clock, processes of their own, the machine in words, one kind of table.

Times are processor seconds of one thread, as a shared machine's clock says nothing. On standard output goes one Markdown table, the
one that stands in docs/; remarks go to standard error.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from physics.scene import Scene, read_scene

ROOT = Path(__file__).parents[1]
MATERIAL = {"young_modulus": 1e6, "poisson_ratio": 0.4}
NUMBER = re.compile(r"[-+]?\d[\d.e+-]*( \S+){0,2}|–")
T = TypeVar("T")


def press(cells: Sequence[int] = (40, 5, 5), steps: int = 400, *, heights: Sequence[float] = (0.03, 0.0), **body: Any) -> Scene:
    """A beam that is clamped at one end, and near the other a cylinder that goes down on it; 1476 nodes.

    Args:
        heights: [m] of the cylinder's axis, from the first to the last step; it touches at 0.03
        body: more for the table [body]
    """
    return read_scene({
        "name": "press", "body": {"length": 0.1, "width": 0.02, "height": 0.02, "cells": list(cells), **body}, "material": MATERIAL,
        "support": [{"where": "x-min", "fixed": "xyz"}], "steps": {"count": steps},
        "obstacle": {"shape": "cylinder", "radius": 0.01, "path": [[0.08, 0.01, height] for height in heights]}})


def cost(run: Callable[..., T], *given: Any, **named: Any) -> tuple[float, T]:
    """Processor seconds of a call, and what it returned."""
    start = time.process_time()
    found = run(*given, **named)
    return time.process_time() - start, found


def least(run: Callable[[], Any], laps: int) -> float:
    """Processor seconds of the fastest of some calls."""
    return min(cost(run)[0] for _ in range(laps))


def median(run: Callable[[], Any], laps: int) -> float:
    return float(np.median([cost(run)[0] for _ in range(laps)]))


def child(run: Callable[..., T], *given: Any) -> T:
    """What a function of a module returns in a process of its own; both ways as JSON."""
    module = sys.modules["__main__"].__spec__.name if run.__module__ == "__main__" else run.__module__  # type: ignore[union-attr]
    program = f"import json, sys; from {module} import {run.__name__} as run; print(json.dumps(run(*json.loads(sys.argv[1]))))"
    done = subprocess.run([sys.executable, "-c", program, json.dumps(given)], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    found: T = json.loads(done.stdout.splitlines()[-1])
    return found


def peak_memory() -> float:
    """The largest memory of this process so far [MB]; that of its parent, which getrusage counts too, left out."""
    return int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]) / 1024


def exponent(sizes: Sequence[float], values: Sequence[float]) -> float:
    """p of values ~ sizes^p, least squares of the logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def machine() -> str:
    """Processor, linear algebra, threads and load."""
    names = re.findall(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE) or [platform.machine()]
    loaded = re.findall(r"[^/\n]+/lib\w*blas[^/\n]*$", Path("/proc/self/maps").read_text(), re.MULTILINE)
    return (f"{names[0]}, {' and '.join(sorted(set(loaded))) or 'no BLAS'}, threads: {os.environ['OMP_NUM_THREADS']}, "
            f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def parser(doc: str | None) -> argparse.ArgumentParser:
    return argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)


class Table:
    """A Markdown table on standard output, row by row as they come; columns whose first entry is a number stand right.

    rows: heading -> entry, those of the first row for all
    """

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []
        say(machine())

    def add(self, row: dict[str, Any]) -> None:
        """An entry is words, or a number, of which three digits are shown; None, or none, is a dash."""
        if not self.rows:
            self._print(row)
            self._print("---:" if NUMBER.fullmatch(_shown(entry)) else "---" for entry in row.values())
        self.rows.append(row)
        self._print(_shown(row.get(head)) for head in self.rows[0])

    def fit(self, *heads: str) -> None:
        """A last row: the powers of the first column by which these grow."""
        by = next(iter(self.rows[0]))
        powers = {head: f"{exponent(*zip(*((row[by], row[head]) for row in self.rows), strict=True)):.2f}" for head in heads}
        self.add({by: f"{by}^p, p ="} | powers)

    @staticmethod
    def _print(entries: Any) -> None:
        print("| " + " | ".join(entry.replace("|", "\\|") for entry in entries) + " |", flush=True)


def _shown(entry: Any) -> str:
    number = isinstance(entry, float)
    text = "–" if entry is None else f"{entry:.0f}" if number and 999.5 <= abs(entry) < 1e6 else f"{entry:.3g}" if number else str(entry)
    return re.sub(r"(?<=\de)([+-])0(?=\d)", r"\1", text)
