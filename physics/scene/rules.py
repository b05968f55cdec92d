"""The rules that bind several keys of a body, its materials or an obstacle: what a shape needs, takes and refuses, and what is left out."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from physics.scene.body import FOCUS, KEYS, PLANE_CELLS, SOLID_CELLS, Body, Material, Where
from physics.scene.parts import NEEDS, TAKES, Load, Obstacle, Steps, Support
from physics.scene.surface import read_surface, surface_in
from physics.scene.tables import check_steps
from physics.schema import InputError, nearest

CHANNEL = {"length": 1.6, "height": 0.41, "hole_centre": [0.2, 0.2], "hole_radius": 0.05, "cell_size": 0.02,
           "cell": "triangle"}
PANEL = {"cell": "tetrahedron", "layers": 2}


def with_defaults(body: Any) -> Any:
    """The table of a body with the values that its shape has when they are left out."""
    if isinstance(body, dict) and body.get("shape") == "channel":
        return CHANNEL | body
    if isinstance(body, dict) and body.get("shape") == "panel":
        return PANEL | body
    return body


def is_plane(body: Body) -> bool:
    """Whether a shape is plane; of a file that is not known before it is read."""
    return body.shape == "channel" or (body.shape == "plate" and body.cell in PLANE_CELLS)


def keys_of(body: Body) -> list[str]:
    """The keys that the shape of a body takes."""
    plane = is_plane(body)
    unfit = "height" if plane and body.shape == "plate" else "cell_size" if body.shape == "file" and not body.drawn else ""
    takes = [key for key in KEYS[body.shape] if key != unfit]
    return takes + ["shape", "order", "element"] + ["plane", "thickness"] * (plane or body.shape == "file")


def orthotropic(table: dict[str, Any]) -> dict[str, Any]:
    """The table of a scene in which orthotropic materials have the keys that every material has."""
    given = table.get("material")
    if isinstance(given, list):
        return table | {"material": [_with_moduli(each, f"material[{i}]") for i, each in enumerate(given)]}
    return table | {"material": _with_moduli(given, "material")} if "material" in table else table


def _with_moduli(material: Any, key: str) -> Any:
    if not (isinstance(material, dict) and isinstance(material.get("orthotropic"), dict)):
        return material
    moduli = material["orthotropic"].get("young_moduli")
    first = {"young_modulus": moduli[0] if isinstance(moduli, list) and moduli else 1.0, "poisson_ratio": 0.0}
    for name, value in first.items():
        if material.get(name, value) != value:
            raise InputError(f"{key}.{name}: an orthotropic material has its own; leave it out")
    return material | first


def chosen_keys(body: Any) -> tuple[str, ...]:
    """The keys of a body's table that an error asked for decides, how fine its mesh is. A plane body's cell stays its own."""
    plane = isinstance(body, dict) and body.get("cell") in PLANE_CELLS
    return ("cells", "cell_size", "graded", *FOCUS, "layers", "order", "element", *(() if plane else ("cell",)))


def check_error(steps: Steps, body: Body, given: dict[str, Any]) -> None:
    """Whether an error may be asked for, and that nothing is given which it decides."""
    if steps.error is None:
        if steps.quantity is not None:
            raise InputError("steps.quantity: needs error, the one asked for")
        return
    if body.shape == "channel":
        raise InputError("steps.error: a channel has modes only")
    if decided := [key for key in chosen_keys(given) if key in given]:
        raise InputError(f"body.{decided[0]}: steps.error decides {', '.join(chosen_keys(given))}; leave {' and '.join(decided)} out")


def check_materials(materials: tuple[Material, ...], body: Body) -> None:
    """What each of the materials of a body needs, and what goes with what."""
    for i, material in enumerate(materials):
        key = "material" if len(materials) == 1 else f"material[{i}]"
        _check_orthotropic(material, key)
        if len(materials) == 1 and material.where is not None:
            raise InputError("material.where: a single material is that of the whole body; leave it out")
        if isinstance(material.where, str) and body.shape != "file":
            raise InputError(f"{key}.where = {material.where!r}: a {body.shape} has no regions with names; give a place by coordinates: "
                             "near, plane or box")
        check_place(body, material.where, f"{key}.where")
    rest = [i for i, material in enumerate(materials) if material.where is None]
    if len(rest) > 1:
        raise InputError(f"material[{rest[1]}].where: missing; material[{rest[0]}] is that of all other cells already")
    if len({material.law == "linear" for material in materials}) > 1:
        raise InputError("material: the linear law is that of the whole body or of no part of it, for it knows no turn")


def _check_orthotropic(material: Material, key: str) -> None:
    """Orthotropic constants belong to a body that resists every strain."""
    given = material.orthotropic
    if given is None:
        return
    (x, y, z), (xy, yz, xz) = given.young_moduli, given.poisson_ratios
    yx, zy, zx = xy * y / x, yz * z / y, xz * z / x
    if not (min(1 - xy * yx, 1 - yz * zy, 1 - xz * zx) > 0 and 1 - xy * yx - yz * zy - xz * zx - 2 * yx * zy * xz > 0):
        raise InputError(f"{key}.orthotropic.poisson_ratios = {list(given.poisson_ratios)}: with these moduli some strain would give "
                         "energy; nu_ij must be below the root of E_i / E_j, and all three together smaller still")


def check_body(body: Body, given: dict[str, Any], *, chosen: bool = False) -> None:
    """Which keys a shape needs, takes and refuses. Args: chosen: its mesh is, by the error asked for."""
    plane, takes = is_plane(body), keys_of(body)
    kind = f"a plane {body.shape}" if body.shape == "plate" and plane else "a drawing" if body.drawn else f"a {body.shape}"
    for key in given:
        if key not in takes:
            raise InputError(f"body.{key}: {kind} takes {', '.join(takes)}")
    for key in takes:
        if key in ("length", "width", "height", "path", "outline") and getattr(body, key) is None:
            raise InputError(f"body.{key}: missing")
    if body.cell not in (PLANE_CELLS if body.shape == "channel" else SOLID_CELLS if body.shape == "beam" else (body.cell,)):
        raise InputError(f"body.cell = {body.cell!r}: {kind} has "
                         f"{' or '.join(PLANE_CELLS if plane else SOLID_CELLS)} cells")
    if body.shape != "file" and body.order == 2 and body.cell == "prism":
        raise InputError("body.order = 2: prisms are of first order only; take cell = \"tetrahedron\" or \"hexahedron\"")
    if body.element == "reduced" and (body.shape != "beam" or body.cell != "prism" or body.extent[0] < max(body.extent[1:])):
        raise InputError("body.element = \"reduced\": only for a beam of prisms that is at least as long as wide and high; leave it out")
    if body.element == "mean-dilatation" and body.shape != "file" and (plane or (body.cell == "tetrahedron" and body.order == 1)):
        raise InputError("body.element = \"mean-dilatation\": only for prisms, hexahedra and tetrahedra of order 2, not for cell = "
                         f"{body.cell!r}; leave it out")
    if body.element == "reduced" and body.order == 2:
        raise InputError("body.element = \"reduced\": for cells of first order only; leave it or order = 2 out")
    if wrong := [face for face in body.graded or () if face not in (body.places or ())]:
        raise InputError(f"body.graded: {kind} has no {wrong[0]}, but {', '.join(body.places or ())}")
    for key, side, spots in zip(FOCUS, body.extent if any(body.focus) else (), body.focus, strict=False):
        if spots and not side:
            raise InputError(f"body.{key}: {kind} has no side along {key[-1]}; leave it out")
        for i, (place, within) in enumerate(spots):
            if not (place <= side and 0 < within <= side):
                raise InputError(f"body.{key}[{i}] = [{place:g}, {within:g}]: give a place on the side, from 0 to {side:g} m, and over how "
                                 "far cells get shorter, above 0 and at most as long")
    if body.shape == "panel":
        _check_panel(body, chosen=chosen)
    if chosen:
        return
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
        if body.hole_cell_size is not None and body.cell != "triangle":
            raise InputError(f"body.hole_cell_size: only triangles grow away from the hole, not cell = {body.cell!r}")
        if body.hole_cell_size is not None and body.hole_cell_size > body.cell_size:
            raise InputError(f"body.hole_cell_size = {body.hole_cell_size:g}: must be at most cell_size, {body.cell_size:g} m")
        if room <= 0:
            raise InputError(f"body: the hole at ({x:g}, {y:g}) m of radius {radius:g} m does not lie inside the channel of "
                             f"{length:g} x {height:g} m")


def _check_panel(body: Body, *, chosen: bool) -> None:
    """What a panel needs; whether its outline crosses itself is seen when it is meshed."""
    if body.cell_size is None and not chosen:
        raise InputError("body.cell_size: missing")
    if body.cell not in ("tetrahedron", "prism"):
        raise InputError(f"body.cell = {body.cell!r}: a panel has tetrahedron or prism cells")
    if len(body.outline or ()) < 3 or len(set(body.outline or ())) < len(body.outline or ()):
        raise InputError("body.outline must have three points at least, each another one")
    if not min(body.extent[:2]) > 1e-9:
        raise InputError("body.outline: has no width")
    for k, (_, _, radius) in enumerate(body.holes or ()):
        if not radius > 0:
            raise InputError(f"body.holes[{k}] = {list((body.holes or ())[k])}: x, y and a radius above 0")


def check_place(body: Body, where: str | Where | None, key: str) -> None:
    """Refuse a place that the shape does not have; those of a file are checked when it is read."""
    if isinstance(where, Where):
        _check_where(where, key)
        return
    if where is None or body.places is None:
        return
    for word in where.split() or [""]:
        if word not in body.places:
            raise InputError(f"{key} = {word!r}: must be one of {', '.join(body.places)}{nearest(word, body.places)}")


def check_support(support: Support, key: str) -> None:
    """What a support holds, moves and turns."""
    if not support.fixed or set(support.fixed) - set("xyz") or len(set(support.fixed)) != len(support.fixed):
        raise InputError(f"{key}.fixed = {support.fixed!r}: must be some of the letters x, y and z, each once")
    for axis, moved in zip("xyz", support.displacement, strict=True):
        if moved and axis not in support.fixed:
            raise InputError(f"{key}.displacement moves {axis}, which fixed = {support.fixed!r} leaves free")
    if (support.angle is None) != (support.axis is None) or (support.centre is not None and support.angle is None):
        raise InputError(f"{key}: a support that turns has an axis and an angle, and may have a centre")
    if support.angle is not None and len(support.fixed) < 3:
        raise InputError(f"{key}.angle: fixed = {support.fixed!r} leaves free what would turn; hold all of xyz")
    _check_direction(support.axis, f"{key}.axis")
    check_steps(support.steps, support.factor, key, "factor")


def check_load(load: Load, key: str, *, dynamic: bool, linear: bool) -> None:
    """What a load needs, and what goes with what."""
    if [load.traction, load.pressure, load.acceleration].count(None) != 2:
        raise InputError(f"{key}: give exactly one of traction, pressure and acceleration")
    if (load.acceleration is not None) != (load.where is None):
        raise InputError(f"{key}: a traction or a pressure needs a where, an acceleration takes none")
    if load.sudden and not dynamic:
        raise InputError(f"{key}.sudden: a load can only be sudden where [steps] dynamic = true")
    check_steps(load.steps, load.factor, key, "factor")
    if load.sudden and load.steps is not None:
        raise InputError(f"{key}.sudden: a load with a table is not sudden; leave one of them out")
    if load.follower and load.pressure is None:
        raise InputError(f"{key}.follower: only a pressure follows its face")
    if load.follower and dynamic:
        raise InputError(f"{key}.follower: a pressure follows its face through equilibria only; leave it or dynamic = true out")
    if load.follower and linear:
        raise InputError(f"{key}.follower: the linear law knows no turned face; leave it out, or take a law of finite strain")


def _check_where(where: Where, key: str) -> None:
    """A place by coordinates has exactly one of near, plane and box, and what that needs."""
    kinds = {"near": ("near", "within"), "plane": ("plane", "normal", "within"), "box": ("box",)}
    given = [name for name in ("near", "plane", "normal", "within", "box") if getattr(where, name) is not None]
    chosen = [name for name in kinds if name in given]
    if len(chosen) != 1:
        raise InputError(f"{key}: give exactly one of near, plane and box")
    needs = kinds[chosen[0]]
    for name in (*given, *needs):
        if name not in needs:
            raise InputError(f"{key}.{name}: {chosen[0]} takes {' and '.join(needs[1:]) or 'nothing else'}")
        if name not in given:
            raise InputError(f"{key}.{name}: missing; {chosen[0]} needs it")
    if where.normal is not None and math.hypot(*where.normal) == 0:
        raise InputError(f"{key}.normal must not be the zero vector")
    if where.box is not None and any(low > high for low, high in zip(*where.box, strict=True)):
        raise InputError(f"{key}.box: its first corner must have the smaller coordinates")


def _check_direction(vector: tuple[float, float, float] | None, key: str) -> None:
    """A direction that has one."""
    if vector is not None and math.hypot(*vector) == 0:
        raise InputError(f"{key} must not be the zero vector")
    if vector is not None and not 1e-9 <= math.hypot(*vector) <= 1e9:
        raise InputError(f"{key} = {list(vector)}: its length must be from 1e-9 to 1e9; what counts is its direction")


def complete(obstacle: Obstacle, where: str = "obstacle") -> Obstacle:
    """An obstacle with all that its shape needs and nothing else. Raises `InputError`."""
    obstacle = _with_surface(obstacle, where)
    for key in ("radius", "length", "size", "normal", "file", "surface", "source", "scale", "angle"):
        given = getattr(obstacle, key) is not None
        if key in NEEDS[obstacle.shape] and not given:
            raise InputError(f"{where}.{key}: missing; a {obstacle.shape} needs it")
        if given and key not in TAKES[obstacle.shape]:
            raise InputError(f"{where}.{key}: a {obstacle.shape} has none")
    if obstacle.size is not None:
        smallest = min(obstacle.size)
        radius = smallest / 20 if obstacle.radius is None else obstacle.radius
        if radius > smallest / 2:
            raise InputError(f"{where}.radius = {radius!r}: must be at most {smallest / 2:g} m, half the smallest side of the box")
        obstacle = replace(obstacle, radius=radius)
    elif obstacle.radius is not None and obstacle.radius < 1e-9:
        raise InputError(f"{where}.radius = {obstacle.radius!r}: must be {'at least 1e-09' if obstacle.radius else 'above 0'} m")
    for key in ("axis", "normal"):
        _check_direction(getattr(obstacle, key), f"{where}.{key}")
    if not obstacle.path:
        raise InputError(f"{where}.path must have at least one way-point")
    check_steps(obstacle.steps, obstacle.path, where, "path")
    return obstacle


def _with_surface(obstacle: Obstacle, where: str) -> Obstacle:
    """An obstacle that holds its surface, which is sound, in place of a file. Raises `InputError`."""
    if obstacle.shape != "mesh":
        return obstacle
    if (obstacle.file is None) == (obstacle.surface is None):
        raise InputError(f"{where}: a mesh has a file" + ("; a surface stands in its place" if obstacle.file else ", which is missing"))
    try:
        if obstacle.file is not None:
            surface, source = read_surface(obstacle.file)
            obstacle = replace(obstacle, file=None, surface=surface, source=source)
        assert obstacle.surface is not None
        points, _ = surface_in(obstacle.surface)
    except InputError as error:
        raise InputError(f"{where}.{'file' if obstacle.file else 'surface'}: {error}") from None
    smallest = (obstacle.scale or 1.0) * float((points.max(axis=0) - points.min(axis=0)).min())
    if not 1e-9 <= smallest <= 1e9:
        raise InputError(f"{where}: {smallest:.3g} m wide; from 1e-09 to 1e+09 m are taken")
    if obstacle.radius is not None and not smallest / 200 <= obstacle.radius <= smallest / 4:
        raise InputError(f"{where}.radius = {obstacle.radius!r}: must be from {smallest / 200:.3g} to {smallest / 4:.3g} m, "
                         "1/200 to 1/4 of the smallest extent")
    return obstacle
