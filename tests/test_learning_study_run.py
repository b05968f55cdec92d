"""A study that is killed again and again comes to the table of one that never was."""

import csv
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.five_nodes import write_set
from tests.synthetic import bending
from tests.test_learning_study import TINY

ROOT = Path(__file__).parents[1]
OF_THE_CLOCK = ("train_ms", "test_ms", "hours", "valid_equal")


def figures(folder):
    with open(folder / "table.csv") as file:
        return [line for line in csv.DictReader(file) if line["figure"] not in OF_THE_CLOCK]


@pytest.mark.slow
def test_a_study_killed_at_ten_random_instants_comes_to_the_same_table(tmp_path):
    write_set(tmp_path / "data", {f"{split}/0000.vtkhdf": bending(cells=(4, 2, 2), steps=4, at=at)
                                  for split, at in (("train", 0.06), ("valid", 0.07), ("test", 0.08))})
    (tmp_path / "study.toml").write_text(TINY.replace("steps = 4, batch_size = 2, validate_every = 2", "steps = 120, validate_every = 20"))

    def started(out):
        command = [sys.executable, "-m", "fidelity", "study", tmp_path / "study.toml", "--size", "check", "--data", tmp_path / "data",
                   "--workers", "2", "--out", tmp_path / out]
        return subprocess.Popen(command, cwd=ROOT, start_new_session=True, stdout=subprocess.DEVNULL)

    assert started("whole").wait() == 0
    dice, killed = random.Random(3), 0
    for _ in range(10):
        running = started("cut")
        try:
            running.wait(dice.uniform(2, 15))
        except subprocess.TimeoutExpired:
            os.killpg(running.pid, signal.SIGKILL) if dice.random() < 0.5 else running.kill()
            running.wait()
            killed += 1
            time.sleep(0.2)  # workers end when their parent is gone
    assert killed and started("cut").wait() == 0
    assert figures(tmp_path / "cut") == figures(tmp_path / "whole") and len(figures(tmp_path / "cut")) > 20
