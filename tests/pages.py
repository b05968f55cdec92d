"""The pages of the project, README.md and docs/, as the tests read them."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    """The fenced blocks of a page in one language, "" for those that name none."""
    found = re.findall(r"^```(\w*)\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)
    return [text for name, text in found if name == language]


def commands(page: Path) -> list[str]:
    """Every command of a page: lines of blocks without a language and indented ones, and whole spans of code; remarks cut off."""
    text = page.read_text()
    lines = [*"\n".join(blocks(page, "")).splitlines(), *re.findall(r"^    (.*)$", text, re.MULTILINE),
             *re.findall(r"`([^`\n]+)`", text), *re.findall(r"<!-- made by: (.*) -->", text)]
    known = ("./run ", ".venv/bin/python ", "mpirun ")
    return [line.split("   #")[0].split(" # ")[0].strip() for line in map(str.strip, lines) if line.startswith(known)]
