"""Where networks run: on the processor, or on a GPU that torch's CUDA knows.

What a network does with a graph is some thousand small kernels, and a GPU is done with each of them before Python has begun the next.
CUDA graphs take this away: all kernels are recorded once, and then started as one. They hold the addresses of what they read and write, so
that there is one recording for every set of sizes, with places of its own for the input (graphs/alike.py keeps the sizes few).

Source: the section on CUDA graphs of torch's notes, "CUDA semantics".
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from typing import Any

import torch
from torch import Tensor

from learning.graphs.graph import mapped
from physics.schema import InputError


def device_of(word: str = "auto") -> torch.device:
    """auto: a GPU where there is one (of several processes on one machine, each its own), else the processor; cpu; cuda; cuda:1.

    Raises `InputError` for another word, or a GPU that is not there.
    """
    kind, _, number = word.partition(":")
    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if word == "cpu" or (word == "auto" and not count):
        return torch.device("cpu")
    if word not in ("auto", "cuda") and not (kind == "cuda" and number.isdigit()):
        raise InputError(f"--device {word}: must be auto, cpu, cuda or cuda:0 and so on")
    if not count:
        raise InputError(f"--device {word}: this torch ({torch.__version__}) sees no GPU; --device cpu does without")
    wanted = int(number) if number else int(os.environ.get("LOCAL_RANK", "0")) % count
    if wanted >= count:
        raise InputError(f"--device {word}: there {'is one GPU' if count == 1 else f'are {count} GPUs'}, numbered from 0")
    return torch.device("cuda", wanted)


@contextmanager
def one_core() -> Iterator[None]:
    """On the processor torch has one thread here, and then as many as before."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


class Replays:
    """What is done with some tensors on a GPU, recorded for every set of sizes and then replayed.

    The first call of a set of sizes is done as it is, which also makes ready what CUDA prepares at a first use, and then recorded. Where
    that fails, this is said once, and calls are done as they are from then on.
    """

    def __init__(self, run: Callable[[Any], Tensor], device: torch.device) -> None:
        """run: takes what consists of tensors on the device, as a batch or a graph, gives a tensor; never waits for the device."""
        self.run, self.device, self.stream, self.failed = run, device, torch.cuda.Stream(device), False
        self.recorded: dict[tuple[Any, ...], tuple[torch.cuda.CUDAGraph, list[Tensor], Tensor]] = {}

    def __call__(self, value: Any) -> Tensor:
        """What `run` gives; read it before the next call.

        value: on any device, in pinned memory best
        """
        parts = list(_parts(value))
        given = [part for part in parts if isinstance(part, Tensor)]
        sizes = tuple(part.shape if isinstance(part, Tensor) else part for part in parts)  # numbers beside tensors are recorded, too
        if sizes not in self.recorded:
            return self._first(mapped(value, lambda tensor: tensor.to(self.device, copy=True)), sizes)
        graph, places, told = self.recorded[sizes]
        for place, tensor in zip(places, given, strict=True):
            place.copy_(tensor, non_blocking=True)
        graph.replay()
        return told

    def _first(self, here: Any, sizes: tuple[Any, ...]) -> Tensor:
        self.stream.wait_stream(torch.cuda.current_stream(self.device))
        with torch.cuda.stream(self.stream):
            told = self.run(here).clone()
        torch.cuda.current_stream(self.device).wait_stream(self.stream)
        if self.failed:
            return told
        graph, pool = torch.cuda.CUDAGraph(), next((graph.pool() for graph, _, _ in self.recorded.values()), None)
        try:  # other threads pin memory meanwhile, which would end a recording that is not this thread's alone
            with torch.cuda.graph(graph, pool=pool, stream=self.stream, capture_error_mode="thread_local"):
                recorded = self.run(here)
        except RuntimeError as error:
            self.failed = True
            warnings.warn(f"no CUDA graph: {str(error).splitlines()[0]}; kernels are started one by one", stacklevel=2)
        else:
            self.recorded[sizes] = graph, [part for part in _parts(here) if isinstance(part, Tensor)], recorded
        return told


def _parts(value: Any) -> Iterator[Any]:
    """All that it consists of."""
    if isinstance(value, tuple):
        for part in value:
            yield from _parts(part)
    elif is_dataclass(value):
        for each in fields(value):
            yield from _parts(getattr(value, each.name))
    else:
        yield value
