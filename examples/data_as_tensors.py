"""Data as torch tensors in three lines, and a law that they obey: the work of the obstacle is the energy of the body.

The 24 small beams come with the program, packed. Sets of your own come from `generate` (docs/data.md), as files of the
same kind.
"""

from pathlib import Path

import torch

from datagen import read_manifest, read_trajectory, unpack

unpack(Path(__file__).parents[1] / "assets" / "beam-small.pack", "small")
trajectories = [read_trajectory(Path("small", entry.file)) for entry in read_manifest("small").trajectories]
moved = [torch.from_numpy(trajectory.displacement) for trajectory in trajectories]  # (T, N, 3) [m] each, obstacle nodes last

ratios = []
for trajectory, displacement in zip(trajectories, moved, strict=True):
    obstacle = displacement[:, torch.from_numpy(~trajectory.body)][:, 0].double()  # (T, 3) it is rigid: any of its nodes will do
    force = torch.from_numpy(trajectory.per_frame["reaction"])  # (T, 3) [N] on the obstacle
    work = -((force[1:] + force[:-1]) / 2 * obstacle.diff(dim=0)).sum().item()  # [J]
    ratios.append(work / trajectory.per_frame["energy"][-1])

print(f"{len(moved)} trajectories, the first of shape {tuple(moved[0].shape)}")
print(f"work of the obstacle over stored energy: from {min(ratios):.4f} to {max(ratios):.4f}")
assert len(moved) == 24 and all(abs(ratio - 1) < 0.01 for ratio in ratios)
