"""Predictions led back to equilibrium: each frame followed by Newton steps, contact included.

A step takes a guess u of the equilibrium at a fraction of the loading to u + K^-1 (b + contact - f(u)), with one factor of K kept over
the frames for as long as it serves, and a low-rank update of it from the steps before (newton.py, mixing.py). It begins at the
prediction, or nearer where the frames before tell how (starts.py). `count` steps are to take as many orders of magnitude from the
prediction's error: where the last step shows that they did not, more follow. One that grows, or ends at an unstable state, is
begun elsewhere; and where a state lies twice as far from its prediction as the last one did, the body may have slid, and one nearer
to the prediction is looked for. What no step leads to is found as the solver finds it, from the last state. Without a count the steps
go on until the solver's own tolerance: what comes out then is its solution, unless the guess lay nearer to another equilibrium.

Legend: N nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from physics.equilibrium.balance import Balance
from physics.equilibrium.newton import Newton
from physics.equilibrium.snap import Relaxation
from physics.equilibrium.state import HALVINGS, NoEquilibrium, State
from physics.fidelity.starts import Starts
from physics.mesh.mesh import Mesh
from physics.scene import Scene

Floats = NDArray[np.float64]

MARGIN = 3.0  # what is left after a step is less than it by a factor that is not known; a slow one leaves a third of itself
ELSEWHERE = 2.0  # times as far from its prediction as the last state, a state may be another than the predicted one


class Corrector:
    """Takes guesses one frame after the other, along the path."""

    def __init__(self, scene: Scene, mesh: Mesh, *, count: int | None = 1) -> None:
        """Args: count Newton steps for each frame, each worth an order of magnitude; None: to the solver's tolerance."""
        self.balance, self.count = Balance(scene, mesh), count
        self.newton = Newton(self.balance)
        contact = self.balance.contact
        self._starts = Starts(State(0.0, np.zeros_like(mesh.points), np.zeros(0 if contact is None else len(contact.surface.area))))

    def __call__(self, u: Floats, fraction: float) -> Floats:
        """Displacements (N, 3) after the steps; held components are put on their prescription.

        With a count, a guess that nothing can be made of comes back.

        Raises:
            NoEquilibrium: without a count, or when the guess is not finite: no equilibrium is reached from it, nor from the last state
        """
        guess = np.where(self.balance.fixed, self.balance.moved(fraction), np.asarray(u, np.float64))
        last = self._starts.states[-1]
        if not last.u.any() and self.balance.rests(fraction):  # before anything touches the rest state is the solution
            self._starts.rested(fraction, guess)
            return np.zeros_like(guess)
        try:
            state = self._first(self._ways(fraction, guess))
        except NoEquilibrium:
            if self.count is None or not np.isfinite(guess).all():
                raise
            return guess
        self._starts.add(state, guess)
        return state.u

    @property
    def share(self) -> float:
        """Of the way from a prediction, that a correction may leave."""
        return 0.0 if self.count is None else 0.1**self.count / MARGIN

    @property
    def iterations(self) -> int:
        """Newton steps so far, those that led nowhere included."""
        return self.newton.taken

    @property
    def factorisations(self) -> int:
        """Factors so far."""
        return self.newton.factorisations

    def _ways(self, fraction: float, guess: Floats) -> Iterator[Callable[[], State]]:
        """What may lead to the state, the cheapest and likeliest first."""
        for place in self._starts.ranked(fraction, guess):
            yield partial(self._from, place, fraction, guess)
        yield from self._sure(fraction, guess)

    def _sure(self, fraction: float, guess: Floats) -> list[Callable[[], State]]:
        """The solver itself, from the guess and from the last state."""
        last = self._starts.states[-1]
        return [partial(self.newton.equilibrium, fraction, guess, last), partial(self._reached, fraction, last)]

    def _from(self, start: Floats, fraction: float, guess: Floats) -> State:
        """The state that steps from a start lead to, or one nearer to the guess where that is suspiciously far off."""
        state = self._steps(fraction, start, guess)
        away = np.linalg.norm(state.u - guess)
        if start is guess or away <= ELSEWHERE * self._starts.off or not self.balance.turned(state.u, guess):
            return state
        try:
            other = self._first([partial(self._steps, fraction, guess, guess), *self._sure(fraction, guess)])
        except NoEquilibrium:
            return state
        return other if np.linalg.norm(other.u - guess) < away else state

    def _steps(self, fraction: float, start: Floats, guess: Floats) -> State:
        last, led = self._starts.states[-1], self.newton.led(start, self.balance.moved(fraction))
        if self.count is None:
            return self.newton.equilibrium(fraction, led, last)
        return self.newton.improve(fraction, led, last, guess=guess, share=self.share)

    def _first(self, ways: Iterable[Callable[[], State]]) -> State:
        """What the first way that leads anywhere leads to, each with a new factor after one that did not. Raises `NoEquilibrium`."""
        failed = NoEquilibrium("there is no way")
        for way in ways:
            try:
                return way()
            except NoEquilibrium as error:
                failed = error
                self.newton.outdate()
        raise failed

    def _reached(self, fraction: float, last: State, depth: int = 0) -> State:
        """As the solver goes on from the last state: in as many halves as it takes, and from where that ends to where the body comes to
        rest. Raises `NoEquilibrium`."""
        if self.balance.stride(last.fraction, fraction) <= 1:
            try:
                return self.newton.equilibrium(fraction, self.newton.led(last.u, self.balance.moved(fraction)), last)
            except NoEquilibrium:
                if depth >= HALVINGS:
                    return Relaxation(self.balance).settle(fraction, last, self.newton)[0]
                self.newton.outdate()
        return self._reached(fraction, self._reached((last.fraction + fraction) / 2, last, depth + 1), depth + 1)
