"""The style that pyproject.toml asks for: ruff over the whole tree, mypy over what is installed; short files, and tests that test."""

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]


def said(*command: str) -> str:
    """What a program says of the tree, when anything is wrong with it."""
    done = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True)
    return (done.stdout + done.stderr)[-4000:] if done.returncode else ""


def test_ruff_finds_nothing():
    assert said("ruff", "check", "--output-format", "concise", ".") == ""


@pytest.mark.skipif(not np.__version__.startswith("1."), reason="numpy 2 annotates its functions otherwise: mypy judges with Debian 12's")
def test_mypy_finds_nothing():
    assert said("mypy") == ""


@pytest.mark.parametrize("path", sorted((ROOT / "tests").glob("test_*.py")), ids=lambda path: path.name)
def test_every_test_file_asserts_something(path):
    """By `assert`, by a failure that is expected, or by numpy's assertions."""
    nodes = list(ast.walk(ast.parse(path.read_text())))
    called = {node.attr for node in nodes if isinstance(node, ast.Attribute)} | {node.id for node in nodes if isinstance(node, ast.Name)}
    assert any(isinstance(node, ast.Assert) for node in nodes) or any(name == "raises" or name.startswith("assert_") for name in called)


def test_files_are_short_for_each_answers_one_question():
    most = {"fidelity.py": 300, "physics/**/*.py": 300, "datagen/**/*.py": 300, "learning/**/*.py": 300, "tests/*.py": 400}
    long = [(path.name, lines) for pattern, limit in most.items() for path in ROOT.glob(pattern)
            if (lines := len(path.read_text().splitlines())) > limit]
    assert long == []
