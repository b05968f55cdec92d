"""What is simulated: a body, its material, its supports and loads, a rigid obstacle, and the steps.

A scene is a TOML file, read into frozen dataclasses that carry unit and bounds of every key. Coordinates are
Cartesian [m]; the body is given in its stress-free rest state. Loading is quasi-static: step s = 0 .. count is a
fraction s/count of the loading, not a time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import tomli_w

from physics.schema import InputError, quantity, read_table, read_toml, to_table

PLACES = ("x-min", "x-max", "y-min", "y-max", "z-min", "z-max")
Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Body:
    """A straight beam of rectangular section from the origin along x.

    Exactly one of `cells` (numbers along x, y, z) and `cell_size` is given.
    """

    shape: str = quantity("beam", choice=("beam",))
    length: float = quantity(unit="m", above=0)
    width: float = quantity(unit="m", above=0)
    height: float = quantity(unit="m", above=0)
    cells: tuple[int, int, int] | None = quantity(None, at_least=1, at_most=10_000)
    cell_size: float | None = quantity(None, unit="m", above=0)
    cell: str = quantity("prism", choice=("prism", "tetrahedron", "hexahedron"))

    @property
    def extent(self) -> Vector:
        """Length, width and height [m]."""
        return self.length, self.width, self.height

    @property
    def divisions(self) -> tuple[int, int, int]:
        """Numbers of cells along x, y and z."""
        if self.cells is not None:
            return self.cells
        assert self.cell_size is not None
        nx, ny, nz = (max(1, round(side / self.cell_size)) for side in self.extent)
        return nx, ny, nz


@dataclass(frozen=True, kw_only=True)
class Material:
    """A homogeneous isotropic material; the laws are written down in material.py."""

    law: str = quantity("neo-hookean", choice=("neo-hookean", "neo-hookean-log", "saint-venant-kirchhoff", "linear"))
    young_modulus: float = quantity(unit="Pa", above=0)
    poisson_ratio: float = quantity(above=-1, below=0.5)
    density: float = quantity(1000.0, unit="kg/m3", above=0)


@dataclass(frozen=True, kw_only=True)
class Support:
    """Components of the displacement held at a face; `displacement` is reached linearly at the last step."""

    where: str = quantity(choice=PLACES)
    fixed: str = "xyz"
    displacement: Vector = quantity((0.0, 0.0, 0.0), unit="m")


@dataclass(frozen=True, kw_only=True)
class Load:
    """A dead load, reached linearly at the last step: a traction [Pa] on a face, or an acceleration [m/s2] of the body."""

    where: str | None = quantity(None, choice=PLACES)
    traction: Vector | None = quantity(None, unit="Pa")
    acceleration: Vector | None = quantity(None, unit="m/s2")


@dataclass(frozen=True, kw_only=True)
class Obstacle:
    """A rigid body that touches without friction; what each shape is stands in obstacle.py.

    Its centre follows the way-points of `path`, reached at equal fractions of the steps, the first one at step 0.
    """

    shape: str = quantity(choice=("sphere", "cylinder", "capsule", "box", "half-space"))
    radius: float | None = quantity(None, unit="m", at_least=0)  # of a box: of its edges, by default a twentieth of its smallest side
    axis: Vector = (0.0, 1.0, 0.0)  # cylinder and capsule
    length: float | None = quantity(None, unit="m", above=0)  # capsule, between the centres of its ends
    size: Vector | None = quantity(None, unit="m", above=0)  # box
    normal: Vector | None = None  # half-space, out of it
    path: tuple[Vector, ...] = quantity(unit="m")
    contact: str = quantity("facets", choice=("facets", "nodes"))


@dataclass(frozen=True, kw_only=True)
class Steps:
    """The number of equal steps in which the loading is applied."""

    count: int = quantity(400, at_least=1, at_most=1_000_000)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """One body and what happens to it."""

    body: Body
    material: Material
    name: str = "scene"
    support: tuple[Support, ...] = ()
    load: tuple[Load, ...] = ()
    obstacle: Obstacle | None = None
    steps: Steps = field(default_factory=Steps)

    def to_toml(self) -> str:
        """The scene as a TOML file that `load_scene` reads back unchanged."""
        return tomli_w.dumps(to_table(self))


def load_scene(path: str | Path) -> Scene:
    """A scene from a TOML file. Raises `InputError` in one line when anything about it is wrong."""
    try:
        return read_scene(read_toml(path))
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(str(path)) else f"{path}: {text}") from None


def read_scene(table: dict[str, Any]) -> Scene:
    """A scene from a table, with the rules that bind several keys. Raises `InputError`."""
    scene = read_table(Scene, table)
    body = scene.body
    if (body.cells is None) == (body.cell_size is None):
        raise InputError("body: give exactly one of cells and cell_size")
    if math.prod(body.divisions) > 20_000_000:
        raise InputError(f"body: {math.prod(body.divisions):.3g} cells are more than the 2e+07 that this solver takes on")
    for i, support in enumerate(scene.support):
        if not support.fixed or set(support.fixed) - set("xyz") or len(set(support.fixed)) != len(support.fixed):
            raise InputError(f"support[{i}].fixed = {support.fixed!r}: must be some of the letters x, y and z, each once")
        for axis, moved in zip("xyz", support.displacement, strict=True):
            if moved and axis not in support.fixed:
                raise InputError(f"support[{i}].displacement moves {axis}, which fixed = {support.fixed!r} leaves free")
    for i, load in enumerate(scene.load):
        if (load.traction is None) == (load.acceleration is None):
            raise InputError(f"load[{i}]: give exactly one of traction and acceleration")
        if (load.traction is None) != (load.where is None):
            raise InputError(f"load[{i}]: a traction needs a where, an acceleration takes none")
    if scene.obstacle is not None:
        scene = replace(scene, obstacle=_complete(scene.obstacle))
    return scene


def _complete(obstacle: Obstacle) -> Obstacle:
    """An obstacle with all that its shape needs and nothing else. Raises `InputError`."""
    needs = {"sphere": {"radius"}, "cylinder": {"radius"}, "capsule": {"radius", "length"}, "box": {"size"}, "half-space": {"normal"}}
    for key in ("radius", "length", "size", "normal"):
        given = getattr(obstacle, key) is not None
        if key in needs[obstacle.shape] and not given:
            raise InputError(f"obstacle.{key}: missing; a {obstacle.shape} needs it")
        if given and key not in needs[obstacle.shape] | ({"radius"} if obstacle.shape == "box" else set()):
            raise InputError(f"obstacle.{key}: a {obstacle.shape} has none")
    if obstacle.shape == "box":
        assert obstacle.size is not None
        smallest = min(obstacle.size)
        radius = smallest / 20 if obstacle.radius is None else obstacle.radius
        if radius > smallest / 2:
            raise InputError(f"obstacle.radius = {radius!r}: must be at most {smallest / 2:g} m, half the smallest side of the box")
        obstacle = replace(obstacle, radius=radius)
    elif obstacle.radius == 0:
        raise InputError("obstacle.radius = 0.0: must be above 0 m")
    for key in ("axis", "normal"):
        vector = getattr(obstacle, key)
        if vector is not None and math.hypot(*vector) == 0:
            raise InputError(f"obstacle.{key} must not be the zero vector")
    if not obstacle.path:
        raise InputError("obstacle.path must have at least one way-point")
    return obstacle
