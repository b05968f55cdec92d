"""What every kind of network costs on the same mesh, and for each step of its message passing and each edge.

    .venv/bin/python -m benchmarks.rivals             hidden size 32, 1.5 k nodes, about two minutes
    .venv/bin/python -m benchmarks.rivals --paper     the published sizes, about eight minutes

Every kind in a process of its own, in float32, on the same frames of one beam with the same contact edges. Times are processor
seconds of one thread, the least of some runs, of one sample: forward and backward pass in a batch of two (training), forward pass
alone (prediction). Set-up is what a new mesh costs before its first frame, elastic modes not counted; a graph, what each frame
costs before the network sees it. Memory is what the training passes add to the process.

A message is an edge in one step: levels count with their own edges, blocks that run twice twice. Its time is that of the prediction
inside of the steps, which is the share beside it; the last column is that time over M4GN's.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import torch
from torch import Tensor

from benchmarks import footing
from benchmarks.network import CELLS, learn, predict
from learning.config import TrainConfig
from learning.graphs.graph import Graph, join
from learning.networks.blocks import MessagePassing, Network
from learning.networks.kinds import CONFIGS, build
from learning.networks.rivals import bsms, eagle, gcn
from learning.prediction.memory import keep_freed_memory
from learning.samples.samples import build_example, fit_normaliser, sample
from tests.synthetic import bending

BATCH = 2
STEPS = (MessagePassing, gcn.Convolution, bsms.MessageBlock, eagle.Step)
SMALL: dict[str, dict[str, Any]] = {
    "m4gn": dict(hidden=32, message_steps=4, heads=4), "mgn": dict(hidden=32, message_steps=4), "gcn": dict(hidden=32, layers=4),
    "g-u-net": dict(hidden=32, levels=3), "bsms": dict(hidden=32, levels=3), "eagle": dict(hidden=32, width=64),
    "transolver": dict(hidden=32, layers=4, slices=32)}


def config_of(kind: str, paper: bool) -> TrainConfig:
    """A training around one kind, with the contact edges of all."""
    network = CONFIGS[kind](**({} if paper else SMALL[kind]))
    return TrainConfig(network=replace(network, world_radius=0.0) if kind == "mgn" else network, contact_radius=0.004)


@dataclass
class Steps:
    """The message-passing steps of a network as they run: their messages and their processor seconds so far."""

    messages: int = 0
    seconds: float = 0.0
    _began: list[float] = field(default_factory=list)

    def watch(self, network: Network) -> None:
        for part in network.modules():
            if isinstance(part, STEPS):
                part.register_forward_pre_hook(self._before)
                part.register_forward_hook(self._after)

    def _before(self, part: torch.nn.Module, given: tuple[Any, ...]) -> None:
        self.messages += sum(pair.shape[1] for pair in pairs_in(given))
        self._began.append(time.process_time())

    def _after(self, part: torch.nn.Module, given: tuple[Any, ...], found: Any) -> None:
        self.seconds += time.process_time() - self._began.pop()


def pairs_in(given: tuple[Any, ...]) -> Iterator[Tensor]:
    """The senders and receivers (2, E) that a step is called with."""
    for each in given:
        for value in vars(each).values() if isinstance(each, bsms.Edges) else (each,):
            if isinstance(value, Tensor) and value.dtype == torch.int64:
                yield value


def one(kind: str, paper: bool, cells: str, laps: int) -> dict[str, Any]:
    """The row of one kind."""
    keep_freed_memory()
    config, trajectory = config_of(kind, paper), bending(cells=CELLS[cells])
    set_up, case = footing.cost(build_example, trajectory, config)
    normaliser, generator = fit_normaliser([case], config), torch.Generator().manual_seed(0)
    graph_seconds = footing.median(lambda: sample(case, 8, config, generator), laps)
    samples = [sample(case, frame, config, generator) for frame in range(10 - BATCH, 10)]
    alone = normaliser.graph(samples[0][0])
    batch: Graph = normaliser.graph(join([graph for graph, _ in samples]))
    target = torch.cat([target for _, target in samples]) / normaliser.velocity
    torch.manual_seed(0)
    network = build(config.network)
    free = torch.from_numpy(case.skeleton.free).repeat(BATCH)
    before = footing.peak_memory()
    training = footing.least(partial(learn, partial(network, batch), network, free, target), laps) / BATCH
    memory = footing.peak_memory() - before
    prediction = footing.least(partial(predict, partial(network, alone)), laps)
    steps = Steps()
    steps.watch(network)
    whole = sum(footing.cost(predict, partial(network, alone))[0] for _ in range(laps))
    return {"network": network.title, "weights": sum(weight.numel() for weight in network.parameters()), "set-up [ms]": 1e3 * set_up,
            "graph [ms]": 1e3 * graph_seconds, "prediction [ms]": 1e3 * prediction, "training [ms]": 1e3 * training,
            "memory [MB]": round(memory),
            "messages": steps.messages // laps, "in steps": f"{steps.seconds / whole:.0%}",
            "a message [ns]": 1e9 * steps.seconds / steps.messages if steps.messages else None}


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("--paper", action="store_true", help="the published sizes")
    parser.add_argument("--cells", choices=CELLS, default="1.5 k", help="nodes of the beam (1.5 k)")
    parser.add_argument("--laps", type=int, default=5)
    parser.add_argument("--only", nargs="+", choices=CONFIGS, default=list(CONFIGS))
    asked = parser.parse_args()
    table, ours = footing.Table(), None
    for kind in asked.only:
        row = footing.child(one, kind, asked.paper, asked.cells, asked.laps)
        ours = ours or row["a message [ns]"]
        row["of M4GN's"] = row["a message [ns]"] / ours if ours and row["a message [ns]"] else None
        table.add(row)


if __name__ == "__main__":
    main()
