"""Modes of orthotropic bodies: the isotropic special case, plates and beams in closed form, constants that no material has."""

import numpy as np
import pytest

from physics.body.material import orthotropic_stiffness
from physics.modes.elastic import elastic_modes, euler_bernoulli_hz
from physics.scene import Orthotropic, Scene, read_scene
from physics.schema import InputError
from physics.solution import solve

# Birch, along the grain and across it [Pa].
WOOD = {"young_moduli": [16.3e9, 0.62e9, 1.1e9], "poisson_ratios": [0.43, 0.38, 0.49], "shear_moduli": [0.91e9, 0.19e9, 1.18e9]}


def scene(body, material=None, support=(), **more):
    return read_scene({"body": body, "material": material or {"orthotropic": WOOD, "density": 650.0}, "support": list(support), **more})


def isotropic(young, poisson):
    return {"young_moduli": [young] * 3, "poisson_ratios": [poisson] * 3, "shear_moduli": [young / (2 + 2 * poisson)] * 3}


@pytest.mark.parametrize("body", [
    {"length": 0.06, "width": 0.02, "height": 0.01, "cells": [6, 2, 2], "cell": "prism"},
    {"length": 0.06, "width": 0.02, "height": 0.01, "cells": [3, 1, 1], "cell": "tetrahedron", "order": 2},
    {"shape": "plate", "length": 0.06, "width": 0.02, "cells": [6, 2], "cell": "quadrilateral", "plane": "strain"},
    {"shape": "plate", "length": 0.06, "width": 0.02, "cells": [6, 2], "cell": "triangle", "plane": "stress"}])
def test_equal_constants_are_those_of_an_isotropic_body(body):
    one = elastic_modes(scene(body, {"young_modulus": 2e6, "poisson_ratio": 0.3}, [{"where": "x-min"}]), count=5)
    other = elastic_modes(scene(body, {"orthotropic": isotropic(2e6, 0.3)}, [{"where": "x-min"}]), count=5)
    np.testing.assert_allclose(other.frequencies_hz, one.frequencies_hz, rtol=1e-9)


def test_stresses_along_an_axis_and_in_a_plane_strain_as_the_constants_say():
    wood = Orthotropic(**{name: tuple(values) for name, values in WOOD.items()})
    strain = np.linalg.solve(orthotropic_stiffness(wood)[0], [1.0, 0, 0])  # under a unit stress along x
    np.testing.assert_allclose(strain, np.array([1, -0.43, -0.49]) / 16.3e9, rtol=1e-12)
    strain = np.linalg.solve(orthotropic_stiffness(wood)[0], [0, 1.0, 0])
    np.testing.assert_allclose(strain, [-0.43 / 16.3e9, 1 / 0.62e9, -0.38 / 0.62e9], rtol=1e-12)
    normal, shear = orthotropic_stiffness(wood, "stress")
    np.testing.assert_allclose(np.linalg.solve(normal, [1.0, 0]), np.array([1, -0.43]) / 16.3e9, rtol=1e-12)
    assert shear == (0.91e9,)
    np.testing.assert_allclose(orthotropic_stiffness(wood, "strain")[0], orthotropic_stiffness(wood)[0][:2, :2], rtol=1e-12)


def test_a_slender_beam_bends_by_its_modulus_along_the_grain():
    """Euler-Bernoulli with E_x; shear is soft, E_x / G = 18, and lowers it by some times (h / L)^2 E_x / G = 0.2 %."""
    made = scene({"length": 1.0, "width": 0.01, "height": 0.01, "cells": [40, 1, 1], "cell": "hexahedron", "order": 2},
                 support=[{"where": "x-min"}])
    assert made.material.young_modulus == 16.3e9
    np.testing.assert_allclose(elastic_modes(made, count=2).frequencies_hz, euler_bernoulli_hz(made, 2), rtol=3e-3)


@pytest.mark.parametrize("turned", [False, True])
def test_a_simply_supported_plate_has_naviers_frequencies(turned):
    """omega^2 = pi^4 / (rho h) (D_x (m/a)^4 + 2 (D_xy + 2 D_k) (m n / a b)^2 + D_y (n/b)^4) (Leissa, Vibration of Plates, 9.4)."""
    a, b, h, rho = 1.0, 0.7, 0.01, 650.0
    ex, ey, gxy = (0.62e9, 16.3e9, 0.91e9) if turned else (16.3e9, 0.62e9, 0.91e9)
    xy = 0.43 * 0.62 / 16.3 if turned else 0.43
    yx = xy * ey / ex
    wood = {"young_moduli": [ex, ey, 1.1e9], "poisson_ratios": [xy, 0.1, 0.1], "shear_moduli": [gxy, 0.9e9, 0.9e9]}
    made = scene({"shape": "plate", "length": a, "width": b, "height": h, "cells": [16, 12, 1], "cell": "hexahedron", "order": 2},
                 {"orthotropic": wood, "density": rho},
                 [{"where": "x-min", "fixed": "yz"}, {"where": "x-max", "fixed": "yz"}, {"where": "y-min", "fixed": "xz"},
                  {"where": "y-max", "fixed": "xz"}])
    dx, dy, dk = (h**3 / 12 * value for value in (ex / (1 - xy * yx), ey / (1 - xy * yx), gxy))
    m, n = np.meshgrid(np.arange(1, 8), np.arange(1, 8))
    squares = np.pi**4 / (rho * h) * (dx * (m / a) ** 4 + 2 * (xy * dy + 2 * dk) * (m * n / a / b) ** 2 + dy * (n / b) ** 4)
    expected = np.sort(np.sqrt(squares).ravel())[:3] / (2 * np.pi)
    # Shear across the plate, of the order of E (pi h / a)^2 / (10 G), and the mesh.
    np.testing.assert_allclose(elastic_modes(made, count=3).frequencies_hz, expected, rtol=0.01)


def test_it_is_written_and_read_and_left_out_elsewhere():
    made = scene({"length": 1.0, "width": 0.1, "height": 0.1, "cells": [4, 1, 1]}, support=[{"where": "x-min"}])
    assert Scene.from_toml(made.to_toml()) == made and made.material.orthotropic.shear_moduli == (0.91e9, 0.19e9, 1.18e9)
    with pytest.raises(InputError, match="orthotropic: has modes at rest, but no law of finite strain"):
        solve(made)
    with pytest.raises(InputError, match="for isotropic materials only"):
        elastic_modes(scene({"length": 1.0, "width": 0.1, "height": 0.1, "cells": [4, 1, 1], "element": "reduced"}), count=1)


@pytest.mark.parametrize(("changes", "said"), [
    ({"poisson_ratios": [5.2, 0, 0]}, "would give energy"),  # above the root of 16.3 / 0.62 = 5.13
    ({"poisson_ratios": [0, 0, 3.9]}, "would give energy"),
    ({"poisson_ratios": [3.5, 0.5, 3.0]}, "would give energy"),  # each below its root, but not all together
    ({"young_moduli": [1e9, -1, 1e9]}, "young_moduli = -1.0: must be above 0 Pa"),
    ({"young_moduli": 3}, "young_moduli must be an array"),
    ({"shear_moduli": [1e9]}, "must have 3 entries"),
])
def test_constants_of_no_material_are_refused(changes, said):
    with pytest.raises(InputError, match=said):
        scene({"length": 1.0, "width": 0.1, "height": 0.1, "cells": [4, 1, 1]}, {"orthotropic": WOOD | changes})


def test_another_modulus_beside_it_is_refused():
    with pytest.raises(InputError, match="material.young_modulus: an orthotropic material has its own"):
        scene({"length": 1.0, "width": 0.1, "height": 0.1, "cells": [4, 1, 1]}, {"orthotropic": WOOD, "young_modulus": 1e9})
