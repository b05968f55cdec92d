"""Small wrongs put into the code at random, one at a time: how many do the nearest tests see?

    .venv/bin/pip install cosmic-ray==8.7.0
    .venv/bin/python benchmarks/mutation.py --seed 0 1 --count 300 --workers 2 --out mutants.jsonl
    .venv/bin/python benchmarks/mutation.py --seed 0 --count 20 physics/equilibrium/newton.py physics/equilibrium/balance.py

The wrongs are cosmic-ray's: another arithmetic or comparing operator, a number one more or less, `not`, and/or, True/False,
break/continue, no sign, a loop without turns, no decorator, another exception. Drawn are places, all equally likely, and then one
wrong for each; left out are annotations and protocols, the words of messages (`raise` statements and strings), which no test should
hold, assertions and what else guards the code against itself (zip's strict, dataclasses' frozen), `is` in place of ==, and what
cosmic-ray cannot write. The tests nearest to a module are the test files named after it and the four that import it and the
least beside it; where there are neither, those of the modules that import it. Each test file has to pass before; one that does not
is left out and said (with --trust they are taken to pass, and to take as long as they are).

Everything happens in copies of the tree in a temporary folder, one for each worker, and nothing of it stays. A wrong counts as
killed when a test fails or does not end within four times its usual time (a minute at least). Exit status 1 when fewer than
`--least` per cent are killed.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import difflib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from queue import Queue

import parso.python.tree  # noqa: F401 -- before cosmic_ray, whose own imports need it complete
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.provider import OperatorProvider
from tqdm import tqdm

PACKAGES = ("physics", "datagen", "learning")
GUARDS = ("strict", "frozen", "kw_only")  # arguments by which code guards itself, like its assertions
NEAR, BUDGET = 4, 60.0  # test files, and seconds of them, beside those named after the module
SETTINGS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg", "VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow",
            "PYTHONNOUSERSITE": "1", "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "HWLOC_HIDE_ERRORS": "2",
            "OMPI_MCA_plm": "isolated", "OMPI_MCA_btl": "self"}  # as in `run`


@dataclass(frozen=True)
class Wrong:
    module: str  # path from the root of the tree
    operator: str
    occurrence: int
    line: int
    change: str  # the lines that differ


@dataclass(frozen=True)
class Verdict:
    wrong: Wrong
    killed: bool
    by: str  # the test that failed, "no end", or "" for a survivor
    seconds: float


def places(path: Path) -> dict[tuple[int, int, str], list[tuple[str, int]]]:
    """Where a module can be made wrong, and how: (line, column, kind) -> [(operator, occurrence)]."""
    source = path.read_text()
    silent = list(_silent(ast.parse(source)))
    tree, operators, found = get_ast(source), OperatorProvider(), {}
    for name in sorted(operators):
        if name == "NoOp" or name.startswith("Variable") or name.endswith(("Eq_Is", "NotEq_IsNot")):  # for constants the same
            continue
        operator, occurrence = operators[name](), 0
        kind = name.rsplit("_", 2)[0]  # of ReplaceBinaryOperator_Add_Sub: ReplaceBinaryOperator
        for node in ast_nodes(tree):
            for (line, column), _ in operator.mutation_positions(node):
                if not any(first <= (line, column) < last for first, last in silent):
                    found.setdefault((line, column, kind), []).append((name, occurrence))
                occurrence += 1
    return found


def _silent(tree: ast.Module) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """From where to where a module says things that change nothing: annotations, raised messages, strings."""
    for node in ast.walk(tree):
        parts: list[ast.AST | None] = [node] if isinstance(node, ast.Raise | ast.JoinedStr | ast.Assert) else []
        if isinstance(node, ast.AnnAssign | ast.arg):
            parts = [node.annotation]
        elif isinstance(node, ast.FunctionDef):
            parts = [node.returns]
        elif isinstance(node, ast.keyword) and node.arg in GUARDS:
            parts = [node.value]
        elif isinstance(node, ast.ClassDef) and any(isinstance(base, ast.Name) and base.id == "Protocol" for base in node.bases):
            parts = [node]
        elif isinstance(node, ast.Assign) and isinstance(node.value, ast.BinOp) and isinstance(node.value.op, ast.BitOr):
            parts = [node]  # a name for a type, A | B
        for part in parts:
            if part is not None:
                yield (part.lineno, part.col_offset), (part.end_lineno, part.end_col_offset)


def draw(root: Path, modules: Sequence[str], count: int, seed: int) -> list[Wrong]:
    """`count` wrongs at different places of the modules."""
    everywhere = [(module, *place, ways) for module in modules for place, ways in sorted(places(root / module).items())]
    chance = random.Random(seed)
    chance.shuffle(everywhere)
    wrongs: list[Wrong] = []
    for module, line, _, _, ways in everywhere:
        if len(wrongs) == count:
            break
        operator, occurrence = chance.choice(ways)
        source = (root / module).read_text()
        try:
            wrong = mutate_code(source, OperatorProvider()[operator](), occurrence)
        except AttributeError:  # an exception named with its module, as zipfile.BadZipFile: the operator knows bare names only
            continue
        change = [text for text in difflib.unified_diff(source.splitlines(), (wrong or source).splitlines(), n=0, lineterm="")][3:]
        try:
            same = wrong is None or ast.dump(ast.parse(source)) == ast.dump(ast.parse(wrong))
        except SyntaxError:
            continue
        if not same:
            wrongs.append(Wrong(module, operator, occurrence, line, "\n".join(change)))
    return wrongs


def imports(path: Path) -> set[str]:
    """The project's modules that a file imports, as paths: `from physics import fem` names physics/fem.py and physics/fem/__init__.py."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return {name.replace(".", "/") + end for name in names for end in (".py", "/__init__.py")}


def nearest(root: Path) -> dict[str, list[list[str]]]:
    """Of every module: the test files named after it, and those that import it (or, without both, its importers' tests)."""
    tests = sorted((root / "tests").glob("test_*.py"))
    modules = [str(path.relative_to(root)) for package in PACKAGES for path in sorted((root / package).rglob("*.py"))]
    helpers = {str(path.relative_to(root)): imports(path) for path in (root / "tests").glob("*.py")}
    taken = {str(path.relative_to(root)): imports(path) for path in tests}
    for used in taken.values():
        for helper in used & helpers.keys():
            used |= helpers[helper]
    above = {module: imports(root / module) for module in modules}
    found: dict[str, list[list[str]]] = {}
    for module in modules:
        parts = Path(module.removesuffix("/__init__.py")).with_suffix("").parts
        stems = {f"test_{parts[0]}_{parts[-1]}", "test_" + "_".join(parts)}
        named = _named(stems, taken) or _named({f"test_{parts[0]}_{part}" for part in parts[1:-1]}, taken)  # or after its room
        importing = [test for test in taken if module in taken[test] and test not in named]
        found[module] = [named, sorted(importing, key=lambda test: len(taken[test]))[:NEAR]]
    for module, (named, importing) in list(found.items()):
        if not named and not importing:
            upper = sorted({test for upper in modules if module in above[upper] for group in found[upper] for test in group})
            found[module] = [[], sorted(upper, key=lambda test: len(taken[test]))[:NEAR]]
    return found


def _named(stems: set[str], tests: Iterable[str]) -> list[str]:
    return [test for test in tests if any(Path(test).stem == stem or Path(test).stem.startswith(stem + "_") for stem in stems)]


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
            sys.path.insert(0, os.getcwd())
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
        self.process = subprocess.Popen([sys.executable, str(Path(__file__).resolve()), "--serve"], cwd=folder, text=True,
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
