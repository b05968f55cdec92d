"""Which package may import what, read from the sources themselves, and that training stays free of the FE solver."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
OURS = ("physics", "datagen", "learning", "fidelity", "notebooks", "tests", "benchmarks")
# Each package may import itself and what stands before it.
MAY_IMPORT = {"physics": {"physics"}, "datagen": {"physics", "datagen"}, "learning": {"physics", "datagen", "learning"}}
FORMS = {"dolfinx", "ffcx", "basix"}
SOLVERS = FORMS | {"ufl", "petsc4py", "slepc4py", "mpi4py"}
SOURCES = sorted(path.relative_to(ROOT) for package in MAY_IMPORT for path in (ROOT / package).rglob("*.py"))


def imported(path: Path) -> set[str]:
    """The top-level names that a source file imports, wherever in it; a relative import counts as its own package."""
    found = set()
    for node in ast.walk(ast.parse((ROOT / path).read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(path.parts[0] if node.level or node.module is None else node.module.split(".")[0])
    return found


@pytest.mark.parametrize("path", SOURCES, ids=str)
def test_imports_go_one_way(path: Path) -> None:
    package, names = path.parts[0], imported(path)
    assert names & set(OURS) <= MAY_IMPORT[package]
    if package == "physics":
        assert "torch" not in names
        assert path.name == "fem.py" or not names & FORMS, "only physics/fem.py knows dolfinx"
    else:
        assert not names & SOLVERS, "the solvers are reached through physics"


def test_training_does_not_load_the_solver() -> None:
    """What training needs of the physics lies in the trajectory files."""
    program = "import sys, learning.train; print(*sorted(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert not set(done.stdout.split()) & SOLVERS
