"""The curve of a training: one line a figure, cut at the step from which a training goes on, and the same for TensorBoard."""

import json
import sys
from types import SimpleNamespace

import pytest

from learning.training import curve as module
from learning.training.curve import Curve


def lines(folder):
    return [json.loads(line) for line in (folder / "curve.jsonl").read_text().splitlines()]


@pytest.fixture
def board(monkeypatch):
    """TensorBoard's writer, made up: what it is told."""
    told = []

    class Writer:
        def __init__(self, folder, purge_step):
            told.append(("open", folder, purge_step))

        def add_scalar(self, name, value, step):
            told.append((name, value, step))

        def close(self):
            told.append("close")

    monkeypatch.setattr(module.importlib.util, "find_spec", lambda name: True if name == "tensorboard" else None)
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", SimpleNamespace(SummaryWriter=Writer))
    return told


def test_a_line_is_on_disk_at_once_and_begins_with_its_step(tmp_path, monkeypatch):
    monkeypatch.setattr(module.importlib.util, "find_spec", lambda name: None)
    with Curve(tmp_path, 0) as curve:
        curve.add(2, loss=0.5, rate=1e-3)
        assert (tmp_path / "curve.jsonl").read_text() == '{"step": 2, "loss": 0.5, "rate": 0.001}\n'
        curve.add(4, error=None)
        assert lines(tmp_path)[1] == {"step": 4, "error": None}
    assert curve._file.closed


def test_a_new_curve_forgets_an_old_one_and_a_resumed_one_what_came_after_its_step(tmp_path, monkeypatch):
    monkeypatch.setattr(module.importlib.util, "find_spec", lambda name: None)
    old = ['{"step": 1}', '{"step": 2, "loss": 1.0}', '{"step": 3}', '{"step": 2, "error": 2.0}', '{"step": 1, "lo', '{"step": 2}']
    for step, kept in ((2, [old[0], old[1], old[3]]), (3, old[:4]), (1, old[:1]), (0, [])):
        (tmp_path / "curve.jsonl").write_text("\n".join(old))
        with Curve(tmp_path, step) as curve:
            curve.add(7)
        assert (tmp_path / "curve.jsonl").read_text().splitlines() == [*kept, '{"step": 7}']
    (tmp_path / "curve.jsonl").unlink()
    with Curve(tmp_path, 5):
        pass
    assert lines(tmp_path) == []


def test_the_board_is_told_the_same_and_forgets_later_steps(tmp_path, board):
    with Curve(tmp_path, 3) as curve:
        curve.add(4, loss=0.5, error=None, rate=2.0)
    assert board == [("open", str(tmp_path), 4), ("loss", 0.5, 4), ("rate", 2.0, 4), "close"]
    assert lines(tmp_path) == [{"step": 4, "loss": 0.5, "error": None, "rate": 2.0}]


def test_without_a_folder_nothing_is_written(tmp_path, board, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with Curve(None, 3) as curve:
        curve.add(4, loss=0.5)
    assert board == [] and list(tmp_path.iterdir()) == []
