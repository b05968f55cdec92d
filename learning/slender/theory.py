"""What beam theory says of a clamped beam under one force or torque; Timoshenko's beam and Saint-Venant's torsion.

A unit force at the abscissa a bends a beam of stiffness EI = 1 and shear flexibility s = EI / (k G A), clamped at x = 0, by

    w_a(x) = x^2 (3 a - x) / 6 + s x,   p_a(x) = a x - x^2 / 2         for x <= a
    w_a(x) = a^2 (3 x - a) / 6 + s a,   p_a(x) = a^2 / 2               beyond

(w deflection, p rotation of the section). Held at x = L as well, the end adds a force P and a moment M that bring both back to zero there:

    P = -(a^2 L / 4 - a^3 / 6 + s a) / (L^3 / 12 + s L),     M = -(a^2 + P L^2) / (2 L)

A unit torque at a turns the section at x by min(x, a) / (G J), times 1 - max(x, a) / L where both ends are held.

Legend: P poses, S sections. Lengths in any one unit, forces in units in which EI = 1.
Source: Timoshenko, Phil. Mag. 41 (1921); k = 10 (1 + nu) / (12 + 11 nu) of a rectangle: Cowper, J. Appl. Mech. 33 (1966); J of a
rectangle: Roark's Formulas for Stress and Strain, table 10.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Bar:
    """A beam as theory knows it: its sides, `height` along the bending, held at x = 0 or at both ends."""

    length: float
    width: float
    height: float
    poisson_ratio: float
    held_at_both: bool

    @property
    def shear(self) -> float:
        """EI / (k G A) [length^2]."""
        nu = self.poisson_ratio
        return self.height**2 / 12 * 2 * (1 + nu) / (10 * (1 + nu) / (12 + 11 * nu))

    @property
    def torsion_constant(self) -> float:
        """J [length^4]."""
        long, short = max(self.width, self.height), min(self.width, self.height)
        return long * short**3 * (1 / 3 - 0.21 * short / long * (1 - (short / long) ** 4 / 12))

    @property
    def second_moment(self) -> float:
        """I [length^4]."""
        return self.width * self.height**3 / 12

    @property
    def lying(self) -> Bar:
        """The same beam bent to the side."""
        return Bar(self.length, self.height, self.width, self.poisson_ratio, self.held_at_both)

    def bend(self, x: Tensor, a: Tensor) -> tuple[Tensor, Tensor]:
        """Deflection and rotation at abscissas x under a unit force at a (shapes that broadcast)."""
        length, below = self.length, torch.minimum(x, a)
        w = below**2 * (3 * a - below) / 6 + self.shear * below + (x - below) * a**2 / 2
        p = a * below - below**2 / 2
        if self.held_at_both:
            force = -(a**2 * length / 4 - a**3 / 6 + self.shear * a) / (length**3 / 12 + self.shear * length)
            moment = -(a**2 + force * length**2) / (2 * length)
            w = w + force * (x**2 * (3 * length - x) / 6 + self.shear * x) + moment * x**2 / 2
            p = p + force * (length * x - x**2 / 2) + moment * x
        return w, p

    def own(self, a: Tensor) -> tuple[Tensor, Tensor]:
        """Deflection and rotation where the unit force is: `bend(a, a)`, in fewer operations."""
        square = a * a
        w, p = a * (square / 3 + self.shear), square / 2
        if self.held_at_both:
            length = self.length
            force = a * (a * (a / 6 - length / 4) - self.shear) / (length**3 / 12 + self.shear * length)
            moment = (square + force * length**2) / (-2 * length)
            w = w + force * a * (a * (3 * length - a) / 6 + self.shear) + moment * p
            p = p + a * (force * (length - a / 2) + moment)
        return w, p

    def twist(self, x: Tensor, a: Tensor) -> Tensor:
        """Angle at abscissas x under a unit torque at a (shapes that broadcast)."""
        flexibility = self.second_moment * 2 * (1 + self.poisson_ratio) / self.torsion_constant  # EI / (G J)
        share = 1 - torch.maximum(x, a) / self.length if self.held_at_both else 1.0
        return flexibility * torch.minimum(x, a) * share

    def drawn_in(self, x: Tensor, deflection: Tensor) -> Tensor:
        """(P, S) how far sections at (S,) are drawn towards x = 0 by deflections (P, S), for an axis that keeps its length.

        The integral of w'^2 / 2; held at both ends the axis is stretched evenly.
        """
        pieces = torch.diff(deflection, dim=1) ** 2 / (2 * torch.diff(x))
        whole = torch.cat([torch.zeros_like(deflection[:, :1]), torch.cumsum(pieces, dim=1)], dim=1)
        return whole - whole[:, -1:] * (x / x[-1]) if self.held_at_both else whole
