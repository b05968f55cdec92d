"""A page that shows bodies to be turned, zoomed and followed through time: one file of HTML that opens offline.

The page, its style and its program lie in web/; here they are filled with data. The tables hold the same figures for whoever does
not see the pictures.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from matplotlib import colormaps

from physics.view.exhibit import Exhibit, packed, stored
from physics.whole import write_whole

WEB = Path(__file__).parent / "web"
SCRIPTS = ("motion.js", "stage.js", "viewer.js")
ROOM = 6_000_000  # [bytes] for all motions of a page


def write_page(path: str | Path, title: str, exhibits: Sequence[Exhibit], facts: dict[str, str]) -> None:
    """Write a page of its own, with what there is to say below, by its name. Raises OSError."""
    said = "".join(f"<dt>{escape(name)}</dt><dd>{escape(fact)}</dd>" for name, fact in facts.items())
    write_whole(path, shell(title, f"<h1>{escape(title)}</h1>\n{section(exhibits)}\n<dl>{said}</dl>").encode())


def shell(title: str, body: str, style: str = "") -> str:
    """A whole page around its body, HTML; rules of style of one's own go after the common ones."""
    return Template(_text("page.html")).substitute(title=escape(title), style=_text("page.css") + style, body=body)


def section(exhibits: Sequence[Exhibit]) -> str:
    """The part of a page that shows exhibits, with its program and data; empty without any."""
    if not exhibits:
        return ""
    drawn = [exhibit.drawable for exhibit in exhibits]
    room = ROOM // max(1, sum(1 + len(motion.fields) for exhibit in drawn for motion in exhibit.motions.values()))
    contents = [stored(exhibit, room) for exhibit in drawn if exhibit.motions]
    names = {quantity["colours"] for content in contents for quantity in content["quantities"]}
    colours = {name: packed(np.rint(255 * colormaps[name](np.linspace(0, 1, 256))[:, :3]), "u1") for name in sorted(names)}
    data = json.dumps({"exhibits": contents, "colours": colours}, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    lost = "".join(f"<p>{escape(exhibit.title)}: {escape(', '.join(exhibit.blown_up))} cannot be drawn: "
                   "not finite, or out of all bounds.</p>" for exhibit in exhibits if exhibit.blown_up)
    return Template(_text("viewer.html")).substitute(
        style=_text("viewer.css"), data=data, script="\n".join(map(_text, SCRIPTS)), lost=lost, tables="".join(map(_table, contents)))


def _text(name: str) -> str:
    return (WEB / name).read_text()


def _table(content: dict[str, Any]) -> str:
    """The largest value of each quantity in each frame of each motion, and how well the page shows it."""
    columns = [(f"{motion['name']}: largest {quantity['name']} [{quantity['unit']}]", motion["curves"][quantity["key"]], quantity["factor"])
               for motion in content["motions"] for quantity in content["quantities"] if quantity["key"] in motion["curves"]]
    head = "".join(f"<th>{escape(name)}</th>" for name, _, _ in columns)
    rows = "".join(f'<tr><th scope="row">{escape(frame)}</th>'
                   + "".join(f"<td>{factor * curve[k]:.4g}</td>" for _, curve, factor in columns)
                   + "</tr>" for k, frame in enumerate(content["frames"]))
    return (f"<details><summary>{escape(content['title'])}: the figures of every frame</summary>"
            f"<p>At most off by: {escape('; '.join(motion['drawn'] for motion in content['motions']))}.</p>"
            f'<div class="wide"><table><tr><th>frame</th>{head}</tr>{rows}</table></div></details>')
