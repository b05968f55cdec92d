"""Unit, default and bounds of every number of a solid's scene, in one table; what has neither bound nor unit has none."""

import dataclasses

import pytest

from physics.scene import Body, Load, Material, Obstacle, Steps, Support
from physics.scene.body import Orthotropic, Where
from physics.schema import Bound

LENGTH, FAR = ("m", 0, None, 1e-9, 1e9), ("m", None, None, -1e9, 1e9)
STRONG, FACTOR = (None, None, -1e18, 1e18), ("", None, None, -1e9, 1e9)
ANGLE = ("degrees", None, None, -36_000, 36_000)
FOCUS = ("m", None, None, 0, 1e9)
# (unit, above, below, at least, at most), of keys that have any
BOUNDS = {
    Body: {"length": LENGTH, "width": LENGTH, "height": LENGTH, "cell_size": LENGTH, "hole_radius": LENGTH, "hole_cell_size": LENGTH,
           "thickness": LENGTH, "cells": ("", None, None, 1, 10_000), "order": ("", None, None, 1, 2), "focus_x": FOCUS, "focus_y": FOCUS,
           "focus_z": FOCUS, "outline": FAR, "holes": FAR,
           "layers": ("", None, None, 1, 1000), "scale": ("", 0, None, 1e-12, 1e12), "hole_centre": FAR},
    Orthotropic: {"young_moduli": ("Pa", 0, None, 1e-9, 1e18), "poisson_ratios": ("", None, None, -100, 100),
                  "shear_moduli": ("Pa", 0, None, 1e-9, 1e18)},
    Material: {"young_modulus": ("Pa", 0, None, 1e-9, 1e18), "poisson_ratio": ("", -1, 0.5, None, None),
               "density": ("kg/m3", 0, None, 1e-12, 1e12)},
    Where: {"near": ("m", None, None, None, None), "plane": ("m", None, None, None, None), "within": ("m", None, None, 0, None),
            "box": ("m", None, None, None, None)},
    Support: {"displacement": FAR, "angle": ANGLE, "centre": FAR, "factor": FACTOR},
    Load: {"traction": ("Pa", *STRONG), "acceleration": ("m/s2", *STRONG), "pressure": ("Pa", *STRONG), "factor": FACTOR},
    Obstacle: {"radius": ("m", None, None, 0, 1e9), "angle": ANGLE, "length": LENGTH, "size": LENGTH, "scale": ("", 0, None, 1e-12, 1e12),
               "path": FAR},
    Steps: {"count": ("", None, None, 1, 1_000_000), "duration": ("s", 0, None, 1e-9, 1e9), "velocity": ("m/s", None, None, -1e9, 1e9),
            "error": ("", 0, 1, None, None)},
}
DEFAULTS = {
    Body: {"shape": "beam", "cell": "prism", "order": 1, "element": "standard"}, Orthotropic: {},
    Material: {"law": "neo-hookean", "density": 1000.0}, Where: {}, Support: {"fixed": "xyz", "displacement": (0.0, 0.0, 0.0)},
    Load: {"sudden": False}, Obstacle: {"axis": (0.0, 1.0, 0.0), "contact": "facets"}, Steps: {"count": 400, "dynamic": False}}
NEEDED = {Orthotropic: {"young_moduli", "poisson_ratios", "shear_moduli"}, Material: {"young_modulus", "poisson_ratio"},
          Support: {"where"}, Obstacle: {"shape", "path"}}


@pytest.mark.parametrize("kind", BOUNDS)
def test_every_number_of_a_solid_has_its_unit_and_bounds(kind):
    found = {field.name: field.metadata.get("bound", Bound()) for field in dataclasses.fields(kind)}
    seen = {name: (bound.unit, bound.above, bound.below, bound.at_least, bound.at_most) for name, bound in found.items()}
    assert {name: bound for name, bound in seen.items() if bound != ("", None, None, None, None)} == BOUNDS[kind]


@pytest.mark.parametrize("kind", DEFAULTS)
def test_every_key_is_needed_has_a_default_or_is_not_given(kind):
    fields = {field.name: field.default for field in dataclasses.fields(kind)}
    assert {name for name, default in fields.items() if default is dataclasses.MISSING} == NEEDED.get(kind, set())
    assert {name: default for name, default in fields.items() if default not in (dataclasses.MISSING, None)} == DEFAULTS[kind]


@pytest.mark.parametrize(("kind", "table", "keys"), [
    (Body, {}, "shape length width height cells cell_size graded focus_x focus_y focus_z cell order element"),
    (Body, {"shape": "beam", "cell": "triangle"},
     "shape length width height cells cell_size graded focus_x focus_y focus_z cell order element plane thickness"),
    (Body, {"shape": "channel"}, "shape length height hole_centre hole_radius cell_size hole_cell_size cell order element plane thickness"),
    (Body, {"shape": "panel"}, "shape outline holes height layers cell_size cell order element"),
    (Body, {"shape": "file"}, "shape path scale order element plane thickness"),
    (Body, {"shape": 3}, "shape order element"),
    (Obstacle, {}, "shape path steps contact"), (Obstacle, {"shape": 3}, "shape path steps contact"),
    (Obstacle, {"shape": "half-space"}, "shape normal path steps contact"),
    (Obstacle, {"shape": "cylinder"}, "shape radius axis path steps contact"),
    (Obstacle, {"shape": "mesh"}, "shape file surface source scale radius angle axis path steps contact")])
def test_keys_of_a_shape_as_they_are_told(kind, table, keys):
    assert kind.keys_for(table) == tuple(keys.split())


def test_the_extent_of_a_panel_is_that_of_its_outline_and_layers_are_its_cells_across():
    panel = Body(shape="panel", outline=((1.0, -2.0), (4.0, 0.0), (2.0, 5.0)), height=0.5, cell_size=2.0, layers=3,
                 holes=((2.0, 1.0, 0.3), (2.0, 2.0, 0.1)))
    assert panel.extent == (3.0, 7.0, 0.5) and panel.divisions == (2, 4, 3)  # 1.5 and 3.5, the halves to even numbers
    assert panel.places == ("z-min", "z-max", "edge-1", "edge-2", "edge-3", "hole-1", "hole-2")
    assert dataclasses.replace(panel, cell_size=9.0).divisions == (1, 1, 3)
    assert dataclasses.replace(panel, height=None, holes=None).extent == (3.0, 7.0, 0.0)
    assert dataclasses.replace(panel, holes=None).places == ("z-min", "z-max", "edge-1", "edge-2", "edge-3")


def test_a_place_by_coordinates_reads_as_in_a_file():
    where = Where(plane=(0.0, 1.5, -2.0), normal=(0.0, 0.0, 1.0), within=0.25)
    assert str(where) == repr(where) == "{ plane = [0.0, 1.5, -2.0], normal = [0.0, 0.0, 1.0], within = 0.25 }"
    assert str(Where(box=((0.0, 1.0, 2.0), (3.0, 4.0, 5.0)))) == "{ box = [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]] }"
    assert str(Where(near=(0.0, 0.0, 0.0), within=0.0)) == "{ near = [0.0, 0.0, 0.0], within = 0.0 }"
