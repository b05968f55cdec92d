"""What training and prediction cost a network: ours against the same one written plainly, and against the machine.

    .venv/bin/python -m benchmarks.network             the paper's sizes on a mesh of the paper's, about four minutes
    .venv/bin/python -m benchmarks.network --growth    1.5 k, 4.5 k and 15 k nodes: time and memory of a sample

"Plain" is the network as its equations read: the inputs of every edge side by side in one product, in float32
(tests/plain_m4gn.py: the same weights and the same result, which is measured here too). Times are the least of runs made
in turn, of one training sample (forward and backward) and of one prediction. The peak is that of the product of two 2048 x 2048
matrices in the same precision and the same run; operations are counted by torch.
"""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.profiler import ProfilerActivity, profile
from torch.utils.flop_counter import FlopCounterMode

from benchmarks import footing
from learning.config import TrainConfig
from learning.graphs.graph import Graph, join
from learning.networks.blocks import PRECISIONS, products
from learning.networks.m4gn import M4GN, M4GNConfig
from learning.prediction.memory import keep_freed_memory
from learning.samples.samples import build_example, fit_normaliser, sample
from tests import plain_m4gn
from tests.synthetic import bending

CELLS = {"1.5 k": (40, 5, 5), "4.5 k": (60, 8, 7), "15 k": (100, 11, 11)}
PARTS = {
    "products": ("aten::addmm", "aten::mm", "aten::linear", "aten::mkldnn_linear", "aten::bmm", "mkldnn::_linear_pointwise"),
    "layer norm": ("aten::native_layer_norm", "aten::native_layer_norm_backward"),
    "gathers and sums over edges": ("aten::index_select", "aten::index_add_", "aten::index_add", "aten::index"),
}
Run = Callable[[], Tensor]


def batch_of(cells: tuple[int, int, int], size: int) -> tuple[Graph, Tensor, Tensor]:
    """A normalised batch of some frames of one beam, which of its nodes are free, and its target (N, 3)."""
    config = TrainConfig(contact_radius=0.004)
    case = build_example(bending(cells=cells), config)
    normaliser = fit_normaliser([case], config)
    generator = torch.Generator().manual_seed(0)
    samples = [sample(case, frame, config, generator) for frame in range(10 - size, 10)]
    target = torch.cat([target for _, target in samples]) / normaliser.velocity
    return normaliser.graph(join([graph for graph, _ in samples])), torch.from_numpy(np.tile(case.skeleton.free, size)), target


def network_in(precision: str) -> M4GN:
    """The same weights in every precision."""
    torch.manual_seed(0)
    return M4GN(M4GNConfig(precision=precision))


def ways(graph: Graph) -> dict[str, tuple[M4GN, Run]]:
    """Each way to run the network: the network, and its forward pass."""
    found: dict[str, tuple[M4GN, Run]] = {}
    for precision in PRECISIONS:
        network = network_in(precision)
        found[precision] = network, partial(network, graph)
    network = network_in("float32")
    return {"plain": (network, partial(plain_m4gn.forward, network, graph)), **found}


def predict(forward: Run) -> Tensor:
    with torch.inference_mode():
        return forward()


def learn(forward: Run, network: M4GN, free: Tensor, target: Tensor) -> Tensor:
    """One forward and one backward pass; returns all gradients in a row."""
    network.zero_grad()
    (forward() - target)[free].square().mean().backward()
    return torch.cat([weight.grad.flatten() for weight in network.parameters() if weight.grad is not None])


def peak(precision: str) -> float:
    """Operations a second in the product of two large matrices."""
    a = torch.randn(2048, 2048, dtype=torch.bfloat16 if precision == "bfloat16" else torch.float32)
    return 2 * 2048**3 / footing.least(lambda: a @ a, 3)


def versus(repeats: int, size: int) -> dict[str, Any]:
    """Times, errors and shares of the peak of every way, at the paper's sizes."""
    graph, free, target = batch_of(CELLS["1.5 k"], size)
    found = ways(graph)
    times: dict[str, dict[str, list[float]]] = {way: {"predict": [], "learn": []} for way in found}
    peaks: dict[str, float] = {}
    for _ in range(repeats):
        for way, (network, forward) in found.items():
            with products(network_config(way)):
                peaks[way] = max(peaks.get(way, 0.0), peak(way))
                times[way]["predict"].append(footing.cost(predict, forward)[0])
                times[way]["learn"].append(footing.cost(learn, forward, network, free, target)[0])
    rows: dict[str, dict[str, Any]] = {}
    exact: list[Tensor] = []
    for way, (network, forward) in found.items():
        runs = {"predict": partial(predict, forward), "learn": partial(learn, forward, network, free, target)}
        row: dict[str, Any] = {"peak_gflops": peaks[way] / 1e9}
        with products(network_config(way)):
            results = [run() for run in runs.values()]
            exact = exact or results  # of the first way, the plain one
            for (kind, run), result, right in zip(runs.items(), results, exact, strict=True):
                seconds = min(times[way][kind])
                row |= {f"{kind}_ms": 1e3 * seconds / size, f"{kind}_ratio": min(times["plain"][kind]) / seconds,
                        f"{kind}_error": relative(result, right), f"{kind}_share": counted(run) / seconds / peaks[way]}
            rows[way] = {**row, "where": where(runs["learn"])}
    return {"nodes": len(graph.node) // size, "edges": len(graph.mesh_edge) // size, "contact_edges": len(graph.contact_edge) // size,
            "batch": size, "torch": torch.__version__, "rows": rows}


def network_config(way: str) -> M4GNConfig:
    return M4GNConfig(precision="float32" if way == "plain" else way)


def counted(run: Callable[[], Any]) -> float:
    """Operations in products of matrices."""
    with FlopCounterMode(display=False) as counter:
        run()
    return float(counter.get_total_flops())


def relative(found: Tensor, exact: Tensor) -> float:
    return float((found - exact).norm() / exact.norm())


def where(run: Run) -> dict[str, float]:
    """Shares of the time of a training step."""
    with profile(activities=[ProfilerActivity.CPU]) as profiler:
        run()
    events = profiler.key_averages()
    total = sum(event.self_cpu_time_total for event in events)
    shares = {part: sum(e.self_cpu_time_total for e in events if e.key in names) / total for part, names in PARTS.items()}
    return {**shares, "the rest": 1 - sum(shares.values())}


def one(name: str) -> dict[str, Any]:
    """One size of the mesh, in "medium" precision."""
    keep_freed_memory()
    graph, free, target = batch_of(CELLS[name], 1)
    network = network_in("medium")
    with products(network_config("medium")):
        before = footing.peak_memory()
        second = footing.least(partial(learn, partial(network, graph), network, free, target), 3)
        memory = footing.peak_memory() - before
        first = footing.least(partial(predict, partial(network, graph)), 3)
    return {"nodes": len(graph.node), "mesh edges": len(graph.mesh_edge), "training [ms]": 1e3 * second, "prediction [ms]": 1e3 * first,
            "memory of a training sample [MB]": round(memory)}


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("--growth", action="store_true")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--batch", type=int, default=2)
    parser.add_argument("--json", type=Path, help="a file for all numbers")
    asked = parser.parse_args()
    table = footing.Table()
    if asked.growth:
        for name in CELLS:
            table.add(footing.child(one, name))
        table.fit("training [ms]", "prediction [ms]")
        return
    keep_freed_memory()
    found = versus(asked.repeats, asked.batch)
    footing.say(", ".join(f"{name} {value}" for name, value in found.items() if name != "rows"))
    for way, row in found["rows"].items():
        table.add({"": way, "prediction [ms]": f"{row['predict_ms']:.0f}", "prediction, against plain": f"{row['predict_ratio']:.1f}",
                   "training [ms a sample]": f"{row['learn_ms']:.0f}", "training, against plain": f"{row['learn_ratio']:.1f}",
                   "difference of result, of gradient": f"{row['predict_error']:.0e}, {row['learn_error']:.0e}",
                   "share of peak, prediction, training":
                       f"{row['predict_share']:.0%}, {row['learn_share']:.0%} of {row['peak_gflops']:.0f} GFLOP/s"})
        footing.say(f"{way}: " + ", ".join(f"{part} {share:.0%}" for part, share in row["where"].items()))
    if asked.json:
        asked.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
