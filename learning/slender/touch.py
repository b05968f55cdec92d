"""How a rigid obstacle meets a beam: where it touches, how far that bends the beam, and where to it leans.

The obstacle prescribes a deflection, not a force, so Young's modulus cancels. Its centre c lies at r + h/2 less the indentation i from
the beam's axis, along the normal of the bent axis: with the slope q of the axis at the touched abscissa a, which is drawn in by d,

    deflection(a) = (r + h/2) cos q - i - height of c above the axis at rest,      a = c_x - (r + h/2) sin q + d

A cylinder turned by g from y towards x lies flat on the beam: the section turns by -atan(tan q tan g), the force F leans by tan q tan g.
A sphere presses at e beside the middle with a force that leans by m against the normal of the face. With T and B what a unit torque
turns and a unit force bends sideways at a, and H = r + h/2, the angle f and the displacement y of the section are

    f = T F (e + m (H - B F)) / (1 + T F (H - B F)),     y = B F (m - f)

and the face's point under the sphere, z = e - y - H f, is linear in m: z = Z - C m. Contact is felt at rows of points a distance b
apart, at the nodes and midway between them, and these, which two nodes carry, stand out as ridges between which a sphere sits as in a
groove (`groove_law`). It starts in the groove where it first touched and moves on when that holds it no more.

Legend: P poses, S sections; y to the side, an angle about x is positive where the side of positive y goes down.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from learning.slender.theory import Bar

ROUNDS = 8  # of the iteration for the touched abscissa
SPHERE, CYLINDER = 0.5, 1.0  # of Hertz's indentation of a half-space; of F (1 - nu^2) / (E w)
SMALL = 1e-12
SHIFT, TORN = 0.05, 0.4  # distances of rows: by how much a pull may be off; apart, for such pulls, where a body may be on either branch


@dataclass(frozen=True)
class Indenter:
    """A sphere, round = True, or a cylinder whose axis is turned [rad] from y towards x.

    first, row: where a sphere first touches, from a row of nodes, and the distance b of rows; in distances of rows and [length]
    nodes: where that row of nodes is, from the middle of the section

    All but `round` and `row` may be tensors (P,), one number for each pose.
    """

    radius: float | Tensor
    round: bool
    turn: float | Tensor = 0.0
    first: float | Tensor = 0.0
    row: float = 1.0
    nodes: float | Tensor = 0.0


@dataclass(frozen=True)
class Bent:
    """A beam as theory bends it at P poses.

    touch: (P,) touched abscissa; depth: (P,) how far the obstacle reaches below the face at rest, 0 where it does not
    push: (P,) deflection there; slope: (P,) angle of the axis there; force: (P,) that this takes, EI = 1
    indentation, width: (P,) by the touch, and its half-width
    deflection, rotation, drawn_in, aside, turn: (P, S) of the sections; `rotation` about y and `turn` about x are angles
    lean, pull, hold, lies, groove: (P,) of a sphere, M = b / (2 r): m / M; Z from the nodes of its groove, C M and z from those nodes, in
        distances of rows; how many grooves it moved on
    torn: (P,) of a sphere, how far apart pulls SHIFT to either side put the body sideways, in distances of rows
    jumps: (P,) True where it has left the place where it first lay at a jump, and where it may (`torn` past TORN): a body that did so
        snapped, when exactly is not known
    """

    touch: Tensor
    depth: Tensor
    push: Tensor
    slope: Tensor
    force: Tensor
    indentation: Tensor
    width: Tensor
    deflection: Tensor
    rotation: Tensor
    drawn_in: Tensor
    aside: Tensor
    turn: Tensor
    lean: Tensor
    pull: Tensor
    hold: Tensor
    lies: Tensor
    groove: Tensor
    torn: Tensor
    jumps: Tensor


def first_touch(start: Tensor, end: Tensor, radius: float | Tensor, height: float) -> Tensor:
    """(...) fraction of a path from `start` to `end` (..., 3) at which the obstacle reaches the face at rest; 0 where it starts there,
    1 where it never does."""
    low, high = (place[..., 2] - radius - height / 2 for place in (start, end))
    return torch.where(low <= 0, 0.0, torch.where(high >= 0, 1.0, low / (low - high)))


def groove(start: Tensor, end: Tensor, touched: Tensor, row: float, cells: int) -> tuple[Tensor, Tensor]:
    """(...) where an obstacle first touches, at the fraction `touched` of its path, and the row of nodes nearest to that [length], from
    the middle of a section that is so many cells wide, each two distances of rows."""
    beside = start[..., 1] + touched * (end[..., 1] - start[..., 1])
    shift = cells % 2 / 2
    return beside, (torch.round(beside / (2 * row) - shift) + shift) * (2 * row)


def press(x: Tensor, centre: Tensor, obstacle: Indenter, bar: Bar) -> Bent:
    """The beam under an obstacle at some poses.

    Args:
        x: (S,) abscissas of the sections, ascending from 0 to the length
        centre: (P, 3) of the obstacle: abscissa, to the side, and height above the axis at rest
    """
    arm = obstacle.radius + bar.height / 2
    low, high = 1e-3 * bar.length, (1 - 1e-3 * bar.held_at_both) * bar.length
    depth = (arm - centre[:, 2]).clamp(min=0)
    a, push, q = centre[:, 0].clamp(low, high), depth, torch.zeros_like(depth)
    force, indentation = torch.zeros_like(depth), torch.zeros_like(depth)
    for _ in range(ROUNDS):
        w, p = bar.own(a)
        push = (arm * torch.cos(q) - centre[:, 2] - indentation).clamp(min=0)
        force = push / w
        indentation = torch.minimum((indentation + _indentation(force, obstacle, bar)) / 2, depth / 2)
        q = (q + torch.atan(force * p)) / 2
        drawn = 0.0 if bar.held_at_both else 0.6 * push**2 / a
        a = (centre[:, 0] - arm * torch.sin(q) + drawn).clamp(low, high)
    at, here = a[:, None], x[None, :]
    w, p = bar.bend(here, at)
    deflection = force[:, None] * w
    width = torch.sqrt(obstacle.radius * indentation)
    lean, sideways, torque, groove = (_grooved if obstacle.round else _flat)(a, force, q, centre[:, 1], width, obstacle, bar)
    return Bent(touch=a, depth=depth, push=push, slope=q, force=force, indentation=indentation, width=width, deflection=deflection,
                rotation=torch.atan(force[:, None] * p), drawn_in=bar.drawn_in(x, deflection),
                aside=sideways[:, None] * _lying(here, at, bar), turn=torque[:, None] * bar.twist(here, at),
                lean=lean, pull=groove[0], hold=groove[1], lies=groove[2], groove=groove[3],
                torn=groove[4], jumps=groove[5].bool())


def _indentation(force: Tensor, obstacle: Indenter, bar: Bar) -> Tensor:
    """(P,) how deep the obstacle enters the face, by Hertz for a sphere."""
    pressed = (1 - bar.poisson_ratio**2) * force * bar.second_moment  # F (1 - nu^2) / E
    if obstacle.round:
        return SPHERE * (0.75 * pressed / obstacle.radius**0.5) ** (2 / 3)
    return CYLINDER * pressed / bar.width


def _lying(x: Tensor, a: Tensor, bar: Bar) -> Tensor:
    """Displacement to the side under a unit force, in the units of EI = 1 for bending down."""
    return bar.lying.bend(x, a)[0] * (bar.second_moment / bar.lying.second_moment)


Answer = tuple[Tensor, Tensor, Tensor, tuple[Tensor, ...]]


def _flat(a: Tensor, force: Tensor, slope: Tensor, beside: Tensor, width: Tensor, obstacle: Indenter, bar: Bar) -> Answer:
    """Lean, force to the side and torque (P,) of a cylinder; it knows no grooves across."""
    lean, none = torch.tan(slope) * torch.tan(torch.as_tensor(obstacle.turn, dtype=a.dtype)), torch.zeros_like(a)
    return lean, force * lean, -torch.atan(lean) / bar.twist(a, a), (none,) * 6


def _grooved(a: Tensor, force: Tensor, slope: Tensor, beside: Tensor, width: Tensor, obstacle: Indenter, bar: Bar) -> Answer:
    """Lean m / M, force to the side and torque (P,) of a sphere, and what its grooves say: from pull to jumps of `Bent`."""
    most, arm = obstacle.row / (2 * obstacle.radius), obstacle.radius + bar.height / 2
    sideways, twist = _lying(a, a, bar), bar.twist(a, a)
    lever = arm - sideways * force
    turn = twist * force / (1 + twist * force * lever).clamp(min=0.1)  # angle for a unit of e + m lever
    pull = (beside * (1 - lever * turn) - obstacle.nodes) / obstacle.row
    hold = (sideways * force + lever**2 * turn) * most / obstacle.row + SMALL
    lean, lies, moved, jumped = held(pull, hold, width / obstacle.row, obstacle.first)
    torn = torn_apart(pull, hold, width / obstacle.row, obstacle.first)
    angle = turn * (beside + most * lean * lever)
    jumps = (jumped | (torn > TORN)).to(a.dtype)
    return lean, force * (most * lean - angle), angle / twist, (pull - 2 * moved, hold, lies, moved, torn, jumps)


# The law of a groove, read off 2000 frames of finite elements (docs/network.md): half-width of the touch in distances of rows -> k, g.
WIDTH_AT = torch.tensor([0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95, 1.4, 1.65, 2.2], dtype=torch.float64)
STEEP_AT = torch.tensor([15.0, 10.0, 8.0, 6.0, 3.0, 2.8, 2.4, 2.6, 1.75, 1.0], dtype=torch.float64)
START_AT = torch.tensor([0.48, 0.45, 0.42, 0.40, 0.24, 0.18, 0.0, 0.0, 0.0, 0.0], dtype=torch.float64)


def groove_law(width: Tensor) -> tuple[Tensor, Tensor]:
    """k and g of the law m / M = max(k (z - g), -2 z), at most 2 (1 - z), for 0 <= z <= 1 from a row of nodes to a ridge; odd in z.

    A narrow touch rests between two rows, where the law jumps; a wide one feels the ridges alone, and rests on the nodes' row.

    Args:
        width: (P,) half-width of the touch in distances of rows
    """
    at = torch.searchsorted(WIDTH_AT, width.contiguous()).clamp(1, len(WIDTH_AT) - 1)
    share = ((width - WIDTH_AT[at - 1]) / (WIDTH_AT[at] - WIDTH_AT[at - 1])).clamp(0, 1)
    return STEEP_AT[at - 1] + share * (STEEP_AT[at] - STEEP_AT[at - 1]), START_AT[at - 1] + share * (START_AT[at] - START_AT[at - 1])


def held(pull: Tensor, hold: Tensor, width: Tensor, first: float | Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """m / M of a sphere in its groove, where it lies from the groove's nodes, by how many grooves it moved on, and whether at a jump.

    Solves z = pull - hold m(z) / M with the law of the groove.

    Args:
        pull: (P,) where it would be without grooves, from the nodes of the groove where it starts, in distances of rows
        hold: (P,) how far m = M moves it, likewise; above 0
        width: (P,) half-width of the touch, likewise
        first: where it first touched, likewise; -1 to 1; one number or (P,)
    """
    steep, start = groove_law(width)
    knee = (2 + steep * start) / (2 + steep)  # where the law is at its highest
    stiff = hold < 0.5  # the beam follows past that; a softer one jumps
    highest = torch.where(stiff, 1.0, knee + 2 * hold * (1 - knee))  # pull that is just held
    moved = torch.sign(pull) * torch.ceil((pull.abs() - highest) / 2).clamp(min=0)
    rest = pull - 2 * moved
    begun = torch.where(start > 0, torch.where(torch.as_tensor(first) >= 0, 1.0, -1.0), torch.sign(rest))
    begun = torch.where(begun == 0, 1.0, begun)
    side = torch.where(moved == 0, begun, -torch.sign(moved))
    foot = steep * start / (steep + 2)  # below it the law is that of the nodes' row, -2 z
    side = torch.where(side * rest < foot * (1 - 2 * hold), torch.where(stiff & (side * rest > -foot * (1 - 2 * hold)), side, -side), side)
    along = side * rest
    z = (along + hold * steep * start) / (1 + hold * steep)
    past = (along - 2 * hold) / (1 - 2 * hold)
    low = along / (1 - 2 * hold)
    z = torch.where(stiff & (z > knee), past, z)
    z = torch.where(stiff & (z < foot), low, z).clamp(-1, 1)
    m = torch.minimum(torch.maximum(steep * (z - start), -2 * z), 2 * (1 - z))
    return side * m, side * z, moved, ~stiff & ((moved != 0) | (side != begun))


def torn_apart(pull: Tensor, hold: Tensor, width: Tensor, first: float | Tensor) -> Tensor:
    """(P,) how far apart the body lies sideways, in distances of rows, for pulls SHIFT less and SHIFT more; arguments as of `held`.

    Theory knows a pull to some hundredths of a row, so that a body may lie in either place.
    """
    first = torch.as_tensor(first, dtype=pull.dtype).expand_as(pull)
    lean = held(torch.cat([pull - SHIFT, pull + SHIFT]), hold.repeat(2), width.repeat(2), first.repeat(2))[0].unflatten(0, (2, -1))
    return hold * (lean[1] - lean[0]).abs()
