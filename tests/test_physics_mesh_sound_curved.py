"""Curved cells with all of their middle nodes anywhere: their map put together function after function, away from the origin."""

from itertools import product

import numpy as np
import pytest

from physics.mesh.cell import CELLS
from physics.mesh.shapes.boxes import box, rectangle
from physics.mesh.sound import curved
from physics.scene import Body
from tests.test_physics_mesh_sound_by_hand import LOCAL, literal_map

KINDS = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")


def two_cells(kind):
    """Some cells beside one another, uneven and away from the origin, and a middle node of each edge, face and inside, off by so much."""
    plane = CELLS[kind].dimension == 2
    shape = Body(shape="plate" if plane else "beam", length=2.0, width=1.0, height=None if plane else 1.0, cell=kind,
                 cells=(2, 1) if plane else (2, 1, 1))
    mesh = rectangle(shape) if plane else box(shape)
    draw = np.random.default_rng(5)
    flat = np.array([1, 1, not plane])
    points = mesh.points + (0.05 * draw.uniform(-1, 1, mesh.points.shape) + (3, -2, 5)) * flat
    straight = curved.complete(points, mesh.cells, kind, {})
    return points, mesh.cells, {k: (rows, at + 0.06 * draw.uniform(-1, 1, at.shape) * flat) for k, (rows, at) in straight.items()}


def entities_of(kind):
    """What has a function of its own, in the order in which each builds on those before."""
    found = [(corner,) for corner in range(CELLS[kind].corners)] + list(CELLS[kind].edges)
    if kind == "hexahedron":
        found += CELLS[kind].facets
    return found + ([tuple(range(CELLS[kind].corners))] if kind in ("quadrilateral", "hexahedron") else [])


def factors(kind, points, cell, middles):
    """Each entity's factor is how far its node lies from where the functions before it put its centre; without a node nothing."""
    local, found = entities_of(kind), []
    for entity in local:
        centre = np.mean([LOCAL[kind][corner] for corner in entity], axis=0)
        if len(entity) == 1:
            found.append(points[cell[entity[0]]])
            continue
        rows, at = middles.get(len(entity), (np.empty((0, len(entity)), int), np.empty((0, 3))))
        node = np.flatnonzero((rows == np.sort(cell[list(entity)])).all(axis=1))
        before = literal_map(kind, local[:len(found)], found, np.pad(centre, (0, 3 - len(centre))))
        found.append(at[node[0]] - before if len(node) else np.zeros(3))
    return local, found


@pytest.mark.parametrize("kind", KINDS)
def test_the_smallest_determinant_is_that_of_the_map_put_together_function_after_function(kind):
    points, cells, middles = two_cells(kind)
    d = CELLS[kind].dimension
    samples = [p for p in product((0, 0.5, 1, 0.5 - 12**-0.5, 0.5 + 12**-0.5), repeat=d) if kind[0] in "qh" or sum(p) <= 1]
    wanted = []
    for cell in cells:
        local, factor = factors(kind, points, cell, middles)
        least = np.inf
        for place in samples:
            place, steps = np.pad(np.array(place, float), (0, 3 - d)), 0.25 * np.eye(3)[:d]  # differences of quadratic functions are exact
            slopes = [literal_map(kind, local, factor, place + s) - literal_map(kind, local, factor, place - s) for s in steps]
            least = min(least, np.linalg.det(np.array(slopes)[:, :d] / 0.5))
        wanted.append(least)
    assert curved.smallest_jacobian(points, cells, kind, middles) == pytest.approx(wanted, rel=1e-9)
    assert len({round(each, 6) for each in wanted}) == len(wanted)  # no two are alike


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_file_leaves_out_lies_where_the_functions_of_the_rest_put_it(kind):
    """Edges alone, some of the edges, and no node at all."""
    points, cells, middles = two_cells(kind)
    rows, at = middles[2]
    some = np.arange(len(rows)) % 3 > 0
    for given in ({2: (rows, at)}, {2: (rows[some], at[some])}, {}, {k: middles[k] for k in middles if k != 4}):
        found = curved.complete(points, cells, kind, given)
        assert {k: each[0].tolist() for k, each in found.items()} == {k: each[0].tolist() for k, each in middles.items()}
        for k, (keys, places) in found.items():
            for cell in cells:
                local, factor = factors(kind, points, cell, given)
                for entity in (entity for entity in local if len(entity) == k):
                    centre = np.mean([LOCAL[kind][corner] for corner in entity], axis=0)
                    row = keys.tolist().index(sorted(cell[list(entity)].tolist()))
                    expected = literal_map(kind, local, factor, np.pad(centre, (0, 3 - len(centre))))
                    assert places[row] == pytest.approx(expected, abs=1e-12)
