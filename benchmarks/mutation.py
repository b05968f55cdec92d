"""Small wrongs put into the code at random, one at a time: how many do the nearest tests see?

    .venv/bin/pip install cosmic-ray==8.7.0
    .venv/bin/python -m benchmarks.mutation --seed 0 1 --count 300 --workers 2 --out mutants.jsonl
    .venv/bin/python -m benchmarks.mutation --seed 0 --count 20 physics/equilibrium/newton.py physics/equilibrium/balance.py

benchmarks/mutants.py says which wrongs there are, and which tests are the nearest. Each test file has to pass before; one that does not
is left out and said (with --trust they are taken to pass, and to take as long as they are).

Everything happens in copies of the tree in a temporary folder, one for each worker, and nothing of it stays. A wrong counts as
killed when a test fails or does not end within four times its usual time (a minute at least). Exit status 1 when fewer than
`--least` per cent are killed.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from queue import Queue

from tqdm import tqdm

from benchmarks.mutants import PACKAGES, OperatorProvider, Wrong, draw, mutate_code, nearest

BUDGET = 60.0  # seconds of tests beside those named after the module
SETTINGS = {"VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow", "PYTHONNOUSERSITE": "1", "HWLOC_HIDE_ERRORS": "2",
            "OMPI_MCA_plm": "isolated", "OMPI_MCA_btl": "self", "OMPI_ALLOW_RUN_AS_ROOT": "1",
            "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}  # as in `run`


@dataclass(frozen=True)
class Verdict:
    wrong: Wrong
    killed: bool
    by: str  # the test that failed, "no end", or "" for a survivor
    seconds: float


def preload() -> None:
    """What every test imports and no wrong touches; children are forked from here."""
    import h5py  # noqa: F401
    import meshio  # noqa: F401
    import pytest  # noqa: F401
    import safetensors  # noqa: F401
    import scipy.linalg
    import scipy.optimize
    import scipy.sparse.linalg
    import scipy.spatial  # noqa: F401
    import torch  # noqa: F401


def serve() -> None:
    """A worker's loop: a line of JSON (tests, seconds) in, run in a forked child, a line (status, first failure, seconds) out."""
    preload()
    for line in sys.stdin:
        tests, limit = json.loads(line)
        start = time.perf_counter()
        log = Path("mutation.log")
        child = os.fork()
        if child == 0:
            os.setsid()
            sys.dont_write_bytecode = True
            with log.open("w") as file:
                os.dup2(file.fileno(), 1)
                os.dup2(file.fileno(), 2)
            import pytest
            os._exit(int(pytest.main(["-x", "-q", "--no-header", "--tb=no", "-p", "no:cacheprovider", "--color=no", *tests])))
        status = _wait(child, start + limit)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)  # what the tests have left running
        text = log.read_text(errors="replace")
        by = next((row.split(" - ")[0] for row in text.splitlines() if row.startswith(("FAILED", "ERROR"))), "crash")
        print(json.dumps([status, "no end" if status is None else by, time.perf_counter() - start]), file=sys.__stdout__, flush=True)


def _wait(child: int, until: float) -> int | None:
    """A child's exit status; None when it had to be ended."""
    while time.perf_counter() < until:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


class Worker:
    """A copy of the tree, and a process that runs tests in it."""

    def __init__(self, root: Path, folder: Path):
        listed = ["git", "ls-files", "-co", "--exclude-standard"]
        for name in subprocess.run(listed, cwd=root, capture_output=True, text=True, check=True).stdout.splitlines():
            if (root / name).is_file():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(root / name, folder / name)
        (folder / ".venv").symlink_to((root / ".venv").resolve())
        subprocess.run(["git", "init", "-q"], cwd=folder, check=True)
        self.folder = folder
        self.compile(*PACKAGES)
        self.process = subprocess.Popen([sys.executable, "-m", "benchmarks.mutation", "--serve"], cwd=folder, text=True,
                                        env=SETTINGS | os.environ, stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def compile(self, *paths: str) -> None:
        command = [sys.executable, "-m", "compileall", "-q", "--invalidation-mode", "unchecked-hash", *paths]
        subprocess.run(command, cwd=self.folder, check=True)

    def run(self, tests: Sequence[str], limit: float) -> tuple[int | None, str, float]:
        print(json.dumps([tests, limit]), file=self.process.stdin, flush=True)
        status, by, seconds = json.loads(self.process.stdout.readline())
        return status, by, seconds

    def judge(self, wrong: Wrong, tests: Sequence[str], limit: float) -> Verdict:
        path = self.folder / wrong.module
        source = path.read_text()
        for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
            compiled.unlink()
        path.write_text(mutate_code(source, OperatorProvider()[wrong.operator](), wrong.occurrence))
        try:
            status, by, seconds = self.run(tests, limit) if tests else (0, "", 0.0)
        finally:
            path.write_text(source)
            self.compile(wrong.module)
        return Verdict(wrong, status not in (0, 5), by if status not in (0, 5) else "", seconds)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("modules", nargs="*", help="paths of modules; all of physics, datagen and learning where none is given")
    parser.add_argument("--seed", type=int, nargs="+", default=[0])
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--least", type=float, default=90.0, help="per cent that have to be killed")
    parser.add_argument("--trust", action="store_true", help="the tests have just passed: do not run them without a wrong")
    parser.add_argument("--out", type=Path, help="a file for the verdicts as they come, a line of JSON each")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        serve()
        return
    root = Path.cwd()
    near = nearest(root)
    modules = options.modules or list(near)
    wrongs = [(seed, wrong) for seed in options.seed for wrong in draw(root, modules, options.count, seed)]
    wanted = sorted({test for _, wrong in wrongs for group in near[wrong.module] for test in group})
    with tempfile.TemporaryDirectory(prefix="mutation-") as folder:
        workers: Queue[Worker] = Queue()
        for number in range(options.workers):
            workers.put(Worker(root, Path(folder) / str(number)))

        def with_worker(task):
            worker = workers.get()
            try:
                return task(worker)
            finally:
                workers.put(worker)

        def timed(test: str) -> tuple[int | None, float]:
            if options.trust:
                return 0, 1e-4 * (root / test).stat().st_size  # some seconds, more for longer ones
            status, by, seconds = with_worker(lambda worker: worker.run([test], 900.0))
            if status not in (0, 5):
                tqdm.write(f"left out, as it fails without any wrong: {test} ({by})")
            return status, seconds

        with ThreadPoolExecutor(options.workers) as pool:
            alone = tqdm(pool.map(timed, wanted), desc="tests as they are", total=len(wanted), disable=None)
            usual = dict(zip(wanted, alone, strict=True))

            def tests_of(module: str) -> list[str]:
                named, importing = ([test for test in group if usual[test][0] == 0] for group in near[module])
                chosen, sum_ = sorted(named, key=lambda test: usual[test][1]), sum(usual[test][1] for test in named)
                for test in sorted(importing, key=lambda test: usual[test][1]):
                    if sum_ + usual[test][1] < BUDGET:
                        chosen.append(test)
                        sum_ += usual[test][1]
                return chosen

            def judged(drawn: tuple[int, Wrong]) -> Verdict:
                tests = tests_of(drawn[1].module)
                limit = max(240.0 if options.trust else 60.0, 4 * sum(usual[test][1] for test in tests))
                verdict = with_worker(lambda worker: worker.judge(drawn[1], tests, limit))
                if options.out:
                    with options.out.open("a") as file:
                        file.write(json.dumps({"seed": drawn[0], **asdict(verdict)}) + "\n")
                return verdict

            verdicts = list(tqdm(pool.map(judged, wrongs), desc="wrongs", total=len(wrongs), disable=None))
        while not workers.empty():
            worker = workers.get()
            worker.process.stdin.close()
            worker.process.wait()
    for verdict in sorted(verdicts, key=lambda verdict: (verdict.wrong.module, verdict.wrong.line)):
        if not verdict.killed:
            print(f"\n{verdict.wrong.module}:{verdict.wrong.line} {verdict.wrong.operator} survives\n{verdict.wrong.change}")
    print()
    shares = []
    for seed in options.seed:
        own = [verdict.killed for (of, _), verdict in zip(wrongs, verdicts, strict=True) if of == seed]
        shares.append(100 * sum(own) / max(len(own), 1))
        print(f"seed {seed}: {sum(own)} of {len(own)} killed, {shares[-1]:.1f} %")
    sys.exit(min(shares) < options.least)


if __name__ == "__main__":
    main()
