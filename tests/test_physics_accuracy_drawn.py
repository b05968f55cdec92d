"""An error asked of a drawing: cells are put where a solution says that they are needed, and the error asked is kept."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from physics.accuracy.choose import choose
from physics.accuracy.estimate import distance
from physics.accuracy.frequency import choose_modes
from physics.accuracy.meshes.drawn import Drawing, proportions
from physics.accuracy.meshes.ladder import families
from physics.accuracy.pilot import Pilots
from physics.body.stress import stress_jumps
from physics.mesh.build import build_mesh
from physics.mesh.formats.drawing import Cut
from physics.mesh.quality import cell_volumes
from physics.mesh.second import second_order
from physics.mesh.shapes.boxes import box, rectangle
from physics.modes.elastic import elastic_modes
from physics.scene import Body, Material
from physics.solution import solve
from tests.scenes import beam
from tests.test_physics_mesh_drawing import BRACKET, CORNER, NAMED, drawing

pytestmark = pytest.mark.skipif(shutil.which("gmsh") is None, reason="gmsh is not installed")

TORUS = 'SetFactory("OpenCASCADE"); Torus(1) = {0, 0, 0, 20, 5};'  # its cells are as small as its curvature asks, coarse ones too
LINEAR = Material(law="linear", young_modulus=1e6, poisson_ratio=0.3)


def corner(folder, text=CORNER + NAMED, **steps):
    """A plane L, held at its top and pulled down at its right end."""
    return beam(body={"shape": "file", "path": str(drawing(folder, text))}, support=[{"where": "top"}],
                load=[{"where": "right", "traction": [0.0, -2e3, 0.0]}], steps={"count": 2, "error": 0.003} | steps)


@pytest.mark.parametrize("cell", ["tetrahedron", "triangle"])
def test_stress_jumps_nowhere_where_it_is_that_of_the_cells(cell):
    """Of first order where it is even, of second order where it is linear; the law is linear, u quadratic."""
    sides = {"length": 0.6, "width": 0.2, "height": 0.1}
    mesh = (rectangle if cell == "triangle" else box)(Body(shape="plate", cell=cell, cells=(3, 2, 2)[:2 + (cell != "triangle")], **sides))
    x, y, z = mesh.points.T
    even = np.stack([0.1 * x + 0.2 * y, 0.05 * y, 0.1 * z * (mesh.dimension == 3)], axis=1)
    bent = np.stack([0.1 * x * x, 0.2 * x * y, 0.0 * z], axis=1)
    assert stress_jumps(mesh, even, LINEAR).max() < 1e-6 < 1e3 < stress_jumps(mesh, bent, LINEAR).max()
    fine = second_order(mesh)
    x, y, z = fine.points.T
    assert stress_jumps(fine, np.stack([0.1 * x * x, 0.2 * x * y, 0.0 * z], axis=1), LINEAR).max() < 1e-5
    assert stress_jumps(fine, np.stack([0.1 * x**3, 0.2 * x * y * y, 0.0 * z], axis=1), LINEAR).max() > 1e2


def test_a_jump_by_hand():
    """Two triangles of a unit square, cut from (0, 0) to (1, 1), with u = x - y below the cut and 0 above; E = 1, nu = 0. Below it
    sigma_xx = 1 and sigma_xy = -1/2, of norm sqrt(3/2). The corners on the cut have half of that, so two of three jump by sqrt(3/2) / 2."""
    square = second_order(rectangle(Body(shape="plate", length=1.0, width=1.0, cell="triangle", cells=(1, 1))))
    x, y, z = square.points.T
    jumps = stress_jumps(square, np.stack([np.maximum(x - y, 0), z, z], axis=1), replace(LINEAR, young_modulus=1.0, poisson_ratio=0.0))
    np.testing.assert_allclose(jumps, [0.5, 0.5], rtol=1e-9)


def test_cells_that_make_more_of_the_error_become_smaller_and_as_many_come_as_are_wanted():
    """Of stress that jumps tenfold on one half of a plate, eta^(-1/3) is 0.464 of that on the other: cells of first order in a plane."""
    mesh = rectangle(Body(shape="plate", length=2.0, width=1.0, cell="triangle", cells=(40, 20)))
    x, y, _ = mesh.points.T
    u = np.stack([np.where(x < 1, 5e-4 * (x - 1) ** 2, 5e-3 * (x - 1) ** 2), 0 * y, 0 * y], axis=1)
    points, cells, sizes = proportions(mesh, [u], LINEAR, 4 * len(mesh.cells))
    assert points.shape == mesh.points.shape and (cells == mesh.cells).all()
    inside = (y > 0.2) & (y < 0.8)
    left, right = (float(np.median(sizes[inside & (abs(x - at) < 0.25)])) for at in (0.5, 1.5))
    assert right / left == pytest.approx(10 ** (-1 / 2), rel=0.02)
    each = cell_volumes(mesh.points, mesh.cells, "triangle")
    many = (4 / 3**0.5 * each / sizes[cells].mean(axis=1) ** 2).sum()
    assert many / (4 * len(mesh.cells)) == pytest.approx(1, abs=0.1)


def test_a_body_at_rest_says_nothing_and_its_cells_stay_even():
    mesh = rectangle(Body(shape="plate", length=2.0, width=1.0, cell="triangle", cells=(10, 5)))
    sizes = proportions(mesh, [np.zeros((len(mesh.points), 3))], LINEAR, len(mesh.cells))[2]
    np.testing.assert_allclose(sizes, (4 / 3**0.5 * 0.02) ** 0.5, rtol=1e-9)


def test_the_families_of_a_drawing_have_cells_along_its_longest_side(tmp_path):
    second, first = families(corner(tmp_path))
    assert [(one.order, one.base, one.axes, one.spans) for one in (second, first)] == [
        (order, (6,), ("along the drawing",), (2,)) for order in (2, 1)]
    assert second.after((6,), 0) == (9,) and second.finer((6,), (1.4,)) == (8,) and second.dimension == 2
    assert second.said((6,)) == "about 6 triangles along the drawing, second order"
    assert first.said((9,)) == "about 9 triangles along the drawing, first order, graded"
    made = [one.rung((6,))[1] for one in (second, first)]
    assert [mesh.cell for mesh in made] == ["triangle6", "triangle"] and second.rung((6,))[1] is made[0]
    ball = {"shape": "sphere", "radius": 0.02, "path": [[1.1, 0.1, 0], [1.0, 0.1, 0]]}
    assert families(replace(corner(tmp_path), obstacle=beam(obstacle=ball).obstacle))[0].base == (13,)  # 1 m in twice 40 mm


def test_cells_go_to_the_corner_and_their_number_as_the_square(tmp_path):
    scene = corner(tmp_path)
    second, _ = families(scene)
    for n in (6, 9, 14):
        mesh = second.rung((n,))[1]
        x = mesh.points
        second.learn((n,), np.stack([np.hypot(x[:, 0] - 0.3, x[:, 1] - 0.3) ** 0.55, 0 * x[:, 1], 0 * x[:, 2]], axis=1)[None] * 1e-4)
    meshes = [second.rung((n,))[1] for n in (6, 9, 14)]
    counts = [len(mesh.cells) for mesh in meshes]
    assert 1.6 < counts[1] / counts[0] < 3.4 and 3.8 < counts[2] / counts[0] < 8
    size = (4 / 3**0.5 * cell_volumes(meshes[2].points, meshes[2].cells[:, :3], "triangle")) ** 0.5
    away = np.hypot(*(meshes[2].points[meshes[2].cells[:, :3]].mean(axis=1)[:, :2] - 0.3).T)
    assert 5 * np.median(size[away < 0.05]) < np.median(size[away > 0.4])


def test_the_error_asked_of_a_plane_drawing_is_kept(tmp_path):
    scene = corner(tmp_path)
    choice = choose(scene)
    assert choice.climb.reached and choice.climb.family.drawn is not None and choice.climb.error <= 0.003
    plain = replace(scene, body=replace(scene.body, order=2), steps=replace(scene.steps, error=None))
    truth, even = (choice.pilots.beside(plain, build_mesh(plain.body, Cut(size)), 1e-6, choice.pilot, choice.pilots.fractions)
                   for size in (0.008, 0.03))
    off, other = (distance(one.values, truth.values, choice.pilots.weights) for one in (choice.pilot, even))
    assert off < 0.003 and len(choice.mesh.points) < even.nodes and 3 * off < other


def test_the_error_asked_of_a_drawings_frequencies_is_kept(tmp_path):
    scene = corner(tmp_path)
    found = choose_modes(scene, 3)
    assert found.verdict.reached
    second = replace(scene.body, order=2)
    fine = elastic_modes(replace(scene, body=second), count=3, mesh=build_mesh(second, Cut(0.015)))
    np.testing.assert_allclose(found.modes.frequencies_hz, fine.frequencies_hz, rtol=3e-3 * 3**0.5)


def test_a_drawing_that_prescribes_its_rows_is_halved(tmp_path):
    rows = CORNER.replace("Curve Loop(1) = {1, 2, 3, 4, 5, 6}", "Line(7) = {1, 4}; Curve Loop(2) = {7, 4, 5, 6}; Plane Surface(2) = {2};\n"
                          "Curve Loop(1) = {1, 2, 3, -7}") + NAMED + "Transfinite Curve{:} = 4; Transfinite Surface{:};\n"
    second, first = families(corner(tmp_path, rows))
    assert second.own is not None and second.drawn is None and second.base == (1,) and second.after((1,), 0) == (2,)
    assert len(first.rung((2,))[1].cells) == 4 * len(first.rung((1,))[1].cells)


@pytest.mark.parametrize("kind, follows", [(CORNER, True), (BRACKET, True), (TORUS, True), (CORNER + "Recombine Surface{1};", False)])
def test_whether_a_drawing_takes_sizes(kind, follows, tmp_path):
    body = Body(shape="file", path=str(drawing(tmp_path, kind)))
    first = build_mesh(body, Cut(parts=6))
    assert Drawing(body, 1, first).follows is follows


def test_meshes_are_compared_that_have_other_chords_of_a_curved_side(tmp_path):
    """A torus that its own weight bends: middles of coarse cells lie outside of other meshes where it is hollow."""
    bent = beam(body={"shape": "file", "path": str(drawing(tmp_path, TORUS)), "scale": 1e-3},
                material={"law": "linear", "young_modulus": 1e6, "poisson_ratio": 0.3, "density": 1000.0},
                support=[{"where": {"box": [[-1.0, -1.0, -1.0], [-0.015, 1.0, 1.0]]}}], load=[{"acceleration": [0.0, 0.0, -9.81]}],
                steps={"count": 1, "error": 0.3})
    assert choose(bent).climb.reached


@pytest.mark.slow
def test_a_graded_bracket_is_closer_than_an_even_one_on_as_many_nodes(tmp_path):
    """Second order, small strain, against 13 800 graded nodes; both families begin with the same even mesh."""
    scene = beam(body={"shape": "file", "path": str(drawing(tmp_path, BRACKET)), "scale": 1e-3}, material={
        "law": "linear", "young_modulus": 2e9, "poisson_ratio": 0.3}, support=[{"where": "surface-1"}],
        load=[{"where": "surface-8", "traction": [0.0, 0.0, -5e4]}], steps={"count": 1, "error": 0.03})
    graded, even = families(scene)[0], families(scene)[0]
    pilots = Pilots(scene, [graded], "displacement", tolerance=1e-6, small_strain=0.0)

    def found(family, n, teach):
        shown, mesh = family.rung((n,))
        solution = solve(shown, mesh=mesh)
        if teach:
            family.learn((n,), solution.displacement[-1:])
        return len(mesh.points), pilots.of(shown, solution, [1])

    truth = [found(graded, n, True) for n in (6, 9, 12, 20)]
    plain = found(even, 20, False)
    nodes, close = truth[2]
    off, other = (distance(values, truth[-1][1], pilots.weights) for values in (close, plain[1]))
    assert nodes < plain[0] and 1.5 * off < other
