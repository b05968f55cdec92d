"""A beam and its obstacle in a frame where beams look alike, and what its sections do as a few numbers.

The beam's axis is x and starts at a clamped end; y and z are measured from the middle of the section; the obstacle presses down on
the face z-max; where both ends are held it touches the half nearer to x = 0. Reflections and a swap of the sides across lead there,
which are exact symmetries of the elements but for one thing: the diagonals of the prisms alternate like a chess board, and a
reflection of an odd number of cells turns the board by one. `diagonal` tells which of the two it is.

A section is the nodes of one abscissa, a grid of n nodes. Its displacement is told by six polynomials of (y, z) that are orthonormal on
the grid, 1, y, z, y z, y^2, z^2 up to factors and constants: with c = project(u), the mean of |u|^2 over the nodes is the sum of c^2 and
what they leave out.

Legend: T frames or poses, S sections, n nodes of a section, N = S n nodes. [m]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learning.slender.touch import first_touch, groove
from physics.scene import Scene
from physics.schema import InputError

Floats = NDArray[np.floating[Any]]
FUNCTIONS = 6


@dataclass(frozen=True)
class Beam:
    """A beam and its obstacle, seen from a frame of its own.

    extent, cells: along the frame's axes
    side, up: the scene's axes that are the frame's y and z; signs: (3,) of the frame's axes along the scene's
    radius, round: the obstacle's; round is True for a sphere; turn: angle [rad] of a cylinder's axis from y towards x
    start, end: (3,) of the obstacle's centre in the frame
    """

    extent: tuple[float, float, float]
    cells: tuple[int, int, int]
    held_at_both: bool
    poisson_ratio: float
    neo_hookean: bool
    radius: float
    round: bool
    turn: float
    start: Floats
    end: Floats
    side: int
    up: int
    signs: tuple[int, int, int]

    @property
    def x(self) -> Floats:
        """(S,) abscissas."""
        return np.linspace(0.0, self.extent[0], self.cells[0] + 1)

    @property
    def diagonal(self) -> int:
        """0 or 1: which of the two chess boards the diagonals of the prisms make."""
        return ((self.signs[1] < 0) * self.cells[1] + (self.signs[2] < 0) * self.cells[2]) % 2

    def centre(self, fraction: Floats) -> Floats:
        """(T, 3) places of the obstacle's centre at fractions of its path."""
        return self.start + np.asarray(fraction)[:, None] * (self.end - self.start)

    @property
    def first_touch(self) -> float:
        """The fraction of the path at which the obstacle reaches the face at rest; 0 where it starts there, 1 where it never does."""
        return first_touch(*self.ends, self.radius, self.extent[2]).item()

    @property
    def ends(self) -> tuple[Tensor, Tensor]:
        """(3,) start and end, in double precision."""
        return torch.as_tensor(self.start), torch.as_tensor(self.end)

    @property
    def row(self) -> float:
        """[m] how far apart the points are, across the beam, at which contact is felt."""
        return self.extent[1] / self.cells[1] / 2

    @property
    def groove(self) -> tuple[float, float]:
        """Where the obstacle first touches, and the row of nodes nearest to that [m], from the middle of the section."""
        beside, nodes = groove(*self.ends, torch.tensor(self.first_touch, dtype=torch.float64), self.row, self.cells[1])
        return beside.item(), nodes.item()

    def mirrored(self) -> Beam:
        """The same beam seen from the frame with y turned round."""
        turned = np.array([1.0, -1.0, 1.0])
        signs = (self.signs[0], -self.signs[1], self.signs[2])
        return replace(self, signs=signs, turn=-self.turn, start=self.start * turned, end=self.end * turned)

    def functions(self) -> Floats:
        """(n, 6) the polynomials at the nodes of a section, numbered as in the scene."""
        y, z = (np.linspace(-1.0, 1.0, self.cells[axis] + 1) * sign for axis, sign in ((1, self.signs[1]), (2, self.signs[2])))
        y, z = (along / np.sqrt(np.mean(along**2)) for along in (y, z))
        if self.side == 1:
            y, z = y[:, None], z[None, :]
        else:
            y, z = y[None, :], z[:, None]
        square = [(along**2 - 1) / np.sqrt(np.mean((along**2 - 1) ** 2)) for along in (y, z)]
        parts = np.broadcast_arrays(np.ones(()), y, z, y * z, *square)
        return np.stack(parts, axis=-1).reshape(-1, FUNCTIONS)

    @property
    def spread(self) -> tuple[float, float]:
        """[m] root mean squares of y and of z over the nodes of a section: factors of the functions y and z."""
        widths = [self.extent[k] / 2 * np.sqrt(np.mean(np.linspace(-1, 1, self.cells[k] + 1) ** 2)) for k in (1, 2)]
        return float(widths[0]), float(widths[1])

    def project(self, displacement: Floats) -> Floats:
        """(T, S, 3, 6) coefficients of displacements (T, N, 3) of the scene's nodes, in the frame."""
        sections = displacement.reshape(len(displacement), self.cells[0] + 1, -1, 3)
        sections = sections[..., [0, self.side, self.up]] * np.array(self.signs, displacement.dtype)
        if self.signs[0] < 0:
            sections = sections[:, ::-1]
        functions = self.functions().astype(displacement.dtype)
        return np.einsum("tsnk,nm->tskm", sections, functions, optimize=True) / len(functions)

    def nodes(self, coefficients: Floats) -> Floats:
        """(T, N, 3) displacements of the scene's nodes from coefficients (T, S, 3, 6)."""
        if self.signs[0] < 0:
            coefficients = coefficients[:, ::-1]
        place = np.argsort([0, self.side, self.up])
        turned = (coefficients * np.array(self.signs, coefficients.dtype)[:, None])[:, :, place]
        functions = self.functions().astype(coefficients.dtype)
        return np.matmul(functions, turned.swapaxes(2, 3)).reshape(len(coefficients), -1, 3)


def see(scene: Scene) -> Beam:
    """The beam of a scene. Raises `InputError` in one line for a scene that is none, saying what it would have to be."""
    body, obstacle = scene.body, scene.obstacles[0] if scene.obstacles else None
    held = {support.where for support in scene.support}
    wrong = [
        (body.shape != "beam" or body.cell != "prism" or body.element != "standard",
         "the body is not a beam of first-order prisms"),
        (min(body.divisions[1:], default=0) < 2, "it has fewer than two cells across"), (not body.even, "its cells are not even"),
        (len(scene.obstacles) > 1, "it has several obstacles"), (len(scene.materials) > 1, "it has several materials"),
        (scene.steps.dynamic or bool(scene.load), "it has loads or inertia"),
        (not held or not held <= {"x-min", "x-max"} or any(set(s.fixed) != set("xyz") or any(s.displacement) for s in scene.support),
         "it is not clamped at x-min, at x-max or at both and nowhere else"),
        (obstacle is None or obstacle.shape not in ("sphere", "cylinder"), "its obstacle is neither a sphere nor a cylinder"),
        (obstacle is not None and obstacle.contact != "facets", "contact is not felt at facets"),
        (obstacle is not None and len(obstacle.path) != 2, "its obstacle's path is not one straight line"),
        (obstacle is not None and obstacle.shape == "cylinder" and abs(obstacle.axis[0]) > 0.5 * np.linalg.norm(obstacle.axis),
         "its cylinder lies along the beam"),
    ]
    for is_wrong, words in wrong:
        if is_wrong:
            raise InputError(f"a predictor of beams does not take this scene: {words}")
    assert obstacle is not None and obstacle.radius is not None
    (material,) = scene.materials
    path = np.array(obstacle.path)
    way = path[1] - path[0]
    up = 1 + int(abs(way[2]) >= abs(way[1]))
    side = 3 - up
    if abs(way[0]) > abs(way[up]):
        raise InputError("a predictor of beams does not take this scene: its obstacle moves along the beam rather than onto it")
    axis = np.array(obstacle.axis) if obstacle.shape == "cylinder" else np.eye(3)[side]
    if abs(axis[up]) > 1e-6 * np.linalg.norm(axis):
        raise InputError("a predictor of beams does not take this scene: its cylinder does not lie in the face that it presses on")
    extent, cells = np.array(body.extent), body.divisions
    from_far = held == {"x-max"} or (len(held) == 2 and path[:, 0].mean() > extent[0] / 2)
    signs = np.array([-1 if from_far else 1, 1, -1 if way[up] > 0 else 1])
    place = [0, side, up]
    origin = np.array([extent[0] if from_far else 0.0, extent[side] / 2, extent[up] / 2])
    start, end = ((point[place] - origin) * signs for point in path)
    turn = float(np.arctan(axis[0] * signs[0] / axis[side])) if obstacle.shape == "cylinder" else 0.0
    beam = Beam(extent=tuple(extent[place].tolist()), cells=(cells[0], cells[side], cells[up]), held_at_both=len(held) == 2,
                poisson_ratio=material.poisson_ratio, neo_hookean=material.law == "neo-hookean", radius=obstacle.radius,
                round=obstacle.shape == "sphere", turn=turn, start=start, end=end, side=side, up=up, signs=tuple(signs.tolist()))
    return beam.mirrored() if (turn < 0 or (beam.round and end[1] < 0)) else beam
