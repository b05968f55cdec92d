"""Panels of any outline with round holes: volumes and places worked out on paper, and what cannot be meshed."""

import numpy as np
import pytest

from physics import build_mesh
from physics.mesh.cell import CELLS
from physics.mesh.quality import cell_volumes
from physics.mesh.shapes.graded import quality
from physics.scene import Scene, read_body, read_scene
from physics.schema import InputError

SQUARE = {"outline": [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]], "holes": [[0.05, 0.05, 0.02]], "height": 0.01}
ANGLE = [[0.0, 0.0], [0.4, 0.0], [0.4, 0.1], [0.15, 0.1], [0.15, 0.3], [0.0, 0.3]]


def body(**keys):
    table = {"shape": "panel", "outline": ANGLE, "height": 0.02, "cell_size": 0.02} | keys
    return read_body({"body": {key: value for key, value in table.items() if value is not None}})


def volumes(mesh):
    a, b, c, d = (mesh.points[mesh.cells[:, k]] for k in range(4))
    return np.einsum("ci,ci->c", np.cross(b - a, c - a), d - a) / 6


def test_a_panel_fills_its_outline_without_its_holes():
    """The angle has 0.4 x 0.1 + 0.15 x 0.2; a hole of 2 pi 0.03 / 0.02 = 9 nodes is a polygon of that many corners."""
    mesh = build_mesh(body(holes=[[0.07, 0.2, 0.03]]))
    hole = 9 / 2 * np.sin(2 * np.pi / 9) * 0.03**2
    assert mesh.cell == "tetrahedron" and volumes(mesh).min() > 0
    assert volumes(mesh).sum() == pytest.approx(0.02 * (0.07 - hole), rel=1e-12)
    assert len(np.unique(mesh.points[:, 2])) == 3 and mesh.points[:, 2].max() == 0.02  # two layers unless said otherwise
    outer = np.unique(np.sort(np.concatenate([mesh.cells[:, f] for f in ([0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3])]), axis=1), axis=0,
                      return_counts=True)[1]
    assert set(outer) == {1, 2}  # no crack between the layers, nor between two prisms
    assert (outer == 1).sum() == sum(len(facets) for facets in mesh.surface)


def test_places_are_the_sides_in_the_order_given_whichever_way_it_runs():
    for outline in (ANGLE, ANGLE[::-1]):
        mesh = build_mesh(body(outline=outline, holes=[[0.07, 0.2, 0.03]]))
        for k, (a, b) in enumerate(zip(outline, outline[1:] + outline[:1], strict=True)):
            nodes = mesh.points[mesh.places[f"edge-{k + 1}"]]
            way, along = np.subtract(b, a), nodes[:, :2] - a
            assert abs(along @ [-way[1], way[0]]).max() < 1e-12 and len(nodes) == 3 * (round(np.hypot(*way) / 0.02) + 1)
            assert (along @ way / (way @ way)).min() == pytest.approx(0) and (along @ way / (way @ way)).max() == pytest.approx(1)
        rim = mesh.points[mesh.places["hole-1"]]
        assert np.hypot(*(rim[:, :2] - [0.07, 0.2]).T) == pytest.approx(0.03) and len(rim) == 27
        assert set(mesh.points[mesh.places["z-max"], 2]) == {0.02} and len(mesh.places["z-max"]) == len(mesh.points) / 3


def test_triangles_are_near_to_equilateral_and_of_the_size_asked_for():
    mesh = build_mesh(body(cell="prism", layers=1, cell_size=0.01, holes=[[0.07, 0.2, 0.03], [0.3, 0.05, 0.02]]))
    triangles = mesh.cells[:, :3]
    assert mesh.cell == "prism" and mesh.cells.shape[1] == CELLS["prism"].corners
    found = quality(mesh.points[:, :2], triangles)
    assert found.min() > 0.5 and found.mean() > 0.93
    sides = np.linalg.norm(mesh.points[triangles] - mesh.points[np.roll(triangles, 1, axis=1)], axis=2)
    assert np.median(sides) == pytest.approx(0.01, rel=0.08)


def test_a_panel_is_the_same_each_time_and_comes_back_from_its_scene():
    table = {"body": {"shape": "panel", "outline": ANGLE, "height": 0.02, "cell_size": 0.03, "holes": [[0.07, 0.2, 0.03]]},
             "material": {"young_modulus": 1e6, "poisson_ratio": 0.3}, "support": [{"where": "hole-1"}, {"where": "edge-2"}]}
    scene = read_scene(table)
    again = Scene.from_toml(scene.to_toml())
    assert again == scene and np.array_equal(build_mesh(again.body).points, build_mesh(scene.body).points)
    assert scene.body.extent == (0.4, 0.3, 0.02) and scene.body.divisions == (13, 10, 2) and scene.body.cell == "tetrahedron"


@pytest.mark.parametrize("keys, words", [
    ({"outline": None}, "body.outline: missing"), ({"height": None}, "body.height: missing"),
    ({"cell_size": None}, "body.cell_size: missing"),
    ({"outline": [[0, 0], [1, 0]]}, "must have three points at least"), ({"outline": [[0, 0], [1, 0], [0, 0]]}, "each another one"),
    ({"outline": [[0, 0], [1, 0], [2, 0]]}, "has no width"), ({"cell": "hexahedron"}, "a panel has tetrahedron or prism cells"),
    ({"holes": [[0.05, 0.05, 0.0]]}, "a radius above 0"), ({"length": 1.0}, "body.length: a panel takes outline, holes"),
    ({"layers": 0}, "must be at least 1"), ({"cell": "prism", "order": 2}, "prisms are of first order only")])
def test_what_a_panel_takes_and_refuses(keys, words):
    with pytest.raises(InputError, match=words):
        body(**keys)


@pytest.mark.parametrize("keys, words", [
    ({"outline": [[0, 0], [1, 1], [1, 0], [0, 1]], "cell_size": 0.1}, "its sides 1 and 3 meet"),
    ({"holes": [[0.3, 0.2, 0.01]]}, r"holes\[0\]: does not lie within"),
    ({"holes": [[0.07, 0.05, 0.08]]}, r"holes\[0\]: does not lie within"),
    ({"holes": [[0.05, 0.05, 0.02], [0.08, 0.05, 0.02]]}, r"holes\[1\]: meets holes\[0\]"),
    ({"holes": [[0.07, 0.05, 0.0495]]}, "do not fit this outline and these holes"), ({"cell_size": 2e-4}, "nodes; at most")])
def test_what_cannot_be_meshed_is_refused_in_one_line(keys, words):
    with pytest.raises(InputError, match=words):
        build_mesh(body(**keys))


def test_cells_of_second_order_are_round_at_a_hole():
    """Eight arcs, each a parabola through its ends and its middle: two thirds of chord times rise more than the polygon."""
    flat, curved = (build_mesh(body(**SQUARE, order=order)) for order in (1, 2))
    rim = curved.points[curved.places["hole-1"]]
    np.testing.assert_allclose(np.hypot(*(rim[:, :2] - 0.05).T), 0.02, rtol=1e-12)
    assert len(rim) == 16 * 5  # and in five heights, the middles of two layers' among them
    chord, rise, polygon = 2 * 0.02 * np.sin(np.pi / 8), 0.02 * (1 - np.cos(np.pi / 8)), 4 * 0.02**2 * np.sin(np.pi / 4)
    volumes = [cell_volumes(mesh.points, mesh.cells, mesh.cell).sum() / 0.01 for mesh in (flat, curved)]
    assert volumes == pytest.approx([0.1**2 - polygon, 0.1**2 - polygon - 8 * 2 / 3 * chord * rise], rel=1e-12)


def test_where_round_sides_would_turn_a_cell_over_they_stay_straight_and_it_is_said():
    """A hole 4 mm from an edge between cells of 45 mm: two of eight arcs, of five sides each in two layers, stay chords."""
    near = SQUARE | {"holes": [[0.024, 0.05, 0.02]], "cell_size": 0.045, "order": 2}
    mesh, flat = build_mesh(body(**near)), build_mesh(body(**near | {"order": 1}))
    assert mesh.remarks == ("10 sides of cells on holes are left straight: curved they would turn cells over; take another cell_size",)
    chord, rise = 2 * 0.02 * np.sin(np.pi / 8), 0.02 * (1 - np.cos(np.pi / 8))
    assert cell_volumes(mesh.points, mesh.cells, mesh.cell).sum() == pytest.approx(
        volumes(flat).sum() - 0.01 * 6 * 2 / 3 * chord * rise, rel=1e-12)
    assert not flat.remarks and not build_mesh(body(**SQUARE, order=2)).remarks
