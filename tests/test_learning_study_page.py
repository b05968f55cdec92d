"""The page of a study: what its curves show, and its tables."""

import base64
import io
import math
import re

import pytest
from PIL import Image

from learning.config import TrainConfig
from learning.study import page
from learning.study.page import COLOURS, curves, write_page
from learning.study.plan import Data, Line, Plan, Trial
from learning.study.table import FIGURE, Result, Score
from physics.fidelity.figures import FIGURES


def result_of(drawn, **words):
    plan = Plan(**{"title": "A & B", "about": "", "source": "", "size": "small"} | words, seeds=2,
                rows=tuple(Line(name, TrainConfig(), {}) for name in drawn), tests=(Trial("one <t>", "data"), Trial("two", "data")),
                sets={"data": ({}, Data(family="demo", train=1))})
    cells = {name: {test.name: {FIGURE: Score(1e-3 * (k + 1), 0.0, 2)} for test in plan.tests} for k, name in enumerate(drawn)}
    return Result(plan, {FIGURE: FIGURES[FIGURE]}, cells, {}, drawn)


@pytest.fixture
def figure(monkeypatch):
    """The last figure that was drawn."""
    made = []

    class Kept(page.Figure):
        def __init__(self, *given, **named):
            super().__init__(*given, **named)
            made.append(self)

    monkeypatch.setattr(page, "Figure", Kept)
    return made


def lines_of(panel):
    return [([float(x) for x in line.get_xdata()], [float(y) for y in line.get_ydata()]) for line in panel.lines]


def test_curves_are_error_over_steps_and_seconds_and_loss_over_steps(figure):
    """What is none, no number or not above zero, as no logarithm takes it, is left out."""
    first = [{"step": 1, "seconds": 2.0, "error": 0.5}, {"step": 1, "seconds": 2.5, "loss": 9.0},
             {"step": 2, "seconds": 4.0, "error": None}, {"step": 3, "seconds": 6.0, "error": 0.25, "loss": 1},
             {"step": 4, "seconds": 8.0, "error": 0.0, "loss": "low"}]
    image = Image.open(io.BytesIO(curves(result_of({"a": [first, first[:1]], "b": []}))))
    assert image.size == pytest.approx((1430, 506), abs=1)  # 4.6 in at 110 dpi, which versions of Matplotlib round differently
    errors, times, losses = figure[0].axes
    assert lines_of(errors) == [([1, 3], [0.5, 0.25]), ([1], [0.5])]
    assert lines_of(times) == [([2.0, 6.0], [0.5, 0.25]), ([2.0], [0.5])]
    assert lines_of(losses) == [([1, 3], [9.0, 1.0])]
    assert [(each.get_xlabel(), each.get_ylabel()) for each in figure[0].axes] == [
        ("training steps", "error in validation [m]"), ("seconds of training", "error in validation [m]"), ("training steps", "loss")]
    assert {each.get_yscale() for each in figure[0].axes} == {"log"}
    assert not any(each.spines[side].get_visible() for each in figure[0].axes for side in ("top", "right"))


def test_a_row_has_one_colour_and_one_name_and_a_ninth_another_stroke(figure):
    """Eight colours; few points are marked, from twelve on they are a line."""
    rows = {f"r{k}": [[{"step": s, "seconds": s, "loss": 1.0} for s in range(1, count + 1)] for count in (11, 12)] for k in range(33)}
    curves(result_of(rows))
    lines = figure[0].axes[2].lines
    assert len(lines) == 66 and len(COLOURS) == 8
    for k in range(33):
        first, second = lines[2 * k:2 * k + 2]
        assert first.get_color() == second.get_color() == COLOURS[k % 8]
        assert first.get_linestyle() == second.get_linestyle() == ("-", "--", ":", "-.", "-")[k // 8]
        assert (first.get_marker(), second.get_marker()) == (".", "")
        assert first.get_label() == f"r{k}" and second.get_label().startswith("_")
    (legend,) = figure[0].legends
    assert [text.get_text() for text in legend.get_texts()] == list(rows) and legend._ncols == 4 and not legend.get_frame_on()


def test_curves_of_nothing_are_empty_panels_without_a_legend(figure):
    curves(result_of({"a": [[]]}))
    assert not figure[0].legends and [len(each.lines) for each in figure[0].axes] == [0, 0, 0]
    assert {each.get_yscale() for each in figure[0].axes} == {"linear"}


def test_the_page_has_every_table_and_what_can_be_said_of_it(tmp_path):
    found = result_of({"a <1>": [[{"step": 1, "seconds": 1.0, "error": 1.0}]], "b": []}, about="Why.\n\nHow.")
    write_page(tmp_path, found)
    text = (tmp_path / "report.html").read_text()
    assert "<h1>A &amp; B</h1><p>Why.</p><p>How.</p><p>Size small: " in text
    assert ('<h2>Tested on: one &lt;t&gt;</h2><div class="wide"><table><tr><th></th><th>RMSE-all [mm]</th></tr><tr><th scope="row">a '
            '&lt;1&gt;</th><td>1</td></tr><tr><th scope="row">b</th><td>2</td></tr></table></div><ul><li>b has 1 mm more than a '
            "&lt;1&gt;: more than two standard errors of 2 seeds each.</li></ul><h2>Tested on: two</h2>") in text
    assert f"<dl><dt>RMSE-all</dt><dd>{FIGURES[FIGURE].meaning}.</dd></dl>" in text
    picture = base64.b64decode(re.search(r"base64,([^\"]+)\"", text).group(1))
    assert picture == curves(found)
    write_page(tmp_path, result_of({"a": []}))
    assert "<h1>A &amp; B</h1><p>Size small: " in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize("value, drawn", [(1, True), (0.5, True), (0, False), (-1.0, False), (None, False), ("1", False),
                                          (math.nan, False)])
def test_a_number_above_zero_is_drawn(value, drawn):
    assert page._drawn(value) is drawn
