"""The card and the statistics say what an independent reader of the files finds."""

import csv
import json
import re

import h5py
import numpy as np
import pytest

import fidelity
from datagen.files.trajectory import read_trajectory
from datagen.sets import dataset, statistics
from datagen.sets.card import write_card
from tests.small_set import FILES


def test_the_card_says_what_the_files_hold(folder, capsys):
    """Read again with h5py and YAML alone."""
    yaml = pytest.importorskip("yaml")
    path = write_card(folder, refined=0)
    text = path.read_text()
    header = yaml.safe_load(text.split("---")[1])
    nodes, largest, energy = [], [], []
    for file in FILES:
        with h5py.File(folder / file) as opened:
            root = opened["VTKHDF"]
            nodes.append(len(root["Points"]))
            u = root["PointData/displacement"][()].reshape(-1, nodes[-1], 3)
            free = root["PointData/node_kind"][()] == 0
            largest.append(np.sqrt((u[:, free].astype(float) ** 2).sum(axis=2)).max())
            energy.append(root["FieldData/energy"][()].max())
    assert header["pretty_name"] == "small" and header["trajectories"] == 4 and header["license"] == "mit"
    assert header["splits"] == {"train": 2, "valid": 1, "test": 1} and header["seed"] == 0
    assert header["nodes"]["mean"] == pytest.approx(np.mean(nodes)) and header["nodes"]["max"] == max(nodes)
    assert header["steps"]["mean"] == 6

    def row(name):
        cells = re.search(rf"^\| {name} \| (.*) \|", text, re.M)[1].split(" | ")
        return [float(cell) for cell in cells[:4]]

    for name, values in (("displacement largest", largest), ("energy largest", energy)):
        expected = [np.mean(values), np.std(values), np.min(values), np.max(values)]
        assert row(name) == pytest.approx(expected, rel=1e-3)  # four digits are printed
    assert "| body.length | 0.08 to 0.1 | m |" in text and "| obstacle.radius | 0.01 | m |" in text
    assert "| material.young_modulus | 1e+06 | Pa |" in text and "No scene failed." in text
    with open(folder / "trajectories.csv") as table:
        rows = list(csv.DictReader(table))
    assert [line["file"] for line in rows] == [entry.file for entry in dataset.read_manifest(folder).trajectories]
    assert {"storage_noise", "solver_noise"} <= rows[0].keys()
    assert fidelity.main(["dataset", "stats", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["nodes"]["mean"] == pytest.approx(np.mean(nodes))


def test_failures_are_in_the_card(folder):
    import dataclasses

    manifest = dataset.read_manifest(folder)
    entries = (dataclasses.replace(manifest.trajectories[0], failed_attempts=("it slipped",)), *manifest.trajectories[1:])
    dataset.write_manifest(folder, dataclasses.replace(manifest, trajectories=entries))
    text = write_card(folder, refined=0).read_text()
    assert "1 scene had no solution" in text and "- it slipped" in text and "failed_attempts: 1" in text


def test_the_noise_floor(folder):
    """Against a solution on finer cells; what is known is not solved again."""
    found = statistics.statistics(folder, refined=2)["refined"]
    assert found["count"] == 2 and not found["failures"]
    known = json.loads((folder / "refined.json").read_text())
    assert len(known) == 2
    sizes = statistics.of_trajectory(read_trajectory(folder / FILES[0]))
    # These beams have two cells across: their mesh is off by some per cent of the motion, many times what the solver leaves.
    assert 0.005 < found["mesh_relative"]["mean"] < 0.5
    assert found["solver_largest"]["max"] < 1e-2 * found["mesh_rmse"]["min"]
    # The estimate from the residual is of the size of what was measured (40 steps at most, so here the same ones).
    assert sizes["storage_noise"] < 1e-8 and sizes["solver_noise"] < 1e-6
    known[next(iter(known))]["mesh_rmse"] = 123.0
    (folder / "refined.json").write_text(json.dumps(known))
    assert statistics.statistics(folder, refined=2)["refined"]["mesh_rmse"]["max"] == 123.0


def test_refining_a_refined_mesh_changes_less(family):
    """The error measured is one of the mesh: it falls with the size of the cells."""
    import dataclasses

    from datagen.family.family import draw
    from datagen.sets.generate import trajectory_of

    scene = draw(family, 0, 0)
    errors = []
    for cells in ((6, 2, 2), (12, 4, 4)):
        body = dataclasses.replace(scene.body, cells=cells)
        errors.append(statistics.mesh_error(trajectory_of(dataclasses.replace(scene, body=body)))["mesh_rmse"])
    # Locking in bending falls with the square of the size; contact and a corner at the support slow that down.
    assert errors[1] < 0.5 * errors[0]
