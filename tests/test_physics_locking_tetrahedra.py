"""First-order tetrahedra lock, and that is said wherever they do: in beams, in plates, in Cook's membrane, and near a Poisson ratio of 1/2.

Each case is solved on the same mesh at both orders and held against a value known from elsewhere.
"""

import pytest

from physics.modes.locking import said_of_path
from physics.scene import read_scene
from physics.solution import solve
from tests.cook import INCOMPRESSIBLE, loaded


def remarks(scene, solution):
    return said_of_path(scene, solution.mesh, solution.displacement, solution.energy, solution.linear_steps)


def bent(body, order, support, load):
    scene = read_scene({"body": {"cell": "tetrahedron", "order": order} | body, "support": support, "load": [load], "steps": {"count": 1},
                        "material": {"law": "linear", "young_modulus": 1e6, "poisson_ratio": 0.0}})
    solution = solve(scene)
    return -solution.displacement[-1][:, 2].min(), remarks(scene, solution)


def beam(order):
    """Deflection over that of Timoshenko's beam, twenty times as long as thick, Poisson's ratio 0."""
    body = {"length": 0.4, "width": 0.02, "height": 0.02, "cells": [20, 2, 2]}
    found, said = bent(body, order, [{"where": "x-min"}], {"where": "x-max", "traction": [0.0, 0.0, -1.0]})
    force = 0.02**2
    return found / (force * 0.4**3 / (3 * 1e6 * 0.02**4 / 12) + force * 0.4 / (5 / 6 * 0.5e6 * 0.02**2)), said


def plate(order):
    """Deflection in the middle of a strip forty times as long as thick, held at both ends, over p L^4 / 384 E I + p L^2 / 8 k G A."""
    body = {"shape": "plate", "length": 0.4, "width": 0.1, "height": 0.01, "cells": [20, 4, 1]}
    found, said = bent(body, order, [{"where": "x-min"}, {"where": "x-max"}], {"where": "z-max", "traction": [0.0, 0.0, -1.0]})
    return found / (0.4**4 / (384 * 1e6 * 0.01**3 / 12) + 0.4**2 / (8 * 5 / 6 * 0.5e6 * 0.01)), said


def cook(order):
    """Cook's membrane at nu = 1/3, plane strain, over what hexahedra of second order have on twice as many cells a side."""
    material, shear = {"law": "linear", "young_modulus": 1.0, "poisson_ratio": 1 / 3}, 1 / 16
    scene, solution, found = loaded(4, shear, material, cell="tetrahedron", order=order)
    return found.mean() / loaded(8, shear, material, order=2)[2].mean(), remarks(scene, solution)


def nearly_incompressible(order):
    """Cook's membrane at nu = 0.4999, over the 6.87 of published references; of second order with its mean dilatation."""
    element = {"element": "mean-dilatation"} if order == 2 else {}
    scene, solution, found = loaded(4, 6.25, INCOMPRESSIBLE, cell="tetrahedron", order=order, **element)
    return found.mean() / 6.87, remarks(scene, solution)


@pytest.mark.parametrize("case, most, near", [(beam, 0.6, 0.02), (plate, 0.4, 0.02), (cook, 0.8, 0.04), (nearly_incompressible, 0.5, 0.03)])
def test_where_tetrahedra_lock_it_is_said_and_at_second_order_they_do_not(case, most, near):
    locked, told = case(1)
    assert locked < most
    text, = told
    assert "cells of first order resist too stiffly" in text and "body.order = 2" in text
    free, told = case(2)
    assert free == pytest.approx(1, abs=near) and told == ()
