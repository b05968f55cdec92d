"""What holds for any input, tried on inputs that hypothesis makes up; the same ones in every run."""

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings
from hypothesis import strategies as st

from datagen.files.tfrecord import parse_example, write_example
from datagen.files.trajectory import read_trajectory, write_trajectory
from datagen.sets.pack import decode, encode
from physics.contact.conditions import solve_complementarity
from physics.contact.obstacles import Rigid
from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS
from physics.mesh.quality import cell_volumes
from physics.scene import Body, Obstacle, Scene, read_scene
from tests.five_nodes import tiny

FINDING = settings(derandomize=True, deadline=None, max_examples=60)

length = st.floats(1e-3, 10)
coordinate = st.floats(-5, 5)
vector = st.tuples(coordinate, coordinate, coordinate)
direction = vector.filter(lambda v: np.linalg.norm(v) > 1e-3)
stretch = st.integers(1, 3)
LAWS = ("neo-hookean", "neo-hookean-log", "saint-venant-kirchhoff", "linear")


@st.composite
def obstacles(draw):
    """The table of an obstacle far above the body."""
    shape = draw(st.sampled_from(["sphere", "cylinder", "capsule", "box", "half-space"]))
    table = {"shape": shape, "path": [list(draw(vector)), list(draw(vector))], "contact": draw(st.sampled_from(["facets", "nodes"]))}
    if shape in ("sphere", "cylinder", "capsule"):
        table["radius"] = draw(length)
    if shape in ("cylinder", "capsule"):
        table["axis"] = list(draw(direction))
    if shape == "capsule":
        table["length"] = draw(length)
    if shape == "box":
        table["size"] = [draw(length) for _ in range(3)]
        if draw(st.booleans()):
            table["radius"] = draw(st.floats(0, 0.5)) * min(table["size"])
    if shape == "half-space":
        table["normal"] = list(draw(direction))
    return table


@st.composite
def bodies(draw):
    """The table of a body of any shape, with all that this shape takes or with less."""
    shape = draw(st.sampled_from(["beam", "plate", "plane plate", "channel", "file"]))
    body = {"shape": shape.removeprefix("plane ")}
    if shape in ("beam", "plate"):
        body |= {"length": draw(length), "width": draw(length), "height": draw(length),
                 "cell": draw(st.sampled_from(["prism", "tetrahedron", "hexahedron"]))}
        body |= draw(st.sampled_from([{"cells": [draw(stretch) for _ in range(3)]}, {"cell_size": max(body["length"], body["width"])}]))
        if shape == "beam" and body["cell"] == "prism" and body["length"] >= max(body["width"], body["height"]):
            body["element"] = draw(st.sampled_from(["standard", "mean-dilatation", "reduced"]))
        if body["cell"] != "prism":
            body["order"] = draw(st.integers(1, 2))
    if shape == "plane plate":
        body |= {"length": draw(length), "width": draw(length), "cell": draw(st.sampled_from(["triangle", "quadrilateral"])),
                 "cells": [draw(stretch) for _ in range(2)]}
    if shape == "channel" and draw(st.booleans()):
        body |= {"length": 2.0, "height": 1.0, "hole_centre": [1.0, 0.5], "hole_radius": draw(st.floats(0.01, 0.4)), "cell_size": 0.1}
    if shape == "file":
        body |= {"path": draw(st.text(min_size=1, max_size=20)), "element": draw(st.sampled_from(["standard", "mean-dilatation"]))}
    if shape in ("plane plate", "channel", "file") and draw(st.booleans()):
        body |= {"plane": draw(st.sampled_from(["strain", "stress"])), "thickness": draw(length)}
    return body


@st.composite
def scenes(draw):
    body = draw(bodies())
    table = {"name": draw(st.text(max_size=20)), "body": body,
             "material": {"law": draw(st.sampled_from(LAWS)), "young_modulus": draw(st.floats(1, 1e12)),
                          "poisson_ratio": draw(st.floats(-0.9, 0.49)), "density": draw(st.floats(1e-3, 1e5))},
             "support": [{"where": draw(places_of(body)), "fixed": "xz", "displacement": [draw(coordinate), 0.0, draw(coordinate)]}],
             "load": [{"where": "y-max", "traction": list(draw(vector))}, {"acceleration": list(draw(vector))}],
             "steps": {"count": draw(st.integers(1, 1000))}}
    if draw(st.booleans()):
        table["obstacle"] = draw(obstacles())
    if draw(st.booleans()):
        table["steps"] |= {"dynamic": True, "duration": draw(length), "velocity": list(draw(vector))}
    return table


def places_of(body):
    """The name of a place that a support may be at; a file's are not known before it is read."""
    if body["shape"] == "file":
        return st.text(min_size=1, max_size=30)
    return st.sampled_from(["x-min", "x-max y-min"] + ["x-min z-min"] * ("height" in body and body["shape"] != "channel"))


@FINDING
@given(scenes())
def test_a_scene_written_and_read_is_the_same_scene(table):
    scene = read_scene(table)
    assert Scene.from_toml(scene.to_toml()) == scene


@FINDING
@given(scenes(), st.dictionaries(st.text(max_size=20), st.tuples(st.sets(st.integers(0, 3), min_size=1), st.booleans()), max_size=4))
def test_a_scene_and_its_places_come_back_from_a_trajectory_and_from_a_pack(tmp_path_factory, table, drawn):
    scene = read_scene(table)
    places = {name: {"nodes": np.array(sorted(nodes)), **({"line": np.array([[0, max(nodes)]])} if made else {})}
              for name, (nodes, made) in drawn.items()}
    of_file = scene.body.shape == "file"
    written = tiny(scene=scene.to_toml(), places=places if of_file else None)
    path = tmp_path_factory.mktemp("written") / "a.vtkhdf"
    write_trajectory(path, written)
    for found in (read_trajectory(path), decode(encode(written, 1e-6)[0])):
        assert Scene.from_toml(found.scene) == scene
        assert (found.places is not None) == of_file
        if of_file:
            assert {name: {kind: array.tolist() for kind, array in place.items()} for name, place in found.places.items()} == {
                name: {kind: array.tolist() for kind, array in place.items()} for name, place in places.items()}


@FINDING
@given(obstacles(), vector, vector)
def test_a_gap_changes_by_no_more_than_the_point_moves_and_its_normal_has_length_1(table, one, other):
    rigid = Rigid(Obstacle(**{key: tuple(map(tuple, value)) if key == "path" else tuple(value) if isinstance(value, list) else value
                              for key, value in table.items()}))
    gap, normal = rigid.gap(np.array([one, other]), rigid.position(0.3))
    assert abs(gap[0] - gap[1]) <= np.linalg.norm(np.subtract(one, other)) + 1e-12
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1, abs=1e-12)


@FINDING
@given(st.sampled_from(["tetrahedron", "prism", "hexahedron"]), st.tuples(*[st.floats(0, 1)] * 3), st.integers(0, 10**6))
def test_shape_functions_sum_to_1_and_follow_linear_fields(name, at, seed):
    cell, rng = CELLS[name], np.random.default_rng(seed)
    slope, start = rng.normal(size=3), rng.normal()
    corners = {"tetrahedron": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
               "prism": [(r, s, t) for t in (0, 1) for r, s in ((0, 0), (1, 0), (0, 1))],
               "hexahedron": [(r, s, t) for t in (0, 1) for r, s in ((0, 0), (1, 0), (1, 1), (0, 1))]}[name]
    values, gradients = cell.shapes(np.array([at]))
    field = np.array(corners) @ slope + start
    assert values[0].sum() == pytest.approx(1, abs=1e-14) and gradients[0].sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-14)
    assert values[0] @ field == pytest.approx(np.dot(at, slope) + start, abs=1e-13)
    assert field @ gradients[0] == pytest.approx(slope, abs=1e-13)


@FINDING
@given(st.sampled_from(["prism", "tetrahedron", "hexahedron"]), st.sampled_from(["beam", "plate"]), length, length, length,
       stretch, stretch, stretch)
def test_the_cells_of_a_box_fill_it_once(cell, shape, x, y, z, i, j, k):
    mesh = build_mesh(Body(shape=shape, length=x, width=y, height=z, cells=(i, j, k), cell=cell))
    volumes = cell_volumes(mesh.points, mesh.cells, cell)
    assert volumes.min() > 0 and volumes.sum() == pytest.approx(x * y * z, rel=1e-12)
    # outward facets: their moments r . n A sum to three times the volume (divergence theorem)
    moment = 0.0
    for facets in mesh.boundary:
        corner = mesh.points[facets]
        for a, b in ((1, 2), (2, 3))[:facets.shape[1] - 2]:
            area = np.cross(corner[:, a] - corner[:, 0], corner[:, b] - corner[:, 0]) / 2
            moment += (corner[:, [0, a, b]].mean(axis=1) * area).sum()
    assert moment == pytest.approx(3 * x * y * z, rel=1e-12)


@FINDING
@given(st.integers(1, 7), st.integers(0, 10**6))
def test_contact_forces_are_those_of_non_negative_least_squares(count, seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(count, count)) + 0.5 * np.eye(count)
    matrix, gap = root @ root.T + 1e-3 * np.eye(count), rng.normal(size=count)
    p = solve_complementarity(matrix, gap, rng.random(count) < 0.5)
    w = gap + matrix @ p
    scale = abs(matrix).max() * max(1, abs(p).max())
    assert p.min() >= 0 and w.min() > -1e-9 * scale and abs(p @ w) < 1e-9 * scale * max(1, abs(p).max())
    lower = np.linalg.cholesky(matrix)
    assert p == pytest.approx(scipy.optimize.nnls(lower.T, -np.linalg.solve(lower, gap))[0], abs=1e-6 * max(1, abs(p).max()))


@FINDING
@given(st.dictionaries(st.text(min_size=1, max_size=10), st.binary(max_size=300), max_size=6))
def test_an_example_written_and_parsed_is_the_same(features):
    assert parse_example(write_example(features)) == {name: [value] for name, value in features.items()}
