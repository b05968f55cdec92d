"""What several processes agree on, each of them made up by the words that torch.distributed would have said."""

from types import SimpleNamespace

import pytest
import torch
from torch import nn

from learning import processes as module
from learning.config import TrainConfig
from learning.prediction import memory
from learning.processes import Processes, processes
from physics.schema import InputError


@pytest.fixture
def said(monkeypatch):
    """torch.distributed of rank 1 of 3; the first process says 5, the others' values add up to 40."""
    words = []

    def broadcast(tensor, source):
        words.append(("broadcast", source, tensor.dtype))
        tensor[:] = 5

    def all_reduce(tensor):
        words.append(("sum", float(tensor), tensor.dtype))
        tensor += 40

    monkeypatch.setattr(module, "distributed", SimpleNamespace(
        broadcast=broadcast, all_reduce=all_reduce, init_process_group=lambda how: words.append(how), get_rank=lambda: 1,
        destroy_process_group=lambda: words.append("end")))
    monkeypatch.setattr(module, "DistributedDataParallel", lambda network: ("averaged", network))
    return words


def test_one_process_talks_to_nobody(said, monkeypatch):
    monkeypatch.delenv("WORLD_SIZE", raising=False)
    network = nn.Linear(2, 2)
    for size in (None, "1"):
        if size:
            monkeypatch.setenv("WORLD_SIZE", size)
        with processes(TrainConfig(batch_size=7)) as group:
            assert (group.rank, group.count, group.first) == (0, 1, True) and group == Processes()
            assert group.learner(network) is network
            assert group.agreed(3.5) == 3.5 and group.total(2.5) == 2.5
    assert said == []


def test_three_processes_take_the_firsts_value_and_the_sum_of_all(said, monkeypatch):
    monkeypatch.setenv("WORLD_SIZE", "3")
    with processes(TrainConfig(batch_size=6)) as group:
        assert (group.rank, group.count, group.first) == (1, 3, False)
        assert said == ["gloo"]
        assert group.learner("network") == ("averaged", "network")
        assert group.agreed(3.5) == 5 and group.total(2.5) == 42.5
    assert said[1:] == [("broadcast", 0, torch.float64), ("sum", 2.5, torch.float64), "end"]


def test_two_are_several(said):
    pair = Processes(rank=0, count=2)
    assert pair.first and pair.learner("network") == ("averaged", "network") and pair.agreed(1.0) == 5 and pair.total(1.0) == 41


def test_the_group_ends_with_an_error_too(said, monkeypatch):
    monkeypatch.setenv("WORLD_SIZE", "2")
    with pytest.raises(ZeroDivisionError), processes(TrainConfig(batch_size=2)):
        1 / 0
    assert said == ["gloo", "end"]


def test_a_batch_that_cannot_be_shared_evenly_is_refused(said, monkeypatch):
    monkeypatch.setenv("WORLD_SIZE", "3")
    with pytest.raises(InputError, match="batch_size = 8: must be a multiple of the 3 processes"), processes(TrainConfig(batch_size=8)):
        pass
    assert said == []


# memory, which is the process's own

def test_malloc_is_told_to_map_nothing_and_to_trim_nothing(monkeypatch):
    calls = []
    library = SimpleNamespace(mallopt=lambda *given: calls.append(given))
    monkeypatch.setattr(memory.ctypes, "CDLL", lambda name: library if name is None else None)
    memory.keep_freed_memory()
    # malloc.h: M_MMAP_MAX is -4, M_TRIM_THRESHOLD -1; the largest int there is
    assert calls == [(-4, 0), (-1, 2147483647)]
    monkeypatch.setattr(memory.ctypes, "CDLL", lambda name: SimpleNamespace())
    memory.keep_freed_memory()  # another C library: nothing to tell
