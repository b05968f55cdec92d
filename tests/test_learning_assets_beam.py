"""The trained checkpoint in assets/m4gn-beam on beams that it has not seen: those of another, coarser family."""

from pathlib import Path

import numpy as np
import pytest

from datagen.files.trajectory import read_trajectory
from datagen.sets.dataset import files
from datagen.sets.pack import unpack
from learning.prediction.checkpoint import load_model, read_checkpoint
from learning.prediction.rollout import walk
from learning.report.evaluate import evaluate
from learning.samples.samples import build_example
from physics.mesh.quality import rmsd

ASSETS = Path(__file__).parent.parent / "assets"
RUN = ASSETS / "m4gn-beam"


@pytest.fixture(scope="module")
def beams(tmp_path_factory):
    folder = tmp_path_factory.mktemp("beams")
    unpack(ASSETS / "beam-small.pack", folder)
    return files(folder, "test")


@pytest.fixture(scope="module")
def errors(beams):
    """(beams, 3) root mean square errors [m] over every tenth frame: network, estimate alone, nothing moves."""
    model, found = load_model(RUN), []
    for path in beams:
        trajectory = read_trajectory(path)
        targets = np.arange(10, len(trajectory.displacement), 10)
        case = build_example(trajectory, model.config, targets=targets)
        truth = trajectory.displacement[targets]
        paths = walk(model, case)[targets], case.estimate.displacement, np.zeros_like(truth)
        found.append([rmsd(path, truth, trajectory.free) for path in paths])
    return np.array(found)


def test_it_is_small_and_says_where_it_comes_from():
    assert sum(path.stat().st_size for path in RUN.iterdir()) < 12e6
    about = read_checkpoint(RUN / "model.safetensors").about
    assert about["config"]["scheme"] == "pose" and len(about["fingerprint"]) == 64 and about["seconds"] > 0


def test_it_is_below_the_published_error_by_ten(errors):
    # published: 1.87e-4 m in RMSD-all, on beams like these but finer
    assert errors[:, 0].mean() < 1.87e-5
    assert (errors[:, 0] < 0.05 * errors[:, 2]).all()  # and 20 times better than no motion at all, beam by beam


def test_the_network_takes_a_third_off_its_estimates_error(errors):
    # the limits above are kept by the estimate alone: this one is the network's. It takes off 45 % on the average and 13 % at least
    assert errors[:, 0].mean() < errors[:, 1].mean() / 1.5
    assert (errors[:, 0] < 0.95 * errors[:, 1]).all()
    assert errors[:, 0].mean() < 1e-6


def test_evaluate_holds_it_against_finite_elements(beams, errors, tmp_path):
    report = evaluate(RUN, beams[1:2], tmp_path, refined=0)
    row = next(row for row in report["rows"] if row["kind"] == "learned")["scores"]
    # no motion at all has the error of the motion
    model, trajectory = load_model(RUN), read_trajectory(beams[1])
    path = walk(model, build_example(trajectory, model.config, targets=np.arange(1, len(trajectory.displacement))))
    assert row["rmsd_all"] == pytest.approx(rmsd(path[1:], trajectory.displacement[1:], trajectory.free), rel=1e-3)
    assert row["inverted_elements"] == 0
    still = next(row for row in report["rows"] if row["name"] == "nothing moves")["scores"]
    assert still["rmsd_all"] == pytest.approx(errors[1, 2], rel=0.1)
