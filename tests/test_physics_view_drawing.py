"""What VTK is told: where the camera stands and how much it sees, which light falls from where, which surfaces and edges are drawn."""

from types import SimpleNamespace

import numpy as np
import pytest

from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.scene import Body
from physics.view import drawing
from tests.tools import ball

MESH = build_mesh(Body(length=0.1, width=0.02, height=0.03, cells=(2, 1, 1)))
EYE = np.array([0.0, -0.6, 0.8])


@pytest.fixture
def told(monkeypatch):
    """Calls of a plotter, by name, whose picture has four channels that count up."""
    calls = {}

    class Plotter:
        def __init__(self, **given):
            calls["made"], self.camera = given, SimpleNamespace()
            calls["plotter"] = self

        def __getattr__(self, name):
            return lambda *given, **more: calls.setdefault(name, []).append((given, more))

        def screenshot(self, *given, **more):
            return np.arange(24, dtype=np.uint8).reshape(2, 3, 4)

    monkeypatch.setattr(drawing.pv, "Plotter", Plotter)
    monkeypatch.setattr(drawing.pv, "Light", lambda **given: given)
    return calls


def drawn(camera, size, **more):
    moved, colour = np.full_like(MESH.points, 1e-3), np.arange(float(len(MESH.points)))
    return drawing.draw(MESH, moved, colour, (2.0, 5.0), "viridis", camera, size, **more)


@pytest.mark.parametrize(("half", "scale"), [((0.06, 0.02), 0.06 / 4), ((0.06, 0.01), 0.06 / 4), ((0.02, 0.03), 0.03)])
def test_the_camera_stands_far_off_in_the_eyes_direction_and_sees_all(told, half, scale):
    """A picture four times as wide as high: half of what is seen is its height, unless its width asks for more."""
    camera = drawing.Camera(np.array([1.0, 2, 3]), *half, EYE)
    picture = drawn(camera, (400, 100))
    away = 10 * sum(half)
    (place, focus, up), seen = told["plotter"].camera_position, told["plotter"].camera
    assert place == pytest.approx([1, 2 - 0.6 * away, 3 + 0.8 * away]) and focus == pytest.approx([1, 2, 3])
    assert up == pytest.approx([0, 0.8, 0.6])  # across to the eye, and upwards
    assert seen.parallel_scale == pytest.approx(max(scale, half[1])) and seen.clipping_range == pytest.approx((0.01 * away, 3 * away))
    assert told["made"] == {"off_screen": True, "window_size": [400, 100], "lighting": "none"}
    assert told["set_background"] == [(("white",), {})]
    assert told["enable_parallel_projection"] == [((), {})] and told["close"] == [((), {})]
    assert np.array_equal(picture, np.arange(24).reshape(2, 3, 4)[:, :, :3])


def test_light_comes_from_the_eye_and_from_above(told):
    drawn(drawing.Camera(np.zeros(3), 1.0, 1.0, EYE), (10, 10))
    (((head,), _), ((lamp,), _)) = told["add_light"]
    assert head["light_type"] == "headlight" and 0 < head["intensity"] <= 1
    assert (lamp["position"], lamp["focal_point"], lamp["light_type"]) == ((0, 0, 1), (0, 0, 0), "scene light")


def test_a_body_is_coloured_by_its_nodes_or_its_facets_and_has_its_edges(told):
    camera = drawing.Camera(np.zeros(3), 1.0, 1.0, EYE)
    ball = drawing.ObstacleSurface(np.eye(3), np.array([[0, 1, 2]]))
    drawn(camera, (10, 10), outline=np.full_like(MESH.points, 2.0), obstacle=ball)
    (((body,), how), ((lines,), _), ((rigid,), _)) = told["add_mesh"]
    assert np.asarray(body.points) == pytest.approx(MESH.points + 1e-3) and how["clim"] == (2, 5) and how["cmap"].name == "viridis"
    assert np.array_equal(body.point_data["colour"], np.arange(len(MESH.points))) and how["scalars"] == "colour" and "rgb" not in how
    assert how["show_edges"] and not how["show_scalar_bar"]
    assert np.asarray(lines.points) == pytest.approx(MESH.points + 2) and lines.n_lines == 4 * 2 + 8  # of a box of two cells
    assert np.array_equal(rigid.points, np.eye(3)) and rigid.faces.tolist() == [3, 0, 1, 2]
    told.clear()
    colours = np.zeros((sum(map(len, MESH.surface)), 3))
    drawing.draw(MESH, 0 * MESH.points, colours, (0, 1), "viridis", camera, (10, 10))
    (((body,), how),) = told["add_mesh"]
    assert how["rgb"] and "clim" not in how and np.array_equal(body.cell_data["colour"], colours) and "colour" not in body.point_data


@pytest.mark.parametrize(("angle", "edges"), [(39.0, 0), (41.0, 1)])
def test_an_edge_is_where_facets_meet_at_more_than_forty_degrees(angle, edges):
    """Two squares side by side, one turned up: their rims are edges too, of a sheet; the edge between them if it is sharp."""
    turn = np.radians(angle)
    row = np.array([[0, 0, 0], [1, 0, 0], [1 + np.cos(turn), 0, np.sin(turn)]])
    sheet = Mesh(np.concatenate([row, row + [0, 1, 0]]), np.array([[0, 1, 4, 3], [1, 2, 5, 4]]), "quadrilateral", {})
    found = {tuple(sorted(pair)) for pair in drawing.feature_edges(sheet).tolist()}
    assert found == {(0, 1), (1, 2), (3, 4), (4, 5), (0, 3), (2, 5)} | ({(1, 4)} if edges else set())


def test_the_edges_of_a_box_are_its_twelve_and_have_the_numbers_of_all_nodes():
    box = build_mesh(Body(length=0.1, width=0.02, height=0.03, cells=(3, 2, 2), cell="hexahedron"))
    ends = box.points[drawing.feature_edges(box)]
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum() == pytest.approx(4 * 0.15) and len(ends) == 4 * (3 + 2 + 2)
    at_end = (np.isclose(ends, 0) | np.isclose(ends, [0.1, 0.02, 0.03])).sum(axis=2)
    assert (at_end >= 2).all()
    points, triangles = ball(1.0, 0.3)  # a round one has none
    cells = np.column_stack([triangles, np.full(len(triangles), len(points))])
    whole = Mesh(np.concatenate([points, [[0, 0, 0]]]), cells, "tetrahedron", {})
    assert drawing.feature_edges(whole).shape == (0, 2)


def test_a_plate_is_one_twice_as_wide_as_high_and_wider_than_a_quarter_of_its_length():
    def eye(length, width, height):
        corners = np.array([[x, y, z] for x in (0, length) for y in (0, width) for z in (0, height)])
        return drawing.eye_for(Mesh(corners, np.array([[0, 1, 2, 4]]), "tetrahedron", {}))

    plate = np.array([-0.35, -1.0, 0.8]) / np.sqrt(0.35**2 + 1 + 0.64)
    beam = np.array([-0.12, -1.0, 0.36]) / np.sqrt(0.12**2 + 1 + 0.36**2)
    for length, width, height, flat in ((1, 0.26, 0.12, True), (1, 0.26, 0.131, False), (1, 0.24, 0.01, False), (1, 0.9, 0.44, True)):
        assert eye(length, width, height) == pytest.approx(plate if flat else beam)


def test_the_axes_of_a_view_are_across_and_up():
    for eye in (EYE, np.array([0.6, -0.48, 0.64]), np.array([0.0, np.sqrt(1 - 0.998**2), 0.998])):
        right, up = drawing._axes_of_view(eye)
        assert right[2] == 0 and up[2] > 0 and np.cross(right, up) == pytest.approx(eye) and np.linalg.norm(right) == pytest.approx(1)
    assert drawing._axes_of_view(np.array([np.sqrt(1 - 0.9995**2), 0.0, 0.9995]))[0] == pytest.approx([1, 0, 0])  # as good as from above


def test_the_camera_holds_body_and_near_obstacle():
    assert drawing.TOWARDS_EYE @ drawing.TOWARDS_EYE == pytest.approx(1) and drawing.TOWARDS_EYE[1] < 0 < drawing.TOWARDS_EYE[2]
    right, up = drawing._axes_of_view(np.array([0.0, -1.0, 0.0]))
    assert right == pytest.approx([1, 0, 0]) and up == pytest.approx([0, 0, 1])  # x to the right, z up
    right, up = drawing._axes_of_view(np.array([0.0, 0.0, 1.0]))
    assert right == pytest.approx([1, 0, 0]) and up == pytest.approx([0, 1, 0])
    front = np.array([0.0, -1.0, 0.0])
    box = np.array([[1.0, 2, 3], [5, 3, 4]])
    camera = drawing.fit([box[:1], box[1:]], None, front)
    assert camera.centre == pytest.approx([3, 2.5, 3.5]) and (camera.half_width, camera.half_height) == pytest.approx((2.12, 0.53))
    assert np.array_equal(camera.eye, front)
    # Half the extent, 2, around the box: a point 1.9 above is seen, one 2.1 above, or to any side, is not.
    for away, top in (
            ([3, 2, 5.9], 5.9), ([3, 2, 6.1], 4.0), ([7.1, 2, 5], 4.0), ([-1.1, 2, 5], 4.0), ([3, 5.1, 5], 4.0), ([3, 2, 0.9], 4.0)):
        camera = drawing.fit([box], drawing.ObstacleSurface(np.array([away]), np.zeros((0, 3), int)), front)
        assert camera.half_height == pytest.approx(1.06 * (top - 3) / 2) and camera.centre[2] == pytest.approx((top + 3) / 2)
    camera = drawing.Camera(np.zeros(3), 2.0, 1.0, front)
    assert drawing.panel_size(camera, 1) == (1200, 600) and drawing.panel_size(camera, 2) == (600, 300)
    tall, flat = drawing.Camera(np.zeros(3), 1.0, 3.0, front), drawing.Camera(np.zeros(3), 9.0, 1.0, front)
    assert drawing.panel_size(tall, 1) == (1200, 720) and drawing.panel_size(tall, 2) == (600, 480)
    assert drawing.panel_size(flat, 1) == (1200, 300) and drawing.panel_size(flat, 2) == (600, 150)
    assert np.array_equal(drawing.eye_for(MESH), drawing.TOWARDS_EYE)
    plate = build_mesh(Body(shape="plate", length=0.1, width=0.06, height=0.02, cells=(1, 1, 1)))
    assert drawing.eye_for(plate) == pytest.approx(np.array([-0.35, -1, 0.8]) / np.linalg.norm([0.35, 1, 0.8]))
    sheet = build_mesh(Body(shape="plate", length=0.1, width=0.06, cells=(1, 1), cell="triangle"))
    assert drawing.eye_for(sheet) == pytest.approx([0, 0, 1])
    for width, height in ((0.06, 0.031), (0.024, 0.005)):  # not twice as wide as high; not wider than a quarter of its length
        slim = build_mesh(Body(length=0.1, width=width, height=height, cells=(1, 1, 1)))
        assert np.array_equal(drawing.eye_for(slim), drawing.TOWARDS_EYE)


def test_polygons_are_listed_with_their_number_of_nodes():
    assert drawing._faces([np.array([[4, 5, 6]]), np.array([[0, 1, 2, 3], [7, 8, 9, 1]])]).tolist() == [
        3, 4, 5, 6, 4, 0, 1, 2, 3, 4, 7, 8, 9, 1]
    rigid = drawing.ObstacleSurface(np.arange(18.0).reshape(2, 3, 3), np.array([[0, 1, 2]]))
    assert np.array_equal(rigid.at(1).points, rigid.points[1]) and np.array_equal(rigid.at(1).triangles, rigid.triangles)
    assert rigid.at(1).at(0) is not rigid and np.array_equal(rigid.at(1).at(5).points, rigid.points[1])


def test_the_outline_is_blue_where_the_truth_is_and_the_obstacle_grey():
    """Drawn for once: a body of one colour, the truth's edges 15 mm above it, an obstacle 15 mm below, seen from the front."""
    front, still = np.array([0.0, -1.0, 0.0]), np.zeros_like(MESH.points)
    camera = drawing.Camera(np.array([0.05, 0.01, 0.015]), 0.06, 0.06, front)
    square = drawing.ObstacleSurface(np.array([[0.03, 0.0, -0.03], [0.07, 0.0, -0.03], [0.07, 0.0, -0.015], [0.03, 0, -0.015]]),
                           np.array([[0, 1, 2], [0, 2, 3]]))
    picture = drawing.draw(MESH, still, np.linspace(5, 6, len(still)), (0, 5), "YlOrRd", camera, (120, 120), obstacle=square,
                         outline=still + [0, 0, 0.035]).astype(int)
    assert picture.shape == (120, 120, 3)

    def at(x, z):  # 1 mm a pixel
        return picture[round(1e3 * (0.075 - z)), round(1e3 * (x + 0.01))]

    assert (at(-0.005, 0.015) == 255).all() and (at(0.105, 0.015) == 255).all()
    red, green, blue = at(0.03, 0.012)
    assert red > 80 and green < 40 and blue < 70  # the top of the scale
    grey = at(0.05, -0.022)
    assert np.ptp(grey) < 12 and 120 < grey.mean() < 240
    assert (at(0.05, 0.05) == 255).all()  # inside of the outline
    blues = (picture[..., 2] - picture[..., 0] > 60).nonzero()
    assert len(blues[0]) > 100
    # The outline's box: from 35 to 65 mm high, 0 to 100 mm along.
    assert np.ptp(blues[0]) == pytest.approx(30, abs=2) and np.ptp(blues[1]) == pytest.approx(100, abs=2)
    assert blues[0].min() == pytest.approx(75 - 65, abs=2)


@pytest.mark.parametrize("value", [0.1, 0.35, 0.5, 0.8])
def test_a_plane_body_has_the_colours_of_its_scale(value):
    """Red, green and blue of the scale, but for the lines between cells; a lit one would be up to 1.3 times as bright, and clipped."""
    from matplotlib import colormaps

    mesh = build_mesh(Body(shape="plate", length=0.2, width=0.1, cells=(2, 1), cell="quadrilateral"))
    camera = drawing.fit([mesh.points], None, np.array([0.0, 0.0, 1.0]))
    picture = drawing.draw(mesh, 0 * mesh.points, np.full(len(mesh.points), value), (0.0, 1.0), "RdBu", camera, (200, 100))
    middle = np.median(picture[30:70, 20:80].reshape(-1, 3), axis=0)
    assert middle == pytest.approx(255 * np.array(colormaps["RdBu"](value)[:3]), abs=3)  # 256 colours, and the half of one
