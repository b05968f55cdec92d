"""Sets of flows: packed within a share of their velocity, exchanged as DeepMind's CylinderFlow, and described on their card."""

import json
from dataclasses import replace

import numpy as np
import pytest

from datagen.family.family import counts, load_family
from datagen.files.tfrecord import parse_example, read_records
from datagen.files.trajectory import WALL, read_trajectory
from datagen.sets.card import write_card
from datagen.sets.check import check
from datagen.sets.deepmind import export_records, import_records
from datagen.sets.generate import generate
from datagen.sets.pack import decode, encode, pack, unpack
from datagen.sets.statistics import statistics
from physics.schema import InputError
from tests.five_nodes import tiny, write_set
from tests.test_datagen_flow import TINY


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flows")
    (folder / "tiny.toml").write_text(TINY.replace("count = 3\nduration = 0.03", "count = 12\nduration = 0.12"))
    family = load_family(folder / "tiny.toml")
    generate(family, counts(family), folder / "set", workers=1)
    return folder / "set"


def far(made, true, name):
    return float(np.linalg.norm(made.fields[name].astype(float) - true.fields[name], axis=2).max())


def test_velocity_and_pressure_are_packed_within_a_share_of_their_largest_in_the_median_frame(made):
    true = read_trajectory(made / "train" / "0000.vtkhdf")
    sizes = []
    for share in (1e-2, 1e-3, 1e-5):
        blob, error = encode(true, 1e-6, share)
        found = decode(blob)
        assert error == 0
        for name in ("velocity", "pressure"):
            limit = share * float(np.median(np.linalg.norm(true.fields[name].astype(float), axis=2).max(axis=1)))
            assert 0.1 * limit < far(found, true, name) <= limit
            assert found.extra["field_tolerance"][name] == pytest.approx(limit)
        assert not found.fields["velocity"][:, true.node_kind == WALL].any()
        sizes.append(len(blob))
    assert sizes[0] < sizes[1] < sizes[2]
    again = decode(encode(decode(encode(true, 1e-6, 1e-2)[0]), 1e-6, 1e-4)[0])
    assert again.extra["field_tolerance"]["velocity"] >= 1e-2 * 0.9 * np.linalg.norm(true.fields["velocity"][5], axis=1).max()


def test_a_body_that_moves_keeps_its_other_fields_exactly(made):
    true = read_trajectory(made / "train" / "0000.vtkhdf")
    moved = true.displacement.copy()
    moved[1:, 0, 0] = 0.01
    found = decode(encode(replace(true, displacement=moved), 1e-6)[0])
    assert far(found, true, "velocity") == far(found, true, "pressure") == 0
    assert "field_tolerance" not in found.extra


def test_an_unpacked_set_of_flows_is_still_what_its_scenes_give(made, tmp_path):
    said = pack(made, tmp_path / "set.pack")
    assert said["largest_error"] == 0 < said["largest_share"] <= said["share"] == 1e-3
    unpack(tmp_path / "set.pack", tmp_path / "set")
    assert check(tmp_path / "set", steps=3) == []
    with pytest.raises(InputError, match=r"share = 1\.5: must be above 0 and below 1"):
        pack(made, tmp_path / "other.pack", share=1.5)


def test_records_are_laid_out_as_those_of_cylinder_flow(made, tmp_path):
    """cells (1, C, 3), mesh_pos (1, N, 2), node_type (1, N, 1), velocity (T, N, 2), pressure (T, N, 1); the frame at rest is left out."""
    export_records(made, tmp_path / "records")
    meta = json.loads((tmp_path / "records" / "meta.json").read_text())
    assert {name: (feature["type"], feature["shape"], feature["dtype"]) for name, feature in meta["features"].items()} == {
        "cells": ("static", [1, -1, 3], "int32"), "mesh_pos": ("static", [1, -1, 2], "float32"),
        "node_type": ("static", [1, -1, 1], "int32"), "velocity": ("dynamic", [12, -1, 2], "float32"),
        "pressure": ("dynamic", [12, -1, 1], "float32")}
    assert meta["dt"] == pytest.approx(0.01) and meta["trajectory_length"] == 12
    true = read_trajectory(made / "train" / "0000.vtkhdf")
    record = parse_example(next(iter(read_records(tmp_path / "records" / "train.tfrecord"))))
    velocity = np.frombuffer(record["velocity"][0], np.float32).reshape(12, -1, 2)
    np.testing.assert_array_equal(velocity, true.fields["velocity"][1:, :, :2])


def test_what_is_imported_is_exported_to_the_same_bytes_and_looks_like_ours(made, tmp_path):
    export_records(made, tmp_path / "records")
    import_records(tmp_path / "records", tmp_path / "imported")
    found, true = (read_trajectory(folder / "train" / "0000.vtkhdf") for folder in (tmp_path / "imported", made))
    np.testing.assert_array_equal(found.fields["velocity"], true.fields["velocity"][1:])
    np.testing.assert_array_equal(found.fields["pressure"], true.fields["pressure"][1:])
    assert found.extra["step_seconds"] == true.extra["step_seconds"] and found.flows
    export_records(tmp_path / "imported", tmp_path / "again")
    for name in ("train.tfrecord", "meta.json"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "records" / name).read_bytes()


def test_the_card_of_a_set_of_flows_speaks_of_flows(made, tmp_path):
    text = write_card(made).read_text()
    for words in ("tags: [mesh, finite-elements, fluid, simulation]", "INFLOW 4, OUTFLOW 5, WALL 6", "| fluid.viscosity | 0.001 | Pa s |",
                  "| inflow[0].speed | 0.25 to 0.5 | m/s |", "reynolds number [-]", "CylinderFlow was published with 820 ms a step"):
        assert words in text, words
    for words in ("obstacle", "reaction", "contact", "depth_in", "DeformingBeam"):
        assert words not in text, words
    found = statistics(made)
    true = read_trajectory(made / "train" / "0000.vtkhdf").fields["velocity"]
    assert found["velocity_change_rms"]["max"] < 0.3 * np.abs(true[1] - true[0]).max()  # the jump at the start is left out


def test_a_bound_that_a_set_has_nothing_for_is_refused_before_a_file_is_written(made, tmp_path):
    """Of flows a tolerance of displacements, of solids a share of velocity: unused, the file would not be what was asked for."""
    write_set(tmp_path / "solid", {"train/0000.vtkhdf": tiny()})
    with pytest.raises(InputError, match=r"^tolerance = 1e-06: .*set is of flows, .*; share bounds velocity and pressure$"):
        pack(made, tmp_path / "set.pack", tolerance=1e-6)
    with pytest.raises(InputError, match=r"^share = 0\.001: .*solid is of solids; tolerance bounds their displacements$"):
        pack(tmp_path / "solid", tmp_path / "set.pack", share=1e-3)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["solid"]
    assert pack(made, tmp_path / "a.pack", share=0.01)["share"] == 0.01
    assert pack(tmp_path / "solid", tmp_path / "b.pack")["tolerance"] == 1e-6
