"""The card of a hand-made set, line by line: its header, ranges with units, statistics, histograms, cost and failures."""

import csv
import dataclasses
import json
from datetime import date

import numpy as np
import pytest

from datagen.files.provenance import machine
from datagen.sets import card, statistics
from datagen.sets.card import _header, _histogram, _leaves, _units, write_card
from physics.scene import Scene
from tests.five_nodes import UNIT, tiny, write_set

FAMILY = '''# Tiny: five nodes.
name = "tiny"
[body]
length = { uniform = [0.0825, 0.2925] }
cell = "tetrahedron"
cells = [2, { choice = [1, 3] }, 1]
[material]
young_modulus = { log-uniform = [1e4, 1e8] }
poisson_ratio = 0.4
[[support]]
where = { choice = ["x-min", "x-max"] }
displacement = [0.5, 0, 0]
[obstacle.place]
depth = 0.25
turn = { uniform = [-15, 15] }
[splits]
train = 9
'''


@pytest.fixture
def lines(tmp_path):
    first = tiny()
    twice = dataclasses.replace(first, displacement=2 * first.displacement,
                                extra={"seconds": 18.0, "failed_attempts": ["slipped", "stuck"]})
    files = {"train/0000.vtkhdf": first, "valid/0000.vtkhdf": tiny(extra={"seconds": 12.0}), "train/0001.vtkhdf": twice}
    write_set(tmp_path, files, family=FAMILY)
    path = write_card(tmp_path, refined=0)
    assert path == tmp_path / "README.md"
    return path.read_text().splitlines()


def test_the_header_of_the_card(lines):
    assert lines[:17] == [
        "---", 'pretty_name: "tiny"', "license: mit", "tags: [mesh, finite-elements, contact, simulation]", 'size_categories: ["n<1K"]',
        "trajectories: 3", "splits:", "  train: 2", "  valid: 1", "nodes: {mean: 8, std: 0, min: 8, max: 8}",
        "graph_diameter: {mean: 2, std: 0, min: 2, max: 2}", "steps: {mean: 2, std: 0, min: 2, max: 2}",
        "xy_extent: {mean: 0.06, std: 0, min: 0.06, max: 0.06}", "seed: 3", "failed_attempts: 2", "---", ""]
    assert lines[17:20] == ["# tiny", "", "Tiny: five nodes. 3 trajectories of 2 steps (train 2, valid 1),"]
    assert lines[20].endswith(f" GB, made by Fidelity (commit abc) on {date.today().isoformat()}.")


@pytest.mark.parametrize(("number", "size"), [(999, "n<1K"), (1000, "1K<n<10K"), (9999, "1K<n<10K"), (10_000, "10K<n<100K")])
def test_the_size_of_a_set_has_the_hubs_words(number, size, tmp_path):
    spread = {"mean": 1.23456789, "std": 0.5, "min": 1, "max": 2}
    found = {"count": number, "split": {"test": number}, "failed_attempts": 0,
             **dict.fromkeys(("nodes", "graph_diameter", "steps", "xy_extent"), spread)}
    said = _header(write_set(tmp_path, {}), found)
    assert f'size_categories: ["{size}"]' in said and "nodes: {mean: 1.23457, std: 0.5, min: 1, max: 2}" in said


def test_ranges_come_with_their_units(lines):
    first = lines.index("| key | values | unit |")
    assert lines[first + 2:lines.index("", first)] == [
        "| body.length | 0.0825 to 0.2925 | m |", "| body.cell | tetrahedron |  |",
        "| body.cells[0] | 2 |  |", "| body.cells[1] | one of 1, 3 |  |", "| body.cells[2] | 1 |  |",
        "| material.young_modulus | 10000 to 1e+08 (log-uniform) | Pa |", "| material.poisson_ratio | 0.4 |  |",
        '| support[0].where | one of "x-min", "x-max" |  |', "| support[0].displacement | [0.5, 0, 0] | m |",
        "| obstacle.place.depth | 0.25 |  |", "| obstacle.place.turn | -15 to 15 | degrees |"]


def test_statistics_are_in_the_table_with_their_units(lines):
    """Largest displacements of 13, 13 and 26 units: mean 52/3, deviation 13 sqrt(2)/3; times of 6, 12, 18 s: 12 and sqrt(24)."""
    def row(name, values, unit):
        return f"| {name} | " + " | ".join(f"{value:.4g}" for value in values) + f" | {unit} |"

    for expected in (row("displacement largest", (UNIT * 52 / 3, UNIT * 13 * 2**0.5 / 3, UNIT * 13, UNIT * 26), "m"),
                     row("seconds", (12, 24**0.5, 6, 18), "s"), row("ms per step", (6000, 1e3 * 6**0.5, 3000, 9000), "ms"),
                     row("reaction largest", (7, 0, 7, 7), "N"), row("energy largest", (0.5, 0, 0.5, 0.5), "J"),
                     row("nodes", (8, 0, 8, 8), ""), row("xy extent", (0.06, 0, 0.06, 0.06), "m²")):
        assert lines.count(expected) == 1, expected
    noise = row("storage noise", np.array([4 / 3, 2**0.5 / 3, 1, 2]) * 2**-24 * UNIT * (299 / 9) ** 0.5, "m")
    assert lines.count(noise) == 2  # among the rest, and among what an error is good for
    assert [line for line in lines if line.startswith("| solver noise")] == 2 * [
        row("solver noise", np.array([4 / 3, 2**0.5 / 3, 1, 2]) * 1e-3 * UNIT * (299 / 6) ** 0.5, "m")]
    assert lines.count("| | mean | std | min | max | unit |") == 2


def test_cost_and_failures_and_where_it_comes_from(lines):
    at = lines.index("## Cost") + 1
    assert lines[at + 1] == "0.01 hours of the solver, 6e+03 ms a step on average; card written on"
    assert lines[at + 2].startswith(machine()) and lines[at + 3] == ""
    assert lines[at + 4:at + 8] == ["2 scenes had no solution, replaced by other draws:", "", "- slipped", "- stuck"]
    assert lines[lines.index("## Versions") + 2] == "numpy 1"
    assert "the seed: `fidelity generate` of family tiny with seed 3 makes the same arrays again:" in lines
    assert "\n".join(lines).rstrip().endswith("```toml\n" + FAMILY.rstrip() + "\n```")


def test_a_table_has_a_row_for_each_file(lines, tmp_path):
    with open(tmp_path / "trajectories.csv") as table:
        rows = list(csv.DictReader(table))
    assert [row["file"] for row in rows] == ["train/0000.vtkhdf", "valid/0000.vtkhdf", "train/0001.vtkhdf"]
    assert [float(row["displacement_largest"]) / UNIT for row in rows] == [13, 13, 26] and rows[2]["seconds"] == "18.0"
    names = list(rows[0])
    assert names[:8] == ["file", "split", "nodes", "obstacle_nodes", "cells", "graph_diameter", "steps", "xy_extent"]
    assert {"storage_noise", "solver_noise", "newton_iterations", "smallest_det_f"} <= set(names) and names[-1] == "megabytes"


def test_a_histogram_has_fifty_signs_at_its_highest():
    """0, 1, ..., 12 with 0 four times: twelve bins of width 1, the last one closed."""
    said = list(_histogram("ms_per_step", np.array([0, 0, 0, *range(13)], float)))
    assert said[0] == "ms per step [ms], mean 4.875" and len(said) == 14 and said[-1] == ""
    assert said[1] == f"{0:10.4g} .. {1:<10.4g} {'#' * 50} 4" and said[2] == f"{1:10.4g} .. {2:<10.4g} {'#' * 12} 1"  # 12.5, to even
    assert said[12] == f"{11:10.4g} .. {12:<10.4g} {'#' * 25} 2"
    assert next(_histogram("nodes", np.array([1.0, 2.0]))) == "nodes [-], mean 1.5"


def test_histograms_are_of_what_is_known(lines):
    heads = [line for line in lines if ", mean " in line]
    assert [line.split(" [")[0] for line in heads] == ["nodes", "graph diameter", "displacement largest", "reaction largest", "ms per step"]


def test_what_was_solved_again_is_in_the_card(tmp_path, monkeypatch):
    write_set(tmp_path, {"test/0000.vtkhdf": tiny(per_frame={})}, family='name = "x"\n')
    calls = []

    def refined(folder, manifest, count, seed):
        calls.append((count, seed))
        return {"count": 1, "mesh_rmse": {"mean": 0.5, "std": 0.25, "min": 0.125, "max": 1}, "failures": ["too thin"]}

    monkeypatch.setattr(statistics, "_refined", refined)
    text = write_card(tmp_path).read_text()
    assert calls == [(1, 0)]  # ten are asked for, there is one
    assert "for a sample of 1;" in text and "| mesh rmse | 0.5 | 0.25 | 0.125 | 1 | m |" in text
    assert "\nNot solved on the finer cells: too thin\n" in text and "No scene failed." in text and "solver noise" not in text
    assert "reaction largest" not in text and text.splitlines()[14].startswith("---") and "\n1 trajectories of 2 steps (test 1)," in text


def test_one_failure_is_one_scene(tmp_path):
    write_set(tmp_path, {"test/0000.vtkhdf": tiny(extra={"failed_attempts": ["slipped"]}, commit="")}, family='[body]\nlength = 1\n')
    text = write_card(tmp_path, refined=0).read_text()
    assert "\n1 scene had no solution, replaced by other draws:\n\n- slipped\n" in text and "(commit unknown)" in text
    assert 'pretty_name: "scenes"' in text and "| body.length | 1 | m |" in text


def test_words_of_the_scenes_are_counted(tmp_path):
    from tests.scenes import pressed

    scene = pressed().to_toml()
    write_set(tmp_path, {"test/0000.vtkhdf": tiny(scene=scene), "test/0001.vtkhdf": tiny(scene=scene)})
    text = write_card(tmp_path, refined=0).read_text()
    assert "\nobstacle: cylinder 2\n" in text and "\nsupport: x-min 2\n" in text


def test_every_key_has_the_unit_of_its_dataclass():
    units = _units(Scene)
    assert {name: units[name] for name in ("length", "young_modulus", "density", "traction", "acceleration", "gap", "direction", "velocity",
                                           "duration", "radius", "poisson_ratio", "along")} == {
        "length": "m", "young_modulus": "Pa", "density": "kg/m3", "traction": "Pa", "acceleration": "m/s2", "gap": "m",
        "direction": "degrees", "velocity": "m/s", "duration": "s", "radius": "m", "poisson_ratio": "", "along": ""}
    assert "depth" not in units  # in metres or in sides of the body


def test_leaves_of_a_family():
    assert list(_leaves({"a": {"b": 1.5, "c": [1, 2]}, "d": [{"e": "x"}, {"f": {"choice": [[1], "y"]}}], "g": True})) == [
        ("a.b", "1.5"), ("a.c", "[1, 2]"), ("d[0].e", "x"), ("d[1].f", 'one of [1], "y"'), ("g", "true")]
    assert card.LICENSE == "mit" and json.dumps("x") == '"x"'


def test_a_family_without_a_first_comment_begins_with_the_number(tmp_path):
    write_set(tmp_path, {"train/0000.vtkhdf": tiny()}, family=FAMILY[FAMILY.index("[body]"):])
    assert "1 trajectories of 2 steps (train 1)," in write_card(tmp_path, refined=0).read_text().splitlines()
