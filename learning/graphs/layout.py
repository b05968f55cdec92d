"""What of a set's trajectories a network sees and predicts: in how many coordinates, which state, and which fields beside it.

    state     the network tells its change from frame to frame:
              displacement   of a body [m]: its nodes move, and so do edges and contact
              velocity       of a fluid [m/s] at nodes that stay where they are
    fields    told straight, as they are in the frame to come: stress of a body, pressure of a fluid

A body in a plane, its third coordinate the same everywhere and always, is seen and predicted in two. The state is predicted on free
nodes, those that nothing prescribes; the fields on all nodes but the obstacle's, for where a body is held its stress is the largest.
Several frames to come may be told at once: first the states of all of them, then the fields of all of them.

Legend: T frames, N nodes, D space dimensions, F numbers of all fields together, b frames told at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.files.trajectory import AIRFOIL, HANDLE, INFLOW, NORMAL, OBSTACLE, OUTFLOW, WALL, Trajectory
from datagen.flow.figures import resting
from learning.graphs.material import FEATURES, material_of
from learning.graphs.wants import Widths
from learning.segments.edges import mesh_edges
from physics.schema import InputError, quantity

BODY = (NORMAL, OBSTACLE, HANDLE)
LENGTHS = ("m", "cell", "body")
FLUID = (NORMAL, OUTFLOW, INFLOW, WALL, AIRFOIL)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """What of a trajectory is seen and predicted; by default a solid body's displacement.

    space: D
    state: displacement or velocity
    fields, sizes: the further fields and how many numbers each has at a node
    material: whether nodes are told the material (material.py)
    bundle: b
    lengths: what lengths are counted in, one of LENGTHS
    """

    space: int = 3
    state: str = "displacement"
    fields: tuple[str, ...] = ()
    sizes: tuple[int, ...] = ()
    material: bool = False
    bundle: int = 1
    lengths: str = quantity("m", choice=LENGTHS)

    @property
    def flow(self) -> bool:
        """Whether nodes stay where they are."""
        return self.state == "velocity"

    @property
    def kinds(self) -> tuple[int, ...]:
        """The kinds of nodes that are told apart."""
        return FLUID if self.flow else BODY

    @property
    def widths(self) -> Widths:
        """How wide graphs and predictions of it are."""
        d, kinds = self.space, len(self.kinds)
        node, mesh_edge = (kinds + d, d + 1) if self.flow else (kinds + (2 + self.bundle) * d, 2 * d + 2)
        return Widths(node=node + FEATURES * self.material, mesh_edge=mesh_edge, contact_edge=d + 1, space=d, further=sum(self.sizes),
                      frames=self.bundle)

    def free(self, trajectory: Trajectory) -> NDArray[np.bool_]:
        """(N,) True on the nodes whose state is predicted."""
        return np.isin(trajectory.node_kind, (NORMAL, OUTFLOW)) if self.flow else trajectory.free

    def asked(self, trajectory: Trajectory) -> NDArray[np.bool_]:
        """(N, b (D + F)) True on the numbers that are predicted."""
        numbers = [self.bundle * self.space, self.bundle * sum(self.sizes)]
        return np.repeat(np.stack([self.free(trajectory), trajectory.body], axis=1), numbers, axis=1)

    def first(self, trajectory: Trajectory) -> int:
        """The frame that a rollout starts from: of a flow that begins at rest the first one in which it moves."""
        return resting(trajectory) if self.flow else 0

    def unit(self, trajectory: Trajectory) -> float:
        """What its lengths are counted in [m]: the median length of the body's edges at rest, or the body's largest extent."""
        if self.lengths == "m":
            return 1.0
        points, body = trajectory.points, trajectory.body
        if self.lengths == "body":
            return float(np.ptp(points[body], axis=0).max())
        ends = mesh_edges(trajectory).T  # (2, E)
        a, b = points[ends[:, body[ends].all(axis=0)]]
        return float(np.median(np.linalg.norm(a - b, axis=1)))

    def states(self, trajectory: Trajectory) -> NDArray[np.float32]:
        """(T, N, D) the state in all frames."""
        return (trajectory.fields["velocity"] if self.flow else trajectory.displacement)[..., :self.space]

    def beside(self, trajectory: Trajectory, frame: int) -> NDArray[np.float32]:
        """(N, b F) the further fields in a frame and those after it."""
        empty = np.empty((len(trajectory.points), 0), np.float32)
        frames = range(frame, frame + self.bundle)
        return np.concatenate([empty, *(trajectory.fields[name][each] for each in frames for name in self.fields)], axis=1)

    def frames_of(self, told: NDArray[Any]) -> NDArray[Any]:
        """(b, N, D + F) what is told of each frame, from the numbers (N, b (D + F)) of a network."""
        state, beside = np.split(told, [self.bundle * self.space], axis=1)
        parts = [part.reshape(len(told), self.bundle, -1) for part in (state, beside)]
        return np.concatenate(parts, axis=2).swapaxes(0, 1)

    def split(self, told: NDArray[Any]) -> tuple[NDArray[np.float32], dict[str, NDArray[np.float32]]]:
        """Numbers (T, N, D + F) as the state in three coordinates (T, N, 3), the third one 0 in a plane, and the further fields."""
        state = np.zeros((*told.shape[:-1], 3), np.float32)
        state[..., :self.space] = told[..., :self.space]
        ends = self.space + np.cumsum((0, *self.sizes))
        return state, {name: told[..., a:b].astype(np.float32) for name, a, b in zip(self.fields, ends, ends[1:], strict=False)}

    def check(self, trajectory: Trajectory) -> None:
        """Raise `InputError` for a trajectory that cannot be seen so."""
        if self.flow and not trajectory.flows:
            raise InputError("it is no flow: it has no velocity, or its mesh moves; the network has learned flows")
        if trajectory.flows and not self.flow:
            raise InputError("a flow, where the network has learned how solids move")
        if self.space == 2 and not in_plane(trajectory):
            raise InputError("a body in space, where the network has learned from bodies in a plane alone")
        self.told(trajectory)

    def told(self, trajectory: Trajectory) -> NDArray[np.float32] | None:
        """(7,) what every node is told of the material; None without. Raises `InputError` where the file does not tell it."""
        return material_of(trajectory) if self.material else None


SOLID_BODY = Layout()


def layout_of(trajectories: Sequence[Trajectory], fields: Sequence[str] = (), *, material: bool = False, lengths: str = "m",
              bundle: int = 1) -> Layout:
    """What is seen and predicted of a set: the velocity where no node ever moves and all have one, else the displacement.

    Args:
        fields: the further ones that are asked for
        material: whether nodes are to be told the material
        lengths: what lengths are to be counted in
        bundle: frames told at once

    Raises:
        InputError: not all trajectories have these fields; a flow has no material, and its lengths are in metres
    """
    flow = not any(map(moves, trajectories)) and all(map(_changes, trajectories))
    sizes = []
    for name in fields:
        found = {each.fields[name].shape[2] if name in each.fields else 0 for each in trajectories}
        if 0 in found or len(found) > 1:
            known = ", ".join(trajectories[0].fields) or "none"
            raise InputError(f"outputs.fields: not every trajectory holds {name!r} with as many numbers at a node; the first one's "
                             f"fields: {known}")
        if flow and name == "velocity":
            raise InputError("outputs.fields: the velocity of a flow is predicted anyway")
        sizes.append(found.pop())
    if flow and (material or lengths != "m"):
        raise InputError(f"inputs.{'material = true' if material else f'lengths = {lengths}'}: is of bodies, and a fluid flows here")
    space = 2 if all(map(in_plane, trajectories)) else 3
    return Layout(space=space, state="velocity" if flow else "displacement", fields=tuple(fields), sizes=tuple(sizes),
                  material=material, lengths=lengths, bundle=bundle)


def moves(trajectory: Trajectory) -> bool:
    """Whether a node that is free ever does."""
    return bool(trajectory.displacement[:, trajectory.free].any())


def in_plane(trajectory: Trajectory) -> bool:
    """Whether a body is plane and stays so: its third coordinate is the same at all nodes in all frames."""
    return (trajectory.mesh.dimension == 2 and not np.ptp(trajectory.points[:, 2]) and not trajectory.displacement[..., 2].any()
            and not trajectory.fields.get("velocity", np.zeros((1, 1, 2)))[..., 2:].any())


def _changes(trajectory: Trajectory) -> bool:
    velocity = trajectory.fields.get("velocity")
    return velocity is not None and velocity.shape[2] >= 2 and bool((velocity != velocity[0]).any())
