"""The mesh that a flow is computed on, and the one that its frames are stored on, counted on few cells."""

from dataclasses import replace

import meshio
import numpy as np
import pytest

from physics.flow.space import FlowSpace
from physics.flow.stored import MIDDLE, computed_mesh, stored
from physics.mesh.build import build_mesh
from physics.scene import Body
from physics.scene.flow import FlowScene, Fluid
from physics.schema import InputError
from tests.flows import channel_flow


def scene_of(body, order=None):
    return FlowScene(body=body, fluid=Fluid(density=1.0, viscosity=1.0, order=order))


def plate(x, y, order):
    return scene_of(Body(shape="plate", length=3.0, width=2.0, cells=(x, y), cell="triangle"), order)


@pytest.mark.parametrize("cells, order, triangles", [((5, 4), 3, 2 * 3 * 2), ((1, 2), 3, 2 * 1 * 1), ((5, 4), 2, 2 * 5 * 4)])
def test_of_order_three_a_plate_has_half_as_many_cells_rounded_up(cells, order, triangles):
    assert len(computed_mesh(plate(*cells, order)).cells) == triangles


def test_of_order_three_a_channel_has_cells_twice_as_large_around_the_hole_too():
    body = channel_flow().body
    large = replace(body, cell_size=2 * body.cell_size, hole_cell_size=2 * body.hole_cell_size)
    for order, wanted in ((3, large), (2, body)):
        np.testing.assert_array_equal(computed_mesh(scene_of(body, order)).points, build_mesh(wanted).points)
    assert len(build_mesh(large).points) < len(build_mesh(body).points) / 2


def test_a_file_is_computed_on_as_it_is_with_curved_sides_and_stored_at_its_vertices(tmp_path):
    """One triangle of second order, a middle node 0.1 m outside: the cell is curved, the stored one straight."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, -0.1, 0], [0.5, 0.5, 0], [0, 0.5, 0]])
    meshio.write(tmp_path / "a.vtu", meshio.Mesh(points, [("triangle6", np.arange(6)[None])]))
    scene = scene_of(Body(shape="file", path=str(tmp_path / "a.vtu")))
    mesh = computed_mesh(scene)
    assert (len(mesh.points), mesh.cell) == (3, "triangle") and mesh.middles
    for order in (2, 3):
        where = stored(scene_of(scene.body, order), FlowSpace(mesh, order))
        assert not where.halved and not where.mesh.middles
        np.testing.assert_array_equal(where.mesh.points, mesh.points)


def test_a_file_of_other_cells_is_refused(tmp_path):
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    meshio.write(tmp_path / "a.vtu", meshio.Mesh(points, [("quad", np.arange(4)[None])]))
    with pytest.raises(InputError, match=r"^body\.path: a mesh of cells of the kind quadrilateral; a flow is in a plane domain of"):
        computed_mesh(scene_of(Body(shape="file", path=str(tmp_path / "a.vtu"))))


@pytest.mark.parametrize("order", (2, 3))
def test_velocities_are_stored_at_vertices_and_the_middles_of_edges_and_pressures_at_all_nodes_in_pascal(order):
    """Of order 3 the cubic's value in the middle is (-a + 9 b + 9 c - d) / 16 of its nodes in a row."""
    scene = plate(4, 2, order)
    space = FlowSpace(computed_mesh(scene), order)
    where = stored(scene, space)
    assert where.halved == (order == 3)
    np.testing.assert_array_equal(16 * MIDDLE, [-1, 9, 9, -1])

    def cubic(x, y):
        return np.stack([x**3 - 2 * x * y**2, y**3 + x**2 * y - x], axis=1)

    x, y = where.mesh.points[:, :2].T
    found = where.velocity(cubic(*space.velocity.points.T))
    assert found.dtype == np.float32 and found.shape == (len(x), 3) and not found[:, 2].any()
    np.testing.assert_allclose(found[:, :2], cubic(x, y), atol=1e-6 * abs(found).max())
    p = space.pressure.points @ [2.0, -3.0]
    pressure = where.pressure(p, 1000.0)
    assert pressure.dtype == np.float32 and pressure.shape == (len(x), 1)
    np.testing.assert_allclose(pressure[:, 0], 1000 * (2 * x - 3 * y), rtol=1e-6, atol=1e-4)


def test_every_cell_is_cut_into_four_alike_and_places_gain_the_middles_of_their_outer_edges():
    """2 x 1 rectangles of 1.5 x 2 m in two: 16 triangles of 0.375 m2 on 5 x 3 nodes; an inner edge between corners of "all" adds none."""
    scene = plate(4, 2, 3)
    mesh = computed_mesh(scene)
    mesh = replace(mesh, points=mesh.points - mesh.points.min(axis=0),
                   places=mesh.places | {"all": np.arange(6), "corner": np.array([0])})
    where = stored(scene, FlowSpace(mesh, 3))
    assert (len(where.mesh.points), len(where.mesh.cells), where.mesh.cell) == (15, 16, "triangle")
    a, b, c = where.mesh.points[where.mesh.cells][..., :2].transpose(1, 0, 2)
    np.testing.assert_allclose((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0], np.full(16, 0.75), rtol=1e-12)
    for k in range(4):  # the quarters of a cell have its corners' and its edges' middles, the last the middles alone
        corners = mesh.points[mesh.cells][..., :2]
        quarter = where.mesh.points[where.mesh.cells[4 * k:4 * k + 4]][..., :2]
        middles = (corners + np.roll(corners, -1, axis=1)) / 2
        if k < 3:
            np.testing.assert_allclose(quarter[:, 0], corners[:, k], atol=1e-12)
            np.testing.assert_allclose(quarter.mean(axis=1), (corners[:, k] + middles[:, k] + middles[:, k - 1]) / 3, atol=1e-12)
        else:
            np.testing.assert_allclose(quarter.mean(axis=1), corners.mean(axis=1), atol=1e-12)
    x, y = np.round(where.mesh.points[:, :2], 12).T
    for name, on in (("x-min", x == 0), ("x-max", x == 3), ("y-min", y == 0), ("y-max", y == 2)):
        np.testing.assert_array_equal(where.mesh.places[name], np.flatnonzero(on))
    np.testing.assert_array_equal(where.mesh.places["all"], np.flatnonzero((x % 3 == 0) | (y % 2 == 0)))
    assert where.mesh.places["corner"].tolist() == [0]
