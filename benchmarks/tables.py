"""Writes the generated tables of README.md and docs/ anew: each stands between `<!-- made by: COMMAND -->` and `<!-- end -->`.

    .venv/bin/python -m benchmarks.tables                       names the commands
    .venv/bin/python -m benchmarks.tables hard_cases dynamics   runs those that have one of these words in them

A command runs in the root of the tree and prints one Markdown table on standard output. Where it does not, the page stays as it is.
"""

import re
import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
MARKED = re.compile(r"^<!-- made by: ([^\n]+) -->\n(.*?)^<!-- end -->$", re.MULTILINE | re.DOTALL)


def marked(root: Path) -> list[tuple[Path, str]]:
    """Pages and commands, in order."""
    pages = [root / "README.md", *sorted((root / "docs").glob("*.md"))]
    return [(page, found[1]) for page in pages for found in MARKED.finditer(page.read_text())]


def made(command: str, root: Path) -> str:
    """The table that a command prints. Raises `ValueError` when it fails or prints anything else."""
    done = subprocess.run(shlex.split(command), cwd=root, stdout=subprocess.PIPE, text=True)
    lines = done.stdout.splitlines()
    if done.returncode:
        raise ValueError(f"exit status {done.returncode}")
    if len(lines) < 3 or not re.fullmatch(r"\|( -+:? \|)+", lines[1]):
        raise ValueError("printed no Markdown table")
    if len({len(re.findall(r"(?<!\\)\|", line)) for line in lines}) > 1 or not all(re.fullmatch(r"\| .* \|", line) for line in lines):
        raise ValueError("printed more than one Markdown table")
    return done.stdout


def put(page: Path, command: str, table: str) -> None:
    """The table between the markers of its command; the page is read only now, as it may have changed while the command ran."""
    text = MARKED.sub(lambda found: f"<!-- made by: {command} -->\n{table}<!-- end -->" if found[1] == command else found[0],
                      page.read_text())
    page.write_text(text)


def main(words: list[str], root: Path = ROOT) -> int:
    """The exit status: 1 when a command failed."""
    status = 0
    for page, command in marked(root):
        if not words:
            print(f"{page.relative_to(root)}: {command}")
        elif any(word in command for word in words):
            print(f"{page.relative_to(root)}: {command}", file=sys.stderr, flush=True)
            try:
                put(page, command, made(command, root))
            except (ValueError, OSError) as error:
                print(f"tables: {command}: {error}; {page.relative_to(root)} stays as it is", file=sys.stderr)
                status = 1
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
