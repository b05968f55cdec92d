"""What a scene is made of: body, materials, supports, loads, rigid obstacles, and steps; frozen, with unit and bounds of every key."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from physics.schema import InputError, quantity

PLACES = ("x-min", "x-max", "y-min", "y-max", "z-min", "z-max")
PLANE_CELLS, SOLID_CELLS = ("triangle", "quadrilateral"), ("prism", "tetrahedron", "hexahedron")
Vector = tuple[float, float, float]
FAR: dict[str, Any] = {"at_least": -1e9, "at_most": 1e9}  # of coordinates and displacements [m], and of velocities [m/s]
STRONG: dict[str, Any] = {"at_least": -1e18, "at_most": 1e18}  # of tractions [Pa] and accelerations [m/s2]

# Which keys of [body] each shape takes besides shape, order, and for plane cells plane and thickness.
KEYS = {
    "beam": ("length", "width", "height", "cells", "cell_size", "cell"),
    "plate": ("length", "width", "height", "cells", "cell_size", "cell"),
    "channel": ("length", "height", "hole_centre", "hole_radius", "cell_size", "hole_cell_size", "cell"),
    "file": ("path", "scale"),
}
# Which keys each shape of [obstacle] needs; a box may have a radius too.
NEEDS = {"sphere": ("radius",), "cylinder": ("radius",), "capsule": ("radius", "length"), "box": ("size",), "half-space": ("normal",)}


@dataclass(frozen=True, kw_only=True)
class Body:
    """The rest shape and its mesh.

    beam: a straight beam of rectangular section from the origin along x; solid cells; prisms have triangles normal to x.
    plate: the same box, its thickness `height` along z; prisms have triangles normal to z. With cell = "triangle" or
        "quadrilateral" it is plane, of sides `length` and `width`, and takes no height.
    channel: a plane rectangle `length` x `height` from the origin with a round hole; what is left out is 1.6 x 0.41 m with
        a hole of radius 0.05 m at (0.2, 0.2), the domain of flow around a cylinder, in triangles of 0.02 m. With `hole_cell_size`
        these grow from that size on the hole to `cell_size`, and the hole is round for second order.
    file: the mesh in `path`, relative to the scene file; its groups name the places. Its coordinates times `scale` are metres:
        0.001 for a file in millimetres.

    A beam or a plate takes exactly one of `cells` (numbers along the axes) and `cell_size`. `order` 2 has quadratic
    displacements, in tetrahedra of 10 and hexahedra of 27 nodes (not for prisms, and of plane cells for modes only); cells of second
    order in a file then keep their curved sides. A plane
    body deforms in its plane, either with no strain across it (plane = "strain", the default: a slice of a long body) or with
    no stress ("stress": a thin sheet); `thickness` is its extent across [m].

    `element` is how cells are sampled (body/element.py): "reduced" lets the first-order prisms of a beam bend as they should,
    "mean-dilatation" frees prisms, hexahedra and tetrahedra of order 2 of locking near a Poisson ratio of 1/2.
    """

    shape: str = quantity("beam", choice=tuple(KEYS))
    length: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)
    width: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)
    height: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)
    cells: tuple[int, ...] | None = quantity(None, at_least=1, at_most=10_000)
    cell_size: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)
    cell: str = quantity("prism", choice=SOLID_CELLS + PLANE_CELLS)
    order: int = quantity(1, at_least=1, at_most=2)
    element: str = quantity("standard", choice=("standard", "mean-dilatation", "reduced"))
    path: str | None = None
    scale: float | None = quantity(None, above=0, at_least=1e-12, at_most=1e12)
    hole_centre: tuple[float, float] | None = quantity(None, unit="m", **FAR)
    hole_radius: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)
    hole_cell_size: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)
    plane: str | None = quantity(None, choice=("strain", "stress"))
    thickness: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)

    @staticmethod
    def keys_for(table: dict[str, Any]) -> tuple[str, ...]:
        """The keys that the shape of a table takes."""
        shape = table.get("shape", "beam")
        across = ("plane", "thickness") if shape in ("channel", "file") or table.get("cell") in PLANE_CELLS else ()
        return ("shape", *KEYS.get(shape if isinstance(shape, str) else "", ()), "order", "element", *across)

    @property
    def extent(self) -> Vector:
        """Length, width and height [m]; a plane body has height 0. Raises `InputError` for a file: its mesh has the extent."""
        if self.shape == "file":
            raise InputError("a body from a file has no length, width and height")
        sides = (self.length, self.height, 0.0) if self.shape == "channel" else (self.length, self.width, self.height or 0.0)
        assert None not in sides
        return sides  # type: ignore[return-value]

    @property
    def divisions(self) -> tuple[int, ...]:
        """Numbers of cells along x, y and, unless the body is plane, z."""
        if self.cells is not None:
            return self.cells
        assert self.cell_size is not None
        return tuple(max(1, round(side / self.cell_size)) for side in self.extent if side)

    @property
    def places(self) -> tuple[str, ...] | None:
        """The names of the places of a shape; None for a file, which is read later."""
        if self.shape == "file":
            return None
        if self.shape == "channel":
            return (*PLACES[:4], "inlet", "outlet", "walls", "hole")
        return PLACES[:4] if self.cell in PLANE_CELLS else PLACES


@dataclass(frozen=True, kw_only=True)
class Orthotropic:
    """Elastic constants of a material that is not the same along x, y and z, for modes at rest (body/material.py).

    Young's moduli are along x, y and z; Poisson's ratios those of xy, yz and xz, nu_ij = - strain along j over strain along i under
    a stress along i; shear moduli those of the planes xy, yz and xz.
    """

    young_moduli: Vector = quantity(unit="Pa", above=0, at_least=1e-9, at_most=1e18)
    poisson_ratios: Vector = quantity(at_least=-100, at_most=100)
    shear_moduli: Vector = quantity(unit="Pa", above=0, at_least=1e-9, at_most=1e18)


@dataclass(frozen=True, kw_only=True)
class Material:
    """A homogeneous material, isotropic unless `orthotropic`; the laws are written down in body/material.py.

    An orthotropic one is given in place of young_modulus and poisson_ratio, which then are its first modulus and 0. Where a body has
    several, `where` says of which cells each one is: a region of a file, or a place by coordinates, which has the cells whose centres
    lie there; the one without is that of all other cells.
    """

    law: str = quantity("neo-hookean", choice=("neo-hookean", "neo-hookean-log", "saint-venant-kirchhoff", "linear"))
    young_modulus: float = quantity(unit="Pa", above=0, at_least=1e-9, at_most=1e18)
    poisson_ratio: float = quantity(above=-1, below=0.5)
    density: float = quantity(1000.0, unit="kg/m3", above=0, at_least=1e-12, at_most=1e12)
    orthotropic: Orthotropic | None = None
    where: str | Where | None = None


@dataclass(frozen=True, kw_only=True)
class Where:
    """A place by coordinates: the nodes within a distance of a point or of a plane, or in a box between two corners.

    As a face it is made of the outer facets whose corners all lie there, as a region of the cells whose centres do.
    """

    near: Vector | None = quantity(None, unit="m")
    plane: Vector | None = quantity(None, unit="m")  # a point of it
    normal: Vector | None = None
    within: float | None = quantity(None, unit="m", at_least=0)
    box: tuple[Vector, Vector] | None = quantity(None, unit="m")

    def __str__(self) -> str:
        pairs = ((key, getattr(self, key)) for key in ("near", "plane", "normal", "within", "box"))
        return "{ " + ", ".join(f"{key} = {_plain(value)}" for key, value in pairs if value is not None) + " }"

    def __repr__(self) -> str:
        return str(self)


Materials = Material | tuple[Material, ...]  # of a body: one, or several by region


def _plain(value: object) -> str:
    return f"[{', '.join(map(_plain, value))}]" if isinstance(value, tuple) else f"{value}"


@dataclass(frozen=True, kw_only=True)
class Support:
    """Components of the displacement held at a place; `displacement` is reached linearly at the last step.

    `where` is a face of a shape, a physical group of a file, or several of them with blanks between: what they have in
    common, so "x-min z-min" is an edge; or a place by coordinates. In a plane body z is held everywhere.

    With `angle` the place turns as a whole about an `axis` through `centre`, by default the mean of its nodes. With `steps`, fractions
    0 .. 1, displacement and angle are at each of them the share `factor` of what is given (tables.py).
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
    step 0.
    """

    @staticmethod
    def keys_for(table: dict[str, Any]) -> tuple[str, ...]:
        """The keys that the shape of a table takes."""
        shape = table.get("shape")
        own = NEEDS.get(shape if isinstance(shape, str) else "", ()) + ("radius",) * (shape == "box")
        return ("shape", *own, *("axis",) * (shape in ("cylinder", "capsule")), "path", "steps", "contact")

    shape: str = quantity(choice=tuple(NEEDS))
    radius: float | None = quantity(None, unit="m", at_least=0, at_most=1e9)  # a box's edges: 1/20 of its smallest side
    axis: Vector = (0.0, 1.0, 0.0)  # cylinder and capsule
    length: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)  # capsule, between the centres of its ends
    size: Vector | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)  # box
    normal: Vector | None = None  # half-space, out of it
    path: tuple[Vector, ...] = quantity(unit="m", **FAR)
    steps: tuple[float, ...] | None = None
    contact: str = quantity("facets", choice=("facets", "nodes"))


@dataclass(frozen=True, kw_only=True)
class Steps:
    """The number of equal steps in which the loading is applied, and the time that it takes.

    `dynamic` gives the body inertia; then `duration` is needed, and `velocity` is that of the whole body at the start, but for
    what is held.
    """

    count: int = quantity(400, at_least=1, at_most=1_000_000)
    duration: float | None = quantity(None, unit="s", above=0, at_least=1e-9, at_most=1e9)
    dynamic: bool = False
    velocity: Vector | None = quantity(None, unit="m/s", **FAR)
