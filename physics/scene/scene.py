"""One body and what happens to it, read from TOML."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import tomli_w

from physics.scene.body import Body, Material
from physics.scene.change import change
from physics.scene.flow import FlowScene, read_flow
from physics.scene.parts import Load, Obstacle, Steps, Support
from physics.scene.rules import (
    check_body,
    check_error,
    check_load,
    check_materials,
    check_place,
    check_support,
    chosen_keys,
    complete,
    keys_of,
    orthotropic,
    with_defaults,
)
from physics.scene.tables import with_tables
from physics.schema import InputError, nearest, parse_toml, read_table, read_toml, to_table


@dataclass(frozen=True, kw_only=True)
class Scene:
    """One body and what happens to it.

    A single material or obstacle, [material] or [obstacle], stands there itself, several, [[material]] or [[obstacle]], as a tuple;
    `materials` and `obstacles` are tuples always.
    """

    body: Body
    material: Material | tuple[Material, ...]
    name: str = "scene"
    support: tuple[Support, ...] = ()
    load: tuple[Load, ...] = ()
    obstacle: Obstacle | tuple[Obstacle, ...] | None = None
    steps: Steps = field(default_factory=Steps)

    @property
    def materials(self) -> tuple[Material, ...]:
        """All of them; of several, each is that of its own cells."""
        return self.material if isinstance(self.material, tuple) else (self.material,)

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """All of them."""
        return self.obstacle if isinstance(self.obstacle, tuple) else () if self.obstacle is None else (self.obstacle,)

    @property
    def pressed_by(self) -> str:
        """The shapes of the obstacles, in words."""
        return " and ".join(obstacle.shape for obstacle in self.obstacles) or "none"

    @property
    def linear(self) -> bool:
        """Whether the law is that of small strain."""
        return all(material.law == "linear" for material in self.materials)

    @property
    def stiffest(self) -> float:
        """The largest Young's modulus of the body [Pa]."""
        return max(material.young_modulus for material in self.materials)

    def under(self, law: str) -> Scene:
        """The same under another law."""
        changed = tuple(replace(material, law=law) for material in self.materials)
        return replace(self, material=changed if isinstance(self.material, tuple) else changed[0])

    def to_toml(self) -> str:
        """The scene as a TOML file that `load_scene` reads back unchanged."""
        table = to_table(self)
        takes = keys_of(self.body)  # without the defaults of other shapes' keys
        left_out = chosen_keys(table["body"]) if self.steps.error is not None else ()
        table["body"] = {key: value for key, value in table["body"].items() if key in takes and key not in left_out}
        return tomli_w.dumps(table)

    @staticmethod
    def from_toml(text: str) -> Scene:
        """The scene in a text, as `to_toml` writes it. Raises `InputError`."""
        return read_scene(_parsed(text))


def load_scene(path: str | Path, changes: Sequence[str] = (), *, anew: bool = False) -> Any:
    """A solid (`Scene`) or a flow (`FlowScene`) from a TOML file, some values changed (`obstacle.radius=0.012`).

    Args: anew: without the keys of the body that an error asked for decides.
    Raises `InputError` when anything about it is wrong.
    """
    return _load(path, read_any, changes, anew=anew)


def load_solid(path: str | Path, changes: Sequence[str] = (), *, anew: bool = False) -> Scene:
    """A solid from a TOML file, as `load_scene` has it. Raises `InputError` when it is a flow too."""
    scene = load_scene(path, changes, anew=anew)
    if not isinstance(scene, Scene):
        raise InputError(f"{path}: is a flow, with its [fluid]; this takes a solid, with a [material]")
    return scene


def scene_of(text: str) -> Scene | FlowScene:
    """The solid or the flow in a text, as `to_toml` writes it. Raises `InputError`."""
    return read_any(_parsed(text))


def load_body(path: str | Path) -> Body:
    """The body of a scene file that may lack all the rest, or a mesh file as a body. Raises `InputError`."""
    if Path(path).suffix.lower() != ".toml":
        return Body(shape="file", path=str(path))
    return _load(path, read_body)


def read_any(table: dict[str, Any]) -> Scene | FlowScene:
    """A solid or a flow from a table. Raises `InputError`."""
    return read_flow(table) if "fluid" in table else read_scene(table)


def _parsed(text: str) -> dict[str, Any]:
    try:
        return parse_toml(text)
    except InputError as error:
        raise InputError(f"its scene is not TOML: {error}") from None


def beside(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """A scene's table whose mesh files, of body and obstacles, are named relative to a folder, named from here."""
    obstacles = table.get("obstacle")
    each = obstacles if isinstance(obstacles, list) else [obstacles]
    for part, key in ((table.get("body"), "path"), *((obstacle, "file") for obstacle in each)):
        if isinstance(part, dict) and isinstance(part.get(key), str):
            part[key] = str(folder / part[key])
    return table


def _load(path: str | Path, read: Callable[[dict[str, Any]], Any], changes: Sequence[str] = (), *, anew: bool = False) -> Any:
    try:
        table = read_toml(path)
        change(table, changes)
        if anew and isinstance(given := table.get("body"), dict):
            table["body"] = {key: value for key, value in given.items() if key not in chosen_keys(given)}
        return read(with_tables(beside(table, Path(path).parent), Path(path).parent))
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(str(path)) else f"{path}: {text}") from None


def read_body(table: dict[str, Any]) -> Body:
    """The body in a scene's table, in which only [body] is needed; the rest is read too when there is a material."""
    if "fluid" in table or "material" in table:
        return read_any(table).body
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
    given, table = table.get("body"), orthotropic(table)
    scene = read_table(Scene, table | {"body": with_defaults(given)} if "body" in table else table)
    check_error(scene.steps, scene.body, given or {})
    check_body(scene.body, given or {}, chosen=scene.steps.error is not None)
    scene = replace(scene, material=_one(scene.material), obstacle=_one(scene.obstacle))
    if not scene.material:
        raise InputError("material: missing")
    check_materials(scene.materials, scene.body)
    places = [(f"support[{i}]", support.where) for i, support in enumerate(scene.support)]
    places += [(f"load[{i}]", load.where) for i, load in enumerate(scene.load) if load.where is not None]
    for name, where in places:
        check_place(scene.body, where, f"{name}.where")
    for i, support in enumerate(scene.support):
        check_support(support, f"support[{i}]")
    for i, load in enumerate(scene.load):
        check_load(load, f"load[{i}]", dynamic=scene.steps.dynamic, linear=scene.linear)
    if scene.steps.dynamic and scene.steps.duration is None:
        raise InputError("steps.duration: missing; dynamic = true needs it")
    if scene.steps.velocity is not None and not scene.steps.dynamic:
        raise InputError("steps.velocity: needs dynamic = true")
    if isinstance(scene.obstacle, tuple):
        return replace(scene, obstacle=tuple(complete(each, f"obstacle[{i}]") for i, each in enumerate(scene.obstacle)))
    return scene if scene.obstacle is None else replace(scene, obstacle=complete(scene.obstacle))


def _one(parts: Any) -> Any:
    """The only one of an array of tables, or None of an empty one; else what is given."""
    return (parts[0] if parts else None) if isinstance(parts, tuple) and len(parts) < 2 else parts
