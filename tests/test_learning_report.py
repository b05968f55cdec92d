"""The report folder, from rows made by hand: what stands where in the page, the text, the table and the JSON."""

import base64
import csv
import json
import math
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from learning.report.pareto import COLOURS, pareto_picture
from learning.report.report import SCALE, STYLE, write_report
from learning.report.table import COLUMNS, KINDS, TABLES, headline
from physics.mesh.build import build_mesh
from physics.scene import Body
from physics.view import Animation, Exhibit, section
from tests.full_disk import full_after
from tests.rows import CASES, report, row, rows

OUTSIDE = {"0003": {"material law": math.inf, "steps": 0.125}, "0007": {}, "0011": {"steps": 0.0625}}
FACTS = {"machine": "one <core>", "seed": "3"}
NOTES = ["a limit of <b>all</b> that", "another"]
PICTURES = [("frame_0011.png", "worst of \"0011\""), ("frame_0003.png", "second")]


def full():
    """Everything that a report can hold, with a name that Markdown and HTML must not take for their own."""
    some = rows()
    some[3] = replace(some[3], name="slow <guess> | x")
    still = row("nothing moves", "trivial", 0.02, 9e-3, (9e-3, 9e-3, 9e-3))
    return report(title="A & B", rows=[*some, still], pictures=PICTURES, outside=OUTSIDE, facts=FACTS, notes=NOTES)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The folder, and what write_report gave."""
    out = tmp_path_factory.mktemp("written") / "deep" / "report"
    out.mkdir(parents=True)
    for i, (name, _) in enumerate(PICTURES):
        (out / name).write_bytes(b"picture %d" % i)
    return out, write_report(out, full())


@pytest.fixture(autouse=True)
def quick(written, monkeypatch):
    """Once the folder is written, other reports get a picture of no pixels."""
    monkeypatch.setattr("learning.report.report.pareto_picture", lambda path, some: path.write_bytes(b"none"))


class Page(HTMLParser):
    """Tables as lists of rows, the class of each row, and all sources of pictures."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tables, self.kinds, self.sources, self.headings, self.text = [], [], [], [], ""
        self._in = ""
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self._in = tag
        if tag == "table":
            self.tables.append([])
            self.kinds.append([])
        elif tag == "tr":
            self.tables[-1].append([])
            self.kinds[-1].append(given.get("class"))
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
        elif tag == "h2":
            self.headings.append("")
        elif tag == "img":
            self.sources.append((given["src"], given["alt"]))

    def handle_endtag(self, tag):
        self._in = ""

    def handle_data(self, data):
        if self._in in ("td", "th"):
            self.tables[-1][-1][-1] += data
        elif self._in == "h2":
            self.headings[-1] += data
        if self._in != "style":
            self.text += data


TIMES = [["predictor", "time [ms/step]", "time, set-up excluded [ms/step]", "RMSD-1 [mm]", "RMSD-all [mm]"],
         ["M4GN a", "5", "4.38", "0.001", "0.4"],
         ["M4GN b", "8", "7", "0.002", "0.2"],
         ["M4GN b, corrected 10-fold", "9", "7.88", "–", "0.05"],
         ["slow <guess> | x", "0.01", "0.00875", "0.3", "7"],
         ["FE, cells twice as large", "2", "1.75", "–", "0.6"],
         ["FE, the reference", "32", "28", "–", "0"],
         ["nothing moves", "0.02", "0.0175", "–", "9"]]
STEPS = [["predictor", "Newton steps"], ["M4GN a", "–"], ["M4GN b", "–"], ["M4GN b, corrected 10-fold", "1"], ["slow <guess> | x", "–"],
         ["FE, cells twice as large", "3.5"], ["FE, the reference", "4.25"], ["nothing moves", "–"]]
BY_CASE = [["test trajectory", "M4GN a", "M4GN b", "M4GN b, corrected 10-fold", "slow <guess> | x", "FE, cells twice as large",
            "nothing moves"],
           ["0003", "0.2", "0.1", "0.04", "6", "0.5", "9"],
           ["0007", "0.3", "0.35", "0.05", "7", "0.6", "9"],
           ["0011", "0.7", "0.15", "0.06", "8", "0.7", "9"]]
ALARM = "1 of 3 test scenes lie far outside of what the simulator was trained on (0003): its errors there say nothing about scenes inside."
LIES = ["0003 is outside: material law (never seen); steps by 12.5 % of the range's width",
        "0011 is outside: steps by 6.25 % of the range's width",
        "1 of 3 test scenes lie inside of every range that the training scenes span"]


def test_the_folder_holds_five_files_beside_its_pictures(written):
    assert {path.name for path in written[0].iterdir()} == {"report.html", "report.md", "report.json", "table.csv", "pareto.png",
                                                          "frame_0011.png", "frame_0003.png"}


def test_the_page_has_all_tables_cell_by_cell(written):
    page = Page((written[0] / "report.html").read_text())
    kinds = [None, "learned", "learned", "hybrid", "trivial", "fe", "reference", "trivial"]
    none = [["predictor"], *([line[0]] for line in TIMES[1:])]
    assert page.tables == [TIMES, none, STEPS, none, BY_CASE]
    assert page.kinds == [kinds, kinds, kinds, kinds, [None, "", "", ""]]
    assert page.headings == ["Speed against error", *TABLES, "RMSD-all of each test trajectory [mm]",
                             "Inside or outside of what was trained on", "Worst frames", "How it was measured", "Limits"]


def test_the_page_opens_offline_with_its_pictures_inside(written):
    out, _ = written
    text = (out / "report.html").read_text()
    names = ("pareto.png", *(name for name, _ in PICTURES))
    captions = (SCALE["rmsd_all"], *(caption for _, caption in PICTURES))
    assert Page(text).sources == [("data:image/png;base64," + base64.b64encode((out / name).read_bytes()).decode(), caption)
                                  for name, caption in zip(names, captions, strict=True)]
    words = re.sub(r"base64,[A-Za-z0-9+/=]+", "", text)
    assert not re.search(r"(?:https?:)?//|(?:src|href)=\"(?!data:)|@import|url\(", words)


def test_what_is_turned_by_hand_stands_between_the_tables_and_the_pictures(tmp_path):
    mesh = build_mesh(Body(length=0.1, width=0.02, height=0.02, cells=(2, 1, 1)))
    exhibit = Exhibit(title="trajectory 0003", mesh=mesh, motions={"M4GN": Animation(displacement=np.zeros((2, 12, 3)))}, frames=["0", "1"])
    for name, _ in PICTURES:
        (tmp_path / name).write_bytes(b"picture")
    write_report(tmp_path, full(), [exhibit])
    text = (tmp_path / "report.html").read_text()
    headings = Page(text).headings
    place = headings.index("To be turned by hand")
    assert headings[place - 1:place + 2] == ["Inside or outside of what was trained on", "To be turned by hand", "Worst frames"]
    assert section([exhibit]) in text and text.count('<section class="viewer"') == 1
    assert "exhibits" not in json.loads((tmp_path / "report.json").read_text())


def test_what_the_page_quotes_is_escaped_and_bold_letters_stay(written):
    text = (written[0] / "report.html").read_text()
    assert "<title>A &amp; B</title>" in text and "<h1>A &amp; B</h1>" in text
    assert "slow &lt;guess&gt; | x" in text and "<guess>" not in text
    assert "<dt>machine</dt><dd>one &lt;core&gt;</dd><dt>seed</dt><dd>3</dd>" in text
    assert "<li>a limit of &lt;b&gt;all&lt;/b&gt; that</li><li>another</li>" in text
    assert f'<p class="alarm">{ALARM}</p>' in text
    assert "<ul>" + "".join(f"<li>{line}</li>".replace("'", "&#x27;") for line in LIES) + "</ul>" in text
    # 9 mm of nothing moves over 0.2 mm of the better network
    assert "nothing moves is <b>45 times as far off</b>. M4GN b takes 8 ms" in text and f'<p class="lead">{headline(full())}</p>' in text
    assert "over steps and <b>free</b> nodes" in text  # of a column's meaning
    assert '<figcaption>worst of &quot;0011&quot;</figcaption>' in text


def test_the_page_tells_the_colours_of_the_kinds_that_occur_and_the_columns_that_it_shows(written):
    text = (written[0] / "report.html").read_text()
    assert re.findall(r'<span class="(\w+)">([^<]+)</span>', text) == [(kind, KINDS[kind]) for kind in (
        "learned", "hybrid", "trivial", "fe", "reference")]
    for kind in KINDS:
        assert f".{kind}{{--kind:{COLOURS[kind]}}}" in STYLE and STYLE in text
    terms = re.findall("<dt>([^<]+)</dt>", text)
    assert terms == ["time", "time, set-up excluded", "RMSD-1", "RMSD-all", "Newton steps", "machine", "seed"]
    assert "The figure to compare by." in text


def test_the_text_is_the_whole_report_line_by_line(written):
    def line(cells):
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

    def table(lines):
        return [line(lines[0]), "| --- |" + " ---: |" * (len(lines[0]) - 1), *map(line, lines[1:]), ""]

    def told(*keys):
        return [*(f"- **{COLUMNS[key].head}**: {COLUMNS[key].meaning.replace('<b>', '**').replace('</b>', '**')}." for key in keys), ""]

    expected = [
        "# A & B",
        "",
        headline(full()).replace("<b>", "**").replace("</b>", "**"),
        "",
        f"**{ALARM}**",
        "",
        "![time per step against error](pareto.png)",
        "",
        SCALE["rmsd_all"],
        "",
        "## Time and error",
        "",
        *table(TIMES),
        *told("ms_per_step", "ms_per_step_alone", "rmsd_1", "rmsd_all"),
        "## Errors as published",
        "",
        *table([[entry[0]] for entry in TIMES]),
        "",
        "## Held against the equations",
        "",
        *table(STEPS),
        *told("iterations"),
        "## The deformed mesh",
        "",
        *table([[entry[0]] for entry in TIMES]),
        "",
        "## RMSD-all of each test trajectory [mm]",
        "",
        *table(BY_CASE),
        "## Inside or outside of what was trained on",
        "",
        *(f"- {entry}" for entry in LIES),
        "",
        "## Worst frames",
        "",
        'worst of "0011"',
        "",
        '![worst of "0011"](frame_0011.png)',
        "",
        "second",
        "",
        "![second](frame_0003.png)",
        "",
        "## How it was measured",
        "",
        "- machine: one <core>",
        "- seed: 3",
        "",
        "## Limits",
        "",
        "- a limit of <b>all</b> that",
        "- another",
        "",
    ]
    assert (written[0] / "report.md").read_text().split("\n") == expected


def test_the_table_holds_all_figures_in_si_units(written):
    with open(written[0] / "table.csv", newline="") as file:
        lines = list(csv.reader(file))
    assert lines[0] == [
        "predictor",
        "kind",
        "ms_per_step [ms]",
        "ms_per_step_alone [ms]",
        "wall_ms_per_step [ms]",
        "seconds [s]",
        "set_up_seconds [s]",
        "paid_back [1]",
        "rmsd_1 [m]",
        "rmsd_50 [m]",
        "rmsd_all [m]",
        "rmsd_all_all_nodes [m]",
        "rmsd_refined [m]",
        "of_motion [1]",
        "below_data [1]",
        "error_bar [m]",
        "covered [1]",
        "unsure [1]",
        "rmse_1 [m]",
        "rmse_50 [m]",
        "rmse_all [m]",
        "rmse_1_by_step [m]",
        "rmse_50_by_step [m]",
        "rmse_all_by_step [m]",
        "rmse_1_all_nodes [m]",
        "rmse_50_all_nodes [m]",
        "rmse_all_all_nodes [m]",
        "rmse_1_by_step_all_nodes [m]",
        "rmse_50_by_step_all_nodes [m]",
        "rmse_all_by_step_all_nodes [m]",
        "relative_residual [1]",
        "largest_penetration [m]",
        "reaction_error [1]",
        "energy_error [1]",
        "stress_error [1]",
        "estimated_error [m]",
        "effectivity [1]",
        "iterations [1]",
        "gf_h [m]",
        "gf_c [m2]",
        "mc [1]",
        "ar [1]",
        "smallest_det_f [1]",
        "smallest_scaled_jacobian [1]",
        "inverted_elements [1]",
    ]
    assert lines[2][:2] == ["M4GN b", "learned"] and len(lines) == 8
    assert [float(value) for value in lines[2][2:12]] == pytest.approx([8.0, 7.0, *[math.nan] * 4, 2e-6, math.nan, 2e-4, math.nan],
                                                                       nan_ok=True)
    assert lines[6][10] == "0.0" and lines[3][8] == "nan"


def test_a_figure_that_a_row_lacks_is_nan_in_the_table(tmp_path):
    some = rows()
    del some[0].scores["rmsd_50"]
    write_report(tmp_path / "new", report(rows=some))
    with open(tmp_path / "new" / "table.csv", newline="") as file:
        assert [line["rmsd_50 [m]"] for line in csv.DictReader(file)] == ["nan"] * 6


@pytest.mark.parametrize("name, write", [("report.json", lambda path: write_report(path.parent, full())),
                                         ("pareto.png", lambda path: pareto_picture(path, rows()))])
def test_on_a_full_disk_there_is_no_half_file_and_the_error_says_its_name(tmp_path, name, write):
    with full_after(100), pytest.raises(OSError) as error:
        write(tmp_path / name)
    assert error.value.filename == str(tmp_path / name) and not list(tmp_path.iterdir())


def test_the_json_holds_everything_and_null_for_what_is_no_number(written):
    out, given = written
    stored = json.loads((out / "report.json").read_text())
    assert stored == json.loads(json.dumps(given, allow_nan=False)) and set(stored) == {
        "summary", "improvement_over_nothing_moves", "far_outside", "title", "rows", "cases", "pictures", "outside", "facts", "notes"}
    assert stored["summary"] == headline(full()).replace("<b>", "").replace("</b>", "")
    assert stored["improvement_over_nothing_moves"] == pytest.approx(45)
    assert stored["far_outside"] == ["0003"]
    assert stored["outside"] == {"0003": {"material law": None, "steps": 0.125}, "0007": {}, "0011": {"steps": 0.0625}}
    assert (stored["title"], stored["cases"], stored["facts"], stored["notes"]) == ("A & B", CASES, FACTS, NOTES)
    assert stored["pictures"] == [list(entry) for entry in PICTURES]
    first = stored["rows"][0]
    assert (first["name"], first["kind"], first["scores"]["rmsd_all"], first["scores"]["rmsd_50"]) == ("M4GN a", "learned", 4e-4, None)
    assert first["each"] == [{"rmsd_all": error, "rmsd_refined": None} for error in (2e-4, 3e-4, 7e-4)]
    assert "–" not in (out / "report.json").read_text() and "<guess>" in (out / "report.json").read_text()


def test_a_report_says_nothing_of_what_it_does_not_know(tmp_path):
    write_report(tmp_path, report(rows=rows()[2:]))
    text, page = (tmp_path / "report.md").read_text(), (tmp_path / "report.html").read_text()
    for words in (text, page):
        assert "Worst frames" not in words and "Inside or outside" not in words and "far outside" not in words
    assert 'class="alarm"' not in page and "****" not in text
    stored = json.loads((tmp_path / "report.json").read_text())
    assert stored["outside"] is None and stored["improvement_over_nothing_moves"] is None and stored["far_outside"] == []


@pytest.mark.parametrize("far, words", [(1, "(c0)"), (5, "(c0, c1, c2, c3, c4)"), (6, "(c0, c1, c2, c3, c4 and more)")])
def test_the_alarm_names_five_scenes_at_most(tmp_path, far, words):
    outside = {f"c{i}": {"steps": 0.21 if i < far else 0.2} for i in range(7)}  # a fifth of the range's width is not yet far
    write_report(tmp_path, report(cases=list(outside), outside=outside, rows=[row("M4GN", "learned", 1.0, 1e-3)]))
    assert (
        f"**{far} of 7 test scenes lie far outside of what the simulator was trained on {words}: " in (tmp_path / "report.md").read_text()
    )
    assert "0 of 7 test scenes lie inside of every range" in (tmp_path / "report.md").read_text()


def test_the_words_below_the_picture_go_with_its_measure(tmp_path):
    some = [row(name, kind, ms, 1e-3, rmsd_refined=2e-3) for name, kind, ms in (("a", "fe", 1.0), ("b", "reference", 2.0))]
    write_report(tmp_path, report(rows=some, cases=[]))
    for name in ("report.md", "report.html"):
        words = (tmp_path / name).read_text()
        assert SCALE["rmsd_refined"] in words and SCALE["rmsd_all"] not in words
    assert "closer to the body" in SCALE["rmsd_refined"] and "closer to the truth" in SCALE["rmsd_all"]
