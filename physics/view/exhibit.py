"""What a page shows of a body in motion: which motions, coloured by what, and how few numbers that takes.

Stored are the surface of the body and of each motion a few shapes (lowrank.py), of a prediction those of its difference to the
truth, so that a small error is shown as well as a large one. The largest value of each quantity in each frame is found over all
nodes before anything is left out.

Legend: T frames, N nodes of the body, C cells, S nodes of its surface, M nodes of the obstacle.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from physics.body.stress import von_mises
from physics.mesh.mesh import Mesh
from physics.scene import Materials
from physics.view.drawing import Floats, ObstacleSurface, eye_for, feature_edges, fit
from physics.view.lowrank import LowRank, compress
from physics.view.pictures import ERROR_COLOURS, SIZE_COLOURS, VALUE_COLOURS

FIELD_COLOURS = "plasma"
MOTION, COLOUR = 1e-4, 1 / 512  # what may be left out: of the largest displacement; half a level of colour of whatever is coloured
FARTHEST = 1e3  # a motion that takes a node so many lengths of the body away is not shown
FRAMES = 401  # at most


@dataclass(frozen=True, kw_only=True)
class Animation:
    """displacement: (T, N, 3) [m]; fields: quantity with its unit in brackets -> (T, N) what else the body can be coloured by."""

    displacement: Floats
    fields: dict[str, Floats] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Exhibit:
    """One body, its motions one beside the other.

    motions: all of the same frames, by name
    frames: what each frame is, such as "step 3 of 60"
    truth: name of the motion that errors are distances to; empty without one
    unit: of displacements and errors, and how many of it are a metre
    """

    title: str
    mesh: Mesh
    motions: dict[str, Animation]
    frames: Sequence[str]
    truth: str = ""
    obstacle: ObstacleSurface | None = None
    unit: tuple[str, float] = ("mm", 1e3)

    @property
    def blown_up(self) -> list[str]:
        """Names of the motions that cannot be drawn: not finite, or too far away."""
        farthest = FARTHEST * np.ptp(self.mesh.points, axis=0).max()
        return [name for name, motion in self.motions.items()
                if not (np.isfinite(motion.displacement).all() and abs(motion.displacement).max() <= farthest)]

    @property
    def drawable(self) -> Exhibit:
        """The same without those."""
        lost = self.blown_up
        return replace(self, motions={name: motion for name, motion in self.motions.items() if name not in lost})


def path_exhibit(title: str, mesh: Mesh, paths: dict[str, Floats], material: Materials | None, *, truth: str = "",
                 obstacle: ObstacleSurface | None = None, first: int = 0, steps: int | None = None,
                 step_seconds: float | None = None) -> Exhibit:
    """Paths (T, N, 3) [m] of one body with their von Mises stress, at most FRAMES of their frames, evenly spread.

    material: without one there is no stress
    first: number of the first frame; steps: that of the last step, T - 1 when it is not given
    step_seconds: of a body with inertia
    """
    count = len(next(iter(paths.values())))
    chosen = np.unique(np.linspace(0, count - 1, min(FRAMES, count)).round().astype(int))
    last = count - 1 if steps is None else steps
    names = [f"step {first + k} of {last}" + ("" if step_seconds is None else f", {(first + k) * step_seconds:.4g} s") for k in chosen]
    exhibit = Exhibit(title=title, mesh=mesh, motions={name: Animation(displacement=path[chosen]) for name, path in paths.items()},
                      frames=names, truth=truth, obstacle=obstacle and ObstacleSurface(obstacle.points[chosen], obstacle.triangles))
    if material is None:
        return exhibit
    stress = {name: at_nodes(mesh, np.array([von_mises(mesh, frame, material) for frame in motion.displacement]))
              for name, motion in exhibit.drawable.motions.items()}
    unit, factor = _readable(max((values.max() for values in stress.values()), default=0.0))
    return replace(exhibit, motions={name: motion if name not in stress else
                                     replace(motion, fields={f"von Mises stress [{unit}]": factor * stress[name]})
                                     for name, motion in exhibit.motions.items()})


def mode_exhibit(mesh: Mesh, modes: Floats, names: Sequence[str], frames: int = 24) -> Exhibit:
    """One period of each mode, (m, N, 3) or (m, N), as `mode_film` moves it: the largest displacement is a sixth of the length."""
    phases = np.cos(2 * np.pi * np.arange(frames) / frames)
    amplitude = float(np.ptp(mesh.points, axis=0).max() / 6)
    motions = {}
    for name, mode in zip(names, modes, strict=True):
        largest = float(abs(mode).max() if mode.ndim == 1 else np.linalg.norm(mode, axis=1).max()) or 1.0
        moving = np.multiply.outer(phases, mode / largest)
        motions[name] = (Animation(displacement=amplitude * moving) if mode.ndim == 2 else
                         Animation(displacement=np.zeros((frames, *mesh.points.shape)), fields={"value [of the largest]": moving}))
    return Exhibit(title="one period", mesh=mesh, motions=motions, unit=("of the largest", 1 / amplitude),
                   frames=[f"phase {360 * k / frames:g} degrees" for k in range(frames)])


def at_nodes(mesh: Mesh, values: Floats) -> Floats:
    """(T, N) means over the cells around each node of values (T, C); over those that are numbers, and zero where none is."""
    cells, corners = mesh.cells.shape
    around = scipy.sparse.csr_matrix((np.ones(mesh.cells.size), (mesh.cells.ravel(), np.repeat(np.arange(cells), corners))),
                                     shape=(len(mesh.points), cells))
    known = np.isfinite(values)
    return ((around @ np.where(known, values, 0.0).T) / np.maximum(around @ known.T.astype(float), 1)).T


def stored(exhibit: Exhibit, room: int) -> dict[str, Any]:
    """A drawable exhibit as the program in the page reads it, for JSON; at most about `room` [bytes] for each quantity of each motion.

    Arrays are base64, little-endian: numbers of nodes 32-bit, places and coefficients 32-bit floats, shapes 16-bit integers.
    """
    mesh, truth = exhibit.mesh, exhibit.motions.get(exhibit.truth)
    shown = np.unique(np.concatenate([part.ravel() for part in mesh.surface]))
    number = np.zeros(len(mesh.points), np.int64)
    number[shown] = np.arange(len(shown))
    base = None if truth is None else _shapes(truth.displacement[:, shown].astype(np.float64), MOTION, room)
    motions = [_motion(name, motion, shown, truth, base, room) for name, motion in exhibit.motions.items()]
    facets = [number[part] for part in mesh.surface]
    quantities = _quantities(exhibit)
    seen = [truth] if truth is not None else list(exhibit.motions.values())
    ends = [mesh.points + end(motion.displacement, axis=0) for motion in seen for end in (np.min, np.max)]
    surface = exhibit.obstacle and ObstacleSurface(exhibit.obstacle.points.reshape(-1, 3), exhibit.obstacle.triangles)
    camera = fit([mesh.points, *ends], surface, eye_for(mesh))
    return {"title": exhibit.title, "frames": list(exhibit.frames), "truth": exhibit.truth if truth is not None else "",
            "camera": {"centre": camera.centre.tolist(), "half": [camera.half_width, camera.half_height], "eye": camera.eye.tolist()},
            "nodes": packed(shown, "<u4"), "points": packed(mesh.points[shown], "<f4"),
            "triangles": packed(np.concatenate([_triangles(part) for part in facets]), "<u4"),
            "edges": packed(np.unique(np.concatenate([_sides(part) for part in facets]), axis=0), "<u4"),
            "outline": packed(number[feature_edges(mesh)], "<u4"), "obstacle": _obstacle(exhibit.obstacle, room),
            "quantities": quantities,
            "motions": [motion | {"drawn": _drawn(motion, quantities)} for motion in motions]}


def _motion(name: str, motion: Animation, shown: NDArray[np.int64], truth: Animation | None, base: LowRank | None,
            room: int) -> dict[str, Any]:
    """One motion; "within" is how far what the page shows is off at most, of each quantity."""
    moved = motion.displacement[:, shown].astype(np.float64)
    curves, above, within = {"displacement": _lengths(motion.displacement).max(axis=1)}, False, {}
    if truth is None or base is None:
        shapes = _shapes(moved, MOTION, room)
        drawn = shapes.frames
    else:
        curves = {"error": _lengths(motion.displacement - truth.displacement.astype(np.float64)).max(axis=1), **curves}
        above = motion is not truth
        shapes = _shapes(moved - truth.displacement[:, shown], COLOUR, room) if above else base
        drawn = base.frames + shapes.frames if above else base.frames
        within["error"] = shapes.error if above else 0.0
    within["displacement"] = float(_lengths(drawn.reshape(moved.shape) - moved).max())
    fields = {}
    for quantity, values in motion.fields.items():
        found = _shapes(values[:, shown, None].astype(np.float64), COLOUR, room)
        fields[quantity], within[quantity] = _words(found), found.error
        curves[quantity] = abs(values).max(axis=1)
    return {"name": name, "motion": _words(shapes), "above": above, "fields": fields, "within": within,
            "curves": {quantity: [float(f"{value:.5g}") for value in curve] for quantity, curve in curves.items()}}


def _quantities(exhibit: Exhibit) -> list[dict[str, Any]]:
    """What the body can be coloured by, the best first: its name in the curves, its words, its unit and its colours."""
    unit, factor = exhibit.unit
    found = [{"key": "displacement", "name": "displacement", "unit": unit, "factor": factor, "colours": SIZE_COLOURS, "signed": False}]
    if exhibit.truth in exhibit.motions and len(exhibit.motions) > 1:
        found.insert(0, found[0] | {"key": "error", "name": "error", "colours": ERROR_COLOURS})
    for key in dict.fromkeys(key for motion in exhibit.motions.values() for key in motion.fields):
        name, _, unit = key.rstrip("]").partition(" [")
        signed = any((motion.fields[key] < 0).any() for motion in exhibit.motions.values() if key in motion.fields)
        found.append({"key": key, "name": name, "unit": unit, "factor": 1.0, "signed": signed,
                      "colours": VALUE_COLOURS if signed else FIELD_COLOURS})
    still = not any(motion.displacement.any() for motion in exhibit.motions.values())
    return found[::-1] if still else found  # where nothing moves the value comes first


def _drawn(motion: dict[str, Any], quantities: list[dict[str, Any]]) -> str:
    """How far off a motion is drawn at most, in words."""
    within = [f"{each['name']} {each['factor'] * motion['within'][each['key']]:.2g} {each['unit']}" for each in quantities
              if each["key"] in motion["within"]]
    return f"{motion['name']}: {', '.join(within)}"


def _obstacle(obstacle: ObstacleSurface | None, room: int) -> dict[str, Any] | None:
    if obstacle is None:
        return None
    places = obstacle.points.reshape(-1, *obstacle.points.shape[-2:]).astype(np.float64)
    return {"points": packed(places[0], "<f4"), "triangles": packed(obstacle.triangles, "<u4"),
            "motion": _words(_shapes(places - places[0], MOTION, room))}


def _shapes(frames: Floats, share: float, room: int) -> LowRank:
    """Shapes of frames (T, n, k) that leave at most a share of the largest vector, as far as there is room."""
    each = (2 * frames[0].size + 4 * len(frames)) * 4 // 3  # [bytes] of a shape in base64
    return compress(frames, share * float(_lengths(frames).max()), max(1, room // each))


def _words(shapes: LowRank) -> dict[str, Any]:
    return {"rank": len(shapes.shapes), "coefficients": packed(shapes.coefficients, "<f4"), "shapes": packed(shapes.shapes, "<i2")}


def packed(array: NDArray[Any], kind: str) -> str:
    """An array as base64 of a kind of number."""
    return base64.b64encode(np.ascontiguousarray(array, kind).tobytes()).decode()


def _lengths(vectors: NDArray[np.floating[Any]]) -> Floats:
    return np.sqrt((vectors.astype(np.float64) ** 2).sum(axis=-1))


def _triangles(facets: NDArray[np.int64]) -> NDArray[np.int64]:
    """(.., 3) of triangles or of quadrilaterals."""
    return np.concatenate([facets[:, [0, k, k + 1]] for k in range(1, facets.shape[1] - 1)])


def _sides(facets: NDArray[np.int64]) -> NDArray[np.int64]:
    """(.., 2) sides, the smaller number first."""
    return np.sort(np.stack([facets, np.roll(facets, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)


def _readable(largest: float) -> tuple[str, float]:
    """The unit in which a stress [Pa] is written without many zeros, and its factor."""
    return next(((unit, factor) for unit, factor in (("GPa", 1e-9), ("MPa", 1e-6), ("kPa", 1e-3)) if largest * factor >= 1), ("Pa", 1.0))
