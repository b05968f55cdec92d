"""One body and what happens to it, read from TOML."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import tomli_w

from physics.scene.change import change
from physics.scene.parts import Body, Load, Material, Obstacle, Steps, Support
from physics.scene.rules import check_body, check_place, complete, keys_of, with_defaults
from physics.schema import InputError, nearest, parse_toml, read_table, read_toml, to_table


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
        table = to_table(self)
        takes = keys_of(self.body)  # without the defaults of other shapes' keys
        table["body"] = {key: value for key, value in table["body"].items() if key in takes}
        return tomli_w.dumps(table)

    @staticmethod
    def from_toml(text: str) -> Scene:
        """The scene in a text, as `to_toml` writes it. Raises `InputError`."""
        try:
            table = parse_toml(text)
        except InputError as error:
            raise InputError(f"its scene is not TOML: {error}") from None
        return read_scene(table)


def load_scene(path: str | Path, changes: Sequence[str] = ()) -> Scene:
    """A scene from a TOML file, some values changed (`obstacle.radius=0.012`). Raises `InputError` when anything about it is wrong."""
    return _load(path, read_scene, changes)


def load_body(path: str | Path) -> Body:
    """The body of a scene file that may lack all the rest, or a mesh file as a body. Raises `InputError`."""
    if Path(path).suffix.lower() != ".toml":
        return Body(shape="file", path=str(path))
    return _load(path, read_body)


def _load(path: str | Path, read: Callable[[dict[str, Any]], Any], changes: Sequence[str] = ()) -> Any:
    try:
        table = read_toml(path)
        change(table, changes)
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
    body = read_table(Body, with_defaults(table["body"]), "body")
    check_body(body, table["body"])
    return body


def read_scene(table: dict[str, Any]) -> Scene:
    """A scene from a table, with the rules that bind several keys. Raises `InputError`."""
    given = table.get("body")
    scene = read_table(Scene, table | {"body": with_defaults(given)} if "body" in table else table)
    check_body(scene.body, given or {})
    places = [(f"support[{i}]", support.where) for i, support in enumerate(scene.support)]
    places += [(f"load[{i}]", load.where) for i, load in enumerate(scene.load) if load.where is not None]
    for name, where in places:
        check_place(scene.body, where, f"{name}.where")
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
        scene = replace(scene, obstacle=complete(scene.obstacle))
    return scene
