"""What a GPU is good for here, in one run of some minutes from a checkout and one packed data set, without a network.

    .venv/bin/python -m benchmarks.gpu OUT --data beam.pack --minutes 9
    .venv/bin/python -m benchmarks.gpu OUT --minutes 1 --device cpu --size small

OUT must be new. In turn, each to its share of the time (SHARES), and whatever did not fit is said:

    data       as many beams as time allows are taken out of the pack
    kinds      every kind of network on frames of one training beam: the same checkpoint on the processor and on the device, then times;
               M4GN in every precision (on CUDA "medium" is TF32)
    training   M4GN for the time that is left, with checkpoints and rollouts of validation beams, then once more the same prediction

The predictions of both places shall differ by less than 1e-4 of the step: largest difference over the root mean square of what is
predicted, over free nodes and components, in float32. Else the exit status is 1.

Times are by the clock on the wall, medians of laps after one that does not count, read when the device has done all that it was
given. A training step (forward, backward, Adam) has its batch in memory, from which it is copied; a prediction its graphs on the device;
what a graph costs before that, on one core, stands beside. Where a GPU replays a network (devices.Replays), the same step without that
stands beside, kernel by kernel. Memory is the largest that torch held on a GPU during training
steps, weights included. OUT/gpu.json is written after every part, OUT/gpu.md is its table, OUT/run the trained network.
"""

from __future__ import annotations

import json
import sys
import time
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks import footing
from benchmarks.rivals import SMALL
from datagen.files.trajectory import write_trajectory
from datagen.sets.pack import decode
from learning.config import TrainConfig
from learning.devices import Replays, device_of
from learning.graphs.alike import alike
from learning.graphs.graph import Graph, join
from learning.networks.blocks import PRECISIONS, products, told_by_sizes
from learning.networks.kinds import CONFIGS
from learning.prediction.checkpoint import Model, load_model
from learning.prediction.rollout import rollout_error
from learning.processes import Processes
from learning.samples.batches import batch_of
from learning.samples.samples import Example, build_example, load_examples, sample
from learning.training.run import set_up
from learning.training.train import descend, take_step, train
from physics.keys import table
from physics.schema import InputError
from physics.whole import write_whole

SHARES = {"data": 0.2, "kinds": 0.5, "training": 0.97}  # of the time, at which each part is over
ALIKE = 1e-4
TRAINING_BATCH, BATCHES, FRAMES, LAPS = 8, (1, 8, 64), 64, 9
VALIDATED, CHECKPOINTS, LEAST = 4, 5, 5.0  # beams; how often in a training; seconds below which none is begun
BEAM = {"segments": 19, "overlap": 1, "contact_radius": 0.004}  # as published, but for a radius that both sets' obstacles reach
Timed = float | str | None


class Clock:
    """The time that a run may take, and when each part is over."""

    def __init__(self, minutes: float) -> None:
        self.start, self.seconds = time.perf_counter(), 60 * minutes

    def left(self, part: str) -> float:
        """Seconds until a part is over."""
        return self.start + SHARES[part] * self.seconds - time.perf_counter()


def taken_out(pack: Path, out: Path, clock: Clock) -> dict[str, list[Path]]:
    """The trajectory files of a packed set by split, those of training while time allows; cutting a beam into segments is counted.

    Raises `InputError` for a file that is none, or holds nothing to learn from.
    """
    found: dict[str, list[Path]] = {"valid": [], "train": []}
    try:
        with zipfile.ZipFile(pack) as archive:
            names = {split: sorted(name for name in archive.namelist() if name.startswith(f"{split}/")) for split in found}
            longest = 0.0
            first, *rest = [("train", name) for name in names["train"]] or [("train", "train/0000")]
            for split, name in [first, *(("valid", name) for name in names["valid"][:VALIDATED]), *rest]:
                if split == "train" and found["train"] and clock.left("data") < longest:
                    break
                start = time.perf_counter()
                trajectory = decode(archive.read(name))
                if not longest:
                    build_example(trajectory, TrainConfig(**BEAM))
                path = out / split / f"{len(found[split]):04d}.vtkhdf"
                path.parent.mkdir(parents=True, exist_ok=True)
                write_trajectory(path, trajectory)
                found[split].append(path)
                longest = max(longest, time.perf_counter() - start)
    except (OSError, zipfile.BadZipFile, KeyError, ValueError) as error:
        raise InputError(f"{pack}: not a whole packed data set: {error}") from None
    return found


def settled(device: torch.device) -> float:
    """The clock [s], when the device has done all that it was given."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    return time.perf_counter()


def lap(run: Callable[[], Any], device: torch.device) -> float:
    start = settled(device)
    run()
    return settled(device) - start


def median(run: Callable[[], Any], device: torch.device, seconds: float) -> float:
    """The median of laps [s]; of one alone, the first, where more would take longer than these seconds."""
    first = lap(run, device)
    laps = [lap(run, device) for _ in range(max(0, min(LAPS, int(seconds / first) - 1)))]
    return float(np.median(laps or [first]))


def held(run: Callable[[int], float], size: int, device: torch.device) -> Timed:
    """What a run on a batch gives; where the device's memory does not hold it, a line with a batch that it does, found by halving."""
    asked, found = size, None
    while size and found is None:
        try:
            found = run(size)
        except torch.OutOfMemoryError:
            pass  # the error holds what the run made, and is let go before less is tried
        if found is None:
            size //= 2
            if device.type == "cuda":
                torch.cuda.empty_cache()
    return found if size == asked else f"out of memory; {size} fits" if size else "out of memory, with a single sample too"


def apart(here: torch.Tensor, there: torch.Tensor, free: torch.Tensor) -> float:
    """Largest difference of predictions (N, D) of free nodes over the root mean square of the first; infinity where one is no number."""
    a, b = here[free].double(), there[free].cpu().double()
    found = float((a - b).abs().max() / a.square().mean().sqrt())
    return found if np.isfinite(found) else float("inf")


def compared(run: Path, example: Example, graph: Graph, device: torch.device) -> float:
    """By how much the predictions of one checkpoint differ from the processor to the device."""
    here, there = (load_model(run, word) for word in ("cpu", str(device)))
    assert isinstance(here, Model) and isinstance(there, Model)
    return apart(here.said(graph), there.said(graph), torch.from_numpy(example.skeleton.free).repeat(graph.count))


def row_of(config: TrainConfig, file: Path, out: Path, device: torch.device, seconds: float) -> dict[str, Any]:
    """One kind of network: whether both places agree, and its times; None where there was none left."""
    end, cuda = time.perf_counter() + seconds, device.type == "cuda"
    (example,) = load_examples([file], config)
    run = set_up(config, [example], out, resume=False, device=device)
    run.keep("model")
    frames, model = np.resize(example.targets - 1, max(BATCHES)).tolist(), run.model
    replayable = cuda and told_by_sizes(model.network)
    start = time.perf_counter()
    dice = torch.Generator().manual_seed(config.seed)
    samples = [(*sample(example, frame, config, dice), example.asked) for frame in frames]
    row: dict[str, Any] = {
        "network": type(model.network).title, "precision": config.network.precision,  # type: ignore[attr-defined]
        "weights": sum(weight.numel() for weight in model.network.parameters()), "nodes": len(example.skeleton.free),
        "edges": example.skeleton.pair.shape[1], "graph [ms]": 1e3 * (time.perf_counter() - start) / len(frames),
        "apart": compared(out, example, join([graph for graph, _, _ in samples[-2:]]), device)}

    def learnt(size: int, *, replayed: bool) -> float:
        batch = batch_of(samples[:size], fill=replayed)
        batch = batch.pin_memory() if cuda else batch
        replays = Replays(partial(descend, model.network, run.optimizer, model.normaliser, config), device) if replayed else None
        step = partial(take_step, model.network, run.optimizer, model.normaliser, config, batch, Processes(), replays)
        with products(config.network):
            return 1e3 * median(step, device, (end - time.perf_counter()) / 4)

    def predicted(size: int) -> float:
        graph = join([graph for graph, _, _ in samples[-size:]]).to(device)
        graph = alike(graph) if replayable else graph
        return 1e3 * median(partial(model.said, graph), device, (end - time.perf_counter()) / 4) / size

    if cuda:
        torch.cuda.reset_peak_memory_stats(device)
    row["step [ms]"] = held(partial(learnt, replayed=replayable), TRAINING_BATCH, device)
    row["memory [MB]"] = torch.cuda.max_memory_allocated(device) / 2**20 if cuda and isinstance(row["step [ms]"], float) else None
    row["kernel by kernel [ms]"] = held(partial(learnt, replayed=False), TRAINING_BATCH, device) if replayable else None
    before = row["step [ms]"] / TRAINING_BATCH if isinstance(row["step [ms]"], float) else 0.0
    for size in BATCHES:
        fits = end - time.perf_counter() > 2e-3 * size * before
        found = row[f"prediction, {size} [ms a frame]"] = held(predicted, size, device) if fits else None
        before = found if isinstance(found, float) else before
    return row


def trained(config: TrainConfig, files: dict[str, list[Path]], out: Path, device: torch.device, clock: Clock,
            times: dict[str, Any]) -> dict[str, Any]:
    """A training until its time is over: what it told, its curve, and whether both places agree about it. times: the row of its network.

    Raises `InputError` where there is too little time.
    """
    if not isinstance(times.get("step [ms]"), float):
        raise InputError("the time of its step is not known")
    start = time.perf_counter()
    probe = load_examples((files["valid"] or files["train"])[:1], config, walk=True)[0]
    reading = (time.perf_counter() - start) * (len(files["train"]) + len(files["valid"]))
    short = replace(probe, targets=probe.targets[:5])
    model = load_model(out.parent / "kinds" / "m4gn", str(device))
    assert isinstance(model, Model)
    rollout_error(model, short)
    beam = lap(partial(rollout_error, model, short), device) * len(probe.targets) / len(short.targets)
    left = clock.left("training") - reading
    valid = files["valid"][:max(0, int(0.3 * left / beam / (CHECKPOINTS + 1)))]
    budget = left - 1.5 * beam * (1 + len(valid))  # after it: the last validation; and what both places say
    if budget < LEAST:
        raise InputError(f"{max(left, 0):.0f} s are left, of which reading, validation and the last check leave {max(budget, 0):.0f}")
    step = times["step [ms]"] + (config.batch_size * times["graph [ms]"] if device.type == "cpu" else 0.0)  # else made meanwhile
    every = max(1, min(config.steps, int(1e3 * (budget - CHECKPOINTS * beam * len(valid)) / step)) // CHECKPOINTS)
    told = train(replace(config, budget_seconds=budget, validate_every=every), files["train"], valid, out, device=str(device))
    graph = sample(probe, int(probe.targets[-1]) - 1, replace(config, noise=0.0), torch.Generator())[0]
    curve = [json.loads(line) for line in (out / "curve.jsonl").read_text().splitlines()]
    return {**told, "train": len(files["train"]), "valid": len(valid), "budget_seconds": budget, "nothing_moves": still(probe),
            "curve": curve, "apart": compared(out, probe, graph, device)}


def still(example: Example) -> float:
    """The error [m] of a body that does not move, on the first validation beam: what the errors of the training stand against."""
    moved = example.states[example.targets][:, example.skeleton.free].astype(np.float64)
    return float(np.sqrt((moved**2).sum(axis=-1).mean()))


def write(out: Path, about: dict[str, Any]) -> None:
    """What is known so far."""
    heads = tuple(about["kinds"][0]) if about["kinds"] else ("nothing",)
    rows = [tuple(_shown(row[head]) for head in heads) for row in about["kinds"]]
    write_whole(out / "gpu.json", (json.dumps(about, indent=1) + "\n").encode())
    write_whole(out / "gpu.md", (table(rows, heads) + "\n").encode())


def _shown(entry: Any) -> str:
    return "–" if entry is None else f"{entry:.3g}" if isinstance(entry, float) else str(entry)


def measured(pack: Path, out: Path, device: torch.device, *, minutes: float, paper: bool, only: list[str], steps: int) -> dict[str, Any]:
    """The whole run; returns what it wrote."""
    clock = Clock(minutes)
    torch.optim.Adam([torch.zeros(1)])  # whose first use takes seconds
    cuda = torch.cuda.get_device_properties(device) if device.type == "cuda" else None
    about: dict[str, Any] = {
        "device": cuda.name if cuda else footing.machine(), "memory_mb": cuda.total_memory / 2**20 if cuda else None,
        "torch": torch.__version__, "cuda": torch.version.cuda if cuda else None, "data": pack.name, "size": "paper" if paper else "small",
        "minutes": minutes, "seconds": {}, "left_out": [], "kinds": [], "training": None}
    files = taken_out(pack, out / "data", clock)
    about["seconds"]["data"] = time.perf_counter() - clock.start
    write(out, about)

    networks = {kind: CONFIGS[kind](**({} if paper else SMALL[kind])) for kind in only}
    networks = {kind: replace(network, world_radius=0.0) if kind == "mgn" else network for kind, network in networks.items()}
    if "m4gn" in networks:
        networks |= {f"m4gn {precision}": replace(networks["m4gn"], precision=precision) for precision in PRECISIONS[1:]}
    for number, (name, network) in enumerate(networks.items()):
        if (left := clock.left("kinds")) <= 0:
            about["left_out"].append(f"{name}: no time was left")
            continue
        footing.say(f"{name}, {left:.0f} s left")
        config = TrainConfig(**{**BEAM, "overlap": int(network.wants.overlap)}, network=network, frames=FRAMES, batch_size=TRAINING_BATCH)
        row = row_of(config, files["train"][0], out / "kinds" / name.replace(" ", "-"), device, left / (len(networks) - number))
        about["left_out"] += [f"{name}: {head}: no time was left" for head, value in row.items() if "prediction" in head and value is None]
        about["kinds"].append(row)
        write(out, about)
    about["seconds"]["kinds"] = time.perf_counter() - clock.start

    try:
        rows = [row for row in about["kinds"] if row["network"] == "M4GN" and row["precision"] == "float32"]
        if not rows:
            raise InputError("M4GN was not asked for, or had no time")
        config = TrainConfig(**BEAM, network=networks["m4gn"], steps=steps, batch_size=TRAINING_BATCH)
        about["training"] = trained(config, files, out / "run", device, clock, rows[0])
    except (InputError, FloatingPointError) as error:
        about["left_out"].append(f"training: {error}")
    checked = [row["apart"] for row in (*about["kinds"], about["training"] or {}) if row.get("precision", "float32") == "float32" and row]
    about |= {"alike": bool(checked) and max(checked) <= ALIKE}
    about["seconds"]["all"] = time.perf_counter() - clock.start
    write(out, about)
    return about


def main(words: list[str] | None = None) -> int:
    parser = footing.parser(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--data", type=Path, default=footing.ROOT / "assets" / "beam-small.pack", help="a packed set")
    parser.add_argument("--minutes", type=float, default=9.0)
    parser.add_argument("--device", default="auto")
    parser.add_argument("--size", choices=("paper", "small"), default="paper", help="of the networks")
    parser.add_argument("--only", nargs="+", choices=CONFIGS, default=list(CONFIGS))
    parser.add_argument("--steps", type=int, default=1_000_000, help="after which training ends in any case")
    asked = parser.parse_args(words)
    try:
        if not 0 < asked.minutes <= 1e4 or asked.steps < 1:
            raise InputError(f"--minutes {asked.minutes:g} --steps {asked.steps}: must both be above 0")
        device = device_of(asked.device)
        if asked.out.exists():
            raise InputError(f"{asked.out}: is there already; choose another folder")
        about = measured(asked.data, asked.out, device, minutes=asked.minutes, paper=asked.size == "paper", only=asked.only,
                         steps=asked.steps)
    except InputError as error:
        footing.say(str(error))
        return 2
    for line in about["left_out"]:
        footing.say(f"left out: {line}")
    print((asked.out / "gpu.md").read_text(), end="")
    footing.say(f"both places {'say the same' if about['alike'] else 'DIFFER, or nothing was compared'}")
    return 0 if about["alike"] else 1


if __name__ == "__main__":
    sys.exit(main())
