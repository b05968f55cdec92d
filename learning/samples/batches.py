"""Batches of a training: which frames, shown with which noise, side by side in one graph.

Batch k falls as dice of its own tell, seeded with the training's seed and k, and each of its samples with dice of its own beside: so a
batch is made without those before it, in any process, and a training goes on from any step. Frames are drawn with replacement, evenly or
by chances (samples.chances).

Where a GPU trains, other processes of the same machine make the batches that come next while it works.

Source of the seeds: numpy's SeedSequence, which spreads any two numbers over all bits.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from learning.config import TrainConfig
from learning.graphs.alike import alike
from learning.graphs.graph import Graph, join, mapped
from learning.processes import Processes
from learning.samples.samples import Example, all_frames, chances, sample

MOST_MAKERS, WAITING = 6, 3  # processes that make batches; how many each has ready


class Walks(Protocol):
    """Where a training shows trajectories other than as they are (training/walks.py)."""

    def next(self, which: int, frame: int, generator: torch.Generator) -> tuple[int, NDArray[np.float32]]:
        """The frame of an example to learn from, and (N, D) what is shown of it, for a frame that was drawn."""


@dataclass(frozen=True)
class Batch:
    """What a process learns from at once.

    graph: its samples side by side, (N, O) target: what the network should say, asked: True on the numbers that count
    numbers: how many these are, of the whole batch, other processes' samples included
    size: samples, of all processes
    """

    graph: Graph
    target: Tensor
    asked: Tensor
    numbers: Tensor
    size: int

    def __len__(self) -> int:
        return self.size

    def to(self, device: torch.device) -> Batch:
        """The same on another device."""
        moved: Batch = mapped(self, lambda tensor: tensor.to(device, non_blocking=True))
        return moved

    def pin_memory(self) -> Batch:
        """The same in memory from which a GPU copies by itself."""
        pinned: Batch = mapped(self, torch.Tensor.pin_memory)
        return pinned


class Batches(Dataset[Batch]):
    """The batches of a training by their number.

    fill: graphs are filled up to few sizes (graphs/alike.py)
    """

    def __init__(self, examples: Sequence[Example], config: TrainConfig, walks: Walks | None = None, group: Processes | None = None, *,
                 fill: bool = False) -> None:
        self.examples, self.config, self.walks, self.group, self.fill = examples, config, walks, group or Processes(), fill
        self.frames, self.chance = all_frames(examples), chances(examples)

    def __getitem__(self, number: int) -> Batch:
        return self.made(number, self.config.batch_size)

    def made(self, number: int, size: int) -> Batch:
        """A batch of this many samples."""
        frames, *dice = map(_dice, np.random.SeedSequence((self.config.seed, number)).generate_state(1 + size).tolist())
        if self.chance is None:
            picked = torch.randint(len(self.frames), (size,), generator=frames)
        else:
            picked = torch.multinomial(self.chance, size, replacement=True, generator=frames)
        samples, numbers = [], 0
        for place, (which, frame) in enumerate(self.frames[picked.numpy()].tolist()):
            example = self.examples[which]
            at, now = (frame, None) if self.walks is None else self.walks.next(which, frame, dice[place])
            numbers += int(example.asked.sum())
            if place % self.group.count == self.group.rank:
                samples.append((*sample(example, at, self.config, dice[place], now=now), example.asked))
        return batch_of(samples, numbers=numbers, size=size, fill=self.fill)


def batch_of(samples: Sequence[tuple[Graph, Tensor, Tensor]], *, numbers: int | None = None, size: int | None = None,
             fill: bool = False) -> Batch:
    """Samples, each a graph, what should be said of it (N, O) and what of that counts, as a batch, by default a whole one."""
    graphs, targets, masks = zip(*samples, strict=True)
    graph, target, asked = join(graphs), torch.cat(targets), torch.cat(masks)
    numbers = int(asked.sum()) if numbers is None else numbers
    if fill:
        graph = alike(graph)
        more = (len(graph.node) - len(target), target.shape[1])
        target, asked = torch.cat([target, target.new_zeros(more)]), torch.cat([asked, asked.new_zeros(more)])
    return Batch(graph, target, asked, torch.tensor(float(numbers)), len(samples) if size is None else size)


def ahead(batches: Batches, first: int, device: torch.device) -> Iterator[Batch]:
    """The batches from one on: for a GPU made ahead of time by other processes, but where they depend on what the network says."""
    makers = 0 if device.type == "cpu" or batches.walks else min(MOST_MAKERS, len(os.sched_getaffinity(0)) - 1)
    if not makers:
        return map(batches.__getitem__, count(first))
    return iter(DataLoader(batches, batch_size=None, sampler=count(first), num_workers=makers, prefetch_factor=WAITING,
                           pin_memory=device.type == "cuda", multiprocessing_context="fork"))


def _dice(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)
