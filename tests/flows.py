"""Flows with known answers on small meshes, and the plain coupled scheme that the splitting must tend to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from physics.flow.conditions import Conditions
from physics.flow.space import FlowSpace
from physics.flow.stepping import Memory, Stepper
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.scene import Body, FlowScene, read_any

Field = Callable[[np.ndarray, float], np.ndarray]


def rectangle(n: int, low: tuple[float, float] = (0.0, 0.0), high: tuple[float, float] = (1.0, 1.0), seed: int | None = None) -> Mesh:
    """A rectangle of n x n squares cut in two, its inner nodes moved about unless the seed is None; sides named x-min to y-max."""
    mesh = build_mesh(Body(shape="plate", length=1.0, width=1.0, cells=(n, n), cell="triangle"))
    points = mesh.points.copy()
    if seed is not None:
        inside = (np.minimum(points[:, :2], 1 - points[:, :2]) > 1e-9).all(axis=1)
        points[inside, :2] += 0.25 / n * np.random.default_rng(seed).uniform(-1, 1, (int(inside.sum()), 2))
    points[:, :2] = np.array(low) + points[:, :2] * (np.array(high) - np.array(low))
    return replace(mesh, points=points)


def vortex(nu: float) -> tuple[Field, Field]:
    """Taylor and Green's, of wave number pi: velocity (n, 2) and pressure over density (n,) at points and a time."""
    k = np.pi

    def velocity(x: np.ndarray, t: float) -> np.ndarray:
        decay = np.exp(-2 * nu * k**2 * t)
        return decay * np.stack([-np.cos(k * x[:, 0]) * np.sin(k * x[:, 1]), np.sin(k * x[:, 0]) * np.cos(k * x[:, 1])], axis=1)

    def pressure(x: np.ndarray, t: float) -> np.ndarray:
        return -0.25 * (np.cos(2 * k * x[:, 0]) + np.cos(2 * k * x[:, 1])) * np.exp(-4 * nu * k**2 * t)

    return velocity, pressure


def given_all_around(space: FlowSpace, velocity: Field) -> Conditions:
    """The velocity of a known flow on the whole boundary."""
    fixed = space.velocity.on_edges(space.mesh, space.mesh.boundary[0])
    at = space.velocity.points[fixed]
    return Conditions(fixed, lambda t: velocity(at, t), np.empty((0, 2), np.int64))


def started(space: FlowSpace, conditions: Conditions, nu: float, velocity: Field, pressure: Field) -> Stepper:
    u, p = velocity(space.velocity.points, 0.0), pressure(space.pressure.points, 0.0)
    return Stepper(space, conditions, nu, Memory(0.0, u, p))


def norm(space: FlowSpace, u: np.ndarray) -> float:
    """Of L2, of a velocity (N, 2)."""
    return float(np.sqrt((u * (space.matrix(space.mass) @ u)).sum()))


def channel_flow(**changes: object) -> FlowScene:
    """A short channel with a cylinder at Reynolds number 20, on few cells."""
    table: dict[str, object] = {
        "body": {"shape": "channel", "length": 0.8, "cell_size": 0.05, "hole_cell_size": 0.02},
        "fluid": {"density": 1.0, "viscosity": 1e-3}, "inflow": [{"speed": 0.3, "ramp": 0.1}], "outflow": [{}],
        "steps": {"count": 4, "duration": 0.2}}
    return read_any(table | changes)


class Coupled:
    """Velocity and pressure in one matrix: backward differences of order two, convection of 2 u_n - u_n-1, first step backward Euler."""

    def __init__(self, space: FlowSpace, conditions: Conditions, nu: float, u: np.ndarray) -> None:
        self.space, self.conditions, self.nu, self.u, self.before, self.time = space, conditions, nu, u, None, 0.0
        self.p = np.zeros(len(space.pressure.points))
        mass, viscosity = (space.matrix(blocks) for blocks in (space.mass, space.viscosity))
        self.mass, self.viscosity = (scipy.sparse.kron(matrix, np.eye(2)).tocsr() for matrix in (mass, viscosity))
        blocks, shape = space.divergence_blocks(), (len(space.pressure.points), 2 * len(u))
        rows = np.broadcast_to(space.pressure.cells[:, :, None, None], blocks.shape)
        columns = np.broadcast_to(2 * space.velocity.cells[:, None, :, None] + np.arange(2), blocks.shape)
        self.divergence = scipy.sparse.csr_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape)
        self.free = np.ones(sum(shape), bool)
        self.free[np.concatenate([2 * conditions.fixed, 2 * conditions.fixed + 1])] = False
        if not len(conditions.open):
            self.free[shape[1]] = False
        self.factors: dict[float, object] = {}

    def step(self, size: float) -> None:
        self.time += size
        a0 = (1.0 if self.before is None else 1.5) / size
        wind = self.u if self.before is None else 2 * self.u - self.before
        history = self.u / size if self.before is None else (2 * self.u - 0.5 * self.before) / size
        matrix = scipy.sparse.bmat([[a0 * self.mass + self.nu * self.viscosity, -self.divergence.T], [-self.divergence, None]]).tocsc()
        x = np.zeros(len(self.free))
        n = self.u.size
        x[:n].reshape(-1, 2)[self.conditions.fixed] = self.conditions.values(self.time)
        right = np.concatenate([self.space.momentum(wind, history, np.zeros_like(self.p)).ravel(), np.zeros(len(self.p))]) - matrix @ x
        if a0 not in self.factors:
            self.factors[a0] = scipy.sparse.linalg.splu(matrix[self.free][:, self.free].tocsc())
        x[self.free] = self.factors[a0].solve(right[self.free])
        self.before, self.u, self.p = self.u, x[:n].reshape(-1, 2), x[n:]
