"""What is simulated: a body, its material, its supports and loads, a rigid obstacle, and the steps.

A scene is a TOML file, read into frozen dataclasses that carry unit and bounds of every key. Coordinates are
Cartesian [m]; the body is given in its stress-free rest state. Step s = 0 .. count is a fraction s/count of the loading; it is a
time only in dynamic scenes.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import tomli_w

from physics.schema import InputError, nearest, quantity, read_table, read_toml, to_table

PLACES = ("x-min", "x-max", "y-min", "y-max", "z-min", "z-max")
PLANE_CELLS, SOLID_CELLS = ("triangle", "quadrilateral"), ("prism", "tetrahedron", "hexahedron")
Vector = tuple[float, float, float]

# Which keys of [body] each shape takes besides shape, order, and for plane cells plane and thickness.
KEYS = {
    "beam": ("length", "width", "height", "cells", "cell_size", "cell"),
    "plate": ("length", "width", "height", "cells", "cell_size", "cell"),
    "channel": ("length", "height", "hole_centre", "hole_radius", "cell_size", "cell"),
    "file": ("path",),
}
# Which keys each shape of [obstacle] needs, and takes besides shape, axis, path and contact.
NEEDS = {"sphere": ("radius",), "cylinder": ("radius",), "capsule": ("radius", "length"), "box": ("size",), "half-space": ("normal",)}
TAKES = NEEDS | {"box": ("size", "radius")}
CHANNEL = {"length": 1.6, "height": 0.41, "hole_centre": [0.2, 0.2], "hole_radius": 0.05, "cell_size": 0.02,
           "cell": "triangle"}


@dataclass(frozen=True, kw_only=True)
class Body:
    """The rest shape and its mesh.

    beam: a straight beam of rectangular section from the origin along x; solid cells; prisms have triangles normal to x.
    plate: the same box, its thickness `height` along z; prisms have triangles normal to z. With cell = "triangle" or
        "quadrilateral" it is plane, of sides `length` and `width`, and takes no height.
    channel: a plane rectangle `length` x `height` from the origin with a round hole; what is left out is 1.6 x 0.41 m with
        a hole of radius 0.05 m at (0.2, 0.2), the domain of flow around a cylinder, in triangles of 0.02 m.
    file: the mesh in `path`, relative to the scene file; its physical groups name the places.

    A beam or a plate takes exactly one of `cells` (numbers along the axes) and `cell_size`. `order` 2 has quadratic
    displacements on straight cells (not for prisms, and for modes only). A plane body deforms in its plane, either with no
    strain across it (plane = "strain", the default: a slice of a long body) or with no stress ("stress": a thin sheet);
    `thickness` is its extent across [m].

    `element` is how first-order cells are sampled (element.py): "reduced" lets the prisms of a beam bend as they should,
    "mean-dilatation" frees prisms and hexahedra of locking near a Poisson ratio of 1/2.
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
    hole_centre: tuple[float, float] | None = quantity(None, unit="m")
    hole_radius: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)
    plane: str | None = quantity(None, choice=("strain", "stress"))
    thickness: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)

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
class Material:
    """A homogeneous isotropic material; the laws are written down in material.py."""

    law: str = quantity("neo-hookean", choice=("neo-hookean", "neo-hookean-log", "saint-venant-kirchhoff", "linear"))
    young_modulus: float = quantity(unit="Pa", above=0, at_least=1e-9, at_most=1e18)
    poisson_ratio: float = quantity(above=-1, below=0.5)
    density: float = quantity(1000.0, unit="kg/m3", above=0, at_least=1e-12, at_most=1e12)


@dataclass(frozen=True, kw_only=True)
class Support:
    """Components of the displacement held at a place; `displacement` is reached linearly at the last step.

    `where` is a face of a shape, a physical group of a file, or several of them with blanks between: what they have in
    common, so "x-min z-min" is an edge. In a plane body z is held everywhere.
    """

    where: str
    fixed: str = "xyz"
    displacement: Vector = quantity((0.0, 0.0, 0.0), unit="m")


@dataclass(frozen=True, kw_only=True)
class Load:
    """A dead load, reached linearly at the last step: a traction [Pa] on a face, or an acceleration [m/s2] of the body.

    With `sudden` it acts in full from the start, in dynamic scenes only.
    """

    where: str | None = None
    traction: Vector | None = quantity(None, unit="Pa")
    acceleration: Vector | None = quantity(None, unit="m/s2")
    sudden: bool = False


@dataclass(frozen=True, kw_only=True)
class Obstacle:
    """A rigid body that touches without friction; what each shape is stands in obstacle.py.

    Its centre follows the way-points of `path`, reached at equal fractions of the steps, the first one at step 0.
    """

    shape: str = quantity(choice=tuple(NEEDS))
    radius: float | None = quantity(None, unit="m", at_least=0)  # of a box: of its edges, by default a twentieth of its smallest side
    axis: Vector = (0.0, 1.0, 0.0)  # cylinder and capsule
    length: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)  # capsule, between the centres of its ends
    size: Vector | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)  # box
    normal: Vector | None = None  # half-space, out of it
    path: tuple[Vector, ...] = quantity(unit="m")
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
    velocity: Vector | None = quantity(None, unit="m/s")


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

    @staticmethod
    def from_toml(text: str) -> Scene:
        """The scene in a text, as `to_toml` writes it. Raises `InputError`."""
        try:
            return read_scene(tomllib.loads(text))
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"its scene is not TOML: {error}") from None


def load_scene(path: str | Path) -> Scene:
    """A scene from a TOML file. Raises `InputError` in one line when anything about it is wrong."""
    return _load(path, read_scene)


def load_body(path: str | Path) -> Body:
    """The body of a scene file that may lack all the rest, or a mesh file as a body. Raises `InputError`."""
    if Path(path).suffix.lower() != ".toml":
        return Body(shape="file", path=str(path))
    return _load(path, read_body)


def _load(path: str | Path, read: Callable[[dict[str, Any]], Any]) -> Any:
    try:
        table = read_toml(path)
        body = table.get("body")
        if isinstance(body, dict) and isinstance(body.get("path"), str):
            body["path"] = str(Path(path).parent / body["path"])
        return read(table)
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(str(path)) else f"{path}: {text}") from None


def read_body(table: dict[str, Any]) -> Body:
    """The body in a scene's table, in which only [body] is needed; the rest is read too when there is a material."""
    if "material" in table:
        return read_scene(table).body
    for key in table:
        if key not in {field.name for field in fields(Scene)}:
            raise InputError(f"{key}: unknown key{nearest(key, [field.name for field in fields(Scene)])}")
    if "body" not in table:
        raise InputError("body: missing")
    body = read_table(Body, _with_defaults(table["body"]), "body")
    _check_body(body, table["body"])
    return body


def read_scene(table: dict[str, Any]) -> Scene:
    """A scene from a table, with the rules that bind several keys. Raises `InputError`."""
    given = table.get("body")
    scene = read_table(Scene, table | {"body": _with_defaults(given)} if "body" in table else table)
    _check_body(scene.body, given or {})
    places = [(f"support[{i}]", support.where) for i, support in enumerate(scene.support)]
    places += [(f"load[{i}]", load.where) for i, load in enumerate(scene.load) if load.where is not None]
    for name, where in places:
        _check_place(scene.body, where, f"{name}.where")
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
        if load.sudden and not scene.steps.dynamic:
            raise InputError(f"load[{i}].sudden: a load can only be sudden where [steps] dynamic = true")
    if scene.steps.dynamic and scene.steps.duration is None:
        raise InputError("steps.duration: missing; dynamic = true needs it")
    if scene.steps.velocity is not None and not scene.steps.dynamic:
        raise InputError("steps.velocity: needs dynamic = true")
    if scene.obstacle is not None:
        scene = replace(scene, obstacle=_complete(scene.obstacle))
    return scene


def _with_defaults(body: Any) -> Any:
    """The table of a body with the values that its shape has when they are left out."""
    if isinstance(body, dict) and body.get("shape") == "channel":
        return CHANNEL | body
    return body


def _check_body(body: Body, given: dict[str, Any]) -> None:
    """Which keys a shape needs, takes and refuses."""
    plane = body.shape == "channel" or (body.shape == "plate" and body.cell in PLANE_CELLS)
    takes = [key for key in KEYS[body.shape] if not (plane and body.shape == "plate" and key == "height")]
    takes += ["shape", "order", "element"] + ["plane", "thickness"] * (plane or body.shape == "file")
    kind = f"a plane {body.shape}" if body.shape == "plate" and plane else f"a {body.shape}"
    for key in given:
        if key not in takes:
            raise InputError(f"body.{key}: {kind} takes {', '.join(takes)}")
    for key in takes:
        if key in ("length", "width", "height", "path") and getattr(body, key) is None:
            raise InputError(f"body.{key}: missing")
    if body.cell not in (PLANE_CELLS if body.shape == "channel" else SOLID_CELLS if body.shape == "beam" else (body.cell,)):
        raise InputError(f"body.cell = {body.cell!r}: {kind} has "
                         f"{' or '.join(PLANE_CELLS if plane else SOLID_CELLS)} cells")
    if body.shape != "file" and body.order == 2 and body.cell == "prism":
        raise InputError("body.order = 2: prisms are of first order only; take cell = \"tetrahedron\" or \"hexahedron\"")
    if body.element == "reduced" and (body.shape != "beam" or body.cell != "prism" or body.extent[0] < max(body.extent[1:])):
        raise InputError("body.element = \"reduced\": only for a beam of prisms that is at least as long as wide and high; leave it out")
    if body.element == "mean-dilatation" and body.shape != "file" and body.cell not in ("prism", "hexahedron"):
        raise InputError(f"body.element = \"mean-dilatation\": only for prisms and hexahedra, not for cell = {body.cell!r}; leave it out")
    if body.element != "standard" and body.order == 2:
        raise InputError(f"body.element = {body.element!r}: for cells of first order only; leave it or order = 2 out")
    if body.shape in ("beam", "plate"):
        if (body.cells is None) == (body.cell_size is None):
            raise InputError("body: give exactly one of cells and cell_size")
        if body.cells is not None and len(body.cells) != 3 - plane:
            raise InputError(f"body.cells must have {3 - plane} entries, not {len(body.cells)}")
    if body.shape != "file" and math.prod(body.divisions) > 20_000_000:
        raise InputError(f"body: {math.prod(body.divisions):.3g} cells are more than the 2e+07 that this solver takes on")
    if body.shape == "channel":
        assert body.hole_centre and body.hole_radius and body.cell_size
        length, height, _ = body.extent
        (x, y), radius = body.hole_centre, body.hole_radius
        room = min(x, length - x, y, height - y) - radius
        if room <= 0:
            raise InputError(f"body: the hole at ({x:g}, {y:g}) m of radius {radius:g} m does not lie inside the channel of "
                             f"{length:g} x {height:g} m")


def _check_place(body: Body, where: str | None, key: str) -> None:
    """Refuse a place that the shape does not have; those of a file are checked when it is read."""
    if where is None or body.places is None:
        return
    for word in where.split() or [""]:
        if word not in body.places:
            raise InputError(f"{key} = {word!r}: must be one of {', '.join(body.places)}{nearest(word, body.places)}")


def _complete(obstacle: Obstacle) -> Obstacle:
    """An obstacle with all that its shape needs and nothing else. Raises `InputError`."""
    for key in ("radius", "length", "size", "normal"):
        given = getattr(obstacle, key) is not None
        if key in NEEDS[obstacle.shape] and not given:
            raise InputError(f"obstacle.{key}: missing; a {obstacle.shape} needs it")
        if given and key not in TAKES[obstacle.shape]:
            raise InputError(f"obstacle.{key}: a {obstacle.shape} has none")
    if obstacle.size is not None:
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
