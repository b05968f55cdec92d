"""Frequencies to an error that is asked, against much finer cells of second order."""

from dataclasses import replace

import numpy as np
import pytest

from physics.accuracy.frequency import choose_modes
from physics.modes.elastic import elastic_modes
from tests.scenes import beam


def test_the_frequencies_of_a_clamped_beam_keep_the_error_and_are_not_far_below_it_nor_the_estimate_far_off():
    scene = beam(body={"length": 0.06, "width": 0.02, "height": 0.01}, steps={"count": 1, "error": 0.03})
    chosen = choose_modes(scene, 3)
    fine = replace(chosen.scene.body, cells=(16, 5, 3), cell="hexahedron", order=2, element="standard")
    exact = np.array(elastic_modes(replace(chosen.scene, body=fine), count=3).frequencies_hz)
    true = np.sqrt(np.mean((np.array(chosen.modes.frequencies_hz) / exact - 1) ** 2))
    assert chosen.verdict.reached and chosen.verdict.quantity == "frequency"
    assert 0.03 / 5 < true < 0.03 and chosen.verdict.estimated < 0.03 and 1 / 1.5 < chosen.verdict.estimated / true < 1.5
    assert chosen.scene.steps.error is None
    assert chosen.verdict.estimated == pytest.approx(sum(row["error"] for row in chosen.verdict.rows[:3]))
