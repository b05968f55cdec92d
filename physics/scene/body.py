"""What a scene is about: a body, its materials, and places on it; frozen, with unit and bounds of every key."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physics.schema import InputError, quantity

PLACES = ("x-min", "x-max", "y-min", "y-max", "z-min", "z-max")
PLANE_CELLS, SOLID_CELLS = ("triangle", "quadrilateral"), ("prism", "tetrahedron", "hexahedron")
Vector = tuple[float, float, float]
FAR: dict[str, Any] = {"at_least": -1e9, "at_most": 1e9}  # of coordinates and displacements [m], and of velocities [m/s]

FOCUS = ("focus_x", "focus_y", "focus_z")
DRAWINGS = (".step", ".stp", ".iges", ".igs", ".brep", ".geo", ".geo_unrolled")  # files without cells

# Which keys of [body] each shape takes besides shape, order, and for plane cells plane and thickness.
KEYS = {
    "beam": ("length", "width", "height", "cells", "cell_size", "graded", *FOCUS, "cell"),
    "plate": ("length", "width", "height", "cells", "cell_size", "graded", *FOCUS, "cell"),
    "channel": ("length", "height", "hole_centre", "hole_radius", "cell_size", "hole_cell_size", "cell"),
    "panel": ("outline", "holes", "height", "layers", "cell_size", "cell"),
    "file": ("path", "scale", "cell_size"),
}


def is_drawing(path: Any) -> bool:
    """Whether a file has a drawing in place of cells, by its ending."""
    return isinstance(path, str) and Path(path).suffix.lower() in DRAWINGS


@dataclass(frozen=True, kw_only=True)
class Body:
    """The rest shape and its mesh.

    beam: a straight beam of rectangular section from the origin along x; solid cells; prisms have triangles normal to x.
    plate: the same box, its thickness `height` along z; prisms have triangles normal to z. With cell = "triangle" or
        "quadrilateral" it is plane, of sides `length` and `width`, and takes no height.
    channel: a plane rectangle `length` x `height` from the origin with a round hole; what is left out is 1.6 x 0.41 m with
        a hole of radius 0.05 m at (0.2, 0.2), the domain of flow around a cylinder, in triangles of 0.02 m. With `hole_cell_size`
        these grow from that size on the hole to `cell_size`, and the hole is round for second order.
    panel: a flat plate whose `outline` is a closed line through points (x, y), not closed by the last one, from z = 0 up to `height`,
        with round `holes`, each (x, y, radius), in `layers` of tetrahedra (or prisms) of `cell_size` along its sides. Its places are
        z-min, z-max, edge-1 from the first point to the second, edge-2, ..., and hole-1, hole-2, ...
    file: the mesh in `path`, relative to the scene file; its groups name the places. Its coordinates times `scale` are metres:
        0.001 for a file in millimetres. A drawing (.step, .iges, .brep, gmsh's .geo) is cut into cells of `cell_size` by gmsh, or
        left out of those that it asks for itself; its parts without names are surface-1, ... as gmsh counts them.

    A beam or a plate takes exactly one of `cells` (numbers along the axes) and `cell_size`. Its cells are even, or get shorter towards
    the faces that they are `graded` to (mesh/shapes/boxes.py), clamped ones, at whose edges strain has no limit, and around places along
    an axis, as where an obstacle touches. `order` 2 has
    quadratic displacements, in tetrahedra of 10, hexahedra of 27, triangles of 6 and quadrilaterals of 9 nodes (not for prisms); cells
    of second order in a file then keep their curved sides. A plane body deforms in its plane, either with no strain across it (plane
    = "strain", the default: a slice of a long body) or with no stress ("stress": a thin sheet); `thickness` is its extent across [m].

    `element` is how cells are sampled (body/element.py): "reduced" lets the first-order prisms of a beam bend as they should,
    "mean-dilatation" frees prisms, hexahedra and tetrahedra of order 2 of locking near a Poisson ratio of 1/2.

    shape: one of these
    length, width, height: along x, y and z; a channel's length and height are along x and y
    cells: how many along the axes
    cell_size: their edges, about
    graded: faces towards which cells get shorter
    focus_x, focus_y, focus_z: places along x, y and z around which cells get shorter, each (where, over how far)
    cell: their kind
    order: of the displacement in a cell; of prisms 1
    element: how cells are sampled
    outline: of a panel, points (x, y)
    holes: of a panel, each (x, y, radius)
    layers: of a panel's cells; 2 when left out
    path: of a mesh file
    scale: metres in a unit of the file
    hole_centre, hole_radius: of a channel
    hole_cell_size: edges of the cells at the hole
    plane: what is zero across a plane body
    thickness: of a plane body; 1 when left out
    """

    shape: str = quantity("beam", choice=tuple(KEYS))
    length: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)
    width: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)
    height: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)
    cells: tuple[int, ...] | None = quantity(None, at_least=1, at_most=10_000)
    cell_size: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)
    graded: tuple[str, ...] | None = quantity(None, choice=PLACES)
    focus_x: tuple[tuple[float, float], ...] | None = quantity(None, unit="m", at_least=0, at_most=1e9)
    focus_y: tuple[tuple[float, float], ...] | None = quantity(None, unit="m", at_least=0, at_most=1e9)
    focus_z: tuple[tuple[float, float], ...] | None = quantity(None, unit="m", at_least=0, at_most=1e9)
    cell: str = quantity("prism", choice=SOLID_CELLS + PLANE_CELLS)
    order: int = quantity(1, at_least=1, at_most=2)
    element: str = quantity("standard", choice=("standard", "mean-dilatation", "reduced"))
    outline: tuple[tuple[float, float], ...] | None = quantity(None, unit="m", **FAR)
    holes: tuple[Vector, ...] | None = quantity(None, unit="m", **FAR)
    layers: int | None = quantity(None, at_least=1, at_most=1000)
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
        own = KEYS.get(shape if isinstance(shape, str) else "", ())
        cells = [key for key in own if key != "cell_size" or shape != "file" or is_drawing(table.get("path"))]
        return ("shape", *cells, "order", "element", *across)

    @property
    def extent(self) -> Vector:
        """Length, width and height [m]; a plane body has height 0. Raises `InputError` for a file: its mesh has the extent."""
        if self.shape == "file":
            raise InputError("a body from a file has no length, width and height")
        if self.shape == "panel" and self.outline is not None:
            along = [max(axis) - min(axis) for axis in zip(*self.outline, strict=True)]
            return along[0], along[1], self.height or 0.0
        sides = (self.length, self.height, 0.0) if self.shape == "channel" else (self.length, self.width, self.height or 0.0)
        assert None not in sides
        return sides  # type: ignore[return-value]

    @property
    def drawn(self) -> bool:
        """Whether it comes from a drawing, which is cut into cells here."""
        return self.shape == "file" and is_drawing(self.path)

    @property
    def focus(self) -> list[tuple[tuple[float, float], ...]]:
        """Along each axis the places around which cells get shorter [m], and over how far."""
        return [self.focus_x or (), self.focus_y or (), self.focus_z or ()]

    @property
    def even(self) -> bool:
        """Whether all cells of a box are alike."""
        return not (self.graded or any(self.focus))

    @property
    def divisions(self) -> tuple[int, ...]:
        """Numbers of cells along x, y and, unless the body is plane, z."""
        if self.cells is not None:
            return self.cells
        if self.cell_size is None:
            raise InputError("body: neither cells nor cell_size; steps.error, which chooses them, is for simulate, generate and modes")
        if self.layers is not None:
            return (*(max(1, round(side / self.cell_size)) for side in self.extent[:2]), self.layers)
        return tuple(max(1, round(side / self.cell_size)) for side in self.extent if side)

    @property
    def places(self) -> tuple[str, ...] | None:
        """The names of the places of a shape; None for a file, which is read later."""
        if self.shape == "file":
            return None
        if self.shape == "channel":
            return (*PLACES[:4], "inlet", "outlet", "walls", "hole")
        if self.shape == "panel":
            rims = (("edge", self.outline), ("hole", self.holes))
            return (*PLACES[4:], *(f"{name}-{k + 1}" for name, parts in rims for k in range(len(parts or ()))))
        return PLACES[:4] if self.cell in PLANE_CELLS else PLACES


@dataclass(frozen=True, kw_only=True)
class Orthotropic:
    """Elastic constants of a material that is not the same along x, y and z, for modes at rest (body/material.py).

    Young's moduli are along x, y and z; Poisson's ratios those of xy, yz and xz, nu_ij = - strain along j over strain along i under
    a stress along i; shear moduli those of the planes xy, yz and xz.

    young_moduli: along x, y and z
    poisson_ratios: nu_xy, nu_yz and nu_xz
    shear_moduli: G_xy, G_yz and G_xz
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

    law: of stress and strain
    young_modulus: needed unless orthotropic
    poisson_ratio: needed unless orthotropic
    density: for inertia, weight and frequencies
    where: the cells, if not all
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

    near: a point
    plane: a point of a plane
    normal: of the plane
    within: distance from the point or the plane
    box: two opposite corners
    """

    near: Vector | None = quantity(None, unit="m")
    plane: Vector | None = quantity(None, unit="m")
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
