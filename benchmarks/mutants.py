"""Which small wrongs the code can be given, and which tests stand nearest to a module: what benchmarks/mutation.py draws from.

The wrongs are cosmic-ray's: another arithmetic or comparing operator, a number one more or less, `not`, and/or, True/False,
break/continue, no sign, a loop without turns, no decorator, another exception. Drawn are places, all equally likely, and then one
wrong for each; left out are annotations and protocols, the words of messages (`raise` statements and strings), which no test should
hold, assertions and what else guards the code against itself (zip's strict, dataclasses' frozen), `is` in place of ==, how thick and
how large lines and letters of pictures are, the -1 of a reshape, for which numpy takes any negative number, and what cosmic-ray
cannot write. The tests nearest to a module are the test files named after it and the four that import it and the
least beside it; where there are neither, those of the modules that import it.
"""

import ast
import difflib
import random
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import parso.python.tree  # noqa: F401 -- before cosmic_ray, whose own imports need it complete
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.provider import OperatorProvider

PACKAGES = ("physics", "datagen", "learning")
GUARDS = ("strict", "frozen", "kw_only")  # arguments by which code guards itself, like its assertions
LOOKS = ("alpha", "dpi", "fontsize", "indent", "labelpad", "labelsize", "line_width", "lw", "markersize", "ms", "zorder",
         "ambient", "diffuse", "intensity", "opacity", "specular")
NEAR = 4  # test files beside those named after the module


@dataclass(frozen=True)
class Wrong:
    module: str  # path from the root of the tree
    operator: str
    occurrence: int
    line: int
    change: str  # the lines that differ


@cache
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
        elif isinstance(node, ast.keyword) and node.arg in GUARDS + LOOKS:
            parts = [node.value]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "reshape":
            parts = [size for size in node.args if isinstance(size, ast.UnaryOp)]
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
