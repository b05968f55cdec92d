"""Several materials in one body, by region: springs in a row and side by side, layered beams, and every cell with one material."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import fidelity
from physics.body.elasticity import Elasticity
from physics.body.material import by_region
from physics.body.stress import cauchy, nodal_stress
from physics.mesh.build import build_mesh
from physics.mesh.files import read_mesh
from physics.mesh.shapes.boxes import box
from physics.modes.elastic import elastic_modes
from physics.scene import Body, read_scene
from physics.schema import InputError
from physics.solution import solve
from tests.test_physics_mesh_places import gmsh_text

L, W, H, FIRST = 0.1, 0.02, 0.02, 0.04  # [m]; the first material ends at x = FIRST
SOFT, STIFF = 1e6, 7e6  # [Pa]
BODY = {"length": L, "width": W, "height": H, "cells": [5, 2, 2], "cell": "hexahedron"}
ALONG = {"box": [[0, 0, 0], [FIRST, W, H]]}
UNDER = {"box": [[0, 0, 0], [L, W, H / 2]]}


def material(young, where=None, law="linear", **more):
    return {"law": law, "young_modulus": young, "poisson_ratio": 0.0} | more | ({} if where is None else {"where": where})


def scene(*materials, **tables):
    return read_scene({"body": BODY, "material": list(materials), "support": [{"where": "x-min"}], "steps": {"count": 2}} | tables)


def test_in_a_row_compliances_add():
    """u = t (l1 / E1 + l2 / E2) under a traction t."""
    t = 1e3
    found = solve(scene(material(SOFT, ALONG), material(STIFF), load=[{"where": "x-max", "traction": [t, 0, 0]}]))
    x, u = found.mesh.points[:, 0], found.displacement[-1]
    expected = t * (np.minimum(x, FIRST) / SOFT + np.maximum(x - FIRST, 0) / STIFF)
    assert u == pytest.approx(np.stack([expected, 0 * x, 0 * x], axis=1), abs=1e-9 * t * L / SOFT)
    assert found.energy[-1] == pytest.approx(t**2 * W * H / 2 * (FIRST / SOFT + (L - FIRST) / STIFF))
    assert found.reaction[-1] == pytest.approx([t * W * H, 0, 0], abs=1e-9)  # the body pulls at its support


@pytest.mark.parametrize("method", ["direct", "multigrid"])
def test_in_a_row_each_part_obeys_its_own_law(method):
    """Without lateral contraction P = E s (s^2 - 1) / 2 of one law and E (s - 1 / s) / 2 of the other, s the stretch."""
    t = 2e5
    first = brentq(lambda s: SOFT * s * (s**2 - 1) / 2 - t, 1, 2)
    second = brentq(lambda s: STIFF * (s - 1 / s) / 2 - t, 1, 2)
    found = solve(scene(material(SOFT, ALONG, "saint-venant-kirchhoff"), material(STIFF, law="neo-hookean-log"),
                        load=[{"where": "x-max", "traction": [t, 0, 0]}]), method=method)
    end = found.displacement[-1, found.mesh.places["x-max"], 0]
    assert end == pytest.approx(FIRST * (first - 1) + (L - FIRST) * (second - 1), rel=1e-6)
    assert "saint-venant-kirchhoff ({ box" in found.model["material"] and "neo-hookean-log (elsewhere)" in found.model["material"]


def test_side_by_side_stiffnesses_add():
    """F = d / l (E1 A1 + E2 A2) when an end is moved by d; each layer has its own stress, up to its surface."""
    d = 1e-5
    given = scene(material(SOFT, {"box": [[0, 0, 0], [L, W, H / 4]]}), material(STIFF), body=BODY | {"cells": [5, 2, 4]},
                  support=[{"where": "x-min"}, {"where": "x-max", "displacement": [d, 0, 0]}])
    found = solve(given)
    assert found.reaction[-1] == pytest.approx([-d / L * W * H * (SOFT / 4 + STIFF * 3 / 4), 0, 0], rel=1e-9, abs=1e-9)
    u, mesh = found.displacement[-1], found.mesh
    stress, z = cauchy(mesh, u, given.material)[:, 0, 0], mesh.points[mesh.cells].mean(axis=1)[:, 2]
    assert stress == pytest.approx(np.where(z < H / 4, SOFT, STIFF) * d / L)
    at_nodes, z = nodal_stress(mesh, u, given.material)[:, 0, 0], mesh.points[:, 2]
    share = np.where(abs(z - H / 4) < 1e-9, (SOFT + STIFF) / 2, np.where(z < H / 4, SOFT, STIFF))
    assert at_nodes == pytest.approx(share * d / L)


def bending_stiffness(soft, stiff):
    """E I of two layers of half the height about their common axis: that of the section made of one material (Gere, 6.3)."""
    axis = (soft * H / 4 + stiff * 3 * H / 4) / (soft + stiff)
    return W * sum(young * ((H / 2) ** 3 / 12 + H / 2 * (axis - middle) ** 2) for young, middle in ((soft, H / 4), (stiff, 3 * H / 4)))


def test_a_layered_beam_bends_as_its_transformed_section():
    """w = F l^3 / (3 E I); the shear deformation of a beam of twenty heights is a thousandth of that."""
    length, t = 20 * H, 1.0
    found = solve(scene(material(SOFT, {"box": [[0, 0, 0], [length, W, H / 2]]}), material(STIFF),
                        body={"length": length, "width": W, "height": H, "cells": [40, 2, 2], "element": "reduced"},
                        load=[{"where": "x-max", "traction": [0, 0, t]}]))
    middle = found.displacement[-1, found.mesh.places["x-max"], 2].mean()
    assert middle == pytest.approx(t * W * H * length**3 / (3 * bending_stiffness(SOFT, STIFF)), rel=0.01)


def test_a_layered_beam_swings_with_its_own_mass_in_each_layer():
    """f = 1.8751^2 / (2 pi l^2) sqrt(E I / m) across the layers, with E I sums of both along them; m per length."""
    length, light, heavy = 40 * H, 500.0, 4000.0
    given = scene(material(SOFT, {"box": [[0, 0, 0], [length, W, H / 2]]}, density=heavy), material(STIFF, density=light),
                  body={"length": length, "width": W, "height": H, "cells": [20, 1, 2], "cell": "hexahedron", "order": 2})
    mass = W * H * (light + heavy) / 2
    stiffness = [bending_stiffness(SOFT, STIFF), (SOFT + STIFF) * H / 2 * W**3 / 12]
    expected = [1.8751040687**2 / (2 * np.pi * length**2) * np.sqrt(each / mass) for each in stiffness]
    found = elastic_modes(given, count=2)
    assert found.frequencies_hz == pytest.approx(sorted(expected), rel=3e-3)
    assert found.free_mass.max() == pytest.approx(mass * length, rel=0.02)  # what is held has a share in the first cells


@pytest.mark.parametrize("order, element, cell", [(1, "standard", "hexahedron"), (2, "standard", "tetrahedron"),
                                                  (1, "mean-dilatation", "prism")])
def test_a_bar_of_two_materials_swings_along_itself_at_the_roots_of_its_equation(order, element, cell):
    """Held at x = 0, free at l, guided: E1 k1 cos(k1 l1) cos(k2 l2) = E2 k2 sin(k1 l1) sin(k2 l2), k = 2 pi f sqrt(rho / E)."""
    one, other = (SOFT, 3000.0), (STIFF, 800.0)

    def equation(f):
        k1, k2 = (2 * np.pi * f * np.sqrt(rho / young) for young, rho in (one, other))
        return (SOFT * k1 * np.cos(k1 * FIRST) * np.cos(k2 * (L - FIRST)) - STIFF * k2 * np.sin(k1 * FIRST) * np.sin(k2 * (L - FIRST)))

    grid = np.linspace(1.0, 900.0, 2000)
    value = np.array([equation(f) for f in grid])
    roots = [brentq(equation, a, b) for a, b, low, high in zip(grid, grid[1:], value, value[1:], strict=False) if low * high < 0]
    thin = 0.002  # else shear across it is among the first
    everywhere = {"box": [[0, 0, 0], [L, thin, thin]]}
    given = scene(material(one[0], ALONG, density=one[1]), material(other[0], density=other[1]),
                  body={"length": L, "width": thin, "height": thin, "cells": [160 // order**2, 1, 1], "cell": cell, "order": order,
                        "element": element},
                  support=[{"where": "x-min"}, {"where": everywhere, "fixed": "yz"}])
    found = elastic_modes(given, count=3)
    assert found.frequencies_hz == pytest.approx(roots[:3], rel=1e-3 if order == 1 else 1e-5)


def test_the_order_of_the_cells_plays_no_part():
    """dolfinx numbers them anew."""
    given = scene(material(SOFT, ALONG, density=3000.0), material(STIFF), body=BODY | {"cells": [8, 3, 3], "order": 2})
    mesh = build_mesh(given.body)
    mixed = replace(mesh, cells=mesh.cells[np.random.default_rng(0).permutation(len(mesh.cells))])
    assert elastic_modes(given, count=3, mesh=mixed).frequencies_hz == pytest.approx(elastic_modes(given, count=3).frequencies_hz, rel=1e-8)


def test_orthotropic_and_isotropic_parts_swing_side_by_side():
    """An orthotropic material of equal constants is the isotropic one."""
    constants = {"young_moduli": [STIFF] * 3, "poisson_ratios": [0.3] * 3, "shear_moduli": [STIFF / 2.6] * 3}
    plain = scene(material(SOFT, ALONG, poisson_ratio=0.2), material(STIFF, poisson_ratio=0.3))
    mixed = scene(material(SOFT, ALONG, poisson_ratio=0.2), {"orthotropic": constants, "law": "linear"})
    assert elastic_modes(mixed, count=4).frequencies_hz == pytest.approx(elastic_modes(plain, count=4).frequencies_hz, rel=1e-9)
    with pytest.raises(InputError, match="material.orthotropic: has modes at rest"):
        solve(mixed)


def test_equal_parts_are_one_material():
    """Forces, stiffness, energy and motion are those of the whole body."""
    law = {"law": "neo-hookean", "young_modulus": SOFT, "poisson_ratio": 0.4}
    loads = {"load": [{"where": "x-max", "traction": [0, 0, -500.0]}, {"acceleration": [0, 0, -9.81]}],
             "obstacle": {"shape": "sphere", "radius": 0.01, "path": [[0.08, 0.01, -0.0101], [0.08, 0.01, -0.011]]}}
    for more in ({}, {"steps": {"count": 4, "duration": 0.05, "dynamic": True}}):
        parts, whole = solve(scene(law | {"where": ALONG}, law, **loads | more)), solve(scene(law, **loads | more))
        assert np.allclose(parts.displacement, whole.displacement, atol=1e-9, rtol=0) and abs(whole.displacement).max() > 1e-4
        assert parts.reaction == pytest.approx(whole.reaction, abs=1e-6) and parts.energy == pytest.approx(whole.energy, rel=1e-6)


def test_where_the_obstacle_presses_the_softer_half_gives_way_more():
    """Plates press equal forces out of a block of two halves in a row: strains are as 1 / E, and small strain sees the same."""
    walls = [{"shape": "half-space", "normal": [-1, 0, 0], "path": [[L + 1e-5, 0, 0], [L - 1e-5, 0, 0]]}]
    given = scene(material(SOFT, ALONG, "neo-hookean-log"), material(STIFF, law="neo-hookean-log"), obstacle=walls)
    found = solve(given)
    x, u = found.mesh.points[:, 0], found.displacement[-1, :, 0]
    at_joint = u[abs(x - FIRST) < 1e-9]
    assert found.linear_steps == 2 and at_joint == pytest.approx(-1e-5 * (FIRST / SOFT) / (FIRST / SOFT + (L - FIRST) / STIFF), rel=1e-3)


def two_regions(tmp_path):
    """A bar of five boxes in a file, "rubber" the first two and "resin" the others, its wall a face."""
    mesh = box(Body(**BODY | {"cells": (5, 1, 1)}))
    names = '$PhysicalNames\n4\n3 1 "rubber"\n3 2 "resin"\n2 3 "wall"\n2 4 "tip"\n$EndPhysicalNames'
    path = tmp_path / "bar.msh"
    path.write_text(gmsh_text(mesh, [(5, 1, mesh.cells[:2]), (5, 2, mesh.cells[2:]), (3, 3, [mesh.cells[0, [0, 1, 2, 3]]]),
                                     (3, 4, [mesh.cells[4, [4, 5, 6, 7]]])], names))
    return path


def test_regions_of_a_file_are_known_by_their_names(tmp_path):
    path, t = two_regions(tmp_path), 1e3
    tables = {"body": {"shape": "file", "path": str(path)}, "support": [{"where": "wall"}], "steps": {"count": 1},
              "load": [{"where": "tip", "traction": [t, 0, 0]}]}
    found = solve(scene(material(STIFF, "resin"), material(SOFT, "rubber"), **tables))
    tip = found.displacement[-1, found.mesh.places["tip"], 0]
    assert tip == pytest.approx(t * (FIRST / SOFT + (L - FIRST) / STIFF))
    mesh = read_mesh(path)
    sizes = [len(cells) for _, cells in by_region(scene(material(STIFF, "resin"), material(SOFT), **tables).material, mesh)]
    assert sizes == [3, 2]


@pytest.mark.parametrize("materials, words", [
    ([material(1.0, ALONG), material(2.0, {"box": [[0.02, 0, 0], [L, W, H]]})],
     "material[1].where = { box = [[0.02, 0.0, 0.0], [0.1, 0.02, 0.02]] }: 4 of its cells are of material[0] already, the first about "
     "(0.03, 0.005, 0.005) m; every cell has one material"),
    ([material(1.0, ALONG), material(2.0, {"box": [[0.08, 0, 0], [L, W, H]]})],
     "material: 8 of 20 cells have none, the first about (0.05, 0.005, 0.005) m; a material without where is that of all other cells"),
    ([material(1.0, {"box": [[0, 0, 0], [L, W, H]]}), material(2.0)],
     "material[1]: is that of all other cells, and there are none: the others have every cell of the body"),
    ([material(1.0, {"near": [0, 0, 0], "within": 1e-3}), material(2.0)],
     "material[0].where = { near = [0.0, 0.0, 0.0], within = 0.001 }: no cell has its centre there"),
    ([material(1.0), material(2.0)], "material[1].where: missing; material[0] is that of all other cells already"),
    ([material(1.0, ALONG)], "material.where: a single material is that of the whole body; leave it out"),
    ([material(1.0, "x-min"), material(2.0)], "material[0].where = 'x-min': a beam has no regions with names; give a place by coordinates"),
    ([material(1.0, ALONG, "neo-hookean"), material(2.0)], "material: the linear law is that of the whole body or of no part of it"),
    ([material(1.0, ALONG), material(-2.0)], "material[1].young_modulus = -2.0: must be above 0"),
    ([], "material: missing")])
def test_every_cell_has_exactly_one_material(materials, words):
    with pytest.raises(InputError) as caught:
        given = scene(*materials)
        Elasticity(build_mesh(given.body), given.material, np.zeros((54, 3), bool))
    assert words in str(caught.value), str(caught.value)


@pytest.mark.parametrize("where, words", [("rubbr", "no place named 'rubbr' in the mesh: there are"),
                                          ("wall", "no cell is made of it: it is no region")])
def test_what_is_no_region_of_a_file_is_refused_with_status_2_before_any_work(tmp_path, capsys, where, words):
    two_regions(tmp_path)
    file = tmp_path / "scene.toml"
    file.write_text('[body]\nshape = "file"\npath = "bar.msh"\n[[material]]\nyoung_modulus = 1.0\npoisson_ratio = 0.3\n'
                    f'where = "{where}"\n[[material]]\nyoung_modulus = 1.0\npoisson_ratio = 0.3\n[[support]]\nwhere = "wall"\n')
    for verb in (["simulate", str(file), "--out", str(tmp_path / "a.vtkhdf")], ["modes", str(file)]):
        assert fidelity.main(verb) == 2
        said = capsys.readouterr().err
        assert f"material[0].where = '{where}': {words}" in said and said.count("\n") == 1
    assert not list(tmp_path.glob("a*"))
