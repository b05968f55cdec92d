"""The report folder: what was measured, as tables, pictures and words.

    report.html   one file that opens offline, its pictures inside, for someone who has never seen the project
    report.md     the same for a terminal or a repository, pictures beside it
    table.csv     all figures of all predictors in SI units
    report.json   everything, for programs; what is not a number is null
    pareto.png    time per step against error (pareto.py)
    frame_*.png   the worst frames
"""

from __future__ import annotations

import base64
import csv
import json
import math
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import Any

from datagen.files.prediction import finite
from learning.report.pareto import COLOURS, measure_of, pareto_picture
from learning.report.table import (
    COLUMNS,
    KINDS,
    TABLES,
    Report,
    by_case,
    cells,
    far_outside,
    headline,
    heads,
    improvement,
    plain,
    shown,
    told,
)
from learning.samples.seen import ALARM

STYLE = """
body{margin:0;background:#fff;color:#1c1d1f;font:16px/1.5 system-ui,"DejaVu Sans",sans-serif}
main{max-width:1200px;margin:0 auto;padding:2rem 1.2rem 4rem}
h1{font-size:1.7rem;margin:0 0 .6rem}
h2{font-size:1.2rem;margin:2.4rem 0 .6rem}
.lead{font-size:1.1rem;max-width:54rem}
.wide{overflow-x:auto}
table{border-collapse:collapse;font-size:.86rem;font-variant-numeric:tabular-nums}
th,td{padding:.4rem .6rem;text-align:right;border-bottom:1px solid #e3e4e6;vertical-align:bottom}
td,th[scope=row]{white-space:nowrap}
tr:first-child th{border-bottom:2px solid #1c1d1f}
tr th:first-child{text-align:left}
th[scope=row],.key span{border-left:5px solid #fff}
""" + "".join(f".{kind} th[scope=row],.key .{kind}{{border-left-color:{colour}}}\n" for kind, colour in COLOURS.items()) + """\
.alarm{background:#fff3cd;border-left:5px solid #c8102e;padding:.6rem 1rem;max-width:54rem}
.key,figcaption{font-size:.88rem;color:#55585c;max-width:54rem}
.key span{padding:0 1.2rem 0 .4rem}
figure{margin:1rem 0 1.6rem}
img{max-width:100%;height:auto}
dl{display:grid;grid-template-columns:max-content 1fr;gap:.35rem 1.2rem;max-width:64rem}
dt{font-weight:600}
dd{margin:0;overflow-wrap:anywhere}
@media(max-width:600px){dl{display:block}dd{margin-bottom:.6rem}}
"""


def write_report(out: Path, report: Report) -> dict[str, Any]:
    """Write the folder, into which the pictures of frames have been put before. Gives the content of report.json."""
    out.mkdir(parents=True, exist_ok=True)
    content = finite({"summary": plain(headline(report)), "improvement_over_nothing_moves": improvement(report.rows),
                      "far_outside": far_outside(report, ALARM), **asdict(report)})
    (out / "report.json").write_text(json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n")
    with open(out / "table.csv", "w", newline="") as file:
        writer = csv.writer(file)
        names = [f"{key} [{column.si}]" for key, column in COLUMNS.items()]
        writer.writerow(["predictor", "kind", *names])
        for row in report.rows:
            writer.writerow([row.name, row.kind, *(row.scores.get(key, math.nan) for key in COLUMNS)])
    pareto_picture(out / "pareto.png", report.rows)
    (out / "report.md").write_text(_markdown(report))
    (out / "report.html").write_text(_page(report, out))
    return content


def _markdown(report: Report) -> str:
    def table(head: list[str], lines: list[list[str]]) -> list[str]:
        return ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |"
                for line in (head, ["---", *["---:"] * (len(head) - 1)], *lines)]

    parts = [f"# {report.title}", "", plain(headline(report), "**"), ""]
    if alarm := _alarm(report):
        parts += [f"**{alarm}**", ""]
    parts += ["![time per step against error](pareto.png)", "", SCALE[measure_of(report.rows)], ""]
    for title, columns in TABLES.items():
        shown_columns = told(columns, report.rows)
        parts += [f"## {title}", "", *table(heads(shown_columns), [cells(row, shown_columns) for row in report.rows]), "",
                  *(f"- **{column.head}**: {plain(column.meaning, '**')}." for column in shown_columns.values()), ""]
    head, lines = by_case(report)
    parts += ["## RMSE-all of each test trajectory [mm]", "", *table(head, lines), ""]
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
    "rmse_all": "Each predictor is a point: further left is faster, further down is closer to the truth. The dashed line is "
                "the time of the solver that made the truth; what lies right of it is slower than what it stands in for.",
    "rmse_refined": "Each predictor is a point: further left is faster, further down is closer to the body. The star is the solver "
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


def _page(report: Report, folder: Path) -> str:
    """The page; pictures are read from the folder."""
    kinds = [kind for kind in KINDS if any(row.kind == kind for row in report.rows)]
    head, lines = by_case(report)
    tables = ""
    for title, columns in TABLES.items():
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
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(report.title)}</title><style>{STYLE}</style></head><body><main>
<h1>{escape(report.title)}</h1>
<p class="lead">{_bold(headline(report))}</p>
{f'<p class="alarm">{escape(alarm)}</p>' if alarm else ""}
<h2>Speed against error</h2>
{_picture(folder, "pareto.png", SCALE[measure_of(report.rows)])}
<p class="key">{" ".join(f'<span class="{kind}">{KINDS[kind]}</span>' for kind in kinds)}</p>
{tables}
<h2>RMSE-all of each test trajectory [mm]</h2>
{_table(head, lines, [""] * len(lines))}
{outside}
{worst}
<h2>How it was measured</h2>
{_list(report.facts)}
<h2>Limits</h2>
<ul>{"".join(f"<li>{escape(note)}</li>" for note in report.notes)}</ul>
</main></body></html>
"""


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
