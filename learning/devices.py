"""Where networks run: on the processor, or on a GPU that torch's CUDA knows."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import torch

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
