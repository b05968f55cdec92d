"""The report folder: what was measured, as tables, pictures and words.

    report.html   one file that opens offline, its pictures inside, some to be turned by hand (physics/view/viewer.py), for someone
                  who has never seen the project; its frame is page.html, its style report.css
    report.md     the same for a terminal or a repository, pictures beside it
    table.csv     all figures of all predictors in SI units
    report.json   everything, for programs; what is not a number is null
    pareto.png    time per step against error (pareto.py)
    frame_*.png   the worst frames
"""

from __future__ import annotations

import base64
import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from learning.report.pareto import COLOURS, measure_of, pareto_picture
from learning.report.table import (
    COLUMNS,
    KINDS,
    Report,
    by_case,
    cells,
    far_outside,
    headline,
    heads,
    improvement,
    plain,
    shown,
    tables_of,
    told,
)
from learning.samples.seen import ALARM
from physics.schema import finite
from physics.view import Exhibit, section, shell
from physics.whole import write_whole

HERE = Path(__file__).parent
STYLE = (HERE / "report.css").read_text() + "".join(f".{kind}{{--kind:{colour}}}\n" for kind, colour in COLOURS.items())


def write_report(out: Path, report: Report, exhibits: Sequence[Exhibit] = ()) -> dict[str, Any]:
    """Write the folder, into which the pictures of frames have been put before. Gives the content of report.json.

    exhibits: what the page shows to be turned and followed by hand
    """
    content = finite({"summary": plain(headline(report)), "improvement_over_nothing_moves": improvement(report.rows),
                      "far_outside": far_outside(report, ALARM), **asdict(report)})
    write_whole(out / "report.json", (json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n").encode())
    table = io.StringIO()
    writer = csv.writer(table)
    writer.writerow(["predictor", "kind", *(f"{key} [{column.si}]" for key, column in COLUMNS.items())])
    for row in report.rows:
        writer.writerow([row.name, row.kind, *(row.scores.get(key, math.nan) for key in COLUMNS)])
    write_whole(out / "table.csv", table.getvalue().encode())
    pareto_picture(out / "pareto.png", report.rows)
    write_whole(out / "report.md", _markdown(report).encode())
    write_whole(out / "report.html", _page(report, out, exhibits).encode())
    return content


def _markdown(report: Report) -> str:
    def table(head: list[str], lines: list[list[str]]) -> list[str]:
        return ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |"
                for line in (head, ["---", *["---:"] * (len(head) - 1)], *lines)]

    parts = [f"# {report.title}", "", plain(headline(report), "**"), ""]
    if alarm := _alarm(report):
        parts += [f"**{alarm}**", ""]
    parts += ["![time per step against error](pareto.png)", "", SCALE[measure_of(report.rows)], ""]
    for title, columns in tables_of(report.rows).items():
        shown_columns = told(columns, report.rows)
        parts += [f"## {title}", "", *table(heads(shown_columns), [cells(row, shown_columns) for row in report.rows]), "",
                  *(f"- **{column.head}**: {plain(column.meaning, '**')}." for column in shown_columns.values()), ""]
    head, lines = by_case(report)
    parts += ["## RMSD-all of each test trajectory [mm]", "", *table(head, lines), ""]
    if report.outside is not None:
        parts += ["## Inside or outside of what was trained on", "", *(f"- {line}" for line in _outside(report)), ""]
    if report.pictures:
        parts += ["## Worst frames", ""]
    for name, caption in report.pictures:
        parts += [caption, "", f"![{caption}]({name})", ""]
    parts += ["## How it was measured", "", *(f"- {key}: {value}" for key, value in report.facts.items()), "",
              "## Limits", "", *(f"- {note}" for note in report.notes), ""]
    return "\n".join(parts)


SCALE = {
    "rmsd_all": "Each predictor is a point: further left is faster, further down is closer to the truth. The dashed line is "
                "the time of the solver that made the truth; what lies right of it is slower than what it stands in for.",
    "rmsd_refined": "Each predictor is a point: further left is faster, further down is closer to the body. The star is the solver "
                    "that made the data, the dotted line the error that its mesh leaves: a predictor on that line knows the "
                    "body as well as the data do, and one right of the star is slower than what it stands in for.",
}


def _alarm(report: Report) -> str:
    """What to shout about test scenes far outside of the training range; empty when there are none."""
    far = far_outside(report, ALARM)
    if not far:
        return ""
    return (f"{len(far)} of {len(report.cases)} test scenes lie far outside of what the simulator was trained on "
            f"({', '.join(far[:5])}{' and more' if len(far) > 5 else ''}): its errors there say nothing about scenes inside.")


def _outside(report: Report) -> list[str]:
    """A sentence for each test trajectory that lies outside somewhere, and one about all others."""
    assert report.outside is not None
    lines = []
    for case, beyond in report.outside.items():
        if beyond:
            what = "; ".join(f"{name} (never seen)" if math.isinf(value) else f"{name} by {shown(100 * value)} % of the range's width"
                             for name, value in beyond.items())
            lines.append(f"{case} is outside: {what}")
    inside = sum(not beyond for beyond in report.outside.values())
    return [*lines, f"{inside} of {len(report.outside)} test scenes lie inside of every range that the training scenes span"]


def _page(report: Report, folder: Path, exhibits: Sequence[Exhibit]) -> str:
    """The page; pictures are read from the folder."""
    kinds = [kind for kind in KINDS if any(row.kind == kind for row in report.rows)]
    head, lines = by_case(report)
    tables = ""
    for title, columns in tables_of(report.rows).items():
        shown_columns = told(columns, report.rows)
        tables += (f"<h2>{escape(title)}</h2>"
                   + _table(heads(shown_columns), [cells(row, shown_columns) for row in report.rows], [row.kind for row in report.rows])
                   + "<details><summary>What the columns are</summary>"
                   + _list({column.head: f"{column.meaning}." for column in shown_columns.values()}) + "</details>")
    alarm = _alarm(report)
    outside = "" if report.outside is None else (
        "<h2>Inside or outside of what was trained on</h2>"
        f'<ul>{"".join(f"<li>{escape(line)}</li>" for line in _outside(report))}</ul>')
    worst = "<h2>Worst frames</h2>" + "".join(_picture(folder, *entry) for entry in report.pictures) if report.pictures else ""
    moving = f"<h2>To be turned by hand</h2>{section(exhibits)}" if exhibits else ""
    body = Template((HERE / "page.html").read_text()).substitute(
        title=escape(report.title), headline=_bold(headline(report)), alarm=f'<p class="alarm">{escape(alarm)}</p>' if alarm else "",
        pareto=_picture(folder, "pareto.png", SCALE[measure_of(report.rows)]),
        key=" ".join(f'<span class="{kind}">{KINDS[kind]}</span>' for kind in kinds), tables=tables,
        by_case=_table(head, lines, [""] * len(lines)), outside=outside, moving=moving, worst=worst, facts=_list(report.facts),
        limits="".join(f"<li>{escape(note)}</li>" for note in report.notes))
    return shell(report.title, body, STYLE)


def _table(head: list[str], lines: list[list[str]], kinds: list[str]) -> str:
    rows = "".join(f'<tr class="{kind}"><th scope="row">{escape(line[0])}</th>'
                   f'{"".join(f"<td>{escape(cell)}</td>" for cell in line[1:])}</tr>'
                   for line, kind in zip(lines, kinds, strict=True))
    return f'<div class="wide"><table><tr>{"".join(f"<th>{escape(cell)}</th>" for cell in head)}</tr>{rows}</table></div>'


def _picture(folder: Path, name: str, caption: str) -> str:
    data = base64.b64encode((folder / name).read_bytes()).decode()
    return (f'<figure><img src="data:image/png;base64,{data}" alt="{escape(caption)}">'
            f'<figcaption>{escape(caption)}</figcaption></figure>')


def _list(entries: dict[str, str]) -> str:
    return f'<dl>{"".join(f"<dt>{escape(key)}</dt><dd>{_bold(value)}</dd>" for key, value in entries.items())}</dl>'


def _bold(text: str) -> str:
    """Escaped text, except for <b> and </b>."""
    return escape(text).replace("&lt;b&gt;", "<b>").replace("&lt;/b&gt;", "</b>")
