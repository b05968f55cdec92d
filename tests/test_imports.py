"""Which package may import what, read from the sources themselves, and that networks are trained and asked without the FE solver."""

import ast
import importlib
import re
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from datagen.files.trajectory import read_trajectory, write_trajectory
from tests.synthetic import bending

ROOT = Path(__file__).parents[1]
OURS = ("physics", "datagen", "learning", "fidelity", "notebooks", "tests", "benchmarks")
# Each package may import itself and what stands before it.
MAY_IMPORT = {"physics": {"physics"}, "datagen": {"physics", "datagen"}, "learning": {"physics", "datagen", "learning"}}
FORMS = {"dolfinx", "ffcx", "basix"}
SOLVERS = FORMS | {"ufl", "petsc4py", "slepc4py", "mpi4py"}
USERS = sorted(path.relative_to(ROOT) for folder in ("benchmarks", "notebooks", "examples") for path in (ROOT / folder).glob("*.py"))
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


def modules_imported(path: Path, known: set[str]) -> set[str]:
    """The project's modules that a source file imports, late imports included."""
    found = set()
    for node in ast.walk(ast.parse((ROOT / path).read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {f"{node.module}.{alias.name}" for alias in node.names} | {node.module}
    return found & known


def name_of(path: Path) -> str:
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


def test_no_import_leads_back_neither_between_modules_nor_between_rooms() -> None:
    """A room is a sub-package, or a module beside them; late imports count."""
    known = {name_of(path) for path in SOURCES}
    graph = {name_of(path): modules_imported(path, known) - {name_of(path)} for path in SOURCES}
    TopologicalSorter(graph).prepare()  # raises CycleError with the circle in it
    rooms: dict[str, set[str]] = {}
    for module, others in graph.items():
        room = ".".join(module.split(".")[:2])
        rooms.setdefault(room, set()).update({".".join(other.split(".")[:2]) for other in others} - {room})
    order = list(TopologicalSorter(rooms).static_order())
    assert order.index("physics.mesh") < order.index("physics.linalg") < order.index("physics.body") < order.index("physics.equilibrium")


@pytest.mark.parametrize("package", sorted({path.parent for path in SOURCES}), ids=str)
def test_the_map_of_a_package_names_all_that_is_in_it(package: Path) -> None:
    docstring = ast.get_docstring(ast.parse((ROOT / package / "__init__.py").read_text()))
    there = {path.stem for path in (ROOT / package).glob("*.py")} | {path.parent.name for path in (ROOT / package).glob("*/__init__.py")}
    assert there - {"__init__"} <= set(re.findall(r"\w+", docstring))
    assert len(there) - len(list((ROOT / package).glob("*/__init__.py"))) <= 10


@pytest.mark.parametrize("path", USERS, ids=str)
def test_what_is_imported_from_the_packages_is_there(path: Path) -> None:
    """Late imports included: no other test runs all of these files."""
    for node in ast.walk(ast.parse((ROOT / path).read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in (*MAY_IMPORT, "tests"):
            module = importlib.import_module(node.module)
            for alias in node.names:
                assert hasattr(module, alias.name) or importlib.import_module(f"{node.module}.{alias.name}")


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_what_a_package_offers_can_be_imported_from_it(package: str) -> None:
    module = importlib.import_module(package)
    assert len(module.__all__) > 5
    for name in module.__all__:
        assert getattr(module, name).__name__.endswith(name)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        module.nonsense


def test_networks_are_trained_and_asked_from_the_command_line_without_the_solver(tmp_path) -> None:
    """As on a machine with a GPU and without FEniCSx: what a network needs of the physics lies in the trajectory files."""
    (tmp_path / "data" / "train").mkdir(parents=True)
    file = tmp_path / "data" / "train" / "0000.vtkhdf"
    write_trajectory(file, bending(steps=4))
    (tmp_path / "run.toml").write_text('segments = 3\nsteps = 2\nbatch_size = 1\n[network]\nkind = "gcn"\nhidden = 4\nlayers = 1\n')
    program = (f"import sys; sys.modules.update(dict.fromkeys({sorted(SOLVERS)})); import fidelity; "  # None: cannot be imported
               "sys.exit(fidelity.main(sys.argv[1:]))")
    run, out = str(tmp_path / "run"), tmp_path / "prediction.vtkhdf"
    for words in (["train", str(tmp_path / "run.toml"), "--data", str(tmp_path / "data"), "--out", run], ["rollout", run, str(file),
                                                                                                       "--out", str(out)]):
        done = subprocess.run([sys.executable, "-c", program, *words], cwd=ROOT, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    assert read_trajectory(out).displacement.shape == read_trajectory(file).displacement.shape
