"""What is given at the boundary of a flow, node by node, and the integrals over the edges through which it leaves, on paper."""

from dataclasses import replace

import numpy as np
import pytest

from physics.flow.conditions import OpenEdges, conditions_of
from physics.flow.space import FlowSpace
from physics.mesh.build import build_mesh
from physics.scene import Body, FlowScene, read_body
from physics.scene.flow import FlowSteps, Fluid, Inflow, Outflow, Wall
from physics.schema import InputError
from tests.flows import rectangle

LENGTH, HEIGHT = 3.0, 2.0
TIMED, STATIONARY = FlowSteps(count=1, duration=4.0), FlowSteps(stationary=True)


def scene_of(steps=TIMED, **what):
    body = Body(shape="plate", length=1.0, width=1.0, cells=(2, 2))
    return FlowScene(body=body, fluid=Fluid(density=1.0, viscosity=1.0), steps=steps, **what)


def plate(cells):
    """3 x 2 m from the origin on, rectangles cut in two."""
    mesh = build_mesh(Body(shape="plate", length=LENGTH, width=HEIGHT, cells=cells, cell="triangle"))
    return replace(mesh, points=mesh.points - mesh.points.min(axis=0))


def box(order=2):
    return FlowSpace(plate((3, 2)), order)


def given(space, found, time):
    """(N, 2) the velocity of each node, not a number where none is given."""
    values = np.full((len(space.velocity.points), 2), np.nan)
    values[found.fixed] = found.values(time)
    return values


@pytest.mark.parametrize("order", (2, 3))
def test_every_node_of_the_boundary_has_what_its_side_says_and_corners_what_counts_more(order):
    """In from the left, out to the right, a wall at rest below and one that moves above, itself before the inflow."""
    space = box(order)
    found = conditions_of(scene_of(inflow=(Inflow(where="x-min", speed=1.5, profile="uniform"),), outflow=(Outflow(where="x-max"),),
                                   wall=(Wall(where="y-max", velocity=(0.7, 0.0)),)), space)
    x, y = np.round(space.velocity.points, 12).T
    wanted = np.full((len(x), 2), np.nan)
    wanted[x == 0] = 1.5, 0.0
    wanted[y == HEIGHT] = 0.7, 0.0
    wanted[y == 0] = 0.0, 0.0
    np.testing.assert_array_equal(given(space, found, 0.3), wanted)
    assert found.source is None
    ends = space.mesh.points[found.open][..., :2]  # two edges on the right, the fluid on their left: upwards
    np.testing.assert_array_equal(ends[np.argsort(ends[:, 0, 1])], [[[3, 0], [3, 1]], [[3, 1], [3, 2]]])


def test_of_two_inflows_that_meet_the_later_one_has_the_corner_and_each_its_own_factor():
    """From the left half of 1.5 m/s after 2 s of a ramp of 4 s; from below, where it points up, the factor 0.25 at half of the duration."""
    space = box()
    found = conditions_of(scene_of(inflow=(Inflow(where="x-min", speed=1.5, profile="uniform", ramp=4.0),
                                           Inflow(where="y-min", speed=2.0, profile="uniform", steps=(0.0, 1.0), factor=(0.0, 0.5))),
                                   outflow=(Outflow(where="x-max"),)), space)
    x, y = np.round(space.velocity.points, 12).T
    wanted = np.full((len(x), 2), np.nan)
    wanted[x == 0] = 0.75, 0.0
    wanted[y == 0] = 0.0, 0.5
    wanted[y == HEIGHT] = 0.0, 0.0
    np.testing.assert_allclose(given(space, found, 2.0), wanted, rtol=1e-12)
    np.testing.assert_allclose(given(space, found, 0.0)[(x == 0) | (y == 0)], 0.0, atol=1e-15)


def test_a_stationary_flow_has_its_inflow_in_full():
    space = box()
    found = conditions_of(scene_of(STATIONARY, inflow=(Inflow(where="x-min", speed=1.5, profile="uniform", ramp=4.0),),
                                   outflow=(Outflow(where="x-max"),)), space)
    assert given(space, found, 0.0)[(abs(space.velocity.points - [0.0, 1.0]) < 1e-12).all(axis=1)].tolist() == [[1.5, 0.0]]


@pytest.mark.parametrize("side, inward", [("x-min", (1, 0)), ("x-max", (-1, 0)), ("y-min", (0, 1)), ("y-max", (0, -1))])
def test_a_profile_runs_along_its_side_with_the_fluid_on_its_left(side, inward):
    """Shares 0.1, 0.9, 0.3 at 0, a quarter and the whole; round the box counter-clockwise. Speeds add on top of the walls nowhere."""
    space = box(3)
    table = dict(profile="table", along=(0.0, 0.25, 1.0), share=(0.1, 0.9, 0.3))
    other = "y-max" if side[0] == "x" else "x-max"
    found = conditions_of(scene_of(inflow=(Inflow(where=side, speed=2.0, **table),), outflow=(Outflow(where=other),)), space)
    x, y = np.round(space.velocity.points, 12).T
    s = {"x-min": 1 - y / HEIGHT, "x-max": y / HEIGHT, "y-min": x / LENGTH, "y-max": 1 - x / LENGTH}[side]
    on = {"x-min": x == 0, "x-max": x == LENGTH, "y-min": y == 0, "y-max": y == HEIGHT}[side]
    inside = on & (s > 1e-9) & (s < 1 - 1e-9)
    wanted = 2.0 * np.interp(s[inside], [0, 0.25, 1], [0.1, 0.9, 0.3])[:, None] * inward
    np.testing.assert_allclose(given(space, found, 1.0)[inside], wanted, atol=1e-12)


def placed(place, shift=None):
    """The box with nodes called "it", one of them perhaps moved."""
    mesh = plate((3, 3))
    points = mesh.points.copy()
    if shift is not None:
        points[np.flatnonzero((points[:, 0] == 0) & (abs(points[:, 1] - HEIGHT / 3) < 1e-9)), 0] += shift
    chosen = np.flatnonzero(place(*mesh.points[:, :2].T))
    return FlowSpace(replace(mesh, points=points, places=mesh.places | {"it": chosen}), 2)


IN = scene_of(inflow=(Inflow(where="it", speed=1.0),), outflow=(Outflow(where="x-max"),))


@pytest.mark.parametrize("shift, fine", [(1.9e-6, True), (-1.9e-6, True), (2.1e-6, False), (-2.1e-6, False)])
def test_an_inflow_is_straight_to_a_millionth_of_its_length(shift, fine):
    space = placed(lambda x, y: x == 0, shift)
    if fine:
        conditions_of(IN, space)
    else:
        with pytest.raises(InputError, match=r"^inflow\[0\]\.where = 'it': an inflow is one straight piece of the boundary$"):
            conditions_of(IN, space)


def test_an_inflow_is_one_piece():
    """Of three edges on the left the first and the last: half as long again as they are together."""
    space = placed(lambda x, y: x == 0)
    edges = space.mesh.facets("x-min")[0]
    middle = space.mesh.points[edges, 1].mean(axis=1)
    apart = edges[abs(middle - HEIGHT / 2) > 0.1]
    mesh = replace(space.mesh, places=space.mesh.places | {"it": np.unique(apart)}, parts={"it": [("line", apart)]})
    with pytest.raises(InputError, match="one straight piece"):
        conditions_of(IN, FlowSpace(mesh, 2))
    mesh = replace(mesh, parts={"it": [("line", edges[middle < HEIGHT / 2 + 0.1])]})
    conditions_of(IN, FlowSpace(mesh, 2))


def test_an_inflow_that_comes_round_to_its_start_is_refused():
    mesh = build_mesh(read_body({"body": {"shape": "channel", "length": 0.8, "cell_size": 0.1, "hole_cell_size": 0.04}}))
    with pytest.raises(InputError, match=r"^inflow\[0\]\.where = 'hole': an inflow is a straight piece of the boundary$"):
        conditions_of(scene_of(inflow=(Inflow(where="hole", speed=1.0),), outflow=(Outflow(where="outlet"),)), FlowSpace(mesh, 2))


@pytest.mark.parametrize("change, said", [
    (dict(inflow=(Inflow(where="nowhere", speed=1.0),)), r"^inflow\[0\]\.where: no place named 'nowhere'"),
    (dict(wall=(Wall(where="nowhere", velocity=(1.0, 0.0)),)), r"^wall\[0\]\.where: no place named 'nowhere'"),
    (dict(outflow=(Outflow(where="x-max"), Outflow(where="x-max"))), r"^outflow\[1\]\.where = 'x-max': has edges of another"),
    (dict(inflow=(Inflow(where="x-min", speed=1.0),) * 2), r"^inflow\[1\]\.where = 'x-min': has edges of another"),
    (dict(inflow=(Inflow(where="x-max", speed=1.0),), outflow=(Outflow(where="x-max"),)), r"^inflow\[0\]\.where = 'x-max': has edges of")])
def test_what_does_not_fit_the_mesh_is_said(change, said):
    with pytest.raises(InputError, match=said):
        conditions_of(scene_of(**change), box())


def test_a_place_of_which_no_edge_is_on_the_boundary_is_refused():
    space = placed(lambda x, y: (x == 1) & (y > 0.1) & (y < 1.9))
    inner = np.sort(space.mesh.edges[np.isin(space.mesh.edges, space.mesh.places["it"]).all(axis=1)], axis=1)
    mesh = replace(space.mesh, parts={"it": [("line", inner)]})
    with pytest.raises(InputError, match=r"^inflow\[0\]\.where"):
        conditions_of(IN, FlowSpace(mesh, 2))


def v(x):
    return np.stack([1 + x[:, 0] - 2 * x[:, 1] ** 2, x[:, 0] * x[:, 1] + 3 * x[:, 0]], axis=1)


@pytest.mark.parametrize("order", (2, 3))
def test_what_comes_back_over_all_sides_is_the_integral_of_its_flux_times_half_of_it(order):
    """u = (-(x - 1/2) (1 + y), -(y - 1/2) (1 + x)) comes in everywhere; against v by quadrature side by side."""

    def u(x):
        return -(x - 0.5) * (1 + x[:, ::-1])

    space = FlowSpace(rectangle(2), order)
    open_ = OpenEdges(space, space.mesh.boundary[0])
    found = (open_.backflow(u(space.velocity.points)) * v(space.velocity.points)[open_.nodes]).sum()
    points, weights = np.polynomial.legendre.leggauss(8)
    s, one, wanted = (points + 1) / 2, np.ones(8), 0.0
    for at, normal in (([0 * s, s], (-1, 0)), ([one, s], (1, 0)), ([s, 0 * s], (0, -1)), ([s, one], (0, 1))):
        x = np.stack(at, axis=1)
        assert (u(x) @ normal < 0).all()
        wanted += (weights / 2 * (u(x) @ normal) * (u(x) * v(x)).sum(axis=1) / 2).sum()
    assert found == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("order", (2, 3))
def test_only_what_comes_back_counts(order):
    """u = (y - 1/2, 1) on the right comes back through the lower of two edges: integrals 1/48 and -1/16."""
    space = FlowSpace(rectangle(2), order)
    right = space.mesh.boundary[0][(space.mesh.points[space.mesh.boundary[0], 0] == 1).all(axis=1)]
    open_, y = OpenEdges(space, right), space.velocity.points[:, 1]
    back = open_.backflow(np.stack([y - 0.5, 1 + 0 * y], axis=1))
    np.testing.assert_allclose(back.sum(axis=(0, 1)), [1 / 48, -1 / 16], rtol=1e-12)
    lower = y[open_.nodes].max(axis=1) < 0.6
    assert lower.tolist().count(True) == 1 and not back[~lower].any()
    assert open_.backflow(np.zeros((len(y), 2))) is None and open_.backflow(np.stack([1 + y, -y], axis=1)) is None
    assert open_.backflow(np.stack([y - 1e-9, -y], axis=1)) is not None
    assert OpenEdges(space, right[:0]).backflow(np.stack([-1 - y, y], axis=1)) is None


@pytest.mark.parametrize("order, mass", [(2, np.array([[2, 1], [1, 2]]) / 6), (3, np.array([[4, 2, -1], [2, 16, 2], [-1, 2, 4]]) / 30)])
def test_the_penalty_is_the_mass_of_an_edge_of_length_one_at_its_nodes_in_its_cell(order, mass):
    """Textbook mass matrices of linear and quadratic functions, nodes in a row; on edges of all directions and either order of ends."""
    space = FlowSpace(rectangle(3, seed=1), order)
    edges = space.mesh.boundary[0].copy()
    edges[::2] = edges[::2, ::-1]
    owner, local, blocks = OpenEdges(space, edges).penalty(5.0)
    assert blocks.shape == (12, order, order)
    np.testing.assert_allclose(blocks, np.broadcast_to(5 * mass, blocks.shape), rtol=1e-12)
    nodes = np.take_along_axis(space.pressure.cells[owner], local, axis=1)
    np.testing.assert_array_equal(nodes, space.pressure.along_edges(space.mesh, edges))
