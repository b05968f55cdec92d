"""Rules of materials, panels, places by coordinates, directions, turns and loads, at their edges: what is just taken, what just not."""

import pytest

from physics.scene import read_body
from physics.schema import InputError
from tests.test_physics_scene_rules import MATERIAL, refused, scene
from tests.tools import brick, text_of

PANEL = {"shape": "panel", "outline": [[0, 0], [2, 0], [2, 1]], "height": 0.1, "cell_size": 0.1}
HALF = {"box": [[0, 0, 0], [0.05, 1, 1]]}
PATH = {"path": [[0, 0, 1]]}


def wood(ratios, moduli=(4.0, 1.0, 1.0)):
    return {"orthotropic": {"young_moduli": list(moduli), "poisson_ratios": list(ratios), "shear_moduli": [1.0, 1.0, 1.0]}}


@pytest.mark.parametrize("ratios", [(1.99, 0, 0), (0, 0.99, 0), (0, 0, 1.99), (-1.99, 0, 0), (0.65, 0.65, 0.65), (1.4, 0, 1.4),
                                    (0, 0.7, 1.4)])
def test_an_orthotropic_body_that_resists_every_strain_is_taken(ratios):
    """nu_xy^2 < E_x / E_y = 4 and so on; with E = 4, 1, 1 and all of them at once 1 - a^2/4 - b^2 - c^2/4 - a b c / 2 > 0."""
    a, b, c = ratios
    assert 1 - a * a / 4 - b * b - c * c / 4 - a * b * c / 2 > 0
    found = scene(material=wood(ratios)).material
    assert found.orthotropic.poisson_ratios == ratios and (found.young_modulus, found.poisson_ratio) == (4.0, 0.0)


@pytest.mark.parametrize("ratios", [(2.0, 0, 0), (2.01, 0, 0), (0, 1.0, 0), (0, -1.01, 0), (0, 0, 2.01), (0.75, 0.75, 0.75),
                                    (1.42, 0, 1.42), (0, 0.72, 1.42), (3, 3, -3)])
def test_one_that_does_not_is_refused(ratios):
    """At (3, 3, -3) all three are wrong, and all together come out above zero."""
    said = f"material.orthotropic.poisson_ratios = {[float(ratio) for ratio in ratios]}: with these moduli some strain"
    refused(said, material=wood(ratios))


def test_an_orthotropic_material_has_its_own_constants():
    assert scene(material=wood((0, 0, 0)) | {"young_modulus": 4.0, "poisson_ratio": 0.0}).material.young_modulus == 4.0
    refused("material.young_modulus: an orthotropic material has its own", material=wood((0, 0, 0)) | {"young_modulus": 1.0})
    refused("material.poisson_ratio: an orthotropic material has its own", material=wood((0, 0, 0)) | {"poisson_ratio": 0.1})
    refused("material[1].poisson_ratio: an orthotropic material has its own",
            material=[MATERIAL, wood((0, 0, 0)) | {"where": HALF, "poisson_ratio": 0.1}])
    for young, words in (([], "young_moduli must have 3 entries, not 0"), (3.0, "young_moduli must be an array")):
        refused(words, material={"orthotropic": wood((0, 0, 0))["orthotropic"] | {"young_moduli": young}})
    refused("material.orthotropic must be a table", material={"orthotropic": 3} | MATERIAL)


def test_several_materials_have_each_its_cells_and_one_has_all_others():
    two = scene(material=[MATERIAL, MATERIAL | {"where": HALF}])
    assert len(two.materials) == 2 and two.material[1].where.box == ((0.0, 0.0, 0.0), (0.05, 1.0, 1.0))
    assert scene(material=[MATERIAL]).material == scene().material
    assert len(scene(material=[MATERIAL | {"where": HALF}] * 2).materials) == 2
    refused("material.where: a single material is that of the whole body", material=MATERIAL | {"where": HALF})
    refused("material.where: a single material is that of the whole body", material=[MATERIAL | {"where": HALF}])
    refused("material[2].where: missing; material[0] is that of all other cells already", material=[MATERIAL, MATERIAL | {"where": HALF},
                                                                                                 MATERIAL])
    refused("material[1].where = 'soft': a beam has no regions with names", material=[MATERIAL, MATERIAL | {"where": "soft"}])
    regions = [MATERIAL, MATERIAL | {"where": "soft"}]
    assert scene(body={"shape": "file", "path": "a.msh"}, material=regions).material[1].where == "soft"
    refused("the linear law is that of the whole body or of no part of it", material=[MATERIAL | {"law": "linear"},
                                                                                     MATERIAL | {"where": HALF}])
    assert scene(material=[each | {"law": "linear"} for each in (MATERIAL, MATERIAL | {"where": HALF})]).linear
    mixed = [MATERIAL | {"law": "neo-hookean-log"}, MATERIAL | {"where": HALF, "young_modulus": 3e6}]
    assert scene(material=mixed).stiffest == 3e6 and not scene(material=mixed).linear
    refused("material[1].where: give exactly one of near, plane and box", material=[MATERIAL, MATERIAL | {"where": {"within": 1.0}}])
    refused("material: missing", material=[])


@pytest.mark.parametrize(("changes", "words"), [
    ({"cell_size": None}, "body.cell_size: missing"), ({"height": None}, "body.height: missing"),
    ({"outline": None}, "body.outline: missing"),
    ({"cell": "hexahedron"}, "body.cell = 'hexahedron': a panel has tetrahedron or prism cells"),
    ({"cell": "triangle"}, "body.cell = 'triangle': a panel has"),
    ({"outline": [[0, 0], [2, 1]]}, "body.outline must have three points at least, each another one"),
    ({"outline": [[0, 0], [2, 0], [2, 1], [0, 0]]}, "body.outline must have three points at least, each another one"),
    ({"outline": [[0, 0], [2, 0], [1, 0]]}, "body.outline: has no width"), ({"outline": [[0, 0], [0, 2], [0, 1]]}, "has no width"),
    ({"outline": [[0, 0], [1e-9, 0], [0, 1]]}, "has no width"),
    ({"holes": [[1.2, 0.3, 0.1], [1.5, 0.3, 0.0]]}, "body.holes[1] = [1.5, 0.3, 0.0]: x, y and a radius above 0"),
    ({"holes": [[1.2, 0.3, -0.1]]}, "body.holes[0]"), ({"order": 2, "cell": "prism"}, "body.order = 2: prisms"),
    ({"element": "mean-dilatation"}, "only for prisms, hexahedra and tetrahedra of order 2"),
    ({"element": "reduced", "cell": "prism"}, "only for a beam of prisms"), ({"width": 1.0}, "body.width: a panel takes outline, holes"),
    ({"cells": [1, 1, 1]}, "body.cells: a panel takes")])
def test_rules_of_a_panel(changes, words):
    table = {key: value for key, value in (PANEL | changes).items() if value is not None}
    with pytest.raises(InputError) as caught:
        read_body({"body": table})
    assert words in str(caught.value), str(caught.value)


@pytest.mark.parametrize("changes", [{"cell": "prism"}, {"order": 2}, {"order": 2, "element": "mean-dilatation"},
                                     {"cell": "prism", "element": "mean-dilatation"}, {"outline": [[0, 0], [2e-9, 0], [0, 1]]},
                                     {"holes": []}, {"layers": 1}])
def test_panels_at_the_edge_of_the_rules(changes):
    body = read_body({"body": PANEL | changes})
    assert body.layers == changes.get("layers", 2) and body.cell == changes.get("cell", "tetrahedron")


@pytest.mark.parametrize(("where", "words"), [
    ({}, "support[0].where: give exactly one of near, plane and box"),
    ({"near": [0, 0, 0], "within": 1, "plane": [0, 0, 0], "normal": [0, 0, 1]}, "give exactly one of near, plane and box"),
    ({"near": [0, 0, 0], "box": [[0, 0, 0], [1, 1, 1]]}, "give exactly one of near, plane and box"),
    ({"near": [0, 0, 0]}, "support[0].where.within: missing; near needs it"),
    ({"near": [0, 0, 0], "within": 1.0, "normal": [0, 0, 1]}, "support[0].where.normal: near takes within"),
    ({"plane": [0, 0, 0], "within": 1.0}, "support[0].where.normal: missing; plane needs it"),
    ({"plane": [0, 0, 0], "normal": [0, 0, 1]}, "support[0].where.within: missing; plane needs it"),
    ({"box": [[0, 0, 0], [1, 1, 1]], "within": 1.0}, "support[0].where.within: box takes nothing else"),
    ({"box": [[0, 0, 0], [1, 1, 1]], "normal": [0, 0, 1]}, "support[0].where.normal: box takes nothing else"),
    ({"plane": [0, 0, 0], "normal": [0, 0, 0], "within": 1.0}, "support[0].where.normal must not be the zero vector"),
    ({"box": [[0, 0, 0], [1, -1, 1]]}, "support[0].where.box: its first corner must have the smaller coordinates"),
    ({"box": [[0, 0, 2], [1, 1, 1]]}, "the smaller coordinates"),
    ({"near": [0, 0, 0], "within": -1.0}, "within = -1.0: must be at least 0 m")])
def test_rules_of_places_by_coordinates(where, words):
    refused(words, support=[{"where": where}])
    refused(words.replace("support", "load"), load=[{"where": where, "traction": [0, 0, 1]}])


def test_places_by_coordinates_at_the_edge_of_the_rules():
    for where in ({"near": [0, 0, 0], "within": 0}, {"plane": [0, 0, 0], "normal": [0, 0, 1e-3], "within": 1.0},
                  {"box": [[1, 1, 1], [1, 1, 1]]}):
        assert scene(support=[{"where": where}]).support[0].where is not None


def test_a_direction_is_from_a_billionth_to_a_billion_long():
    sphere = {"shape": "cylinder", "radius": 0.01} | PATH
    for axis in ([0, 0, 1e-9], [0, 1e9, 0]):
        assert scene(obstacle=sphere | {"axis": axis}).obstacle.axis == tuple(axis)
        assert scene(obstacle={"shape": "half-space", "normal": axis} | PATH).obstacle.normal == tuple(axis)
        assert scene(support=[{"where": "x-min", "axis": axis, "angle": 1.0}]).support[0].axis == tuple(axis)
    for axis in ([0, 0, 0.99e-9], [0, 1.01e9, 0]):
        refused("its length must be from 1e-9 to 1e9", obstacle=sphere | {"axis": axis})
        refused("obstacle.normal = ", obstacle={"shape": "half-space", "normal": axis} | PATH)
        refused("support[0].axis = ", support=[{"where": "x-min", "axis": axis, "angle": 1.0}])


def test_rules_of_supports_that_turn():
    turn = {"where": "x-min", "axis": [0, 0, 1], "angle": 0.0}
    found = scene(support=[turn | {"centre": [0, 0, 1]}, turn]).support
    assert found[0].centre == (0.0, 0.0, 1.0) and found[1].centre is None and found[1].angle == 0
    for one in ({"axis": [0, 0, 1]}, {"angle": 0.0}, {"centre": [0, 0, 0]}, {"axis": [0, 0, 1], "centre": [0, 0, 0]}):
        refused("support[0]: a support that turns has an axis and an angle, and may have a centre", support=[{"where": "x-min"} | one])
    refused("support[0].angle: fixed = 'xz' leaves free what would turn", support=[turn | {"fixed": "xz"}])
    refused("support[0].axis must not be the zero vector", support=[turn | {"axis": [0, 0, 0]}])
    refused("support[0].factor: must start at 0", support=[turn | {"steps": [0, 1], "factor": [1, 1]}])
    refused("support[1].steps: must rise from 0 to 1", support=[turn, turn | {"steps": [0, 2], "factor": [0, 1]}])


def test_rules_of_pressures_and_sudden_loads():
    pressed, moving = {"where": "x-max", "pressure": 3.0}, {"dynamic": True, "duration": 1.0}
    pulled, linear = {"where": "x-max", "traction": [1, 0, 0]}, MATERIAL | {"law": "linear"}
    assert scene(load=[pressed | {"follower": True}]).load[0].follower and scene(load=[pressed | {"follower": False}],
                                                                               steps=moving).load[0].follower is False
    refused("load[1].follower: only a pressure follows its face", load=[pressed, pulled | {"follower": True}])
    refused("load[0].follower: a pressure follows its face through equilibria only", load=[pressed | {"follower": True}], steps=moving)
    refused("load[0].follower: the linear law knows no turned face", load=[pressed | {"follower": True}], material=linear)
    assert scene(load=[pressed], material=linear).load[0].pressure == 3.0
    table = {"steps": [0, 1], "factor": [0, 1]}
    refused("load[0].sudden: a load with a table is not sudden", load=[pressed | {"sudden": True} | table], steps=moving)
    assert scene(load=[pressed | {"sudden": True}, pressed | table], steps=moving).load[0].sudden
    refused("load[0]: give exactly one of traction, pressure and acceleration", load=[pulled | {"pressure": 1.0}])
    refused("load[0]: a traction or a pressure needs a where", load=[{"pressure": 1.0}])
    refused("load[0].steps: must rise from 0 to 1", load=[pressed | {"steps": [0.1, 1], "factor": [0, 1]}])


def test_rules_of_boxes_and_of_surfaces_at_their_edges():
    """A brick 2, 1.2 and 0.6 wide: 0.6 / 200 to 0.6 / 4 may be smoothed over."""
    box = {"shape": "box", "size": [2.0, 1.0, 3.0], "radius": 0.5} | PATH
    assert scene(obstacle=box | {"angle": 5.0}).obstacle.radius == 0.5
    refused("obstacle[1].radius = 0.51: must be at most 0.5 m", obstacle=[box, box | {"radius": 0.51}])
    tool = {"shape": "mesh", "surface": text_of(*brick((1.0, 0.6, 0.3), 0.0, 9.0))} | PATH
    for radius in (0.00301, 0.1499):
        assert scene(obstacle=tool | {"radius": radius}).obstacle.radius == radius
        assert scene(obstacle=tool | {"radius": 1e-3 * radius, "scale": 1e-3}).obstacle.scale == 1e-3
    for radius in (0.00299, 0.1501):
        refused("must be from 0.003 to 0.15 m", obstacle=tool | {"radius": radius})
        refused("must be from 3e-06 to 0.00015 m", obstacle=tool | {"radius": 1e-3 * radius, "scale": 1e-3})
    assert scene(obstacle=tool | {"scale": 1e-9 / 0.599}).obstacle.scale and scene(obstacle=tool | {"scale": 1e9 / 0.601}).obstacle.scale
    refused("obstacle: 9.98e-10 m wide; from 1e-09 to 1e+09 m are taken", obstacle=tool | {"scale": 0.998e-9 / 0.6})
    refused("from 1e-09 to 1e+09 m are taken", obstacle=tool | {"scale": 1e9 / 0.599})
    refused("obstacle: a mesh has a file, which is missing", obstacle={"shape": "mesh"} | PATH)
    refused("obstacle: a mesh has a file; a surface stands in its place", obstacle=tool | {"file": "a.stl"})
