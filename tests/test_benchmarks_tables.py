"""The tables of README.md and docs/: each is put between its markers by the command that they name, and by nothing else."""

import importlib
import re
import resource
import shlex
import sys

import pytest

from benchmarks import footing, tables
from tests.pages import PAGES, ROOT

PAGE = """# Page

<!-- made by: {python} made.py first -->
| old |
| --- |
| 1 |
<!-- end -->

Words between, as `<!-- made by: COMMAND -->` in a sentence.

<!-- made by: {python} made.py second -->
| other |
| --- |
| 2 |
<!-- end -->

The end.
"""
MADE = "import os, sys; print('|', sys.argv[1], '| b |'); print('| --- | ---: |'); print('| in', os.path.basename(os.getcwd()), '| 7 |')"


@pytest.fixture
def site(tmp_path):
    (tmp_path / "docs").mkdir()
    (tmp_path / "README.md").write_text("No table.\n")
    (tmp_path / "docs" / "page.md").write_text(PAGE.format(python=sys.executable))
    (tmp_path / "made.py").write_text(MADE)
    return tmp_path


def test_a_command_with_the_word_rewrites_its_own_table_and_nothing_else(site):
    assert tables.main(["second"], site) == 0
    old = "| other |\n| --- |\n| 2 |\n"
    new = f"| second | b |\n| --- | ---: |\n| in {site.name} | 7 |\n"  # it ran in the root of the tree
    assert (site / "docs" / "page.md").read_text() == PAGE.format(python=sys.executable).replace(old, new)


def test_without_a_word_the_commands_are_named_and_nothing_runs(site, capsys):
    assert tables.main([], site) == 0
    assert capsys.readouterr().out.splitlines() == [f"docs/page.md: {sys.executable} made.py {name}" for name in ("first", "second")]
    assert (site / "docs" / "page.md").read_text() == PAGE.format(python=sys.executable)


@pytest.mark.parametrize(("program", "why"), [
    ("raise SystemExit(3)", "exit status 3"),
    ("print('no table')", "no Markdown table"),
    (MADE + "; print('remark')", "more than one Markdown table"),
    (MADE + "; print('| one cell |')", "more than one Markdown table"),
])
def test_what_is_not_one_table_leaves_the_page_as_it_is(site, capsys, program, why):
    (site / "made.py").write_text(program)
    assert tables.main(["first"], site) == 1
    assert why in capsys.readouterr().err
    assert (site / "docs" / "page.md").read_text() == PAGE.format(python=sys.executable)


def test_every_table_of_the_pages_names_a_module_that_prints_it():
    found = tables.marked(ROOT)
    assert len(found) == sum(page.read_text().count("\n<!-- made by: ") for page in PAGES) > 10
    for _, command in found:
        python, flag, module, *_ = shlex.split(command)
        assert [python, flag] == [".venv/bin/python", "-m"] and module.split(".")[0] in ("benchmarks", "learning", "physics"), command
        assert module.startswith(("learning", "physics")) or callable(importlib.import_module(module).main)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_between_two_markers_stands_one_table(page):
    text = page.read_text()
    found = tables.MARKED.findall(text)
    assert len(found) == text.count("\n<!-- made by:") == text.count("\n<!-- end -->")
    for _, table in found:
        widths = {len(re.findall(r"(?<!\\)\|", line)) for line in table.splitlines()}
        assert len(widths) == 1 and all(line.startswith("|") and line.endswith("|") for line in table.splitlines())


def test_numbers_stand_right_and_words_left_and_a_missing_entry_is_a_dash(capsys):
    table = footing.Table()
    table.add({"nodes": 10, "case": "a|b", "ms": 2.34567, "error": "1.0e-07"})
    table.add({"nodes": 100_000, "ms": 2345.67})
    table.fit("ms")
    assert capsys.readouterr().out.splitlines() == [
        "| nodes | case | ms | error |", "| ---: | --- | ---: | ---: |", r"| 10 | a\|b | 2.35 | 1.0e-7 |", "| 100000 | – | 2346 | – |",
        "| nodes^p, p = | – | 0.75 | – |"]  # 10^3 times as long for 10^4 times as many


def test_a_child_is_a_process_of_its_own_with_a_memory_of_its_own():
    held = bytearray(200_000_000)
    held[::4096] = b"x" * len(held[::4096])
    assert 200 < footing.peak_memory() <= resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 + 1
    assert footing.child(footing.exponent, [1, 10, 100], [5, 500, 50_000]) == pytest.approx(2.0)
    assert footing.child(footing.peak_memory) < footing.peak_memory() - 100
