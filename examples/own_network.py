"""A network of your own on graphs: trained from a torch data set of frames, rolled out, and held against the truth.

`Frames` gives what every network here is trained on, a frame's graph and its target; the way to predict, noise and contact
edges come from the config. This network is as plain as can be: a node hears the mean of the obstacle's nodes and of its own
neighbours. `learning.to_pyg` turns a frame into torch_geometric's Data, where that is installed.
"""

from pathlib import Path

import torch
from torch import nn
from torch.utils.data import DataLoader

from datagen import read_trajectory, unpack
from learning import Frames, Model, TrainConfig, collate, rollout
from physics import verify

unpack(Path(__file__).parents[1] / "assets" / "beam-small.pack", "small")
config = TrainConfig(scheme="pose", frames=12, contact_radius=0.006)
frames = Frames(sorted(Path("small/train").glob("*.vtkhdf")), config)


class Plain(nn.Module):
    def __init__(self):
        super().__init__()
        self.see = nn.Sequential(nn.Linear(12, 64), nn.SiLU(), nn.Linear(64, 64))
        self.say = nn.Sequential(nn.Linear(192, 128), nn.SiLU(), nn.Linear(128, 128), nn.SiLU(), nn.Linear(128, 3))

    def forward(self, graph):
        h, obstacle = self.see(graph.node), graph.node[:, 1] > 0
        near = torch.zeros_like(h).index_add(0, graph.mesh_pair[1], h[graph.mesh_pair[0]]) / graph.mesh_pair[1].bincount()[:, None]
        told = torch.stack([h[obstacle & (graph.owner == b)].mean(dim=0) for b in range(graph.count)])
        return self.say(torch.cat([h, near, told[graph.owner]], dim=1))


torch.manual_seed(0)
network = Plain()
optimizer = torch.optim.Adam(network.parameters(), lr=2e-3)
for _ in range(6):
    for graph, target, asked in DataLoader(frames, batch_size=8, shuffle=True, collate_fn=collate):
        optimizer.zero_grad()
        (network(graph) - target)[asked].square().mean().backward()
        optimizer.step()

errors = []
for path in sorted(Path("small/test").glob("*.vtkhdf")):
    truth = read_trajectory(path)
    predicted, body = rollout(Model(config, network, frames.normaliser, "plain"), truth).displacement, truth.body
    of_both = (verify(u[:, body], truth.displacement[:, body], scene=None, mesh=truth.mesh, free=truth.free[body])
               for u in (predicted, 0 * predicted))
    errors.append([figures.rmse_all for figures in of_both])
mine, idle = torch.tensor(errors).mean(dim=0).tolist()
print(f"{len(frames)} frames; RMSE {1e3 * mine:.3f} mm over {len(errors)} test beams, {1e3 * idle:.3f} mm if nothing moved")
assert mine < 0.5 * idle
