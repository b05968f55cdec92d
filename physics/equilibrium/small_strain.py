"""Whether small strain is enough: linear elasticity in place of a law of finite strain, and the error that this makes.

All laws of material.py have the same stiffness K at rest, Hooke's. A displacement u that solves K u = b with the scene's
loads and contact forces b leaves, in the equations of finite strain, the residual f(u) - K u. One Newton step with K says
how far u is thereby from their solution,

    e = max_i |K^-1 (f(u) - K u)|_i / max_i |u|_i        i: nodes, f: internal forces of the scene's law

to first order in e, which is of the size of the largest rotation or strain. A scene is solved linearly while e <= LINEAR_TOLERANCE.

Legend: N nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from physics.body.elasticity import Elasticity
from physics.equilibrium.balance import Balance
from physics.equilibrium.newton import Newton
from physics.equilibrium.state import NoEquilibrium, State
from physics.linalg.cholesky import NotPositiveDefinite
from physics.linalg.factor import factor_for
from physics.mesh.mesh import Mesh
from physics.scene import Scene

Floats = NDArray[np.float64]

LINEAR_TOLERANCE = 1e-4  # of the largest displacement: about a hundredth of what a usual mesh leaves
DEEPEST = 1e-3  # an obstacle that reaches further into the body at rest, over its largest extent, turns or strains it by more
LOOKS = 20  # places on the obstacle's path where that is looked at
GROWTH, STEPS = 1.1, 10  # the error is estimated anew when the displacement has grown so much, or after so many steps


@dataclass(frozen=True)
class LinearMemory:
    """The largest error so far, the largest displacement [m] that it was estimated for, and steps since."""

    error: float
    largest: float
    since: int


class Linear:
    """A scene solved as linear elasticity, watched by the error that this leaves in the equations of finite strain.

    newton: of the linear equations; error: the largest estimate so far; allowed: how large it may be
    """

    def __init__(self, newton: Newton, finite: Elasticity, *, asked: bool = False, allowed: float = LINEAR_TOLERANCE) -> None:
        """Args: newton: of the linear equations; finite: the body under the law that the error is estimated for; asked: by the scene."""
        self.newton, self.finite, self.asked, self.error, self.allowed = newton, finite, asked, 0.0, allowed
        self._largest, self._since = 0.0, 0

    @cached_property
    def whole(self) -> State:
        """The state at the end of the loading, of a scene without obstacle. Raises `NoEquilibrium`."""
        return self.at(1.0)

    def at(self, fraction: float) -> State:
        """The state at a fraction of the loading, straight from rest. Raises `NoEquilibrium`."""
        balance = self.newton.balance
        points = 0 if balance.contact is None else len(balance.contact.surface.area)
        rest = np.zeros_like(balance.target)
        start = np.where(balance.fixed, balance.moved(fraction), rest)
        return self.newton.equilibrium(fraction, start, State(0.0, rest, np.zeros(points)))

    def scaled(self, fraction: float) -> State:
        """The state at a fraction of the loading without obstacle: what is linear grows with its loads."""
        return replace(self.whole, fraction=fraction, u=fraction * self.whole.u, reaction=fraction * self.whole.reaction, iterations=0)

    def estimate(self, u: Floats) -> float:
        """The error e of a linear solution u (N, 3), or that of its reaction; infinite where finite strain has no such state.

        A bar pulled between two faces may have the displacements of the linear one and yet another force: to first order the
        forces at the supports change by f(u) - K u - K d, d = K^-1 (f(u) - K u) on the free components.
        """
        largest, balance = float(np.linalg.norm(u, axis=1).max()), self.newton.balance
        if largest == 0:
            return 0.0
        linear = balance.elasticity.force(u)
        missing = self.finite.force(u) - linear
        correction = self.newton.tangent.solve(missing)
        change = (missing - balance.elasticity.force(correction))[balance.bearing].sum(axis=0)
        reaction = linear[balance.bearing]
        scale = max(np.linalg.norm(reaction.sum(axis=0)), 1e-3 * np.linalg.norm(reaction, axis=1).sum())
        error = max(float(np.linalg.norm(correction, axis=1).max()) / largest, float(np.linalg.norm(change) / max(scale, balance.floor)))
        return error if np.isfinite(error) else np.inf

    def holds(self, u: Floats) -> bool:
        """Whether a linear solution (N, 3) is good enough, estimated where it may have changed since the last time."""
        if self.asked:
            return True
        largest, self._since = float(np.linalg.norm(u, axis=1).max()), self._since + 1
        if largest > GROWTH * self._largest or self._since >= STEPS:
            self._largest, self._since = max(largest, self._largest), 0
            self.error = max(self.error, self.estimate(u))
        return self.error <= self.allowed

    def said(self, u: Floats) -> str:
        """What was chosen and why, in words; u (N, 3): the last solution."""
        if self.asked:
            return (f"small strain, as the linear law has it; finite strain (Saint-Venant-Kirchhoff) would move the last step by about "
                    f"{self.estimate(u):.1e} of the largest displacement")
        return (f"small strain: linear elasticity is off by an estimated {self.error:.1e} of the largest displacement, "
                f"{self.allowed:g} is allowed")

    def memory(self) -> LinearMemory:
        return LinearMemory(self.error, self._largest, self._since)

    def recall(self, memory: LinearMemory) -> None:
        """Go on as the one whose memory this is."""
        self.error, self._largest, self._since = memory.error, memory.largest, memory.since


def choose(scene: Scene, mesh: Mesh, finite: Balance, allowed: float = LINEAR_TOLERANCE) -> tuple[Linear | None, str]:
    """A linear solver when it is good enough for a scene, None when it is not; and why.

    Args: allowed: error of the largest displacement; it is not tried where that is 0

    Looked at is the end of the loading, or where the obstacle is deepest in the body at rest.
    """
    if scene.linear:
        other = scene.under("saint-venant-kirchhoff").material  # the law of finite strain that is linear in its strain
        return Linear(Newton(finite), Elasticity(mesh, other, finite.fixed, scene.body.element), asked=True), ""
    if allowed <= 0:
        return None, "finite strain"
    if finite.pressed is not None:
        return None, "finite strain: a pressure follows its face"
    if finite.varied:
        return None, "finite strain: loads or supports go by a table, or turn"
    fraction, depth = deepest(finite)
    extent = float(np.ptp(mesh.points, axis=0).max())
    loaded = finite.loaded
    if not loaded and depth <= 0:
        return None, ("finite strain: no load, support or obstacle was found to move the body, so there is nothing to estimate the error "
                      "of small strain by")
    if depth > DEEPEST * extent:
        return None, (f"finite strain: the obstacle reaches {depth:.2g} m into where the body rests, {depth / extent:.1g} of its largest "
                      f"extent; small strain is not tried above {DEEPEST:g}")
    linear = Linear(Newton(Balance(scene.under("linear"), mesh, method=finite.method, spread=finite.spread)), finite.body,
                    allowed=allowed)
    try:
        end = (linear.whole if finite.contact is None else linear.at(fraction)).u
    except NoEquilibrium:
        return None, "finite strain: there is no linear solution"
    error = linear.estimate(end)
    if error > allowed:
        return None, (f"finite strain: linear elasticity would be off by {error:.1e} of the largest displacement, "
                      f"{allowed:g} is allowed")
    try:
        factor_for(finite.elasticity).update(end)
    except NotPositiveDefinite:
        return None, "finite strain: the linear solution is that of a body that buckles"
    return linear, ""


def deepest(balance: Balance) -> tuple[float, float]:
    """The fraction of the loading to look at, and how deep [m] the obstacle then is in the body at rest; below 0 outside."""
    if balance.contact is None:
        return 1.0, 0.0
    legs = max(1, *(len(obstacle.path) - 1 for obstacle in balance.contact.obstacle.each))
    looks = np.linspace(0, 1, legs * int(np.ceil(LOOKS / legs)) + 1)
    depths = [-balance.clearance(float(fraction)) for fraction in looks]
    if max(depths) <= 0 or balance.loaded:
        return 1.0, max(depths)
    return float(looks[int(np.argmax(depths))]), max(depths)
