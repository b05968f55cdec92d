"""Where an obstacle starts and how it moves, relative to the body that it meets.

Let n be the outward normal of a face and t1, t2 the directions of its sides, in the order x, y, z. The obstacle's surface
first touches (were the body flat there and unmoved) at the point that lies the fractions `along` and `across` up the two
sides. Its centre moves on a straight line: from `gap` before that touch to `depth` behind it, both measured along -n,

    c(s) = touch + r n + s (-n + tan a1 t1 + tan a2 t2),   s from -gap to depth,

with r the reach of the obstacle towards the face and the tilts (a1, a2) of the push. An axis lies in the face, turned by
`turn` from t2 (on z-max: from y) towards t1; without either a cylinder's is y, on the faces across y it is z. A box and a
mesh are turned by it about x, y or z, whichever is normal to the face. Of a mesh the point given is where its origin comes,
and what touches is where it reaches furthest. A half-space faces the body. The faces of a body from a mesh file are those
of the box around it, and length, width and height are its sides.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from physics.contact.obstacles import Rigid
from physics.mesh.build import build_mesh
from physics.scene import PLACES, Body, Obstacle, read_scene
from physics.scene.rules import complete
from physics.schema import InputError, quantity, read_table

EXTENTS = ("length", "width", "height")
Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Place:
    """The table [obstacle.place] of a family; see the module's docstring."""

    face: str = quantity("z-max", choice=PLACES)
    along: float = quantity(0.5, at_least=0, at_most=1)  # of the face's first side
    across: float = quantity(0.5, at_least=0, at_most=1)  # of its second side
    gap: float = quantity(0.0, unit="m", at_least=0)  # between surface and face at step 0
    depth: float = quantity(unit="m", above=0)  # of the last step, behind first touch
    depth_in: str = quantity("m", choice=("m", *EXTENTS))  # a depth of 0.2 in "length" is a fifth of the body's length
    direction: tuple[float, float] = quantity((0.0, 0.0), unit="degrees", at_least=-75, at_most=75)  # a1, a2
    turn: float | None = quantity(None, unit="degrees", at_least=-90, at_most=90)  # of the axis, or the box, in the face


def placed(table: dict[str, Any]) -> dict[str, Any]:
    """The obstacle's table of a drawn scene with `place` replaced by the path that it stands for.

    Raises:
        InputError: the place is wrong, or there is a path as well
    """
    obstacle, place = _turned(table["obstacle"])
    # Read and check all but the path, which needs the body's extent and the obstacle's size.
    scene = read_scene({**table, "obstacle": {**obstacle, "path": [[0.0, 0.0, 0.0]]}})
    return {**obstacle, "path": _path(place, scene.body, scene.obstacles[0])}


def placed_on(body: Body, obstacle: dict[str, Any]) -> Obstacle:
    """An obstacle's table, with a place or with a path, on a body that is known; raises `InputError` as `placed` does."""
    place = None
    if "place" in obstacle:
        obstacle, place = _turned(obstacle)
        obstacle["path"] = [[0.0, 0.0, 0.0]]
    found = complete(read_table(Obstacle, obstacle, "obstacle"))
    return found if place is None else replace(found, path=tuple((x, y, z) for x, y, z in _path(place, body, found)))


def _turned(obstacle: dict[str, Any]) -> tuple[dict[str, Any], Place]:
    """An obstacle's table without its place, with the axis or normal that this gives it; and the place."""
    obstacle = dict(obstacle)
    if "path" in obstacle:
        raise InputError("obstacle: give either path or place")
    place = read_table(Place, obstacle.pop("place"), "obstacle.place")
    normal = PLACES.index(place.face) // 2
    first, second = (k for k in range(3) if k != normal)
    if place.turn is not None:
        if "axis" in obstacle or "angle" in obstacle:
            raise InputError(f"obstacle: give either {'axis' if 'axis' in obstacle else 'angle'} or place.turn")
        axis, angle = [0.0, 0.0, 0.0], math.radians(place.turn)
        if obstacle.get("shape") in ("box", "mesh"):
            axis[normal], obstacle["angle"] = 1.0, place.turn
        else:
            axis[first], axis[second] = math.sin(angle), math.cos(angle)
        obstacle["axis"] = axis
    elif normal == 1 and obstacle.get("shape") == "cylinder":
        obstacle.setdefault("axis", [0.0, 0.0, 1.0])  # its own default, y, does not lie in this face
    if obstacle.get("shape") == "half-space" and "normal" not in obstacle:
        obstacle["normal"] = [0.0, 0.0, 0.0]
        obstacle["normal"][normal] = 1.0 if place.face.endswith("min") else -1.0
    return obstacle, place


def _path(place: Place, body: Body, obstacle: Obstacle) -> list[list[float]]:
    """Two way-points of the centre."""
    normal, outward = divmod(PLACES.index(place.face), 2)
    first, second = (k for k in range(3) if k != normal)
    sign = 1 if outward else -1
    low, sides = _box(body)
    touch = [0.0, 0.0, 0.0]
    touch[first], touch[second] = low[first] + place.along * sides[first], low[second] + place.across * sides[second]
    touch[normal] = low[normal] + (sides[normal] if outward else 0.0) + sign * reach(obstacle, normal, place.face)
    unit = 1.0 if place.depth_in == "m" else sides[EXTENTS.index(place.depth_in)]
    way = [0.0, 0.0, 0.0]
    way[normal] = -sign
    way[first], way[second] = (math.tan(math.radians(angle)) for angle in place.direction)
    return [[c + s * w for c, w in zip(touch, way, strict=True)] for s in (-place.gap, unit * place.depth)]


def _box(body: Body) -> tuple[Vector, Vector]:
    """The corner of the box around a body where all coordinates are smallest, and its sides [m]."""
    if body.outline is not None:
        return (min(x for x, _ in body.outline), min(y for _, y in body.outline), 0.0), body.extent
    if body.shape != "file":
        return (0.0, 0.0, 0.0), body.extent
    assert body.path is not None
    changed = Path(body.path).stat().st_mtime_ns if Path(body.path).is_file() else 0
    return _box_of_file(body, changed)


@functools.lru_cache(maxsize=8)
def _box_of_file(body: Body, changed: int) -> tuple[Vector, Vector]:
    """The same of a mesh file as it was at a time: it is read for every scene of a family."""
    points = build_mesh(body).points
    (x, y, z), (length, width, height) = points.min(axis=0).tolist(), (points.max(axis=0) - points.min(axis=0)).tolist()
    return (x, y, z), (length, width, height)


def reach(obstacle: Obstacle, normal: int, face: str) -> float:
    """How far an obstacle's surface lies from its centre towards a face, along a coordinate axis [m]."""
    direction = np.eye(3)[normal] * (1.0 if face.endswith("min") else -1.0)
    found = Rigid(obstacle).shape.reach(direction)
    if not math.isfinite(found):
        raise InputError(f"obstacle.axis = {list(obstacle.axis)}: must be parallel to obstacle.place's face {face}")
    return found
