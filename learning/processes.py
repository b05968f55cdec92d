"""Several processes that train one network: each takes its share of every batch, and gradients are averaged.

    .venv/bin/torchrun --standalone --nproc-per-node 2 fidelity.py train ...

(Debian 13's torch has no libuv, so its torchrun does not start; processes started by hand with RANK, WORLD_SIZE, MASTER_ADDR,
MASTER_PORT and USE_LIBUV=0 in their environment do.)

All processes hold the whole data, draw the same batch with the same noise, and keep the same weights; each works on every n-th
sample of the batch. The result is that of one process up to the order of sums. The first process alone writes and validates, and
its clock is everybody's.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import distributed, nn
from torch.nn.parallel import DistributedDataParallel

from learning.config import TrainConfig
from physics.schema import InputError

CPU = torch.device("cpu")


@dataclass(frozen=True)
class Processes:
    """How many there are, and which this one is."""

    rank: int = 0
    count: int = 1
    device: torch.device = CPU

    @property
    def first(self) -> bool:
        return self.rank == 0

    def learner(self, network: nn.Module) -> nn.Module:
        """The network, with gradients that are averaged over the processes as they are made."""
        return DistributedDataParallel(network) if self.count > 1 else network

    def agreed(self, value: float) -> float:
        """The first process's value."""
        if self.count == 1:
            return value
        shared = torch.tensor([value], dtype=torch.float64, device=self.device)
        distributed.broadcast(shared, 0)
        return float(shared)

    def total(self, value: float) -> float:
        """The sum of the processes' values."""
        if self.count == 1:
            return value
        shared = torch.tensor([value], dtype=torch.float64, device=self.device)
        distributed.all_reduce(shared)
        return float(shared)


@contextmanager
def processes(config: TrainConfig, device: torch.device = CPU) -> Iterator[Processes]:
    """The processes that torchrun has started, or this one. Raises `InputError` for a batch that cannot be shared evenly."""
    count = int(os.environ.get("WORLD_SIZE", "1"))
    if count == 1:
        yield Processes()
        return
    if config.batch_size % count:
        raise InputError(f"batch_size = {config.batch_size}: must be a multiple of the {count} processes")
    distributed.init_process_group("nccl" if device.type == "cuda" else "gloo")
    try:
        yield Processes(distributed.get_rank(), count, device)
    finally:
        distributed.destroy_process_group()
