"""What happens to a body: supports, loads, rigid obstacles, and steps; frozen, with unit and bounds of every key."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from physics.scene.body import FAR, Vector, Where
from physics.schema import quantity

QUANTITIES = ("displacement", "reaction", "stress")
_QUANTITY: Any = quantity(None, choice=QUANTITIES)  # in the class the name is that of the key
STRONG: dict[str, Any] = {"at_least": -1e18, "at_most": 1e18}  # of tractions [Pa] and accelerations [m/s2]
# Which keys each shape of [obstacle] needs; a box may have a radius and an angle too, and a mesh these and a scale. The surface of a mesh
# comes from a `file`.
NEEDS = {"sphere": ("radius",), "cylinder": ("radius",), "capsule": ("radius", "length"), "box": ("size",), "half-space": ("normal",),
         "mesh": ("surface",)}
TAKES = NEEDS | {"box": ("size", "radius", "angle"), "mesh": ("file", "surface", "source", "scale", "radius", "angle")}


@dataclass(frozen=True, kw_only=True)
class Support:
    """Components of the displacement held at a place; `displacement` is reached linearly at the last step.

    `where` is a face of a shape, a physical group of a file, or several of them with blanks between: what they have in
    common, so "x-min z-min" is an edge; or a place by coordinates. In a plane body z is held everywhere.

    With `angle` the place turns as a whole about an `axis` through `centre`, by default the mean of its nodes. With `steps`, fractions
    0 .. 1, displacement and angle are at each of them the share `factor` of what is given (tables.py).

    where: the place
    fixed: the components that are held, some of the letters x, y and z
    displacement: at the last step
    axis, angle, centre: of a turn
    steps: fractions 0 .. 1 at which shares are given; or table = a CSV file in place of both
    factor: shares at these
    """

    where: str | Where
    fixed: str = "xyz"
    displacement: Vector = quantity((0.0, 0.0, 0.0), unit="m", **FAR)
    axis: Vector | None = None
    angle: float | None = quantity(None, unit="degrees", at_least=-36_000, at_most=36_000)
    centre: Vector | None = quantity(None, unit="m", **FAR)
    steps: tuple[float, ...] | None = None
    factor: tuple[float, ...] | None = quantity(None, **FAR)


@dataclass(frozen=True, kw_only=True)
class Load:
    """A load, reached linearly at the last step: a traction [Pa] on a face, outer or inner, a pressure [Pa] on an outer face, or an
    acceleration [m/s2] of the body.

    A pressure pushes along the normal into the body. It is dead, as a traction is, or with `follower` stays normal to the face
    that moves (body/pressure.py).
    With `sudden` it acts in full from the start, in dynamic scenes only. With `steps`, fractions 0 .. 1, it is at
    each of them the share `factor` of what is given (tables.py).

    where: the face; none for an acceleration
    traction: force over area at rest
    acceleration: of the whole body, as gravity
    sudden: in full from the start
    pressure: along the normal into the body
    follower: whether a pressure turns with its face
    steps: fractions 0 .. 1 at which shares are given; or table = a CSV file in place of both
    factor: shares at these
    """

    where: str | Where | None = None
    traction: Vector | None = quantity(None, unit="Pa", **STRONG)
    acceleration: Vector | None = quantity(None, unit="m/s2", **STRONG)
    sudden: bool = False
    pressure: float | None = quantity(None, unit="Pa", **STRONG)
    follower: bool | None = None
    steps: tuple[float, ...] | None = None
    factor: tuple[float, ...] | None = quantity(None, **FAR)


@dataclass(frozen=True, kw_only=True)
class Obstacle:
    """A rigid body that touches without friction; what each shape is stands in contact/obstacles.py.

    Its centre follows the way-points of `path`, reached at equal fractions of the steps, or at those of `steps`, the first one at
    step 0. A box and a mesh may be turned by an `angle` about `axis`.

    mesh: any closed surface, from a `file` of triangles relative to the scene file (surface.py). Its centre is the origin of the file,
        whose coordinates times `scale` are metres; contact sees it smoothed over about `radius` (contact/tool.py). Read, the scene holds
        the `surface` itself as a text, and in `source` where it is from, in place of the file.

    shape: of the body that presses
    radius: of sphere, cylinder and capsule; of the edges of a box, a twentieth of its smallest side by default; a mesh is smoothed over it
    axis: of a cylinder or capsule; a box and a mesh are turned about it
    angle: of that turn
    length: of a capsule, between the centres of its ends
    size: of a box along x, y and z
    normal: of a half-space, out of it
    file: of the triangles of a mesh
    surface: these triangles as a text, in a scene that was written
    source: the file that they are from
    scale: metres in a unit of the file
    path: of the centre
    steps: fractions 0 .. 1 at which the points of the path are reached, evenly by default
    contact: felt at points all over the facets, on a surface without the edges between these, or at nodes alone
    """

    @staticmethod
    def keys_for(table: dict[str, Any]) -> tuple[str, ...]:
        """The keys that the shape of a table takes."""
        shape = table.get("shape")
        own = TAKES.get(shape if isinstance(shape, str) else "", ())
        return ("shape", *own, *("axis",) * (shape in ("cylinder", "capsule", "box", "mesh")), "path", "steps", "contact")

    shape: str = quantity(choice=tuple(NEEDS))
    radius: float | None = quantity(None, unit="m", at_least=0, at_most=1e9)
    axis: Vector = (0.0, 1.0, 0.0)
    angle: float | None = quantity(None, unit="degrees", at_least=-36_000, at_most=36_000)
    length: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)
    size: Vector | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)
    normal: Vector | None = None
    file: str | None = None
    surface: str | None = None
    source: str | None = None
    scale: float | None = quantity(None, above=0, at_least=1e-12, at_most=1e12)
    path: tuple[Vector, ...] = quantity(unit="m", **FAR)
    steps: tuple[float, ...] | None = None
    contact: str = quantity("facets", choice=("facets", "smooth", "nodes"))


@dataclass(frozen=True, kw_only=True)
class Steps:
    """The number of equal steps in which the loading is applied, and the time that it takes.

    `dynamic` gives the body inertia; then `duration` is needed, and `velocity` is that of the whole body at the start, but for
    what is held.

    `error` asks for a solution that is off by at most so much, in a relative norm of the `quantity` over the body and all frames; the
    program then chooses mesh and order of the cells, and of a body in motion the steps of time (accuracy/). It is for solids.

    count: how many
    duration: of all of them
    dynamic: whether the body has inertia
    velocity: of the body at the start
    error: asked for, relative; in place of cells, cell_size, graded, focus, layers, cell (of a solid), order and element
    quantity: that the error is of; displacement when left out
    """

    count: int = quantity(400, at_least=1, at_most=1_000_000)
    duration: float | None = quantity(None, unit="s", above=0, at_least=1e-9, at_most=1e9)
    dynamic: bool = False
    velocity: Vector | None = quantity(None, unit="m/s", **FAR)
    error: float | None = quantity(None, above=0, below=1)
    quantity: str | None = _QUANTITY
