"""The closed surface of a rigid obstacle, from a file of triangles (STL, OBJ, PLY, whatever meshio reads) into the scene itself.

A scene holds the surface as a text, so that it needs the file no more: base64 of the numbers of points and triangles (int32), the
points (float64, in the file's unit) and the corners of the triangles (int32), all little-endian. What is read, file or text, is looked
at before it is believed:

    points at the same place are one; quadrilaterals are cut in two; triangles that then have two corners in one are left out
    every edge belongs to two triangles, no triangle is there twice, none is flat, points are finite
    triangles that look the other way than their neighbours are turned, and whole pieces that have their inside outside
    the surface does not run into itself: winding numbers before and behind some of its triangles are 0 and 1

Legend: P points, F triangles.
"""

from __future__ import annotations

import base64
import binascii
import functools
from pathlib import Path

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from physics.foreign import read_foreign
from physics.schema import InputError, missing

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Surface = tuple[Floats, Integers]

MOST = 20_000  # triangles
LARGEST = 1e12  # coordinate, in the file's unit
LOOKED_AT = 100  # triangles whose sides are looked at
FLAT = 1e-12  # area of a triangle that has none, over the square of its longest edge


def read_surface(path: str | Path) -> tuple[str, str]:
    """The text of a file's surface, and in words where it is from and what was mended.

    Raises:
        InputError: no such file, not one that meshio reads, or not a closed surface
    """
    path = Path(path)
    try:
        if why := missing(path):
            raise InputError(why)
        stamp = path.stat()
        text, said = _read(path, stamp.st_mtime_ns, stamp.st_size)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return text, ", ".join([path.name, *said])


@functools.lru_cache(maxsize=8)
def _read(path: Path, changed: int, size: int) -> tuple[str, tuple[str, ...]]:
    """The same of a file as it was at a time: a family reads it for each of its scenes."""
    found = read_foreign(path)
    triangles = [np.empty((0, 3), np.int64)]
    for block in found.cells:
        if block.type not in ("triangle", "quad", "line", "vertex"):
            raise InputError(f"has cells of the kind {block.type}; an obstacle's surface is made of triangles or quadrilaterals")
        corners = np.asarray(block.data, np.int64)
        if block.type in ("triangle", "quad"):
            triangles += [corners[:, [0, k, k + 1]] for k in range(1, corners.shape[1] - 1)]
    points, kept, said = sound(np.asarray(found.points, float), np.concatenate(triangles))
    parts = np.array([len(points), len(kept)], "<i4").tobytes(), points.astype("<f8").tobytes(), kept.astype("<i4").tobytes()
    return base64.b64encode(b"".join(parts)).decode(), tuple(said)


@functools.lru_cache(maxsize=8)
def surface_in(text: str) -> Surface:
    """The points (P, 3) and outward triangles (F, 3) in a text. Raises `InputError` when it is not what `read_surface` writes."""
    try:
        data = base64.b64decode(text, validate=True)
        count, many = (int(n) for n in np.frombuffer(data[:8], "<i4"))
        if count < 0 or not 0 <= many <= MOST or len(data) != 8 + 24 * count + 12 * many:
            raise ValueError("its length is not that of its points and triangles")
    except (binascii.Error, ValueError) as error:
        raise InputError(f"not a surface: {error}") from None
    points = np.frombuffer(data, "<f8", 3 * count, 8).reshape(-1, 3).astype(np.float64)
    triangles = np.frombuffer(data, "<i4", 3 * many, 8 + 24 * count).reshape(-1, 3).astype(np.int64)
    found, kept, said = sound(points, triangles)
    if said or not (np.array_equal(found, points) and np.array_equal(kept, triangles)):
        raise InputError("not a surface as it is written: its triangles want mending")
    return points, triangles


def sound(points: Floats, triangles: Integers) -> tuple[Floats, Integers, list[str]]:
    """The points (P, 3) and outward triangles (F, 3) of a closed surface, and what was mended, a line each. Raises `InputError`."""
    if not len(triangles):
        raise InputError("has no triangles")
    if len(triangles) > MOST:
        raise InputError(f"{len(triangles)} triangles; at most {MOST}: make it coarser, for contact sees no more of it")
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError("its points are not in space")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise InputError("a triangle names a point that is not there")
    points = points + 0.0  # -0 is 0
    if not (np.isfinite(points).all() and abs(points).max() <= LARGEST):
        raise InputError(f"has coordinates that are not finite or beyond {LARGEST:g}")
    points, triangles = _once(points, triangles)
    said = []
    whole = (np.sort(triangles, axis=1)[:, 1:] != np.sort(triangles, axis=1)[:, :-1]).all(axis=1)
    if not whole.all():
        said.append(f"{(~whole).sum()} triangles with two corners in one left out")
        points, triangles = _once(points, triangles[whole])
    _check(points, triangles)
    turned, piece = _oriented(triangles)
    triangles = np.where(turned[:, None], triangles[:, ::-1], triangles)
    a, b, c = (points[triangles[:, k]] - points.mean(axis=0) for k in range(3))
    inside_out = np.bincount(piece, (np.cross(a, b) * c).sum(axis=1)) < 0
    triangles = np.where(inside_out[piece, None], triangles[:, ::-1], triangles)
    if many := int((turned != inside_out[piece]).sum()):
        said.append(f"{many} of {len(triangles)} triangles looked inwards and have been turned")
    _check_sides(points, triangles)
    return points, triangles, said


def _once(points: Floats, triangles: Integers) -> Surface:
    """The points that triangles use, each place once, in the order in which they first come."""
    used, number = np.unique(triangles, return_inverse=True)
    _, first, same = np.unique(points[used], axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return points[used[first[order]]], place[same.ravel()][number.reshape(triangles.shape)]


def _check(points: Floats, triangles: Integers) -> None:
    """Each triangle once and with an area, each edge in two of them. Raises `InputError`."""
    if not len(triangles):
        raise InputError("has no triangles")
    corners = np.sort(triangles, axis=1)
    alike, count = np.unique(corners, axis=0, return_counts=True)
    if (count > 1).any():
        raise InputError(f"a triangle is there twice, at {_at(points[alike[count.argmax()]].mean(axis=0))}")
    sides = np.linalg.norm(points[triangles] - points[np.roll(triangles, 1, axis=1)], axis=2).max(axis=1)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    if (area <= FLAT * sides**2).any():
        raise InputError(f"a triangle has no area, at {_at(points[triangles[(area / sides**2).argmin()]].mean(axis=0))}")
    edges = np.sort(np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    if (count != 2).any():
        at = int((count != 2).argmax())
        raise InputError(f"is not closed: the edge from {_at(points[edges[at, 0]])} to {_at(points[edges[at, 1]])} belongs to "
                         f"{count[at]} triangle{'s' * int(count[at] > 1)}, not to two")


def _at(point: Floats) -> str:
    return f"({', '.join(f'{x:.4g}' for x in point)})"


def _oriented(triangles: Integers) -> tuple[NDArray[np.bool_], Integers]:
    """(F,) which triangles must be turned to look like the first of their piece, and the number of the piece. Raises `InputError`."""
    directed = np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    edges, owner = np.sort(directed, axis=1), np.tile(np.arange(len(triangles)), 3)
    order = np.lexsort(edges.T)
    one, other = order[::2], order[1::2]  # of each edge its two triangles
    against = (directed[one] == directed[other]).all(axis=1)  # both run along it the same way
    # Each triangle stands there twice, as it is and turned, joined to those of its neighbours that look the same way as it.
    many, one, other = len(triangles), owner[one], owner[other]
    pairs = np.concatenate([[one, other + many * against], [one + many, other + many * ~against]], axis=1)
    _, found = connected_components(scipy.sparse.csr_matrix((np.ones(len(pairs[0]), np.int8), pairs), shape=(2 * many, 2 * many)))
    if (found[:many] == found[many:]).any():
        raise InputError("has one side only: its triangles cannot all look outwards")
    _, first, piece = np.unique(np.minimum(found[:many], found[many:]), return_index=True, return_inverse=True)
    return found[:many] != found[first][piece], piece.astype(np.int64)


def _check_sides(points: Floats, triangles: Integers) -> None:
    """Some triangles have nothing before them and the body behind them. Raises `InputError`."""
    looked = np.unique(np.linspace(0, len(triangles) - 1, LOOKED_AT).round().astype(int))
    a, b, c = (points[triangles[looked, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    size = np.linalg.norm(across, axis=1, keepdims=True)
    step = 1e-3 * np.sqrt(size) * across / size
    for side, wanted in ((1, 0.0), (-1, 1.0)):
        found = winding((a + b + c) / 3 + side * step, points, triangles)
        if (wrong := abs(found - wanted) > 0.5).any():
            raise InputError(f"runs into itself, or has a piece within another, at {_at(((a + b + c) / 3)[wrong.argmax()])}")


def winding(places: Floats, points: Floats, triangles: Integers) -> Floats:
    """(Q,) how often a closed surface goes round places (Q, 3): the solid angles of its triangles over 4 pi.

    van Oosterom and Strackee, IEEE Trans. Biomed. Eng. 30, 1983: tan(angle/2) = a.(b x c) / (abc + (a.b)c + (b.c)a + (c.a)b).
    """
    found = np.empty(len(places))
    for i, place in enumerate(places):
        seen = points - place
        size = np.linalg.norm(seen, axis=1)
        (a, b, c), (la, lb, lc) = (seen[triangles[:, k]] for k in range(3)), (size[triangles[:, k]] for k in range(3))
        below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        found[i] = np.arctan2((a * np.cross(b, c)).sum(axis=1), below).sum() / (2 * np.pi)
    return found
