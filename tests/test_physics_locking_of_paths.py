"""When a path is told that its cells are too stiff, and the measure of finite, nearly incompressible and mixed bodies in plain loops."""

from dataclasses import replace

import numpy as np
import pytest

from physics.modes import locking
from physics.modes.locking import said, said_of_path, too_stiff
from physics.scene import Body, Material, Orthotropic, Scene
from tests.test_physics_locking_by_hand import LOCAL, RULES, functions, uneven

SOFT, HARD = Material(young_modulus=3.0, poisson_ratio=0.2), Material(young_modulus=50.0, poisson_ratio=0.4, where="hard")
PLATE = {"shape": "plate", "length": 1.0, "width": 1.0, "cells": (1, 1)}


def scene(cell="hexahedron", material=SOFT, **body):
    sides = PLATE if cell in ("triangle", "quadrilateral") else {"length": 1.0, "width": 1.0, "height": 1.0, "cells": (1, 1, 1)}
    return Scene(body=Body(**sides | {"cell": cell} | body), material=material)


def told(monkeypatch, stiff, given, energy=(1.0, 5.0, 2.0), linear=0):
    """What is said of a path of three steps, and with which displacement and kind of strain it was asked."""
    asked = []
    monkeypatch.setattr(locking, "too_stiff", lambda mesh, u, material, element, *, finite: asked.append((u.max(), finite)) or stiff)
    mesh, shape = uneven(given.body.cell)
    path = np.stack([(k + 1) * shape / shape.max() for k in range(len(energy))])
    return said_of_path(given, mesh, path, np.array(energy), linear), asked


def test_a_path_is_told_of_from_a_tenth_of_its_stiffness_on(monkeypatch):
    """5 % of a frequency; 1.25 and 0.5 are numbers of which the root is exact."""
    for stiff, many in ((1.05**2 - 1.001, 0), (1.05**2 - 0.999, 1)):
        assert len(told(monkeypatch, stiff, scene())[0]) == many
    monkeypatch.setattr(locking, "TOLD", 0.5)
    assert told(monkeypatch, 1.2499, scene())[0] == () and len(told(monkeypatch, 1.25, scene())[0]) == 1
    monkeypatch.setattr(locking, "too_high", lambda *arguments: 0.5)
    mesh, shape = uneven("hexahedron")
    assert len(said(mesh, shape[None], 0, scene())) == 1


def test_a_path_is_told_of_by_the_step_that_strains_it_most(monkeypatch):
    words = ("cells of first order resist too stiffly here: at step {} the body by about 31 %, so it moves too little or pushes back too "
             "hard; take smaller cells, or body.order = 2")
    for energy, step in (((1.0, 5.0, 2.0), 1), ((7.0, 5.0, 2.0), 0), ((0.0, 0.0, 1e-30), 2)):
        assert told(monkeypatch, 0.312, scene(), energy) == ((words.format(step),), [(pytest.approx(step + 1), step > 0)])
    assert told(monkeypatch, 0.312, scene(), (0.0, 0.0, 0.0)) == ((), [])
    assert told(monkeypatch, 0.312, scene(), (-1.0, -2.0, -3.0)) == ((), [])
    for linear, finite in ((0, True), (1, False), (2, False)):  # steps up to it were of small displacements
        assert told(monkeypatch, 0.312, scene(), linear=linear)[1][0][1] == finite
    assert not told(monkeypatch, 0.312, scene(material=replace(SOFT, law="linear")))[1][0][1]


@pytest.mark.parametrize("body, help_", [
    ({"cell": "prism"}, ', or body.element = "reduced", or tetrahedra or hexahedra of order 2'),
    ({"cell": "prism", "width": 1.001}, ", or tetrahedra or hexahedra of order 2"),
    ({"cell": "prism", "height": 1.001}, ", or tetrahedra or hexahedra of order 2"),
    ({"cell": "prism", "shape": "plate"}, ", or tetrahedra or hexahedra of order 2"),
    ({"cell": "tetrahedron"}, ", or body.order = 2"), ({"cell": "triangle"}, ", or body.order = 2"),
    ({"cell": "quadrilateral"}, ", or body.order = 2")])
def test_what_helps_depends_on_the_cells(monkeypatch, body, help_):
    text, = told(monkeypatch, 0.5, scene(**body))[0]
    assert text.endswith(f"take smaller cells{help_}")


def test_of_second_order_bodies_nearly_incompressible_ones_are_told_of(monkeypatch):
    """From Poisson's ratio 0.49 on, by the largest of several materials."""
    def at(*ratios, energy=(1.0, 5.0), **body):
        materials = tuple(Material(young_modulus=1.0, poisson_ratio=nu) for nu in ratios)
        given = scene(order=2, material=materials if len(materials) > 1 else materials[0], **body)
        found, asked = told(monkeypatch, 9.9, given, energy)
        assert asked == []
        return found

    words = ("Poisson's ratio is {:g}: coarse cells resist too stiffly even so; take body.element = \"mean-dilatation\"",)
    assert at(0.49) == (words[0].format(0.49),) and at(0.3, 0.495, 0.1) == (words[0].format(0.495),) and at(0.4899) == ()
    assert at(0.499, element="mean-dilatation") == () and at(0.499, energy=(0.0, 0.0)) == ()
    assert at(0.499, energy=(0.0, 1e-30)) == (words[0].format(0.499),)


def test_of_first_order_solid_ones_are_told_of_where_strain_does_not_jump(monkeypatch):
    nearly = replace(SOFT, poisson_ratio=0.49)
    words = "Poisson's ratio is 0.49: cells of first order resist too stiffly; take {}body.element = \"mean-dilatation\""
    for cell, order in (("prism", ""), ("hexahedron", ""), ("tetrahedron", "body.order = 2 and ")):
        assert told(monkeypatch, 0.0, scene(cell, nearly))[0] == (words.format(order),)
        assert told(monkeypatch, 0.0, scene(cell, replace(SOFT, poisson_ratio=0.489)))[0] == ()
    assert told(monkeypatch, 0.0, scene("prism", nearly, element="mean-dilatation"))[0] == ()
    assert told(monkeypatch, 0.0, scene("triangle", nearly))[0] == ()
    assert "at step 1" in told(monkeypatch, 0.5, scene("prism", nearly))[0][0]


def test_bodies_that_cannot_lock_or_for_which_there_is_no_measure_are_passed_over(monkeypatch):
    stiff = Orthotropic(young_moduli=(1.0, 1.0, 1.0), poisson_ratios=(0.1, 0.1, 0.1), shear_moduli=(1.0, 1.0, 1.0))
    for given in (scene("prism", element="reduced"), scene(material=replace(SOFT, orthotropic=stiff)),
                  scene(material=(SOFT, replace(SOFT, orthotropic=stiff)))):
        assert told(monkeypatch, 9.9, given) == ((), [])
    mesh, shape = uneven("hexahedron")
    monkeypatch.setattr(locking, "too_high", lambda *arguments: 9.9)
    assert said(mesh, shape[None], 0, scene(order=2)) == () and len(said(mesh, shape[None], 0, scene())) == 1
    assert said(mesh, shape[None], 1, scene()) == ()


def strain(kind, place, x, u, finite):
    """Small strain, or Green's with the change of volume for its trace, and the size of the map."""
    d = len(place)
    slopes = np.array([(functions(kind, place + step) - functions(kind, place - step)) / 0.02 for step in 0.01 * np.eye(d)])
    jacobian = slopes @ x
    f = np.eye(d) + np.linalg.solve(jacobian, slopes @ u).T  # F_ij = d x_i / d X_j
    e = (f.T @ f - np.eye(d)) / 2 if finite else (f + f.T) / 2 - np.eye(d)
    if finite:
        e += (np.linalg.det(f) - 1 - np.trace(e)) / d * np.eye(d)
    return e, np.linalg.det(jacobian)


def literal(kind, mesh, shape, regions, finite, diluted):
    """Energy of what the mean at the nodes takes away over the energy that is left, region by region."""
    d, corners = len(LOCAL[kind][0]), np.array(LOCAL[kind], float)
    weight = {"triangle": 1 / 6, "quadrilateral": 1 / 4, "tetrahedron": 1 / 6, "prism": 1 / 12, "hexahedron": 1 / 8}[kind]
    at = [corner + 1e-3 * (corners.mean(axis=0) - corner) for corner in corners]
    points, moved = mesh.points[:, :d], shape[:, :d]
    whole = jumps = 0.0

    def strains(cell, places):
        inner = [strain(kind, np.array(place), points[cell], moved[cell], finite) for place in RULES[kind]]
        found = [strain(kind, place, points[cell], moved[cell], finite) for place in places]
        if not diluted:
            return found
        mean = sum(np.trace(e) * size for e, size in inner) / sum(size for _, size in inner)
        return [(e + (mean - np.trace(e)) / d * np.eye(d), size) for e, size in found]

    for young, nu, cells in regions:
        first, second = young * nu / (1 + nu) / (1 - 2 * nu), young / 2 / (1 + nu)
        total, volume = np.zeros((len(points), d, d)), np.zeros(len(points))
        for cell in mesh.cells[cells]:
            found = strains(cell, at)
            for node, (e, _) in zip(cell, found, strict=True):
                total[node] += np.mean([size for _, size in found]) * e
                volume[node] += np.mean([size for _, size in found])
        for cell in mesh.cells[cells]:
            places = [np.array(place) for place in RULES[kind]]
            for place, (e, size) in zip(places, strains(cell, places), strict=True):
                smooth = sum(value * total[n] / volume[n] for value, n in zip(functions(kind, place), cell, strict=True))
                for part, sign in ((e, 0), (e - smooth, 1)):
                    energy = weight * size * (first / 2 * np.trace(part)**2 + second * (part**2).sum())
                    whole, jumps = whole + energy * (not sign), jumps + energy * sign
    return jumps / (whole - jumps)


@pytest.mark.parametrize("kind, finite, element, mixed", [
    ("triangle", True, "standard", True), ("quadrilateral", True, "mean-dilatation", False), ("tetrahedron", True, "standard", False),
    ("prism", False, "standard", True), ("hexahedron", True, "mean-dilatation", True), ("hexahedron", False, "mean-dilatation", False),
    ("prism", True, "standard", False)])
def test_the_measure_is_that_of_plain_loops(kind, finite, element, mixed):
    mesh, shape = uneven(kind)
    hard = np.arange(len(mesh.cells)) % 3 == 1
    mesh = replace(mesh, parts={"hard": [(kind, mesh.cells[hard])]}, places={"hard": np.unique(mesh.cells[hard])})
    regions = [(3.0, 0.2, ~hard), (50.0, 0.4, hard)] if mixed else [(3.0, 0.2, slice(None))]
    wanted = literal(kind, mesh, 0.3 * shape, regions, finite, element != "standard")
    assert wanted > 0.004
    assert too_stiff(mesh, 0.3 * shape, (SOFT, HARD) if mixed else SOFT, element, finite=finite) == pytest.approx(wanted, rel=1e-8)


def test_a_strain_of_a_ten_millionth_is_none():
    """The largest mean strain at a node times the extent over the largest displacement; the extent is that of all coordinates."""
    mesh, shape = uneven("tetrahedron")
    found = too_stiff(mesh, shape, SOFT)
    most = 0.0
    for node in range(len(mesh.points)):
        total, volume = np.zeros((3, 3)), 0.0
        for cell in mesh.cells[(mesh.cells == node).any(axis=1)]:
            e, size = strain("tetrahedron", np.full(3, 0.25), mesh.points[cell], shape[cell], False)
            total, volume = total + size * e, volume + size
        most = max(most, abs(total / volume).max())
    extent = mesh.points.max() - mesh.points.min()
    for share, none in ((0.99, True), (1.01, False)):
        far = shape - shape.min() + np.array([0.0, 0.0, 1.0]) * most * extent / 1e-7 / share
        assert abs(far).max() == pytest.approx(most * extent / 1e-7 / share, rel=1e-4)
        assert too_stiff(mesh, far, SOFT) == (pytest.approx(found, rel=1e-3) if not none else 0.0)
    assert too_stiff(mesh, 0 * shape, SOFT) == 0.0


def test_near_a_poisson_ratio_of_one_half_a_failure_names_what_helps():
    """As for a beam under a cylinder, which with this element takes 1.398 N at 0.49999 and at 0.499999 and is not solved at 0.4999999."""
    volume = "Poisson's ratio is {}: cells of first order resist too stiffly; take body.element = \"mean-dilatation\""
    rounding = "take a Poisson's ratio of at most 0.49999: closer to 1/2 the body moves the same, and rounding may be in the way"
    for ratio, element, words in ((0.4, "standard", ()), (0.4999, "standard", (volume.format("0.4999"),)),
                                  (0.49999999, "standard", (volume.format("0.49999999"), rounding)),
                                  (0.4999, "mean-dilatation", ()), (0.49999999, "mean-dilatation", (rounding,))):
        given = scene("prism", replace(SOFT, poisson_ratio=ratio), element=element)
        assert locking.said_of_failure(given, uneven("prism")[0]) == words
