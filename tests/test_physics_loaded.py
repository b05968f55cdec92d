"""Modes of a loaded body: beams under tension and near their Euler load, a beam held by its obstacle, states without a tangent."""

import numpy as np
import pytest

from physics.equilibrium.balance import Balance
from physics.equilibrium.state import NoEquilibrium
from physics.mesh.build import build_mesh
from physics.modes.elastic import elastic_modes
from physics.modes.loaded import loaded_stiffness
from physics.scene import read_scene
from physics.schema import InputError
from physics.solution import solve
from tests.plain_newton import contact_force
from tests.scenes import beam, pressed

LENGTH, WIDTH, HEIGHT = 0.1, 0.02, 0.005
WAVE = np.pi / (2 * LENGTH)  # half of a hinged beam of twice the length
BENDING, MASS = 1e6 * WIDTH * HEIGHT**3 / 12, 1000.0 * WIDTH * HEIGHT
EULER = WAVE**2 * BENDING  # [N] 0.0514


def hinged(force, **more):
    """Half of a beam hinged at its ends under a force along it [N], tension above zero."""
    return beam(body={"length": LENGTH, "width": WIDTH, "height": HEIGHT, "cells": [40, 1, 2], "element": "reduced"}, steps={"count": 2},
                material={"law": "neo-hookean", "young_modulus": 1e6, "poisson_ratio": 0.0},
                support=[{"where": "x-min", "fixed": "x"}, {"where": "y-min", "fixed": "y"},
                         {"where": {"box": [[LENGTH - 1e-6, -1, HEIGHT / 2 - 1e-6], [LENGTH + 1e-6, 1, HEIGHT / 2 + 1e-6]]}, "fixed": "z"}],
                load=[{"where": "x-max", "traction": [force / (WIDTH * HEIGHT), 0, 0]}], **more)


def first(scene, solution, step):
    fraction = step / scene.steps.count
    return elastic_modes(scene, count=1, mesh=solution.mesh, at=(solution.displacement[step], fraction))


def theory(force):
    """[Hz] of a hinged beam under tension: omega^2 = k^2 (EI k^2 + T) / m, k = pi / L (Timoshenko, Vibration Problems, art. 58)."""
    return WAVE * np.sqrt((BENDING * WAVE**2 + force) / MASS) / (2 * np.pi)


@pytest.mark.parametrize("share", [2.0, 20.0])
def test_a_beam_under_tension_swings_as_a_string_with_stiffness(share):
    scene = hinged(share * EULER)
    solution = solve(scene)
    for step in (1, 2):
        found = first(scene, solution, step)
        # The beam is stretched by up to T / EA = 1 %, and shear and rotary inertia are (pi h / 2L)^2 / 12 some times.
        assert found.frequencies_hz[0] == pytest.approx(theory(step / 2 * share * EULER), rel=0.01)
        assert "at %g of the loading" % (step / 2) in found.remarks[0]
    assert theory(share * EULER) > 1.7 * elastic_modes(scene, count=1).frequencies_hz[0]


def test_the_frequency_of_a_column_goes_to_zero_as_the_root_of_what_is_left_to_its_euler_load():
    scene = hinged(-0.98 * EULER)
    solution = solve(scene)
    squares = [first(scene, solution, step).frequencies_hz[0] ** 2 for step in (0, 1, 2)]
    assert squares[0] == pytest.approx(elastic_modes(scene, count=1).frequencies_hz[0] ** 2, rel=1e-6)
    # A straight line in the load, through zero at the Euler load: at 98 % of it an error of 0.2 % in that is a tenth of the rest.
    assert squares[1] / squares[0] == pytest.approx(1 - 0.49, rel=0.005)
    assert squares[2] / squares[0] == pytest.approx(1 - 0.98, rel=0.2)
    assert 0.98 / (1 - squares[2] / squares[0]) == pytest.approx(1, rel=0.003)


def test_past_its_load_a_straight_column_has_no_state_to_swing_about():
    scene = hinged(-1.2 * EULER)
    mesh = build_mesh(scene.body)
    straight = np.outer(-1.2 * EULER / (1e6 * WIDTH * HEIGHT) * mesh.points[:, 0], [1.0, 0, 0])
    with pytest.raises(NoEquilibrium, match="unstable"):
        elastic_modes(scene, count=1, mesh=mesh, at=(straight, 1.0))


def test_a_beam_on_its_obstacle_swings_as_on_a_support_there():
    """A cantilever that a cylinder just touches along a line of nodes: z is held there, along the cylinder and the beam it slides."""
    body = {"length": 0.06, "width": 0.01, "height": 0.02, "cells": [12, 2, 4]}
    obstacle = {"shape": "cylinder", "radius": 0.01, "path": [[0.05, 0.005, 0.0301], [0.05, 0.005, 0.02999]], "contact": "nodes"}
    scene = pressed(body=body, obstacle=obstacle, steps={"count": 4})
    solution = solve(scene)
    assert solution.reaction[-1, 2] > 0
    line = {"box": [[0.0499, -1, 0.0199], [0.0501, 1, 0.0201]]}
    held = beam(body=body, support=[{"where": "x-min"}, {"where": line, "fixed": "z"}])
    found = elastic_modes(scene, count=4, at=(solution.displacement[-1], 1.0))
    # Off by what 0.01 mm bends the beam, and by the softness of contact.
    np.testing.assert_allclose(found.frequencies_hz, elastic_modes(held, count=4).frequencies_hz, rtol=2e-3)
    free = elastic_modes(scene, count=4, at=(solution.displacement[0], 0.0))
    np.testing.assert_allclose(free.frequencies_hz, elastic_modes(scene, count=4).frequencies_hz, rtol=1e-6)
    assert max(abs(np.array(found.frequencies_hz) / free.frequencies_hz - 1)) > 0.5
    assert "3 points of it staying on the obstacle" in found.remarks[0]


@pytest.mark.parametrize("cells", [{"cells": [12, 2, 2]}, {"cells": [6, 1, 1], "cell": "tetrahedron", "order": 2},
                                   {"cells": [6, 1, 1], "cell": "hexahedron", "order": 2}])
def test_the_stiffness_is_the_slope_of_all_forces_contact_included(cells):
    """Of W, a pressure on a face whose rim is held, and contact with a cylinder, along random motions too small to open or close it."""
    scene = pressed(body={"length": 0.06, "width": 0.02, "height": 0.02, **cells}, steps={"count": 4},
                    load=[{"where": "x-max", "pressure": 2e4, "follower": True}],
                    support=[{"where": "x-min"}, {"where": "x-max", "fixed": "xy"}])
    solution = solve(scene)
    balance = Balance(scene, solution.mesh)
    stiffness, space, _ = loaded_stiffness(scene, solution.mesh, solution.displacement[-1], 1.0)
    balance.apply_loads(1.0)
    random, free = np.random.default_rng(0), ~balance.fixed
    right, left = stiffness.createVecs()
    for _ in range(3):
        v = np.where(free, random.normal(size=free.shape), 0.0)
        right.array[:] = space.to_dofs(v)
        stiffness.mult(right, left)
        h = 1e-10
        ends = []
        for sign in (1, -1):
            u = solution.displacement[-1] + sign * h * v
            ends.append(balance.elasticity.force(u) - contact_force(balance, u, 1.0))
        slope = (ends[0] - ends[1]) / (2 * h)
        here = space.from_dofs(left.array)
        np.testing.assert_allclose(here[free], slope[free], atol=1e-5 * abs(slope[free]).max())
    stiffness.destroy()


@pytest.mark.parametrize(("changes", "said"), [
    ({"material": {"law": "linear", "young_modulus": 1e6, "poisson_ratio": 0.0}}, "take a law of finite strain"),
    ({"steps": {"count": 2, "dynamic": True, "duration": 1.0}}, "in no equilibrium"),
])
def test_what_has_no_such_tangent_is_refused(changes, said):
    scene = beam(**changes)
    mesh = build_mesh(scene.body)
    with pytest.raises(InputError, match=said):
        elastic_modes(scene, count=1, mesh=mesh, at=(np.zeros(mesh.points.shape), 1.0))


def test_a_body_without_supports_has_its_rigid_modes_at_rest():
    scene = read_scene({"body": {"length": 0.1, "width": 0.02, "height": 0.01, "cells": [4, 1, 1]},
                        "material": {"young_modulus": 1e6, "poisson_ratio": 0.3}})
    mesh = build_mesh(scene.body)
    found = elastic_modes(scene, count=7, mesh=mesh, at=(np.zeros(mesh.points.shape), 0.0))
    assert found.rigid == 6 and found.frequencies_hz[6] == pytest.approx(elastic_modes(scene, count=7).frequencies_hz[6], rel=1e-8)


@pytest.mark.parametrize("thickness", [1.0, 0.02])
@pytest.mark.parametrize("order", [1, 2])
def test_a_plane_strip_has_the_loaded_modes_of_the_slice_that_it_is(order, thickness):
    """In contact and held across, against hexahedra: frequencies do not know how thick it is."""
    obstacle = {"shape": "cylinder", "axis": [0, 0, 1], "radius": 0.01, "path": [[0.05, 0.0301, 0], [0.05, 0.027, 0]]}
    rest = {"material": {"young_modulus": 1e6, "poisson_ratio": 0.3}, "steps": {"count": 2}, "obstacle": obstacle}
    flat = read_scene({"body": {"shape": "plate", "length": 0.1, "width": 0.02, "cells": [8, 2], "cell": "quadrilateral", "order": order,
                                "thickness": thickness}, "support": [{"where": "x-min"}]} | rest)
    solid = read_scene({"body": {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [8, 2, 1], "cell": "hexahedron", "order": order},
                        "support": [{"where": "x-min"}, *({"where": f"z-{end}", "fixed": "z"} for end in ("min", "max"))]} | rest)
    hz = []
    for scene in (flat, solid):
        found = solve(scene, tolerance=1e-9)
        hz.append([elastic_modes(scene, count=3, mesh=found.mesh, at=at).frequencies_hz[0] for at in (None, (found.displacement[-1], 1.0))])
    assert hz[0][0] == pytest.approx(hz[1][0], rel=1e-7) and hz[0][1] == pytest.approx(hz[1][1], rel=2e-3)
    assert hz[0][1] > 1.5 * hz[0][0]  # it leans on the obstacle
