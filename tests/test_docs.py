"""README.md and docs/: links lead somewhere, files and commands that they name exist, and every public name is listed."""

import importlib.util
import re
import shlex
import tomllib
from pathlib import Path

import pytest

import fidelity
from datagen import draw, load_family
from physics import read_scene
from tests.pages import PAGES, ROOT, blocks, commands

FILES = r"`((?:physics|datagen|learning|tests|benchmarks|notebooks|examples|assets|docs)/[\w./-]*)`"


def prose(page: Path) -> str:
    """A page without its fenced blocks."""
    return re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub and mkdocs make them."""
    titles = re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", title).strip().lower().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if re.match(r"https?://", target):
            continue
        path, _, anchor = target.partition("#")
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), f"{page.name}: {target}"
        assert not anchor or anchor in anchors(there), f"{page.name}: {target}"
        assert page.parent == ROOT or (ROOT / "docs") in there.parents, f"{page.name}: {target} is outside of the site"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_are_named_exist(page):
    for path in re.findall(FILES, prose(page)):
        assert (ROOT / path).exists(), f"{page.name}: {path}"


def test_every_page_is_in_the_site_and_in_the_two_lists_of_pages():
    site, pages = (ROOT / "mkdocs.yml").read_text(), {page.name for page in (ROOT / "docs").glob("*.md")}
    assert set(re.findall(r"^  - .*: (\S+\.md)$", site, re.MULTILINE)) == pages
    assert pages == set(re.findall(r"\]\(docs/([\w-]+\.md)\) \|", (ROOT / "README.md").read_text()))
    assert pages - {"index.md"} == set(re.findall(r"^- \[[^]]+\]\(([\w-]+\.md)\)", (ROOT / "docs" / "index.md").read_text(), re.MULTILINE))


def test_every_picture_is_shown():
    shown = {Path(target).name for page in PAGES for target in re.findall(r"!\[[^]]*\]\(([^)]+)\)", page.read_text())}
    assert shown == {path.name for path in (ROOT / "docs" / "pictures").iterdir()}


def test_the_readme_can_be_read_in_ten_minutes():
    assert 120 <= len((ROOT / "README.md").read_text().splitlines()) <= 150


@pytest.mark.parametrize("command", sorted({command for page in PAGES for command in commands(page)}))
def test_a_command_is_one_that_there_is(command):
    words = shlex.split(command.split(" | ")[0])
    if words[0] == "mpirun":
        words = words[3:]
    if words[:2] == ["./run", "fidelity"]:
        assert fidelity._parser().parse_args(words[2:]).verb == words[2]
    elif words[:2] == ["./run", "test"]:
        assert all((ROOT / word).exists() for word in words[2:] if word.startswith("tests/"))
    elif words[0] == "./run":
        assert fidelity._parser().parse_args(words[1:]).verb == words[1]
    elif words[1] == "-m":
        found = importlib.util.find_spec(words[2])  # not imported: what the mutation run needs may be missing
        assert found is not None and found.origin is not None
        if words[2].startswith("benchmarks."):
            source = Path(found.origin).read_text()
            assert all(f'"{word}"' in source for word in words if word.startswith("--")), command
    else:
        source = (ROOT / words[1]).read_text()
        assert all(f'"{word}"' in source for word in words if word.startswith("--")), command


@pytest.mark.parametrize("package", ("physics", "datagen", "learning"))
def test_every_public_name_is_listed_with_the_file_it_lives_in(package):
    page = (ROOT / "docs" / "python.md").read_text()
    part = page.split(f"\n## {package}\n")[1].split("\n## ")[0]
    listed = dict(re.findall(r"^\| `(\w+)` \| .+ \| `([\w/]+\.py)` \|$", part, re.MULTILINE))
    module = importlib.import_module(package)
    assert listed == {name: f"{getattr(module, name).__module__.replace('.', '/')}.py" for name in module.__all__}


def test_scenes_and_families_of_the_pages_are_read(tmp_path):
    whole = tomllib.loads(blocks(ROOT / "docs" / "index.md", "toml")[0])
    assert read_scene(whole).obstacle.contact == "facets"
    more = tomllib.loads(blocks(ROOT / "docs" / "equilibrium.md", "toml")[0])
    assert read_scene(whole | more).steps.dynamic
    (tmp_path / "mine.toml").write_text(blocks(ROOT / "docs" / "data.md", "toml")[0])
    family = load_family(tmp_path / "mine.toml")
    assert {draw(family, 0, index).name for index in range(20)} == {"mine"}  # each of its shapes on each of its faces
