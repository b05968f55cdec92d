"""A predicted flow held against a reference and against its equations (currents.py), one figure for each thing that can be wrong.

A prediction begins at frame `first`, which it is shown: at an impulsive start the fluid moves from one moment to the next, so that is
the first frame in which it moves. Rates are differences of the frames before and after. Forces and what follows from them are worked
out from the stored nodes, of the reference too, whose own figures therefore say what a perfect prediction would score.

Legend: T frames, S stored nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from physics.fidelity.currents import Currents
from physics.mesh import quality
from physics.mesh.mesh import Mesh
from physics.scene.flow import FlowScene

Floats = NDArray[np.float64]
SHEDDING = 0.02  # peak to peak of a lift coefficient that counts as shedding
BEHIND = (1.0, 2.0, 4.0)  # diameters behind the rear of a cylinder, where spectra are taken
EARLIEST = 0.1  # of the frames: before them a start is too sudden for differences of frames


@dataclass(frozen=True, kw_only=True)
class FlowFidelity:
    """How good a flow is; what is not known is not a number. Nodes are those inside and at the outflow, where no velocity is given."""

    velocity_rmse_1: float  # [m/s] of a component, one step from the true state; without such predictions the first step
    velocity_rmse_50: float  # steps 1 .. 50 of the rollout
    velocity_rmse_all: float
    pressure_rmse_50: float  # [Pa]
    pressure_rmse_all: float
    divergence: float  # [1/s] root mean square over the domain and the checked frames
    momentum_residual: float  # in the weak norm, over density x largest speed^2 x root of the area; likewise
    slip: float  # [m/s] largest difference to what is given at walls and inlets
    flux_error: float  # largest of all sections and checked frames, over the largest inflow
    drag_error: float  # root mean square over the checked frames, over the largest drag of the reference
    lift_error: float  # the same, over the largest lift or a hundredth of the drag
    kinetic_energy_error: float  # over the largest of the reference
    strouhal: float  # frequency of the lift in the second half x length / speed; not a number where nothing sheds
    strouhal_error: float  # over that of the reference
    spectrum_error: float  # of the amplitudes of the velocity across, over those of the reference, three points together
    worst_step: int  # with the largest error of the velocity


@dataclass(frozen=True)
class FlowReference:
    """What predictions of one flow are held against; what is to be known of it alone is found once.

    Args:
        velocity (T, S, 2) [m/s]; pressure (T, S) [Pa] or None; predicted (S,) nodes whose velocity is not given
        scene: None where there is none: the equations say nothing then
        span: [s] between frames; first: the frame that is shown; sample: about so many frames are checked, all by default
    """

    velocity: Floats
    pressure: Floats | None
    predicted: NDArray[np.bool_]
    mesh: Mesh
    scene: FlowScene | None = None
    span: float = 1.0
    first: int = 0
    sample: int | None = None
    computed: Mesh | None = None  # of a scene whose mesh is that of a file

    def verify(self, velocity: ArrayLike, pressure: ArrayLike | None = None, one_step: ArrayLike | None = None) -> FlowFidelity:
        """The figures of a prediction.

        Args:
            velocity: (T, S, 2) [m/s]; pressure: (T, S) [Pa], None where it is not predicted
            one_step: (T - 1 - first, S, 2) velocities one step after each true frame from `first` on
        """
        u, start, chosen = np.asarray(velocity, np.float64), self.first + 1, self.predicted
        p = None if pressure is None else np.asarray(pressure, np.float64)
        single = u[start:start + 1] if one_step is None else np.asarray(one_step, np.float64)
        error = np.sqrt(((u - self.velocity)[:, chosen] ** 2).sum(axis=2).mean(axis=1))
        return FlowFidelity(
            velocity_rmse_1=_rmse(single[:, chosen], self.velocity[start:start + len(single), chosen]),
            velocity_rmse_50=_rmse(u[start:start + 50, chosen], self.velocity[start:start + 50, chosen]),
            velocity_rmse_all=_rmse(u[start:, chosen], self.velocity[start:, chosen]),
            pressure_rmse_50=self._of_pressure(p, slice(start, start + 50)), pressure_rmse_all=self._of_pressure(p, slice(start, None)),
            worst_step=start + int(np.argmax(error[start:])), **self._of_equations(u, p))

    def _of_pressure(self, p: Floats | None, frames: slice) -> float:
        return np.nan if p is None or self.pressure is None else _rmse(p[frames, :, None], self.pressure[frames, :, None])

    @cached_property
    def _checked(self) -> NDArray[np.int64]:
        """The frames that are checked, each with one before and after."""
        last = len(self.velocity) - 1
        low = max(self.first + 1, round(EARLIEST * last))
        every = np.arange(low, last)
        return every[np.unique(np.linspace(0, len(every) - 1, min(len(every), self.sample or len(every))).round().astype(int))]

    @cached_property
    def _currents(self) -> Currents:
        assert self.scene is not None
        return Currents(self.scene, self.computed)

    @cached_property
    def _due(self) -> dict[str, Any]:
        return self._found(self.velocity, self.pressure)

    def _found(self, u: Floats, p: Floats | None) -> dict[str, Any]:
        """What the equations say of checked frames: (frames,) each, forces (frames, 2); and (frames,) of the lift of late ones."""
        of, frames = self._currents, self._checked
        found: dict[str, Any] = {"divergence": np.array([of.divergence(u[t]) for t in frames]),
                                 "energy": np.array([of.energy(u[t]) for t in frames])}
        late = np.arange(max(len(u) // 2, self.first + 1), len(u) - 1)
        if p is None:
            return found | {"residual": np.full(len(frames), np.nan), "force": np.full((len(frames), 2), np.nan), "lift": np.full(0, 0.0)}
        all_of = {int(t): of.forces(u[t], p[t], (u[t + 1] - u[t - 1]) / (2 * self.span)) for t in np.union1d(frames, late)}
        return found | {"residual": np.array([of.residual(all_of[t]) for t in frames.tolist()]),
                        "force": np.array([of.on_place(all_of[t]) for t in frames.tolist()]).reshape(-1, 2),
                        "lift": np.array([of.on_place(all_of[t])[1] for t in late.tolist()])}

    def _of_equations(self, u: Floats, p: Floats | None) -> dict[str, float]:
        names = ("divergence", "momentum_residual", "slip", "flux_error", "drag_error", "lift_error", "kinetic_energy_error", "strouhal",
                 "strouhal_error", "spectrum_error")
        if self.scene is None or not len(self._checked):
            return dict.fromkeys(names, np.nan)
        of, frames, due = self._currents, self._checked, self._due
        same = p is not None and self.pressure is not None and np.array_equal(u, self.velocity) and np.array_equal(p, self.pressure)
        found = due if same else self._found(u, p)
        fastest = float(np.linalg.norm(self.velocity[self.first + 1:], axis=2).max()) or np.nan
        given = np.array([of.values(self.span * t) for t in range(len(u))])
        inflow = np.array([of.inflow(self.span * t) for t in range(len(u))])
        gap = of.fluxes(u[frames]) - inflow[frames, None]
        most = abs(due["force"]).max(axis=0)  # drag and lift of the reference
        scale = np.array([most[0], max(most[1], 0.01 * most[0])])
        missed = np.sqrt(((found["force"] - due["force"]) ** 2).mean(axis=0)) / np.where(scale > 0, scale, np.nan)
        own, true = self._strouhal(found["lift"]), self._strouhal(due["lift"])
        return {
            "divergence": _rms(found["divergence"]),
            "momentum_residual": _rms(found["residual"]) / (of.density * fastest**2 * np.sqrt(of.area)),
            "slip": float(np.linalg.norm(u[self.first + 1:, of.given] - given[self.first + 1:], axis=2).max(initial=0.0)),
            "flux_error": float(abs(gap).max() / (abs(inflow).max() or np.nan)),
            "drag_error": float(missed[0]), "lift_error": float(missed[1]),
            "kinetic_energy_error": _rms(found["energy"] - due["energy"]) / (float(due["energy"].max()) or np.nan),
            "strouhal": own, "strouhal_error": abs(own - true) / true if true else np.nan, "spectrum_error": self._spectrum(u, fastest)}

    def _strouhal(self, lift: Floats) -> float:
        """Of a series of lifts [N/m]."""
        force = self.scene.force if self.scene is not None else None
        if self.scene is None or force is None or force.length is None or force.speed is None or len(lift) < 4:
            return np.nan
        scale = self.scene.fluid.density * force.speed**2 * force.length / 2
        return np.nan if not np.ptp(lift) > SHEDDING * scale else frequency(lift) / self.span * force.length / force.speed

    @cached_property
    def _points(self) -> NDArray[np.int64]:
        """The stored nodes nearest to the places BEHIND the cylinder."""
        assert self.scene is not None
        body = self.scene.body
        if body.shape != "channel" or body.hole_centre is None or body.hole_radius is None:
            return np.empty(0, np.int64)
        away = [body.hole_centre[0] + body.hole_radius * (1 + 2 * far) for far in BEHIND]
        places = [(x, body.hole_centre[1]) for x in away if x < self.mesh.points[:, 0].max()]
        return np.array([np.argmin(np.hypot(*(self.mesh.points[:, :2] - place).T)) for place in places], np.int64)

    def _spectrum(self, u: Floats, fastest: float) -> float:
        late = slice(max(len(u) // 2, self.first + 1), None)
        own, true = (flow[late][:, self._points, 1] for flow in (u, self.velocity))
        if len(own) < 16 or not self._points.size or not np.ptp(true, axis=0).max() > 1e-2 * fastest:
            return np.nan
        window = np.hanning(len(own))[:, None]
        own, true = (abs(np.fft.rfft((flow - flow.mean(axis=0)) * window, axis=0)) for flow in (own, true))
        return float(np.linalg.norm(own - true) / np.linalg.norm(true))


def frequency(signal: ArrayLike) -> float:
    """Periods for each frame of a signal, between the first and the last time that it rises through its mean; not a number below two."""
    value = np.asarray(signal, np.float64) - (np.max(signal) + np.min(signal)) / 2
    up = np.flatnonzero((value[:-1] < 0) & (value[1:] >= 0))
    if len(up) < 2:
        return np.nan
    at = up - value[up] / (value[up + 1] - value[up])
    return float((len(at) - 1) / (at[-1] - at[0]))


def nothing_changes(velocity: Floats, first: int, predicted: NDArray[np.bool_]) -> Floats:
    """(T, S, k) the shown frame for ever, nodes whose velocity is given as they are."""
    found = velocity.copy()
    found[first + 1:, predicted] = velocity[first, predicted]
    return found


def _rmse(found: Floats, true: Floats) -> float:
    return quality.rmse(found, true, space=found.shape[-1]) if found.size else np.nan


def _rms(values: Floats) -> float:
    """Root mean square; infinite where something overflows."""
    value = float(np.sqrt(np.mean(np.square(values))))
    return value if np.isfinite(value) or np.isnan(values).any() else float("inf")
