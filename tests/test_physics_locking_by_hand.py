"""How much too stiff cells are, literally: strain at corners, its mean at the nodes, and the energy of what that takes away, in loops."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from physics.mesh.shapes.boxes import box, rectangle
from physics.modes import locking
from physics.modes.locking import said, too_high
from physics.scene import Body, Material, Scene

MATERIAL = Material(young_modulus=3.0, poisson_ratio=0.2)
LAMBDA, MU = 3.0 * 0.2 / (1.2 * 0.6), 3.0 / 2.4
LOW, HIGH = 0.5 - 12**-0.5, 0.5 + 12**-0.5
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
LOCAL = {"triangle": [(0, 0), (1, 0), (0, 1)], "quadrilateral": SQUARE, "tetrahedron": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
         "prism": [(r, s, t) for t in (0, 1) for r, s in ((0, 0), (1, 0), (0, 1))], "hexahedron": [(*p, t) for t in (0, 1) for p in SQUARE]}
THIRDS = [(1 / 6, 1 / 6), (2 / 3, 1 / 6), (1 / 6, 2 / 3)]
RULES = {"triangle": THIRDS, "quadrilateral": list(itertools.product((LOW, HIGH), repeat=2)), "tetrahedron": [(0.25, 0.25, 0.25)],
         "prism": [(*p, t) for t in (LOW, HIGH) for p in THIRDS], "hexahedron": list(itertools.product((LOW, HIGH), repeat=3))}


def functions(kind, place):
    """The shape functions at a place of a cell, products of linear ones."""
    flat = [1 - place[0] - place[1], place[0], place[1]]
    if kind == "triangle":
        return np.array(flat)
    if kind == "tetrahedron":
        return np.array([1 - sum(place), *place])
    if kind == "prism":
        return np.array([each * (1 - place[2]) for each in flat] + [each * place[2] for each in flat])
    return np.array([np.prod([x if end else 1 - x for x, end in zip(place, corner, strict=True)]) for corner in LOCAL[kind]])


def strain(kind, place, x, u):
    """Small strain and the size of the map at a place; differences are exact for functions linear in each coordinate."""
    d = len(place)
    slopes = np.array([(functions(kind, place + step) - functions(kind, place - step)) / 0.02 for step in 0.01 * np.eye(d)])
    jacobian = slopes @ x
    gradient = np.linalg.solve(jacobian, slopes @ u)
    return (gradient + gradient.T) / 2, np.linalg.det(jacobian)


def density(e):
    return LAMBDA / 2 * np.trace(e) ** 2 + MU * (e * e).sum()


def literal(kind, mesh, shape):
    """By what share of itself a mode's frequency is too high."""
    d, corners = len(LOCAL[kind][0]), np.array(LOCAL[kind], float)
    middle = corners.mean(axis=0)
    points, moved = mesh.points[:, :d], shape[:, :d]
    mean, volume = np.zeros((len(points), d, d)), np.zeros(len(points))
    for cell in mesh.cells:
        found = [strain(kind, corner + 1e-3 * (middle - corner), points[cell], moved[cell]) for corner in corners]
        size = np.mean([each for _, each in found])
        for node, (e, _) in zip(cell, found, strict=True):
            mean[node] += size * e
            volume[node] += size
    mean /= volume[:, None, None]
    whole = jumps = 0.0
    for cell in mesh.cells:
        for place in RULES[kind]:
            e, size = strain(kind, np.array(place), points[cell], moved[cell])
            smooth = np.einsum("n,nij->ij", functions(kind, place), mean[cell])
            whole += size * density(e)
            jumps += size * density(e - smooth)
    return 1 / np.sqrt(1 - jumps / whole) - 1


def uneven(kind):
    """A body of a few cells, none like the other, and a motion of it."""
    plane = kind in ("triangle", "quadrilateral")
    body = Body(shape="plate" if plane else "beam", length=3.0, width=1.0, height=None if plane else 1.0, cell=kind,
                cells=(3, 2) if plane else (3, 1, 2))
    mesh = rectangle(body) if plane else box(body)
    draw = np.random.default_rng(2)
    points = mesh.points + 0.1 * draw.uniform(-1, 1, mesh.points.shape) * ([1, 1, 0] if plane else 1)
    x, y, z = points.T
    return replace(mesh, points=points), np.stack([-x * z - x * y, x**2 / 2, x**2 / 2 + 0.1 * y * z], axis=1)


@pytest.mark.parametrize("kind", LOCAL)
def test_the_excess_is_that_of_the_strain_that_jumps(kind, monkeypatch):
    mesh, shape = uneven(kind)
    wanted = literal(kind, mesh, shape)
    assert wanted > 0.01 and too_high(mesh, shape, MATERIAL) == pytest.approx(wanted, rel=1e-8)
    monkeypatch.setattr(locking, "CHUNK", 2)  # the same two cells at a time
    assert too_high(mesh, shape, MATERIAL) == pytest.approx(wanted, rel=1e-8)


def test_a_mode_without_strain_or_one_that_jumps_alone_ends_in_a_number():
    mesh, shape = uneven("hexahedron")
    assert too_high(mesh, np.zeros_like(shape), MATERIAL) == 0.0
    rough = np.random.default_rng(0).normal(size=shape.shape)
    pair = np.array([[0, 1, 2, 3]])
    alone = replace(uneven("tetrahedron")[0], points=np.eye(4, 3), cells=pair)
    assert too_high(alone, rough[:4], MATERIAL) == pytest.approx(0.0, abs=1e-12)  # one cell of constant strain has none to jump to
    assert np.isfinite(too_high(mesh, rough, MATERIAL)) and too_high(mesh, rough, MATERIAL) <= 0.001**-0.5 - 1  # a share of 0.999 at most


@pytest.mark.parametrize("excess, told", [(0.049, False), (0.051, True), (1.2345, True)])
def test_five_per_cent_are_told_of_the_first_mode_that_strains(monkeypatch, excess, told):
    asked = []
    monkeypatch.setattr(locking, "too_high", lambda mesh, shape, material, element: asked.append(shape) or excess)
    for kind, other in (("hexahedron", "body.order = 2"), ("prism", "hexahedra of order 2")):
        mesh, shape = uneven(kind)
        scene = Scene(body=Body(length=1.0, width=1.0, height=1.0, cells=(1, 1, 1), cell=kind), material=MATERIAL)
        shapes = np.stack([0 * shape, shape, 2 * shape])
        words = (f"cells of first order bend too stiffly here: mode 2 is too high by about {100 * excess:.0f} % or more; take shorter "
                 f"cells or {other}",)
        assert said(mesh, shapes, 1, scene) == (words if told else ()) and asked[-1] is not None and asked[-1].max() == shape.max()
        assert said(mesh, shapes, 3, scene) == ()  # all of them are rigid
