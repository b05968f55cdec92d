"""The examples run, print their number and hold it against a known one; they use the public names and no others."""

import ast
import re
import runpy
import sys

import pytest

from tests.pages import ROOT

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_prints_a_number_that_holds(path, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(path)])
    runpy.run_path(str(path), run_name="__main__")
    assert re.search(r"\d", capsys.readouterr().out)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_asserts_its_number_and_uses_public_names_only(path):
    tree = ast.parse(path.read_text())
    checks = [node for node in ast.walk(tree) if isinstance(node, ast.Assert)]
    assert checks and not any(isinstance(check.test, ast.Constant) for check in checks)
    assert ast.get_docstring(tree) and len(path.read_text().splitlines()) <= 60
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] in ("physics", "datagen", "learning"):
            assert "." not in node.module and {alias.name for alias in node.names} <= set(__import__(node.module).__all__)
        elif isinstance(node, ast.Import):
            assert not {alias.name.split(".")[0] for alias in node.names} & {"physics", "datagen", "learning"}


def test_there_are_eight_to_sixteen_examples():
    assert 8 <= len(EXAMPLES) <= 16
