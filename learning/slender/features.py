"""What the network is shown of a pose, of a section at a pose, and what its answer is added to.

    displacement of a section = base + unit x answer,     unit = depth x envelope(x)

in coefficients (3, 6) of `beam.Beam.project`. The base is theory's: sections stay plane, turn with the axis but for shear, and about it:
u = (z sin q - drawn in, aside + z sin f, -w - z (1 - cos q) - y sin f). The envelope x / (x + h / 2) is 0 where the beam is held, from
both ends where both are.

A pose is told by what does not depend on the size of the beam nor on Young's modulus: proportions, places in lengths of the
beam or the section, the phase of the touch within a cell (contact is felt at points half a cell apart), the force over E h^2.

Legend: P poses, S sections.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from learning.slender.beam import FUNCTIONS, Beam
from learning.slender.theory import Bar
from learning.slender.touch import Bent, Indenter, press

TAU = 2 * math.pi
WIDTHS = (0.25, 0.6, 1.5)  # heights of the beam: of the bells around the touch
TINY = 1e-30  # below the rounding of every feature, and of a root that has a slope
SMALLEST = 1e-6  # of the beam's length, of a depth that is divided by


@dataclass(frozen=True)
class Seen:
    """Some poses of one beam: pose (P, A) and section (P, S, B) features; base (P, S, 3, 6) [m], unit (P, S) [m]
    depth (P,) [m] of the obstacle, and jumps (P,) True where a sphere has or may have left its groove at a jump; force (P,) [m2] of
    the obstacle over Young's modulus, by theory."""

    pose: Tensor
    section: Tensor
    base: Tensor
    unit: Tensor
    depth: Tensor
    jumps: Tensor
    force: Tensor


def shown(beam: Beam, fraction: np.ndarray) -> Seen:
    """The features at fractions of the obstacle's path."""
    return look(beam, torch.as_tensor(beam.centre(fraction)))


def look(beam: Beam, centre: Tensor, obstacle: Indenter | None = None) -> Seen:
    """The features of a beam under its obstacle, or one with other numbers at each pose, at centres (P, 3), in double precision."""
    obstacle = obstacle or obstacle_of(beam)
    x = torch.as_tensor(beam.x)
    bar = Bar(*beam.extent, beam.poisson_ratio, beam.held_at_both)
    bent = press(x, centre, obstacle, bar)
    return Seen(_pose(beam, bar, obstacle, centre, bent), _section(beam, x, obstacle, centre, bent), _base(beam, bent),
                bent.depth[:, None] * _envelope(beam, x), bent.depth, bent.jumps, bent.force * bar.second_moment)


def left(beam: Beam, centre: Tensor, obstacle: Indenter) -> Tensor:
    """(n, K) True from the pose on at which a sphere has or may have left its groove at a jump, for centres (n, K, 3) along n paths and
    an obstacle with numbers (n * K,): past it theory may be in another groove than the body, even where it sees no jump any more."""
    bar = Bar(*beam.extent, beam.poisson_ratio, beam.held_at_both)
    ends = torch.tensor([0.0, bar.length], dtype=centre.dtype)
    return press(ends, centre.flatten(0, 1), obstacle, bar).jumps.view(centre.shape[:2]).cumsum(1) > 0


def obstacle_of(beam: Beam) -> Indenter:
    """The obstacle as theory knows it."""
    first, nodes = beam.groove
    return Indenter(beam.radius, beam.round, beam.turn, (first - nodes) / beam.row, beam.row, nodes)


def _pose(beam: Beam, bar: Bar, obstacle: Indenter, centre: Tensor, bent: Bent) -> Tensor:
    length, width, height = beam.extent
    one, ball = torch.ones_like(bent.push), float(beam.round)
    depth = bent.depth + SMALLEST * length
    cell = length / beam.cells[0]
    force = bent.force * bar.second_moment / height**2  # F / (E h^2)
    off = centre[:, 1] * ball
    radius, turn, nodes = obstacle.radius, obstacle.turn, obstacle.nodes * ball
    a = bent.touch
    most = beam.row / (2 * radius)
    angle = bent.force * off * bar.twist(a, a)
    lying = bar.lying.bend(a, a)[0] * bar.second_moment / bar.lying.second_moment * bent.force
    row, aside = a / cell * 2, (off - nodes) / beam.row  # in rows of points
    sag = [(d * (torch.frac(at) - 0.5).abs()) ** 2 / (2 * radius) for d, at in ((cell / 2, row + 0.5), (beam.row, aside + 0.5))]
    fixed = [math.log(length / height), width / height, radius / height, float(beam.held_at_both), ball, turn,
             float(beam.cells[1]), float(beam.cells[2]), math.log(cell / height), float(beam.diagonal),
             float(beam.diagonal) * (beam.cells[1] % 2), beam.row / height, most, nodes / width,
             obstacle.first * ball, beam.poisson_ratio, float(beam.neo_hookean)]
    columns = [value * one for value in fixed]
    columns += [centre[:, 0] / length, a / length, a / height, (length - a) / height, off / width, off / height, aside * ball,
                bent.depth / length, bent.depth / height, torch.sqrt(bent.depth / height), force, torch.sqrt(force),
                bent.indentation / height, bent.indentation / depth, bent.slope, bent.slope**2, bent.width / (cell / 2),
                bent.width / beam.row * ball, angle, lying * ball / height, torch.tanh(angle * lying / height), off / radius,
                turn * bent.slope, turn * off / width, off * bent.slope / width,
                bent.lean, torch.tanh(bent.pull), torch.tanh(bent.pull / 4), torch.tanh(bent.hold), torch.tanh(bent.hold / 4),
                bent.lies, torch.tanh(bent.groove), (bent.groove != 0).to(one.dtype), torch.tanh(bent.torn),
                sag[0] / depth.clamp(min=1e-3 * height), sag[1] * ball / height]
    for k in (0.5, 1, 2):
        columns += [torch.sin(TAU * k * row), torch.cos(TAU * k * row)]
        columns += [torch.sin(TAU * k * bent.lies) * ball, torch.cos(TAU * k * bent.lies) * ball]
    return torch.stack(columns, dim=1)


def _section(beam: Beam, x: Tensor, obstacle: Indenter, centre: Tensor, bent: Bent) -> Tensor:
    length, _, height = beam.extent
    push = bent.push[:, None] + SMALLEST * length
    from_touch = (x - bent.touch[:, None]) / height
    under = (x - bent.drawn_in - centre[:, :1]) / torch.as_tensor(obstacle.radius, dtype=x.dtype)[..., None]
    below = torch.sqrt((1 - under**2).clamp(min=TINY))
    columns = [x / length, bent.deflection / push, bent.rotation * length / push, bent.rotation, bent.drawn_in * length / push**2,
               torch.exp(-x / height), torch.exp(-3 * x / height), torch.exp(-(length - x) / height),
               torch.exp(-3 * (length - x) / height), torch.tanh(from_touch), torch.tanh(from_touch / 3), below,
               *(torch.exp(-((from_touch / width) ** 2)) for width in WIDTHS)]
    return torch.stack([column.expand_as(bent.deflection) for column in columns], dim=2)


def _base(beam: Beam, bent: Bent) -> Tensor:
    (wide, high), sine = beam.spread, torch.sin(bent.turn)
    base = torch.zeros(*bent.deflection.shape, 3, FUNCTIONS, dtype=bent.deflection.dtype)
    base[..., 0, 0], base[..., 0, 2] = -bent.drawn_in, high * torch.sin(bent.rotation)
    base[..., 1, 0], base[..., 1, 2] = bent.aside, high * sine
    base[..., 2, 0], base[..., 2, 1], base[..., 2, 2] = -bent.deflection, -wide * sine, high * (torch.cos(bent.rotation) - 1)
    return base


def _envelope(beam: Beam, x: Tensor) -> Tensor:
    length, _, height = beam.extent
    envelope = x / (x + height / 2)
    return envelope * (length - x) / (length - x + height / 2) if beam.held_at_both else envelope
