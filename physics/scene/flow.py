"""A flow: a fluid in a plane domain, what enters it where, and what leaves it.

A scene with a table [fluid] is a flow. Its [body] is the domain, in triangles: a "channel" with a round hole, a plane "plate", or a
"file". Whatever of its boundary is no inflow and no outflow is a wall, at rest or moving along itself. An inflow has a profile over
its place times a factor over time:

    parabola   speed 4 s (1 - s), s from 0 to 1 along the place
    uniform    speed
    table      speed times what `share` says at the places `along`, 0 .. 1, linear between

    no key     1 from the start on: an impulsive start, for the fluid is at rest at first
    ramp       (1 - cos(pi t / ramp)) / 2 until t = ramp [s], then 1
    period     mean + (1 - mean) sin(2 pi t / period)
    steps      what `factor` says at the fractions `steps` of the duration, linear between; or a CSV file, as loads have (tables.py)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from physics.scene.body import FAR, PLANE_CELLS, Body
from physics.scene.rules import check_body, check_place, is_plane, keys_of, with_defaults
from physics.scene.tables import check_steps
from physics.schema import InputError, quantity, read_table, to_table

HOLE = 3.0  # cell_size over hole_cell_size of a channel that says nothing of it
Pair = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Fluid:
    """A Newtonian fluid of constant density; `order` of the velocity's polynomials, of which the pressure has one less.

    density: kept
    viscosity: dynamic, mu
    order: of the velocity; chosen by what the mesh asks for when left out
    """

    density: float = quantity(unit="kg/m3", above=0, at_least=1e-12, at_most=1e12)
    viscosity: float = quantity(unit="Pa s", above=0, at_least=1e-15, at_most=1e12)
    order: int | None = quantity(None, at_least=2, at_most=3)


@dataclass(frozen=True, kw_only=True)
class Inflow:
    """Fluid that enters, normal to a straight side; `speed` is the largest of its profile at a factor of 1.

    where: the side
    profile: over the place, see above
    speed: the largest of the profile
    along: shares of the place, of a table
    share: of the speed there
    ramp: time until the full speed
    period: of a speed that swings
    mean: of the factor that swings, 0 by default
    steps: fractions 0 .. 1 of the duration; or table = a CSV file in place of both
    factor: of the speed at these
    """

    where: str = "inlet"
    profile: str = quantity("parabola", choice=("parabola", "uniform", "table"))
    speed: float = quantity(unit="m/s", **FAR)
    along: tuple[float, ...] | None = quantity(None, at_least=0, at_most=1)
    share: tuple[float, ...] | None = quantity(None, **FAR)
    ramp: float | None = quantity(None, unit="s", above=0, at_most=1e9)
    period: float | None = quantity(None, unit="s", above=0, at_most=1e9)
    mean: float | None = quantity(None, at_least=0, at_most=1)
    steps: tuple[float, ...] | None = None
    factor: tuple[float, ...] | None = quantity(None, **FAR)

    def profile_at(self, s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Speed over `speed` at shares s of the place."""
        if self.profile == "uniform":
            return np.ones_like(s)
        if self.profile == "parabola":
            return 4 * s * (1 - s)
        assert self.along is not None and self.share is not None
        return np.interp(s, self.along, self.share)

    def factor_at(self, t: float, duration: float) -> float:
        """Speed over that of the profile at a time [s]."""
        if self.ramp is not None:
            return float((1 - np.cos(np.pi * min(t / self.ramp, 1.0))) / 2)
        if self.period is not None:
            mean = self.mean or 0.0
            return float(mean + (1 - mean) * np.sin(2 * np.pi * t / self.period))
        if self.steps is not None:
            return float(np.interp(t / duration, self.steps, self.factor or ()))
        return 1.0

    @property
    def mean_speed(self) -> float:
        """[m/s] of the profile at factor 1."""
        if self.profile == "table":
            s, share = np.array([0.0, *(self.along or ()), 1.0]), self.profile_at(np.array([0.0, *(self.along or ()), 1.0]))
            return self.speed * float((np.diff(s) * (share[1:] + share[:-1]) / 2).sum())
        return self.speed * {"uniform": 1.0, "parabola": 2 / 3}[self.profile]


@dataclass(frozen=True, kw_only=True)
class Outflow:
    """Where fluid leaves, without traction: viscosity du/dn - p n = 0, and no energy comes in with what flows back (flow/boundary.py).

    where: the side
    """

    where: str = "outlet"


@dataclass(frozen=True, kw_only=True)
class Wall:
    """A wall that moves along itself.

    where: the side
    velocity: along it
    """

    where: str
    velocity: Pair = quantity(unit="m/s", **FAR)


@dataclass(frozen=True, kw_only=True)
class Force:
    """The force on a place, and what makes it a coefficient: F / (density speed^2 length / 2); the pressure at the first of two points
    less that at the second. A channel has its hole, the hole's diameter, the mean speed of its inflow, and the hole's two ends.

    where: the wall
    length: of the coefficients
    speed: of the coefficients
    points: of the pressure difference
    """

    where: str
    length: float | None = quantity(None, unit="m", above=0, at_least=1e-9, at_most=1e9)
    speed: float | None = quantity(None, unit="m/s", above=0, at_least=1e-9, at_most=1e9)
    points: tuple[Pair, Pair] | None = quantity(None, unit="m", **FAR)


@dataclass(frozen=True, kw_only=True)
class FlowSteps:
    """Frames 0 .. count over the duration [s]; the solver takes as many steps between them as it needs. With `stationary` there is one
    frame beside the fluid at rest, the stationary flow at the full speed of the inflow.

    count: frames
    duration: of all of them; needed unless stationary
    stationary: one frame, the flow that no longer changes
    """

    count: int = quantity(1, at_least=1, at_most=100_000)
    duration: float | None = quantity(None, unit="s", above=0, at_most=1e9)
    stationary: bool = False

    @property
    def dynamic(self) -> bool:
        """As solid scenes have it."""
        return not self.stationary


@dataclass(frozen=True, kw_only=True)
class FlowScene:
    """A fluid in a domain and what happens to it."""

    body: Body
    fluid: Fluid
    name: str = "flow"
    inflow: tuple[Inflow, ...] = ()
    outflow: tuple[Outflow, ...] = ()
    wall: tuple[Wall, ...] = ()
    force: Force | None = None
    steps: FlowSteps = field(default_factory=FlowSteps)

    @property
    def order(self) -> int:
        """Of the velocity: 3 in a shape, 2 on a mesh from a file, unless the scene says otherwise."""
        return self.fluid.order or (2 if self.body.shape == "file" else 3)

    @property
    def reynolds_number(self) -> float | None:
        """Density x the force's speed x its length / viscosity: of a channel the inflow's mean speed and the hole's diameter."""
        force = self.force
        if force is None or force.length is None or force.speed is None:
            return None
        return self.fluid.density * force.speed * force.length / self.fluid.viscosity

    def to_toml(self) -> str:
        """The scene as a TOML file that `load_scene` reads back unchanged."""
        table = to_table(self)
        takes = keys_of(self.body)
        table["body"] = {key: value for key, value in table["body"].items() if key in takes}
        return tomli_w.dumps(table)


def read_flow(table: dict[str, Any]) -> FlowScene:
    """A flow from a table, with the rules that bind several keys. Raises `InputError`."""
    given = table.get("body")
    scene = read_table(FlowScene, table | {"body": _domain(given)} if "body" in table else table)
    check_body(scene.body, given or {})
    if scene.body.shape != "file" and not (is_plane(scene.body) and scene.body.cell == "triangle"):
        raise InputError("body: a flow is in a plane domain of triangles: shape = \"channel\", a plate with cell = \"triangle\", or a file")
    if scene.body.element != "standard":
        raise InputError(f"body.element = {scene.body.element!r}: is for solids; leave it out")
    if scene.body.plane is not None or scene.body.thickness is not None:
        raise InputError("body: a flow has no plane and no thickness; its forces are for each metre across")
    names = [(f"{kind}[{i}].where", part.where) for kind in ("inflow", "outflow", "wall") for i, part in enumerate(getattr(scene, kind))]
    for key, where in [*names, *([("force.where", scene.force.where)] if scene.force else [])]:
        check_place(scene.body, where, key)
    for i, inflow in enumerate(scene.inflow):
        _check_inflow(inflow, f"inflow[{i}]")
    if scene.inflow and not scene.outflow:
        raise InputError("outflow: missing; what flows in must flow out")
    if scene.steps.duration is None and not scene.steps.stationary:
        raise InputError("steps.duration: missing; only a stationary flow has none")
    if scene.steps.stationary and (scene.steps.count != 1 or scene.steps.duration is not None):
        raise InputError("steps.stationary: one frame, without a duration; leave count and duration out")
    return replace(scene, force=_force(scene))


def _domain(body: Any) -> Any:
    """The table of a domain with the values that its shape has when they are left out."""
    if isinstance(body, dict) and body.get("shape", "channel") == "channel":
        body = with_defaults(body | {"shape": "channel"})
        size, grows = body["cell_size"], body["cell"] == PLANE_CELLS[0]
        return ({"hole_cell_size": size / HOLE} if grows and isinstance(size, int | float) else {}) | body
    if isinstance(body, dict) and body.get("shape") == "plate" and "cell" not in body:
        return body | {"cell": PLANE_CELLS[0]}
    return body


def _check_inflow(inflow: Inflow, key: str) -> None:
    times = [name for name in ("ramp", "period", "steps") if getattr(inflow, name) is not None]
    if len(times) > 1:
        raise InputError(f"{key}: give at most one of ramp, period and steps")
    if inflow.mean is not None and inflow.period is None:
        raise InputError(f"{key}.mean: goes with a period")
    check_steps(inflow.steps, inflow.factor, key, "factor")
    if (inflow.profile == "table") != (inflow.along is not None) or (inflow.along is None) != (inflow.share is None):
        raise InputError(f"{key}: profile = \"table\" needs along and share, the others take neither")
    if inflow.along is not None and inflow.share is not None:
        if len(inflow.along) != len(inflow.share) or len(inflow.along) < 2:
            raise InputError(f"{key}: along and share must have the same number of entries, two at least")
        if any(a >= b for a, b in zip(inflow.along, inflow.along[1:], strict=False)):
            raise InputError(f"{key}.along must rise")


def _force(scene: FlowScene) -> Force | None:
    """The force that is asked for, with what a channel knows of its own."""
    force = scene.force or (Force(where="hole") if scene.body.shape == "channel" else None)
    if force is None:
        return None
    mean = max((abs(inflow.mean_speed) for inflow in scene.inflow), default=0.0)
    force = replace(force, speed=force.speed or mean or None)
    if scene.body.shape == "channel" and force.where == "hole":
        (x, y), r = scene.body.hole_centre or (0.0, 0.0), scene.body.hole_radius or 0.0
        force = replace(force, length=force.length or 2 * r, points=force.points or ((x - r, y), (x + r, y)))
    return force
