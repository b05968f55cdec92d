"""Speed against error: which predictors nothing beats, which points the picture has, in which units, and where its labels stand."""

import math
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from learning.report import pareto
from learning.report.pareto import COLOURS, MARKERS, front, measure_of, pareto_picture
from learning.report.table import KINDS, Row
from tests.rows import row, rows


def point(name: str, ms: float, error: float) -> Row:
    return row(name, "fe", ms, error)


def refined(some: list[Row], errors: tuple[float, ...]) -> list[Row]:
    """Rows that have an error to finer cells in every trajectory."""
    return [replace(old, scores=old.scores | {"rmsd_refined": error}, each=tuple(each | {"rmsd_refined": error} for each in old.each))
            for old, error in zip(some, errors, strict=True)]


def test_the_front_is_what_no_other_beats_or_equals_in_both():
    # b is beaten by a and c by no one; d is as far off as c and slower; e as fast as f and farther off; g is the closest
    some = [point("g", 9.0, 1.0), point("b", 2.0, 8.0), point("a", 1.0, 7.0), point("d", 5.0, 4.0), point("c", 3.0, 4.0),
            point("e", 6.0, 3.0), point("f", 6.0, 2.0), point("h", 10.0, 1.5)]
    assert [each.name for each in front(some)] == ["a", "c", "f", "g"]
    assert [each.name for each in front(some[::-1])] == ["a", "c", "f", "g"]


def test_the_front_is_of_the_error_that_is_asked_for():
    some = refined([point("a", 1.0, 1.0), point("b", 2.0, 2.0)], (5.0, 4.0))
    assert [each.name for each in front(some)] == ["a"]
    assert [each.name for each in front(some, "rmsd_refined")] == ["a", "b"]


def test_the_front_of_rows_made_by_hand():
    # M4GN a (5 ms, 0.4 mm) and b (8, 0.2), corrected (9, 0.05), nothing moves (0.01, 7), halved cells (2, 0.6), reference (32, 0)
    assert [each.name for each in front(rows())] == [
        "nothing moves", "FE, cells twice as large", "M4GN a", "M4GN b", "M4GN b, corrected 10-fold",
                                                     "FE, the reference"]


def test_the_picture_is_against_finer_cells_only_where_all_rows_have_that_error_in_all_trajectories():
    errors = (1e-4, 2e-4, 3e-4, 4e-4, 5e-4, 6e-4)
    assert measure_of([]) == measure_of(rows()) == "rmsd_all"
    whole = refined(rows(), errors)
    assert measure_of(whole) == "rmsd_refined"
    assert measure_of([*whole[:5], replace(whole[5], scores=rows()[5].scores)]) == "rmsd_all"
    # a mean over some trajectories only
    assert measure_of([replace(whole[0], each=(*whole[0].each[:2], rows()[0].each[2])), *whole[1:]]) == "rmsd_all"
    assert measure_of([replace(whole[0], each=({},)), *whole[1:]]) == "rmsd_all"


def drawn(some: list[Row], path: Path | None = None, **words: str) -> Axes:
    """The axes of a picture of rows."""
    figures = []

    class Kept(Figure):
        def __init__(self, **how):
            super().__init__(**how)
            figures.append(self)

    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory() as folder:
        patch.setattr(pareto, "Figure", Kept)
        pareto_picture(path or Path(folder) / "pareto.png", some, **words)
    axes, = figures[0].axes
    return axes


@cache
def plain() -> Axes:
    """The picture of the rows made by hand."""
    return drawn(rows())


@cache
def crowded() -> Axes:
    return drawn(crowd())


def lines(axes, count: int) -> dict[tuple[float, ...], list]:
    """x of each line with so many points -> its y."""
    return {tuple(line.get_xdata()): list(line.get_ydata()) for line in axes.lines if len(line.get_xdata()) == count}


def test_each_predictor_is_a_point_at_its_time_and_its_error_in_mm():
    axes = plain()
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert axes.get_xlabel().startswith("processor time per step [ms]") and axes.get_ylabel() == (
        "RMSD to the data, whole rollouts, free nodes [mm]")
    spots = [tuple(np.ravel(spot.get_offsets())) for spot in axes.collections]
    # the reference has no error to the data: no point, but a line at its time
    assert spots == [pytest.approx(spot) for spot in ((5, 0.4), (8, 0.2), (9, 0.05), (0.01, 7), (2, 0.6))]
    upright = [line for line in axes.lines if line.get_linestyle() == "--"]
    assert [list(line.get_xdata()) for line in upright] == [[32, 32]]
    assert [line.get_label() for line in upright] == ["FE, the reference: zero error by definition"]
    assert not [line for line in axes.lines if line.get_linestyle() == ":"]


def test_a_bar_leads_to_the_time_without_set_up():
    bars = lines(plain(), 2)
    for ms, error in ((5, 0.4), (8, 0.2), (9, 0.05), (0.01, 7), (2, 0.6)):  # an eighth of each time is set-up
        assert bars[(0.875 * ms, ms)] == pytest.approx([error, error])
    bare = row("bare", "fe", 3.0, 1e-3)
    del bare.scores["ms_per_step_alone"]
    assert lines(drawn([*rows(), bare]), 2)[(3, 3)] == pytest.approx([1, 1])


def test_the_front_is_a_step_line_below_all_points():
    axes = plain()
    step = next(line for line in axes.lines if line.get_label().startswith("front"))
    assert step.get_drawstyle() == "steps-post"
    assert list(step.get_xdata()) == pytest.approx([0.01, 2, 5, 8, 9])  # the reference's point is at zero, which no logarithm shows
    assert list(step.get_ydata()) == pytest.approx([7, 0.6, 0.4, 0.2, 0.05])
    others = [line.get_zorder() for line in axes.lines if line is not step and len(line.get_xdata()) == 2 and line.get_linestyle() == "-"]
    spots = [spot.get_zorder() for spot in axes.collections]
    assert step.get_zorder() < min(others) <= max(others) < min(spots)
    assert step.get_linewidth() > 3 * max(line.get_linewidth() for line in axes.lines if line is not step)


def test_against_finer_cells_the_reference_is_a_star_on_the_line_of_the_datas_error():
    axes = drawn(refined(rows(), (1e-3, 2e-3, 3e-4, 8e-3, 5e-4, 6e-4)))
    assert axes.get_ylabel() == "RMSD to the scene on cells of half the size, whole rollouts, free nodes [mm]"
    spots = {tuple(np.round(np.ravel(spot.get_offsets()), 9)): spot for spot in axes.collections}
    assert list(spots) == [(5, 1), (8, 2), (9, 0.3), (0.01, 8), (2, 0.5), (32, 0.6)]
    flat = [line for line in axes.lines if line.get_linestyle() == ":"]
    assert [list(line.get_ydata()) for line in flat] == [[pytest.approx(0.6)] * 2] and flat[0].get_label() == "error of the data"
    assert not [line for line in axes.lines if line.get_linestyle() == "--"]
    step = next(line for line in axes.lines if line.get_label().startswith("front"))
    assert list(step.get_xdata()) == pytest.approx([0.01, 2, 9])
    sizes = [spot.get_sizes()[0] for spot in axes.collections]
    assert sizes[5] > sizes[0] and sizes[:5] == [sizes[0]] * 5  # a star has less area than a disc


def test_every_kind_has_a_colour_and_a_marker_of_its_own():
    assert set(COLOURS) == set(MARKERS) == set(KINDS)
    assert len(set(COLOURS.values())) == len(set(MARKERS.values())) == len(KINDS)
    assert len(drawn([row("x", kind, 1.0 + i, 1e-3) for i, kind in enumerate(KINDS)]).collections) == len(KINDS)


def test_the_picture_is_1100_pixels_wide_and_white(tmp_path):
    drawn([], tmp_path / "pareto.png")
    with Image.open(tmp_path / "pareto.png") as picture:
        assert picture.size == (1100, 682)  # 10 x 6.2 inches of 110 dots
        assert picture.convert("RGB").getpixel((2, 2)) == (255, 255, 255)


def test_the_points_have_room_around_them_and_the_frame_is_open():
    """An eighth of the span and more is left on each side, in logarithms."""
    axes = plain()
    for (low, high), values in ((axes.get_xlim(), (0.875 * 0.01, 32.0)), (axes.get_ylim(), (0.05, 7.0))):
        span = math.log(max(values) / min(values))
        for room in (math.log(min(values) / low), math.log(high / max(values))):
            assert 0.125 * span < room < 0.2 * span
    assert not axes.spines["top"].get_visible() and not axes.spines["right"].get_visible() and axes.spines["left"].get_visible()


def boxes(axes) -> dict[str, tuple]:
    """Label -> its box [pixels] as left, bottom, right, top."""
    renderer = axes.figure.canvas.get_renderer()
    found = {}
    for note in axes.texts:
        note.update_positions(renderer)
        found[note.get_text()] = Text.get_window_extent(note, renderer).extents
    return found


def gap(a, b) -> float:
    """Distance of two boxes along the axis on which they are farther apart [pixels]; below zero where they overlap."""
    return max(a[0] - b[2], b[0] - a[2], a[1] - b[3], b[1] - a[3])


def crowd() -> list[Row]:
    """Points in twos and threes nearly on top of each other, and at all four corners."""
    kinds = ("learned", "hybrid", "fe", "reduced")
    places = [(0.01, 7), (100, 7), (0.01, 0.003), (100, 0.003), (1, 0.1), (1.05, 0.103), (0.97, 0.096), (9, 0.5), (9.4, 0.52), (30, 0.2)]
    return [row(f"predictor {i}, with a long name", kinds[i % 4], ms, 1e-3 * mm) for i, (ms, mm) in enumerate(places)]


def test_labels_cover_neither_each_other_nor_points_nor_the_edge_even_in_a_crowd():
    for some, axes in ((rows(), plain()), (crowd(), crowded())):
        found, inside = boxes(axes), axes.get_window_extent().padded(2).extents
        shown = {each.name: axes.transData.transform((each.ms_per_step, 1e3 * each.scores["rmsd_all"]))
                 for each in some if each.scores["rmsd_all"] > 0}
        assert [note.get_text() for note in axes.texts] == list(shown) and all(note.get_visible() for note in axes.texts)
        for name, box in found.items():
            assert inside[0] <= box[0] and box[2] <= inside[2] and inside[1] <= box[1] and box[3] <= inside[3], name
            for other, (x, y) in shown.items():
                # half a marker is about 7 pixels; to another point there is twice that
                assert gap(box, (x, y, x, y)) >= (8 if other == name else 15), (name, other)
            assert all(gap(box, beside) >= 0 for other, beside in found.items() if other != name)


def heap(count: int) -> list[Row]:
    """Predictors all in one place, in the middle of four others, with names of 40 letters and one of 90."""
    spots = [(1.0 + 1e-3 * i, 0.1) for i in range(count)] + [(0.01, 7), (100, 7), (0.01, 0.003), (100, 0.003)]
    names = [f"predictor {i:2d} with a name of forty letters" for i in range(len(spots))]
    return [row("x" * 90 if i == 1 else name, "fe", ms, 1e-3 * mm) for i, (name, (ms, mm)) in enumerate(zip(names, spots, strict=True))]


@pytest.mark.parametrize("count", [2, 14])
def test_no_two_labels_ever_lie_over_each_other_not_even_of_points_in_one_place(count):
    """A name that no picture has room for is cut."""
    axes = drawn(heap(count))
    found = list(boxes(axes).items())
    assert len(found) == len(axes.texts) == count + 4 and found[1][0] == 47 * "x" + "…"
    inside = axes.get_window_extent().padded(2).extents
    for i, (name, box) in enumerate(found):
        assert inside[0] <= box[0] and box[2] <= inside[2] and inside[1] <= box[1] and box[3] <= inside[3], name
        assert all(gap(box, other) >= 2 for _, other in found[:i]), name
    assert axes.figure.get_figheight() == pytest.approx(6.2)


@pytest.mark.parametrize("tries, height", [(1, 6.2), (2, 6.2 * 1.25), (7, 6.2 * 1.25**2)])
def test_the_picture_grows_by_a_quarter_until_there_is_room_or_often_enough(monkeypatch, tries, height):
    """Here twice at most; in the last picture the labels stand once, with or without room."""
    monkeypatch.setattr(pareto, "GROWTHS", 2)
    calls, label = [], pareto._label

    def counted(axes, labels):
        calls.append(axes.figure.get_figheight())
        assert not axes.texts
        return label(axes, labels) and len(calls) == tries

    monkeypatch.setattr(pareto, "_label", counted)
    axes = drawn(heap(0))
    assert len(calls) == min(tries, 3) and calls[-1] == axes.figure.get_figheight() == pytest.approx(height) and len(axes.texts) == 4


def test_a_label_stands_as_near_to_its_point_as_it_can_and_a_far_one_has_a_line_to_it():
    axes = drawn(rows()[:2])
    for note in axes.texts:  # two points far apart: up right, 8 points away, no line
        assert note.get_position() == (8, 8) and (note.get_ha(), note.get_va()) == ("left", "bottom") and note.arrow_patch is None
    far = [note for note in crowded().texts if max(map(abs, note.get_position())) > 8]
    assert far and all(note.arrow_patch is not None for note in far)


def test_a_label_is_put_beside_its_point_not_over_it():
    """The corner of the text that is put at the place is the one nearest to the point."""
    for (x, y), across, up in pareto.PLACES:
        assert across == ("left" if x > 0 else "right" if x < 0 else "center")
        assert up == ("bottom" if y > 0 else "top" if y < 0 else "center")
    far = [max(abs(x), abs(y)) for (x, y), _, _ in pareto.PLACES]
    assert far == sorted(far) and min(far) == 8 and len(set(pareto.PLACES)) == len(pareto.PLACES) == 8 * len(set(far))


def test_where_every_place_is_taken_the_least_covered_one_is_chosen(monkeypatch):
    places = [((0, 0), "center", "center"), ((8, 8), "left", "bottom"), ((16, 8), "left", "bottom"), ((16, 9), "left", "bottom")]
    monkeypatch.setattr(pareto, "PLACES", places)
    monkeypatch.setattr(pareto, "GROWTHS", 0)
    axes = drawn([row("one", "fe", 1.0, 1e-3), row("two", "fe", 1.0, 1e-3), row("far", "fe", 50.0, 1e-1)])
    # Two points in one place. 8 points to the side is still within what is kept free around the other point, 16 is free for the first
    # label; the second covers both points in the middle, a point and the first label at 8, the label alone at the last two.
    assert [(note.get_text(), note.get_position()) for note in axes.texts] == [("one", (16, 8)), ("two", (16, 8)), ("far", (8, 8))]
    assert all(note.get_visible() for note in axes.texts)


def test_what_is_brought_along_is_a_labelled_point_or_without_a_time_a_line_with_its_name():
    axes = drawn([*rows(), row("mine", "foreign", 3.0, 1e-3), row("untimed", "foreign", math.nan, 2e-3)])
    at = [tuple(np.asarray(points.get_offsets())[0]) for points in axes.collections if len(points.get_offsets())]
    assert any(np.allclose(place, (3.0, 1.0)) for place in at) and not any(np.isnan(place).any() for place in at)
    assert "mine" in {text.get_text() for text in axes.texts} and "untimed" not in {text.get_text() for text in axes.texts}
    assert {line.get_ydata()[0]: line.get_label() for line in axes.lines}[2.0] == "untimed: its time is not known"
    assert "untimed" not in [each.name for each in front([*rows(), row("untimed", "foreign", math.nan, 1e-9)])]


def spread(name: str, kind: str, factor: float = 1.0) -> Row:
    """Five trajectories with times 1 .. 5 ms and errors 1 .. 16 um, not in one order."""
    each = tuple({"ms_per_step": factor * ms, "rmsd_all": 1e-6 * um} for ms, um in ((2, 16), (5, 1), (1, 4), (4, 2), (3, 8)))
    return replace(row(name, kind, 3.0 * factor, 6.2e-6), each=each)


def test_from_four_trajectories_on_a_cross_has_medians_and_quartiles():
    found = lines(drawn([spread("a", "learned")]), 2)
    assert found[(2.0, 4.0)] == pytest.approx([4e-3, 4e-3]) and found[(3.0, 3.0)] == pytest.approx([2e-3, 8e-3])
    few = replace(spread("a", "learned"), each=spread("a", "learned").each[:3])
    assert (3.0, 3.0) not in lines(drawn([few]), 2)
    four = replace(few, each=spread("a", "learned").each[:4])  # 2, 5, 1 and 4 ms: quartiles 1.75 and 4.25, median 3
    assert (1.75, 4.25) in lines(drawn([four]), 2)


def test_what_is_learned_has_a_front_of_its_own_where_something_else_beats_it():
    alone = drawn([row("a", "learned", 1.0, 1e-3), row("b", "learned", 2.0, 5e-4)])
    assert [line.get_label() for line in alone.lines if line.get_drawstyle() == "steps-post"] == [
        "front: nothing is both faster and closer"]
    axes = drawn([row("a", "learned", 1.0, 1e-3), row("b", "learned", 2.0, 5e-4), row("c", "learned", 3.0, 6e-4),
                  row("d", "fe", 0.5, 7e-4)])
    step = next(line for line in axes.lines if line.get_label() == "front of what is learned")
    assert list(step.get_xdata()) == [1, 2] and list(step.get_ydata()) == pytest.approx([1, 0.5]) and step.get_drawstyle() == "steps-post"


def test_what_the_axes_are_of_is_said_where_it_is_not_whole_rollouts():
    axes = drawn([point("a", 1.0, 1e-3), point("b", 2.0, 5e-4)], across="time of a question [ms]", up="error of the end [mm]")
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time of a question [ms]", "error of the end [mm]")
    assert [tuple(np.ravel(spot.get_offsets())) for spot in axes.collections] == [(1.0, 1.0), (2.0, 0.5)]
