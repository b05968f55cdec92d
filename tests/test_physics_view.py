"""Pictures drawn without a display: what must be seen on them is looked for in their pixels."""

import numpy as np
from PIL import Image

from physics import view
from physics.mesh.build import build_mesh
from physics.scene import Body

MESH = build_mesh(Body(length=0.1, width=0.02, height=0.02, cells=(10, 2, 2)))
STEPS = 5


def bent() -> np.ndarray:
    """(T, N, 3) a cantilever that goes down."""
    bent = np.zeros((STEPS + 1, *MESH.points.shape))
    bent[..., 2] = -0.003 * np.arange(STEPS + 1)[:, None] * (MESH.points[:, 0] / 0.1) ** 2
    return bent


def reds(path, half=slice(None)) -> int:
    """Number of dark red pixels, the colour of the largest error, above the colour bar."""
    pixels = np.asarray(Image.open(path).convert("RGB")).astype(int)[:-74, half]
    return int(((pixels[..., 0] > 110) & (pixels[..., 1] < 60) & (pixels[..., 2] < 80)).sum())


def test_the_error_is_seen_on_the_prediction_and_not_on_the_truth(tmp_path):
    truth = bent()[-1]
    wrong = truth.copy()
    wrong[MESH.points[:, 0] > 0.07, 1] += 0.002
    view.frame_picture(tmp_path / "a.png", MESH, prediction=wrong, truth=truth, step=5, steps=5)
    assert Image.open(tmp_path / "a.png").width == 1200
    assert reds(tmp_path / "a.png", slice(0, 600)) > 3000  # a good part of the 600 x 200 pixels of a beam
    assert reds(tmp_path / "a.png", slice(600, None)) == 0
    view.frame_picture(tmp_path / "b.png", MESH, prediction=truth, truth=truth, step=5, steps=5)
    assert reds(tmp_path / "b.png") == 0


def test_an_obstacle_is_grey_and_a_far_one_does_not_shrink_the_body(tmp_path):
    triangle = np.array([[0.05, 0, 0.021], [0.09, 0, 0.021], [0.07, 0, 0.05]])
    picture = {}
    for name, obstacle in {"none": None, "near": view.ObstacleSurface(triangle, np.array([[0, 1, 2]])),
                           "far": view.ObstacleSurface(triangle + [0, 0, 5], np.array([[0, 1, 2]]))}.items():
        view.frame_picture(tmp_path / f"{name}.png", MESH, prediction=bent()[0], truth=bent()[0], step=0, steps=5,
                           obstacle=obstacle)
        picture[name] = np.asarray(Image.open(tmp_path / f"{name}.png"))[:-74]
    assert np.array_equal(picture["none"], picture["far"])
    spread = np.ptp(picture["near"].astype(int), axis=2)
    grey = (spread < 12) & (picture["near"].mean(axis=2) > 90) & (picture["near"].mean(axis=2) < 225)
    assert grey[80:].sum() > 2000


def test_each_segment_has_one_colour_and_the_larger_one_more_of_the_picture(tmp_path):
    view.segment_picture(tmp_path / "s.png", MESH, (MESH.points[:, 0] > 0.075).astype(np.int64))
    pixels = np.asarray(Image.open(tmp_path / "s.png").convert("HSV")).astype(int).reshape(-1, 3)
    hue = pixels[pixels[:, 1] > 60, 0]  # the white around and the dark edges have none
    first, second = (np.abs(hue - 255 * place) <= 4 for place in (0.0, 0.618))  # hues survive light and shadow
    assert (first | second).mean() > 0.95
    assert 2.4 < first.sum() / second.sum() < 4.4  # 7.5 of 10 layers belong to one, its facets at the cut to either; the end shows


def test_a_film_moves(tmp_path):
    count = view.film(tmp_path / "film.gif", MESH, bent(), truth=1.1 * bent(), frames=2, seconds=0.4)
    film = Image.open(tmp_path / "film.gif")
    assert count == film.n_frames == 2 and film.width == 1200
    first = np.asarray(film.convert("RGB"))
    film.seek(1)
    assert (np.asarray(film.convert("RGB")) != first).any()


def test_a_mode_of_any_scale_gives_the_same_picture(tmp_path):
    mode = bent()[1]
    for name, scale in (("a", 1.0), ("b", 1e-3)):
        view.mode_picture(tmp_path / f"{name}.png", MESH, scale * mode, title="mode 1")
    a, b = (np.asarray(Image.open(tmp_path / f"{name}.png")).astype(int) for name in "ab")
    assert a.shape[1] == 600
    assert abs(a - b).max() <= 8  # the last bit of a colour, not the shape
