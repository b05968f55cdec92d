"""Where panels, names, title and colour bar stand on a page, in pixels; how long pictures of a film stand, and in which colours."""

import errno

import numpy as np
import pytest
from matplotlib import colormaps
from PIL import Image

from physics.mesh.build import build_mesh
from physics.scene import Body
from physics.view import drawing, flow, pictures
from physics.view.page import DPI, Page, write_film
from tests.full_disk import full_after

GREY = np.full((90, 200, 3), 128, np.uint8)  # 200 wide, 90 high


def in_pixels(axes, figure):
    """(left, bottom, width, height) of axes."""
    return np.array(axes.get_position().bounds) * np.tile(figure.get_size_inches() * figure.dpi, 2)


def test_a_page_has_room_for_its_title_above_and_its_colour_bar_below():
    page = Page([GREY, GREY], ("one", "other"), (-2.0, 6.0), "viridis", "size [mm]")
    assert DPI == page.figure.dpi == 100 and page.figure.get_size_inches() * DPI == pytest.approx([400, 90 + 76 + 74])
    left, right, bar = page.figure.axes
    assert in_pixels(left, page.figure) == pytest.approx([0, 74, 200, 90])
    assert in_pixels(right, page.figure) == pytest.approx([200, 74, 200, 90])
    assert in_pixels(bar, page.figure) == pytest.approx([0.3 * 400, 46, 0.4 * 400, 12])
    assert not left.axison and bar.get_xlabel() == "size [mm]" and bar.get_xlim() == (-2, 6)
    said = {text.get_text(): np.array(text.get_position()) * [400, 240] for text in page.figure.texts}
    assert said["one"] == pytest.approx([100, 240 - 66]) and said["other"] == pytest.approx([300, 240 - 66])
    assert said[""] == pytest.approx([200, 240 - 30]) and all(text.get_ha() == "center" for text in page.figure.texts)
    alone = Page([GREY], ("",), (0.0, 1.0), "viridis", "")
    assert in_pixels(alone.figure.axes[0], alone.figure) == pytest.approx([0, 74, 200, 90])


def test_a_page_is_filled_again_with_each_frame():
    page = Page([GREY, GREY], ("", ""), (0.0, 1.0), "viridis", "")
    for shades in ((30, 200), (250, 5)):
        shown = np.asarray(page.show([np.full_like(GREY, shade) for shade in shades], f"step {shades[0]}"))
        assert shown.shape == (240, 400, 3) and page.title.get_text() == f"step {shades[0]}"
        assert (shown[80:160, 5:195] == shades[0]).all() and (shown[80:160, 205:395] == shades[1]).all()
    with pytest.raises(ValueError, match="zip"):
        page.show([GREY], "")


def test_a_film_runs_for_ever_and_has_its_colours_from_all_of_it(tmp_path):
    """Nine pictures, each of one colour: the palette is of the 1st, 3rd, 5th, 7th and 9th; those between take what is nearest of it."""
    red, green, blue, white, black = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255), (0, 0, 0)
    colours = [red, (235, 235, 235), green, (235, 0, 0), blue, (20, 20, 20), white, (0, 235, 0), black]
    frames = [Image.new("RGB", (8, 6), colour) for colour in colours]
    write_film(tmp_path / "new" / "film.gif", frames, [*(100 + 10 * k for k in range(8)), 1000])
    film = Image.open(tmp_path / "new" / "film.gif")
    assert film.n_frames == 9 and film.info["loop"] == 0
    for k, colour in enumerate([red, white, green, red, blue, black, white, green, black]):
        film.seek(k)
        assert film.info["duration"] == (1000 if k == 8 else 100 + 10 * k)
        assert (np.asarray(film.convert("RGB")) == colour).all()
    write_film(tmp_path / "film.gif", frames[:2], [50, 60])  # of few pictures it is of all
    film = Image.open(tmp_path / "film.gif")
    assert (np.asarray(film.convert("RGB")) == red).all()
    film.seek(1)
    assert (np.asarray(film.convert("RGB")) == (235, 235, 235)).all()


MESH = build_mesh(Body(shape="plate", length=2.0, width=1.0, cells=(2, 1), cell="triangle"))


@pytest.fixture
def drawn(monkeypatch):
    calls = []

    def draw(mesh, displacement, colour, limits, cmap, camera, size, **more):
        calls.append((displacement, colour, limits, cmap, camera, size, more))
        return np.full((size[1], size[0], 3), 10 * len(calls) % 250, np.uint8)

    monkeypatch.setattr(flow, "draw", draw)
    monkeypatch.setattr(pictures, "draw", draw)
    monkeypatch.setattr(drawing, "WIDTH", 200)
    return calls


@pytest.fixture
def titles(monkeypatch):
    said, show = [], Page.show
    monkeypatch.setattr(Page, "show", lambda self, panels, title: (said.append(title), show(self, panels, title))[1])
    return said


def turning(frames):
    """(T, N, 3) [m/s] of a fluid that turns at t radians a second about the origin in frame t: its vorticity is 2 t."""
    return np.arange(frames)[:, None, None] * np.stack([-MESH.points[:, 1], MESH.points[:, 0], 0 * MESH.points[:, 0]], axis=1)


def test_a_film_of_a_flow_has_evenly_spread_frames_and_stands_still_at_the_end(tmp_path, drawn, titles):
    fastest = np.sqrt(5)  # at the corner (2, 1)
    assert flow.flow_film(tmp_path / "a.gif", MESH, turning(8), frames=3, seconds=0.6) == 3
    assert titles == [f"frame {k} of 7:  largest speed {k * fastest:.3g} m/s" for k in (0, 4, 7)]  # 3.5 to the even number
    shown = drawn[-3:]
    top = np.quantile(np.repeat([0.0, 8.0, 14.0], 6), 0.99)
    for (displacement, colour, limits, cmap, _, size, _), k in zip(shown, (0, 4, 7), strict=True):
        assert not displacement.any() and colour == pytest.approx(np.full(6, 2.0 * k)) and cmap == "RdBu_r" and size[0] == 200
        assert limits == (-limits[1], pytest.approx(top))
    film = Image.open(tmp_path / "a.gif")
    assert film.n_frames == 3 and film.info["duration"] == 200
    film.seek(2)
    assert film.info["duration"] == 1000
    drawn.clear()
    titles.clear()
    assert flow.flow_film(tmp_path / "b.gif", MESH, turning(3), truth=2 * turning(3), frames=9, seconds=0.01) == 3
    assert Image.open(tmp_path / "b.gif").info["duration"] == 20 and len(titles) == 3
    assert [call[1][0] for call in drawn[-6:]] == pytest.approx([0, 0, 2, 4, 4, 8])  # beside it the truth, whose colours both have
    assert {call[2][1] for call in drawn} == {np.quantile(np.repeat([0.0, 4.0, 8.0], 6), 0.99)} and {call[5][0] for call in drawn} == {100}


def test_a_picture_of_a_flow_is_of_its_frame(tmp_path, drawn, titles):
    flow.flow_picture(tmp_path / "deep" / "a.png", MESH, turning(5), 3)
    assert titles == [f"frame 3 of 4:  largest speed {3 * np.sqrt(5):.3g} m/s"] and drawn[-1][1] == pytest.approx(np.full(6, 6.0))
    assert Image.open(tmp_path / "deep" / "a.png").width == 200
    flow.flow_picture(tmp_path / "b.png", MESH, 0 * turning(5), 3)
    assert drawn[-1][2] == (-1e-9, 1e-9)


def test_a_still_picture_shows_its_frame_by_the_size_of_its_displacement(tmp_path, drawn, titles):
    moved = np.arange(4)[:, None, None] * np.ones((4, 6, 3)) * [1e-3, 2e-3, 2e-3]
    moved[:, 0] = 0
    ball = drawing.ObstacleSurface(np.arange(36.0).reshape(4, 3, 3), np.array([[0, 1, 2]]))
    pictures.still_picture(tmp_path / "deep" / "a.png", MESH, moved, 2, obstacle=ball)
    displacement, colour, limits, cmap, camera, size, more = drawn[0]
    assert titles == ["step 2 of 3:  largest displacement 6 mm"] and np.array_equal(displacement, moved[2]) and cmap == "viridis"
    assert colour == pytest.approx([0, *5 * [6.0]]) and limits == pytest.approx((0, 6)) and size[0] == 200
    assert np.array_equal(more["obstacle"].points, ball.points[2])
    # What is seen is the body at rest and moved: from x = 0, where a corner stays, to 2.002.
    assert 2 * camera.half_width == pytest.approx(1.06 * 2.002) and camera.centre[:2] == pytest.approx([1.001, 0.502])
    pictures.still_picture(tmp_path / "b.png", MESH, 0 * moved, 0)
    assert drawn[1][2] == (0, 1e-9) and drawn[1][6]["obstacle"] is None


def test_colours_of_the_bar_are_those_of_the_map():
    page = Page([GREY], ("",), (0.0, 1.0), "RdBu_r", "")
    shown = np.asarray(page.show([GREY], ""))
    bar = shown[-52, 60:140].astype(int)  # 46 to 58 above the lower edge, from 0.3 to 0.7 of the width
    for share in (0.1, 0.5, 0.9):
        assert abs(bar[round(80 * share)] - 255 * np.array(colormaps["RdBu_r"](share)[:3])).max() < 12
    assert (shown[-60, 60:140] == 255).all() and (shown[-52, :58] == 255).all() and (shown[-52, 143:] == 255).all()


@pytest.mark.parametrize("name, write", [
    ("film.gif", lambda path: pictures.film(path, MESH, np.zeros((3, 6, 3)))),
    ("mode.gif", lambda path: pictures.mode_film(path, MESH, np.ones((6, 3)))),
    ("flow.gif", lambda path: flow.flow_film(path, MESH, turning(5))),
    ("frame.png", lambda path: pictures.frame_picture(path, MESH, prediction=np.zeros((6, 3)), truth=np.ones((6, 3)), step=1, steps=2)),
    ("still.png", lambda path: pictures.still_picture(path, MESH, np.zeros((3, 6, 3)), 1)),
    ("mode.png", lambda path: pictures.mode_picture(path, MESH, np.ones((6, 3)))),
    ("flow.png", lambda path: flow.flow_picture(path, MESH, turning(5), 3)),
    ("segments.png", lambda path: pictures.segment_picture(path, MESH, np.arange(6)))])
def test_on_a_full_disk_a_picture_is_not_there_and_the_error_says_its_name(tmp_path, drawn, name, write):
    with full_after(20), pytest.raises(OSError) as error:
        write(tmp_path / name)
    assert error.value.filename == str(tmp_path / name) and error.value.errno == errno.EFBIG and not list(tmp_path.iterdir())
    write(tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == [name] and Image.open(tmp_path / name).width >= 100
