"""The trained predictor in assets/m4gn-fast, on beams drawn with a seed of their own and solved here in few steps."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from datagen.family.family import draw, load_family
from datagen.sets.generate import trajectory_of
from learning.networks.stored import read_stored
from learning.prediction.checkpoint import load_model
from learning.prediction.predictor import Case
from learning.prediction.surrogates import corrected, learned
from learning.report.compare import predictors
from learning.report.measure import measure
from learning.samples.seen import read_seen
from physics.mesh.build import build_mesh
from physics.scene import Steps

RUN = Path(__file__).parent.parent / "assets" / "m4gn-fast"


@pytest.fixture(scope="module")
def cases():
    found = []
    for index in (0, 1, 2, 3):
        scene = replace(draw(load_family("beam"), 4242, index), steps=Steps(count=24))
        found.append(Case(str(index), trajectory_of(scene), scene, build_mesh(scene.body)))
    return found


@pytest.fixture(scope="module")
def row(cases):
    model = load_model(RUN)
    return measure([learned(model, model.title)], cases, sample=2).rows[0]


def test_it_is_small_and_says_where_it_comes_from():
    assert sum(path.stat().st_size for path in RUN.iterdir()) < 4e6
    about, _ = read_stored(RUN / "model.safetensors")
    assert about["config"]["network"]["kind"] == "sections" and len(about["fingerprint"]) == 64
    assert about["trajectories"] == read_seen(RUN).trajectories > 200


def test_it_is_within_the_published_error_beam_by_beam_where_it_is_sure(row):
    # published: 1.87e-4 m per coordinate, which is 3.2e-4 m of distance, on beams like these
    assert len(row.each) == 4
    for each in row.each:
        assert each["rmsd_all"] < 3.2e-4 or each["unsure"] > 0
    assert np.median([each["rmsd_all"] for each in row.each]) < 1e-4


def test_it_tells_an_error_bar_that_is_of_the_size_of_its_error(row):
    assert 0.3 < row.scores["error_bar"] / row.scores["rmsd_all"] < 5
    assert row.scores["covered"] > 0.5  # of four beams: nine tenths in the mean over many


def test_a_newton_step_starts_from_it_as_from_any_other_run(cases):
    model = load_model(RUN)
    names = [each.name for each in predictors({str(RUN): model})]
    assert names[:3] == ["beam sections", "beam sections, corrected 10-fold", "beam sections, as the start of Newton"]
    alone, better = (predictor(model).predict(cases[0]).path for predictor in (learned, lambda model: corrected(model, 1)))
    truth, free = cases[0].truth, cases[0].free
    off = [np.sqrt(((path - truth)[:, free].astype(np.float64) ** 2).sum(axis=2).mean()) for path in (alone, better)]
    assert off[1] < off[0] / 2
