"""The curve of a training: its lines, what a resumed one keeps, and what TensorBoard is told, with one made by hand in its place."""

import importlib.util
import json
import sys
from types import ModuleType, SimpleNamespace

import pytest

from learning.curve import Curve


@pytest.fixture
def board(monkeypatch):
    """TensorBoard's writer, keeping what it is told."""
    told = SimpleNamespace(made=[], scalars=[], closed=0)

    class SummaryWriter:
        def __init__(self, folder, purge_step):
            told.made.append((folder, purge_step))

        def add_scalar(self, name, value, step):
            told.scalars.append((name, value, step))

        def close(self):
            told.closed += 1

    real = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: object() if name == "tensorboard" else real(name, *rest))
    module = ModuleType("torch.utils.tensorboard")
    module.SummaryWriter = SummaryWriter
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", module)
    return told


def lines(folder):
    return [json.loads(line) for line in (folder / "curve.jsonl").read_text().splitlines()]


def test_tensorboard_has_the_same_curve(board, tmp_path):
    with Curve(tmp_path, 0) as curve:
        curve.add(1, loss=0.5)
        curve.add(2, loss=0.25, error=None)
        curve.add(3, loss=0.125, error=1e-3)
        assert len(lines(tmp_path)) == 3 and board.closed == 0  # a line can be read as soon as it is there
    assert lines(tmp_path) == [
        {"step": 1, "loss": 0.5},
        {"step": 2, "loss": 0.25, "error": None},
        {"step": 3, "loss": 0.125, "error": 1e-3},
    ]
    assert board.made == [(str(tmp_path), 1)] and board.closed == 1
    assert board.scalars == [("loss", 0.5, 1), ("loss", 0.25, 2), ("loss", 0.125, 3), ("error", 1e-3, 3)]


def test_a_resumed_training_keeps_the_steps_of_its_checkpoint_and_tells_tensorboard(board, tmp_path):
    (tmp_path / "curve.jsonl").write_text('{"step": 1}\n{"step": 3}\n{"step": 4}\n{"step": 2, "late": 1}\n{"step": 1, "lo')
    with Curve(tmp_path, 3) as curve:
        curve.add(4, loss=1.0)
    assert lines(tmp_path) == [{"step": 1}, {"step": 3}, {"step": 2, "late": 1}, {"step": 4, "loss": 1.0}]
    assert board.made == [(str(tmp_path), 4)]  # from there on it forgets


def test_a_new_training_begins_a_new_curve_and_one_without_a_folder_has_none(board, tmp_path):
    (tmp_path / "curve.jsonl").write_text('{"step": 0}\n')
    with Curve(tmp_path, 0):
        pass
    assert lines(tmp_path) == []
    with Curve(None, 0) as curve:
        curve.add(1, loss=1.0)
    assert len(board.made) == 1 and board.scalars == []


def test_without_tensorboard_there_is_the_file_alone(monkeypatch, tmp_path):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    with Curve(tmp_path, 0) as curve:
        curve.add(1, loss=1.0)
    assert lines(tmp_path) == [{"step": 1, "loss": 1.0}]
