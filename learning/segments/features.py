"""What the distance between a node and a segment compares: obstacle, modes and place, counted in segment sizes.

Raw numbers do not compare: 19 segments of a 100 mm beam are some 13 mm wide, so tau |x| in metres is near 0.01, while
exp(-d) of a distance in metres is 0.9 to 1 on the whole beam and a mode's amplitude is arbitrary. So everything is counted
in segment sizes S = l (N / K)^(1/D), with l the mean edge length [m] and D = 3, or 2 for a plane mesh: the edge of a cube
that holds as much as a segment.

    x        rest position / S
    f_obs    of the distance d [m] at step 0 to the nearest obstacle node: d / S (od), log(d / S) (od-l), exp(-d / S) (od-e),
             with d at least l / 10 in the logarithm; in a mesh without obstacle nodes d leads to the nearest wall, and with
             neither f_obs is 0
    f_md     modes / (S g), g the mean over mesh edges of |mode_i - mode_j| / |x_i - x_j| : on the average they change by 1
             over one segment size, so segments are short where they are steep and long where they are flat

Solids take elastic modes, which a trajectory brings along; fluids take Laplacian modes, which it brings along or which are
computed (harmonics.py). A mode's sign is arbitrary, and so is the choice inside a multiple eigenvalue (the two bending planes
of a square beam). So of the wanted modes and all within 2 % of the last one's frequency only the space counts: they are made
orthonormal, and with Q an orthonormal basis of a space, |Q_i - Q_j| is the same for all of them.

Legend: N nodes of the body, E edges (each in both directions), K segments, F features, m modes, D space dimensions.
Source: Lei et al., M4GN, appendix "Hybrid Mesh Segmentation Details".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from datagen.files.trajectory import AIRFOIL, WALL, Trajectory
from learning.segments.harmonics import harmonics
from physics.schema import InputError

METHODS = ("metis", "slic-od", "slic-od-l", "slic-od-e", "slic-md", "slic-mdod-l", "slic-mdod-e")
MODES = ("elastic", "laplacian")
CLUSTER = 1.02  # frequencies this close belong together
Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Features:
    """What the superpixel distance compares.

    table: (N, F) obstacle (1), modes (F - 4), position (3) side by side, in segment sizes
    tau: weight of position against the others
    """

    table: Floats
    tau: float

    def distance(self, node: Integers, other: Floats) -> Floats:
        """d = |f_obs - f_obs'| + |f_md - f_md'| + tau |x - x'| between listed nodes (M,) and rows (M, F)."""
        difference = self.table[node] - other
        mode, position = difference[:, 1:-3], difference[:, -3:]
        return (np.abs(difference[:, 0]) + np.sqrt(np.einsum("ij,ij->i", mode, mode))
                + self.tau * np.sqrt(np.einsum("ij,ij->i", position, position)))


def features(trajectory: Trajectory, edges: Integers, *, count: int, method: str, tau: float, modes: str = "elastic",
             mode_count: int = 1) -> Features:
    """Features of the body's nodes; position alone for METIS, where only its stray pieces need a distance.

    Args:
        edges: (2, E) of the body
        modes: elastic or laplacian
        mode_count: m, how many; those within 2 % of the last one's frequency come on top

    Raises:
        InputError: no modes or no obstacle where the method needs them
    """
    points = trajectory.points[trajectory.body]
    span = np.linalg.norm(points[edges[0]] - points[edges[1]], axis=1)  # (E,)
    size = span.mean() * (len(points) / count) ** (1 / trajectory.mesh.dimension)
    columns = [np.zeros((len(points), 1))]
    if "od" in method:
        columns = [_of_obstacle(trajectory, points, size, 0.1 * span.mean(), method)]
    if "md" in method:
        mode = _basis(_elastic(trajectory, method, mode_count) if modes == "elastic" else _laplacian(trajectory, mode_count))
        steepness = (np.linalg.norm(mode[edges[0]] - mode[edges[1]], axis=1) / span).mean()
        columns.append(mode / (size * steepness) if steepness > 0 else mode)
    return Features(np.concatenate([*columns, points / size], axis=1), tau)


def _of_obstacle(trajectory: Trajectory, points: Floats, size: float, least: float, method: str) -> Floats:
    """(N, 1) f_obs."""
    if not trajectory.body.all():
        rigid = ~trajectory.body
        target = trajectory.points[rigid] + trajectory.displacement[0, rigid]
    else:
        target = trajectory.points[np.isin(trajectory.node_kind, (AIRFOIL, WALL))]
    if not len(target):
        if "md" not in method:
            raise InputError(f"the trajectory has neither obstacle nor walls, from which method {method!r} measures; "
                             f"'slic-md' and 'metis' do without")
        return np.zeros((len(points), 1))
    distance = cKDTree(target).query(points)[0][:, None] / size
    if method.endswith("-l"):
        return np.log(np.maximum(distance, least / size))
    return np.exp(-distance) if method.endswith("-e") else distance


def _elastic(trajectory: Trajectory, method: str, count: int) -> Floats:
    """(m, N, 3) the first modes of a trajectory, and those that belong to the last of them."""
    if len(trajectory.modes) < count:
        kept = "no modes" if not len(trajectory.modes) else f"{len(trajectory.modes)} of the {count} modes"
        raise InputError(f"the trajectory carries {kept}, which method {method!r} needs; modes = \"laplacian\" are computed, and "
                         f"method 'metis' does without")
    frequency = np.array(trajectory.frequencies_hz or range(1, 1 + len(trajectory.modes)), np.float64)
    order = np.argsort(frequency, kind="stable")
    wanted = order[frequency[order] <= CLUSTER * frequency[order[count - 1]]]
    return trajectory.modes[wanted][:, trajectory.body].astype(np.float64)


def _laplacian(trajectory: Trajectory, count: int) -> Floats:
    """(m, N, 1) the first Laplacian modes that are not constant, from the file or computed, and those that belong to the last."""
    if "laplacian_eigenvalues" in trajectory.extra:
        shapes = trajectory.modes[:, trajectory.body, 2:].astype(np.float64)  # (m, N, 1)
        moving = np.ptp(shapes, axis=(1, 2)) > 1e-6
        shapes, eigenvalues = shapes[moving], np.array(trajectory.extra["laplacian_eigenvalues"])[moving]
        if len(shapes) >= count:
            return shapes[eigenvalues <= CLUSTER**2 * eigenvalues[count - 1]]
    return harmonics(trajectory, count=count, cluster=CLUSTER**2)[1][:, :, None]


def _basis(modes: Floats) -> Floats:
    """(N, 3m) an orthonormal basis of the space of modes (m, N, 3), each of unit mean square over the nodes."""
    nodes = modes.shape[1]
    basis, weight, _ = np.linalg.svd(modes.reshape(len(modes), -1).T, full_matrices=False)  # (3N, m), (m,)
    return basis[:, weight > 1e-6 * weight.max()].reshape(nodes, -1) * np.sqrt(nodes)
