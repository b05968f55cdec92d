"""Every default, bound and unit of a scene, and every rule that binds several keys, as documented."""

import dataclasses

import pytest

from physics import scene as module
from physics.scene import Body, load_body, load_scene, read_body, read_scene
from physics.schema import InputError

BEAM = {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [4, 2, 2]}
PLATE = {"shape": "plate", "length": 0.1, "width": 0.02, "cells": [4, 2], "cell": "triangle"}
MATERIAL = {"young_modulus": 1e6, "poisson_ratio": 0.4}
SPHERE = {"shape": "sphere", "radius": 0.01, "path": [[0.0, 0.0, 1.0]]}


def scene(**tables):
    return read_scene({"body": BEAM, "material": MATERIAL} | tables)


def refused(words, **tables):
    with pytest.raises(InputError) as caught:
        scene(**tables)
    assert words in str(caught.value), str(caught.value)


def without(table, *keys):
    return {key: value for key, value in table.items() if key not in keys}


def test_every_default():
    found = scene(support=[{"where": "x-min"}], load=[{"where": "x-max", "traction": [1, 2, 3]}], obstacle=SPHERE)
    assert dataclasses.asdict(found) == {
        "name": "scene",
        "body": {"shape": "beam", "length": 0.1, "width": 0.02, "height": 0.02, "cells": (4, 2, 2), "cell_size": None,
                 "graded": None, "focus_x": None, "focus_y": None, "focus_z": None, "cell": "prism",
                 "order": 1,
                 "element": "standard", "outline": None, "holes": None, "layers": None, "path": None,
                 "scale": None, "hole_centre": None, "hole_radius": None, "hole_cell_size": None,
                 "plane": None, "thickness": None},
        "material": {"law": "neo-hookean", "young_modulus": 1e6, "poisson_ratio": 0.4, "density": 1000.0, "orthotropic": None,
                     "where": None},
        "support": ({"where": "x-min", "fixed": "xyz", "displacement": (0.0, 0.0, 0.0), "axis": None, "angle": None, "centre": None,
                     "steps": None, "factor": None},),
        "load": ({"where": "x-max", "traction": (1.0, 2.0, 3.0), "acceleration": None, "sudden": False, "pressure": None,
                  "follower": None, "steps": None, "factor": None},),
        "obstacle": {"shape": "sphere", "radius": 0.01, "axis": (0.0, 1.0, 0.0), "length": None, "size": None,
                     "normal": None, "angle": None,
                     "file": None, "surface": None, "source": None, "scale": None, "path": ((0.0, 0.0, 1.0),), "steps": None,
                     "contact": "facets"},
        "steps": {"count": 400, "duration": None, "dynamic": False, "velocity": None, "error": None,
                      "quantity": None}}
    bare = scene()
    assert bare.support == () and bare.load == () and bare.obstacle is None
    channel = read_body({"body": {"shape": "channel"}})
    assert channel == Body(shape="channel", length=1.6, height=0.41, hole_centre=(0.2, 0.2), hole_radius=0.05, cell_size=0.02,
                           cell="triangle")
    assert read_body({"body": {"shape": "channel", "length": 2, "cell": "quadrilateral"}}).length == 2.0


def of(table, key, value):
    """A scene with one value changed."""
    tables = {"body": BEAM, "material": MATERIAL, "obstacle": SPHERE, "steps": {"count": 2, "duration": 1.0, "dynamic": True}}
    if key in ("cell_size", "thickness", "hole_radius"):
        tables["body"] = {"cell_size": without(BEAM, "cells"), "thickness": PLATE, "hole_radius": {"shape": "channel"}}[key]
    if table == "obstacle" and key in ("length", "size"):
        tables["obstacle"] = SPHERE | ({"shape": "capsule"} if key == "length" else {"shape": "box"})
        if key == "size":
            tables["obstacle"] = without(tables["obstacle"], "radius")
    tables[table] = tables[table] | {key: value}
    return read_scene(tables)


METRES = (1e-9, 9.9e-10, "at least 1e-09 m"), (1e9, 1.01e9, "at most 1e+09 m"), (1.0, 0.0, "above 0 m"), (1.0, -1.0, "above 0 m")
BOUNDS = [("body", key, *case) for key in ("length", "width", "height", "thickness") for case in METRES]
BOUNDS += [("body", "hole_radius", min(ok, 0.19), bad, words) for ok, bad, words in METRES]  # in a channel 0.41 m high
BOUNDS += [("obstacle", "length", *case) for case in METRES]
BOUNDS += [("body", "cell_size", 1e9, 1.01e9, "at most 1e+09 m"), ("body", "cell_size", 1e-3, 9.9e-10, "at least 1e-09 m"),
           ("body", "cell_size", 1e-3, 0.0, "above 0 m")]
BOUNDS += [("obstacle", "size", [1.0, ok, 2.0], [1.0, bad, 2.0], words) for ok, bad, words in METRES]
BOUNDS += [
    ("body", "cells", [1, 10_000, 1], [1, 10_001, 1], "at most 10000"), ("body", "cells", [1, 1, 1], [1, 1, 0], "at least 1"),
    ("body", "order", 1, 0, "at least 1"), ("body", "order", 1, 3, "at most 2"),
    ("material", "young_modulus", 1e-9, 9.9e-10, "at least 1e-09 Pa"), ("material", "young_modulus", 1e18, 1.01e18, "at most 1e+18 Pa"),
    ("material", "young_modulus", 1.0, 0.0, "above 0 Pa"),
    ("material", "poisson_ratio", -0.999, -1.0, "above -1"), ("material", "poisson_ratio", 0.4999, 0.5, "below 0.5"),
    ("material", "density", 1e-12, 9.9e-13, "at least 1e-12 kg/m3"), ("material", "density", 1e12, 1.01e12, "at most 1e+12 kg/m3"),
    ("material", "density", 1.0, 0.0, "above 0 kg/m3"),
    ("obstacle", "radius", 1e-9, -1e-12, "at least 0 m"), ("obstacle", "radius", 1e-9, 0.9e-9, "at least 1e-09 m"),
    ("steps", "count", 1, 0, "at least 1"), ("steps", "count", 1_000_000, 1_000_001, "at most 1e+06"),
    ("steps", "duration", 1e-9, 9.9e-10, "at least 1e-09 s"), ("steps", "duration", 1e9, 1.01e9, "at most 1e+09 s"),
    ("steps", "duration", 1.0, 0.0, "above 0 s"),
]


@pytest.mark.parametrize("table, key, inside, outside, words", BOUNDS)
def test_every_bound_from_both_sides(table, key, inside, outside, words):
    found = getattr(getattr(of(table, key, inside), table), key)
    assert found == (tuple(inside) if isinstance(inside, list) else inside)
    with pytest.raises(InputError) as caught:
        of(table, key, outside)
    assert str(caught.value).startswith(f"{table}.{key} = ") and str(caught.value).endswith(f": must be {words}")


@pytest.mark.parametrize("table, key, unit, far", [
    ("body", "hole_centre", "m", 1e9), ("support", "displacement", "m", 1e9), ("load", "traction", "Pa", 1e18),
    ("load", "acceleration", "m/s2", 1e18), ("obstacle", "path", "m", 1e9), ("steps", "velocity", "m/s", 1e9)])
def test_units_of_what_has_two_signs_and_bounds_that_nobody_reaches(table, key, unit, far):
    kind = {"body": module.Body, "support": module.Support, "load": module.Load, "obstacle": module.Obstacle, "steps": module.Steps}[table]
    bound = next(field for field in dataclasses.fields(kind) if field.name == key).metadata["bound"]
    assert bound.unit == unit and (bound.above, bound.below, bound.at_least, bound.at_most) == (None, None, -far, far)


@pytest.mark.parametrize("table, key, known", [
    ("body", "shape", ["beam", "plate", "channel", "panel", "file"]), ("body", "cell", ["prism", "tetrahedron", "hexahedron", "triangle",
                                                                               "quadrilateral"]),
    ("body", "element", ["standard", "mean-dilatation", "reduced"]),
    ("material", "law", ["neo-hookean", "neo-hookean-log", "saint-venant-kirchhoff", "linear"]),
    ("obstacle", "shape", ["sphere", "cylinder", "capsule", "box", "half-space"]), ("obstacle", "contact", ["facets", "smooth", "nodes"])])
def test_every_choice(table, key, known):
    with pytest.raises(InputError) as caught:
        of(table, key, "none")
    assert f"{table}.{key} = 'none': must be one of {', '.join(known)}" in str(caught.value)


def test_extent_divisions_and_places():
    sized = without(BEAM, "cells") | {"length": 0.1, "width": 0.02, "height": 0.004}
    assert scene(body=BEAM).body.extent == (0.1, 0.02, 0.02) and scene(body=BEAM).body.divisions == (4, 2, 2)
    body = scene(body=sized | {"cell_size": 0.0085}).body
    assert body.divisions == (12, 2, 1)  # 11.8, 2.4 and 0.5 cells; one at least
    plane = read_body({"body": without(PLATE, "cells") | {"cell_size": 0.013}})
    assert plane.extent == (0.1, 0.02, 0.0) and plane.divisions == (8, 2) and plane.places == ("x-min", "x-max", "y-min", "y-max")
    channel = read_body({"body": {"shape": "channel"}})
    assert channel.extent == (1.6, 0.41, 0.0) and channel.divisions == (80, 20)
    assert channel.places == ("x-min", "x-max", "y-min", "y-max", "inlet", "outlet", "walls", "hole")
    assert body.places == ("x-min", "x-max", "y-min", "y-max", "z-min", "z-max")
    file = Body(shape="file", path="a.msh")
    assert file.places is None
    with pytest.raises(InputError, match="a body from a file has no length, width and height"):
        _ = file.extent


@pytest.mark.parametrize("body, words", [
    (BEAM | {"path": "a"},
     "body.path: a beam takes length, width, height, cells, cell_size, graded, focus_x, focus_y, focus_z, cell, shape, order, element"),
    (BEAM | {"plane": "strain"}, "body.plane: a beam takes"), (BEAM | {"thickness": 1.0}, "body.thickness: a beam takes"),
    (BEAM | {"hole_radius": 1.0}, "body.hole_radius: a beam takes"),
    (PLATE | {"height": 1.0},
     "body.height: a plane plate takes length, width, cells, cell_size, graded, focus_x, focus_y, focus_z, cell, shape, order, element, "
     "plane, thickness"),
    (BEAM | {"shape": "plate", "plane": "stress"}, "body.plane: a plate takes length, width, height"),
    ({"shape": "channel", "width": 1.0}, "body.width: a channel takes length, height, hole_centre"),
    ({"shape": "channel", "cells": [1, 1]}, "body.cells: a channel takes"),
    ({"shape": "file", "path": "a", "length": 1.0}, "body.length: a file takes path, scale, shape, order, element, plane, thickness"),
    ({"shape": "file"}, "body.path: missing"), (without(BEAM, "width"), "body.width: missing"),
    (without(BEAM, "height"), "body.height: missing"),
    (without(PLATE, "width"), "body.width: missing"),
    (BEAM | {"cell": "triangle"}, "body.cell = 'triangle': a beam has prism or tetrahedron or hex"),
    ({"shape": "channel", "cell": "prism"}, "body.cell = 'prism': a channel has triangle or quadrilateral cells"),
    (BEAM | {"order": 2}, "body.order = 2: prisms are of first order only"),
    (BEAM | {"shape": "plate", "element": "reduced"},
     'body.element = "reduced": only for a beam of prisms that is at least as long as wide'),
    (BEAM | {"element": "reduced", "cell": "hexahedron"}, "reduced"),
    (BEAM | {"element": "reduced", "width": 0.11}, "as long as wide and high"),
    (BEAM | {"element": "reduced", "height": 0.11}, "as long as wide and high"),
    (BEAM | {"element": "mean-dilatation", "cell": "tetrahedron"}, "only for prisms, hexahedra and tetrahedra of order 2, not for "
                                                                       "cell = 'tetrahedron'"),
    (without(BEAM, "cells"), "body: give exactly one of cells and cell_size"), (BEAM | {"cell_size": 0.1}, "body: give exactly one of"),
    (without(PLATE, "cells"), "body: give exactly one of"),
    (BEAM | {"cells": [2, 2]}, "body.cells must have 3 entries, not 2"),
    (PLATE | {"cells": [2, 2, 2]}, "body.cells must have 2 entries, not 3"),
    (BEAM | {"cells": [201, 1000, 100]}, "body: 2.01e+07 cells are more than the 2e+07"),
    ({"shape": "channel", "cell_size": 1e-4}, "body: 6.56e+07 cells are more than"),
    ({"shape": "channel", "hole_centre": [0.2, 0.04]},
     "body: the hole at (0.2, 0.04) m of radius 0.05 m does not lie inside the channel of 1.6 x 0.41 m"),
    ({"shape": "channel", "hole_centre": [0.2, 0.37]}, "does not lie inside"),
    ({"shape": "channel", "hole_centre": [0.04, 0.2]}, "not lie inside"),
    ({"shape": "channel", "hole_centre": [1.56, 0.2]}, "does not lie inside"),
    ({"shape": "channel", "hole_centre": [0.25, 0.25], "hole_radius": 0.25, "height": 1.0}, "does not lie inside"),
])
def test_rules_of_a_body(body, words):
    with pytest.raises(InputError) as caught:
        read_body({"body": body})
    assert words in str(caught.value), str(caught.value)
    refused(words, body=body)


@pytest.mark.parametrize("body", [
    BEAM | {"element": "reduced", "width": 0.1, "height": 0.1}, BEAM | {"element": "mean-dilatation"},
    BEAM | {"cell": "tetrahedron", "order": 2},
    BEAM | {"element": "mean-dilatation", "cell": "hexahedron"}, BEAM | {"shape": "plate", "element": "mean-dilatation"},
    PLATE | {"plane": "stress", "thickness": 0.1, "order": 2}, BEAM | {"cells": [2, 1000, 10_000]}, {"shape": "channel", "plane": "strain"},
    {"shape": "file", "path": "a", "order": 2, "plane": "stress", "thickness": 1.0},
    {"shape": "file", "path": "a", "element": "mean-dilatation"},
    {"shape": "channel", "hole_centre": [0.06, 0.06]}, {"shape": "channel", "hole_centre": [1.54, 0.35]},
    {"shape": "channel", "order": 2, "thickness": 2.0, "cell": "quadrilateral"}])
def test_bodies_at_the_limits_of_the_rules_are_read(body):
    found = scene(body=body).body
    assert all(getattr(found, key) == (tuple(value) if isinstance(value, list) else value) for key, value in body.items())


def test_rules_of_supports_and_loads():
    for fixed in ("x", "zy", "xyz"):
        assert scene(support=[{"where": "x-min", "fixed": fixed}]).support[0].fixed == fixed
    for fixed in ("", "xx", "w", "xyzx"):
        refused(f"support[0].fixed = {fixed!r}: must be some of the letters x, y and z, each once",
                support=[{"where": "x-min", "fixed": fixed}])
    moved = {"where": "y-max", "fixed": "xz", "displacement": [1e-3, 0, -2e-3]}
    assert scene(support=[moved]).support[0].displacement == (1e-3, 0.0, -2e-3)
    refused("support[1].displacement moves y, which fixed = 'xz' leaves free", support=[moved, moved | {"displacement": [0, 1e-9, 0]}])
    assert scene(support=[{"where": "x-min z-min"}], load=[{"acceleration": [0, 0, -9.81]}]).load[0].acceleration == (0.0, 0.0, -9.81)
    refused("support[0].where = 'x-mim': must be one of x-min, x-max, y-min, y-max, z-min, z-max; did you mean",
            support=[{"where": "x-min x-mim"}])
    refused("support[1].where = '': must be one of x-min", support=[{"where": "x-min"}, {"where": " "}])
    refused("load[0].where = 'hole': must be one of x-min", load=[{"where": "hole", "traction": [0, 0, 1]}])
    refused("support[0].where = 'z-min'", body=PLATE, support=[{"where": "z-min"}])
    anything = scene(body={"shape": "file", "path": "a"}, support=[{"where": "wall of brick"}])
    assert anything.support[0].where == "wall of brick"
    refused("load[1]: give exactly one of traction, pressure and acceleration", load=[{"acceleration": [0, 0, 1]}, {}])
    refused("load[0]: give exactly one", load=[{"where": "x-min", "traction": [0, 0, 1], "acceleration": [0, 0, 1]}])
    refused("load[0]: a traction or a pressure needs a where, an acceleration takes none", load=[{"traction": [0, 0, 1]}])
    refused("load[0]: a traction or a pressure needs a where, an acceleration takes none",
            load=[{"where": "x-min", "acceleration": [0, 0, 1]}])


def test_rules_of_steps():
    sudden = [{"acceleration": [0, 0, 1], "sudden": True}]
    refused("load[0].sudden: a load can only be sudden where [steps] dynamic = true", load=sudden)
    refused("steps.duration: missing; dynamic = true needs it", steps={"dynamic": True})
    refused("steps.velocity: needs dynamic = true", steps={"velocity": [1, 0, 0]})
    found = scene(load=sudden, steps={"dynamic": True, "duration": 2, "velocity": [1, 2, 3]}).steps
    assert found.dynamic and found.duration == 2.0 and found.velocity == (1.0, 2.0, 3.0)
    assert scene(steps={"duration": 2}).steps.duration == 2.0  # said of a scene without inertia too


def test_rules_of_obstacles():
    path = {"path": [[0, 0, 1], [0, 0, 2]]}
    needs = {"sphere": {"radius": 1.0}, "cylinder": {"radius": 1.0}, "capsule": {"radius": 1.0, "length": 2.0},
             "box": {"size": [2.0, 1.0, 3.0]},
             "half-space": {"normal": [0.0, 0.0, 1.0]}}
    values = {"radius": 0.5, "length": 2.0, "size": [2.0, 1.0, 3.0], "normal": [0.0, 0.0, 1.0]}
    for shape, own in needs.items():
        assert scene(obstacle={"shape": shape} | own | path).obstacle.path == ((0.0, 0.0, 1.0), (0.0, 0.0, 2.0))
        for key in own:
            refused(f"obstacle.{key}: missing; a {shape} needs it", obstacle={"shape": shape} | without(own, key) | path)
        for key in set(values) - set(own) - ({"radius"} if shape == "box" else set()):
            refused(f"obstacle.{key}: a {shape} has none", obstacle={"shape": shape, key: values[key]} | own | path)
    box = {"shape": "box", "size": [2.0, 1.0, 3.0]} | path
    assert scene(obstacle=box).obstacle.radius == 0.05 and scene(obstacle=box | {"radius": 0.0}).obstacle.radius == 0.0
    assert scene(obstacle=box | {"radius": 0.5}).obstacle.radius == 0.5
    refused("obstacle.radius = 0.51: must be at most 0.5 m, half the smallest side of the box", obstacle=box | {"radius": 0.51})
    refused("obstacle.radius = 0.0: must be above 0 m", obstacle=SPHERE | {"radius": 0.0})
    refused("obstacle.axis must not be the zero vector", obstacle=SPHERE | {"shape": "cylinder", "axis": [0, 0, 0]})
    refused("obstacle.normal must not be the zero vector", obstacle={"shape": "half-space", "normal": [0, 0, 0]} | path)
    refused("obstacle.path must have at least one way-point", obstacle=SPHERE | {"path": []})
    refused("obstacle.path[0] must have 3 entries, not 2", obstacle=SPHERE | {"path": [[0, 0]]})


def test_a_scene_without_all_but_its_body():
    assert read_body({"body": BEAM}) == read_body({"body": BEAM, "material": MATERIAL}) == scene().body
    assert read_body({"body": BEAM, "steps": {"count": -1}, "name": "x"}) == scene().body  # not looked at, but its name is known
    with pytest.raises(InputError, match="^stepz: unknown key; did you mean 'steps'"):
        read_body({"body": BEAM, "stepz": {}})
    with pytest.raises(InputError, match="^body: missing$"):
        read_body({"name": "x"})
    with pytest.raises(InputError, match="steps.count = -1"):
        read_body({"body": BEAM, "material": MATERIAL, "steps": {"count": -1}})
    with pytest.raises(InputError, match="^body must be a table, not an integer"):
        read_body({"body": 1})
    with pytest.raises(InputError, match="^body: missing$"):
        read_scene({"material": MATERIAL})


def test_files(tmp_path):
    text = '[body]\nshape = "file"\npath = "part.msh"\n'
    (tmp_path / "a.toml").write_text(text)
    assert load_body(tmp_path / "a.toml") == Body(shape="file", path=str(tmp_path / "part.msh"))  # beside the scene
    assert load_body(str(tmp_path / "part.msh")) == Body(shape="file", path=str(tmp_path / "part.msh"))
    (tmp_path / "B.TOML").write_text(text.replace("part.msh", "/elsewhere/part.msh"))
    assert load_body(tmp_path / "B.TOML").path == "/elsewhere/part.msh"
    (tmp_path / "c.toml").write_text(text + "[material]\nyoung_modulus = 1.0\npoisson_ratio = 0.3\n")
    assert load_scene(tmp_path / "c.toml").body.path == str(tmp_path / "part.msh")
    with pytest.raises(InputError) as caught:
        load_scene(tmp_path / "a.toml")
    assert str(caught.value) == f"{tmp_path / 'a.toml'}: material: missing"
    with pytest.raises(InputError) as caught:
        load_scene(tmp_path / "none.toml")
    assert str(caught.value) == f"{tmp_path / 'none.toml'}: No such file or directory"  # the file's name once only


@pytest.mark.parametrize("name, table, takes", [
    ("body", {"shape": "file", "file": "a.msh"}, "shape, path, scale, order, element, plane, thickness"),
    ("body", {"lenght": 1}, "shape, length, width, height, cells, cell_size, graded, focus_x, focus_y, focus_z, cell, order, element"),
    ("body", {"shape": "plate", "cell": "triangle", "x": 1},
     "shape, length, width, height, cells, cell_size, graded, focus_x, focus_y, focus_z, cell, order, element, plane, thickness"),
    ("obstacle", {"shape": "sphere", "place": 1}, "shape, radius, path, steps, contact"),
    ("obstacle", {"shape": "capsule", "r": 1}, "shape, radius, length, axis, path, steps, contact"),
    ("obstacle", {"shape": "box", "r": 1}, "shape, size, radius, angle, axis, path, steps, contact"),
    ("steps", {"number": 1}, "count, duration, dynamic, velocity, error, quantity")])
def test_an_unknown_key_lists_those_that_its_shape_takes(name, table, takes):
    whole = {"body": {"length": 1.0, "width": 1.0, "height": 1.0, "cells": [1, 1, 1]}, "material": {"young_modulus": 1, "poisson_ratio": 0}}
    with pytest.raises(InputError, match=rf"^{name}\.\w+: unknown key.* {name} takes {takes}$"):
        read_scene(whole | {name: table})
