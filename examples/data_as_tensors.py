"""Data as torch tensors in three lines, and a law that they obey: the work of the obstacle is the energy of the body.

What a network needs of a trajectory: places at rest and which nodes are free, edges, the obstacle's pose in each frame,
and the target, the displacement of the body. The 24 small beams come with the program, packed. Sets of your own come
from `generate` (docs/data.md), as files of the same kind.
"""

from pathlib import Path

import torch

from datagen import inputs_of, read_manifest, read_trajectory, unpack

unpack(Path(__file__).parents[1] / "assets" / "beam-small.pack", "small")
trajectories = [read_trajectory(Path("small", entry.file)) for entry in read_manifest("small").trajectories]

ratios = []
for trajectory in trajectories:
    inputs = inputs_of(trajectory)
    points, free, edges, pose = map(torch.from_numpy, (inputs.points, inputs.free, inputs.edges, inputs.pose))  # (N, 3) (N,) (E, 2) (T, 3)
    target = torch.from_numpy(trajectory.displacement[:, trajectory.body])  # (T, N, 3) [m]

    force = torch.from_numpy(trajectory.per_frame["reaction"])  # (T, 3) [N] on the obstacle
    work = -((force[1:] + force[:-1]) / 2 * pose.diff(dim=0)).sum().item()  # [J]
    ratios.append(work / trajectory.per_frame["energy"][-1])
    assert target.shape == (len(pose), len(points), 3) and edges.max() < len(points) and target[:, ~free].abs().max() < 1e-9

print(f"{len(trajectories)} trajectories, the last of {target.shape[1]} nodes, {len(edges)} edges and {len(target)} frames")
print(f"work of the obstacle over stored energy: from {min(ratios):.4f} to {max(ratios):.4f}")
assert len(ratios) == 24 and all(abs(ratio - 1) < 0.01 for ratio in ratios)
