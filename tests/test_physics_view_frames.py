"""What is drawn, and which frames: the drawing itself replaced by a record of what it was asked for."""

import inspect

import numpy as np
import pytest
from PIL import Image

from physics import view
from physics.mesh.build import build_mesh
from physics.scene import Body
from physics.view import drawing, flow, page, pictures

MESH = build_mesh(Body(length=0.1, width=0.02, height=0.03, cells=(2, 1, 1)))
STEPS = 7


@pytest.fixture
def drawn(monkeypatch):
    """Calls of `draw`, each of which gives a plain grey picture a shade lighter than the one before."""
    calls = []

    def draw(mesh, displacement, colour, limits, cmap, camera, size, *, obstacle=None, outline=None):
        calls.append({"displacement": displacement, "colour": colour, "limits": limits, "cmap": cmap, "camera": camera, "size": size,
                      "obstacle": obstacle, "outline": outline})
        return np.full((size[1], size[0], 3), 10 * len(calls) % 250, np.uint8)

    monkeypatch.setattr(pictures, "draw", draw)
    return calls


@pytest.fixture
def titles(monkeypatch):
    said, show = [], page.Page.show
    monkeypatch.setattr(page.Page, "show", lambda self, panels, title: (said.append(title), show(self, panels, title))[1])
    return said


def path():
    """(T, N, 3) all nodes go t (1, 2, 2) mm, the last one twice as far: 3 t and 6 t mm."""
    moved = np.ones((STEPS + 1, len(MESH.points), 1)) * np.arange(STEPS + 1)[:, None, None] * [1e-3, 2e-3, 2e-3]
    moved[:, -1] *= 2
    return moved


def test_a_film_has_evenly_spread_frames_with_the_first_and_the_last(tmp_path, drawn, titles, monkeypatch):
    truth, moved = 0.5 * path(), path()
    points = np.arange((STEPS + 1) * 9.0).reshape(-1, 3, 3)
    rigid = view.ObstacleSurface(points, np.array([[0, 1, 2]]))
    monkeypatch.setattr(drawing, "WIDTH", 300)
    assert view.film(tmp_path / "deep" / "film.gif", MESH, moved, obstacle=rigid, frames=3, seconds=0.6) == 3
    # 0, 3.5 and 7 of 7 steps, the half to the even number
    for call, k in zip(drawn, (0, 4, 7), strict=True):
        assert np.array_equal(call["displacement"], moved[k]) and call["outline"] is None
        assert call["colour"] == pytest.approx([*(len(MESH.points) - 1) * [3 * k], 6 * k])  # [mm]
        assert call["limits"] == pytest.approx((0, 42)) and call["cmap"] == "viridis"
        assert np.array_equal(call["obstacle"].points, points[k]) and call["size"][0] == 300
    assert titles == [f"step {k} of 7:  largest displacement {6 * k} mm" for k in (0, 4, 7)]
    film = Image.open(tmp_path / "deep" / "film.gif")
    assert film.n_frames == 3 and film.info["duration"] == 200 and film.info["loop"] == 0
    film.seek(2)
    assert film.info["duration"] == 1000
    drawn.clear()
    titles.clear()
    assert view.film(tmp_path / "both.gif", MESH, moved, truth=truth, frames=99, seconds=0.01) == 8  # never more than there are
    assert len(drawn) == 16
    for k, (left, right) in enumerate(zip(drawn[::2], drawn[1::2], strict=True)):
        assert np.array_equal(left["displacement"], moved[k]) and np.array_equal(right["displacement"], truth[k])
        assert np.array_equal(left["outline"], truth[k]) and right["outline"] is None and left["obstacle"] is None
        assert left["colour"][0] == pytest.approx(1.5 * k) and left["colour"][-1] == pytest.approx(3 * k) and not right["colour"].any()
        assert left["limits"] == right["limits"] == pytest.approx((0, 21)) and left["cmap"] == right["cmap"] == "YlOrRd"
        assert left["size"][0] == 150
    assert titles[3] == "step 3 of 7:  largest error 9 mm"
    assert Image.open(tmp_path / "both.gif").info["duration"] == 20  # browsers show shorter ones slower
    assert Image.open(tmp_path / "both.gif").width == 300


def test_a_frame_says_its_error_and_shows_prediction_over_truth(tmp_path, drawn, titles):
    truth = path()[3]
    wrong = truth.copy()
    wrong[1] += [2e-3, -3e-3, 6e-3]
    view.frame_picture(tmp_path / "a.png", MESH, prediction=wrong, truth=truth, step=3, steps=7)
    left, right = drawn
    assert np.array_equal(left["displacement"], wrong) and np.array_equal(left["outline"], truth)
    assert np.array_equal(right["displacement"], truth) and right["outline"] is None
    assert left["colour"] == pytest.approx(np.where(np.arange(len(truth)) == 1, 7, 0)) and not right["colour"].any()
    assert left["limits"] == right["limits"] == pytest.approx((0, 7)) and left["size"] == right["size"] and left["size"][0] == 600
    assert titles == ["step 3 of 7:  largest error 7 mm,  largest displacement 18 mm"]
    picture = np.asarray(Image.open(tmp_path / "a.png"))
    height = left["size"][1]
    assert picture.shape == (height + 76 + 74, 1200, 3)
    assert (picture[76 + 5:76 + height - 5, 5:595] == 10).all() and (picture[76 + 5:76 + height - 5, 605:1195] == 20).all()
    assert (picture[:8] == 255).all() and (picture[76 + height + 2:, :300] == 255).all()  # the bar is 0.4 wide, in the middle
    bar = picture[76 + height + 22, 365:835].astype(int)
    assert bar[0].sum() > 700 and bar[-1, 0] < 140 and bar[-1, 1] < 10  # from pale yellow to dark red
    view.frame_picture(tmp_path / "b.png", MESH, prediction=truth, truth=truth, step=0, steps=7)
    assert drawn[2]["limits"] == (0, 1e-9)


def test_a_mode_goes_through_one_period_by_a_sixth_of_the_body(tmp_path, drawn, titles, monkeypatch):
    monkeypatch.setattr(drawing, "WIDTH", 300)
    mode = path()[1]  # the largest is 6 mm long
    view.mode_film(tmp_path / "m.gif", MESH, mode, title="mode 1", frames=6, seconds=1.2)
    assert titles == 6 * ["mode 1"] and Image.open(tmp_path / "m.gif").info["duration"] == 200
    for k, call in enumerate(drawn):
        phase = np.cos(2 * np.pi * k / 6)
        assert call["displacement"] == pytest.approx(phase * mode * (0.1 / 6 / 6e-3), abs=1e-15)
        assert call["colour"] == pytest.approx(abs(phase) * np.where(np.arange(len(mode)) == len(mode) - 1, 1, 0.5))
        assert call["limits"] == (0, 1) and not call["outline"].any() and call["size"][0] == 150
    drawn.clear()
    scalar = np.linspace(-3.0, 4.0, len(MESH.points))
    view.mode_picture(tmp_path / "s.png", MESH, scalar)
    assert len(drawn) == 1 and not drawn[0]["displacement"].any() and drawn[0]["outline"] is None
    assert drawn[0]["colour"] == pytest.approx(scalar / 4) and drawn[0]["limits"] == (-1, 1) and drawn[0]["cmap"] == "RdBu_r"
    drawn.clear()
    view.mode_film(tmp_path / "s.gif", MESH, scalar, frames=4)  # its colours change their sides where a displacement's come back
    for phase, call in zip((1, 0, -1, 0), drawn, strict=True):
        assert call["colour"] == pytest.approx(phase * scalar / 4, abs=1e-15) and not call["displacement"].any()


def test_pictures_of_modes_are_numbered_from_one(tmp_path, monkeypatch):
    asked = []
    for kind in ("mode_picture", "mode_film"):
        monkeypatch.setattr(pictures, kind, lambda path, mesh, mode, *, title: asked.append((path.name, float(mode[0, 1]), title)))
    mode = path()[1]
    written = view.mode_pictures(tmp_path / "all" / "modes", MESH, np.array([mode, 3 * mode]), names=["slow", "fast"])
    assert written == ["mode_01.png", "mode_01.gif", "mode_02.png", "mode_02.gif"] and (tmp_path / "all" / "modes").is_dir()
    assert asked == [("mode_01.png", 2e-3, "mode 1:  slow"), ("mode_01.gif", 2e-3, "mode 1:  slow"),
                     ("mode_02.png", 6e-3, "mode 2:  fast"), ("mode_02.gif", 6e-3, "mode 2:  fast")]


def test_after_the_first_picture_it_is_said_how_long_all_will_take_and_films_can_be_left_out(tmp_path, monkeypatch):
    """A picture takes 2 s, a film twenty times that: of two modes 2 (1 + 20) - 1 = 41 pictures are left then, without films one."""
    clock, said = iter(np.arange(100.0) * 2), []
    monkeypatch.setattr(pictures.time, "perf_counter", lambda: next(clock))
    for kind in ("mode_picture", "mode_film"):
        monkeypatch.setattr(pictures, kind, lambda *given, title: None)
    modes = np.array([path()[1]] * 2)
    view.mode_pictures(tmp_path, MESH, modes, names=["slow", "fast"], say=said.append)
    assert view.mode_pictures(tmp_path, MESH, modes, names=["slow", "fast"], films=False, say=said.append) == ["mode_01.png", "mode_02.png"]
    assert said == ["2 pictures and films of 20 each: about 82 s more", "2 pictures: about 2 s more"]


def test_a_facet_has_the_colour_of_most_of_its_nodes(tmp_path, drawn):
    segment = (MESH.points[:, 0] > 0.04).astype(np.int64) + (MESH.points[:, 0] > 0.09)
    view.segment_picture(tmp_path / "s.png", MESH, segment)
    colour = drawn[0]["colour"]
    facets = [facet for part in MESH.surface for facet in part]
    assert colour.shape == (len(facets), 3) and drawn[0]["size"][0] == 1200
    # hue 0, 0.618 and 0.236 of the circle; saturation 0.45 and 0.75 by turns; value 0.92
    palette = [(0.92, 0.506, 0.506), (0.23, 0.43125, 0.92), (0.7476, 0.92, 0.506)]
    for facet, found in zip(facets, colour, strict=True):
        counts = np.bincount(segment[facet], minlength=3)
        if np.count_nonzero(counts == counts.max()) == 1:
            assert found == pytest.approx(palette[counts.argmax()], abs=0.01)


@pytest.mark.parametrize(("film", "frames", "seconds"), [(pictures.film, 60, 6.0), (flow.flow_film, 60, 6.0),
                                                         (pictures.mode_film, 20, 1.6)])
def test_films_that_nobody_says_more_of_have_sixty_pictures_in_six_seconds_and_periods_twenty(film, frames, seconds):
    given = inspect.signature(film).parameters
    assert (given["frames"].default, given["seconds"].default) == (frames, seconds)
