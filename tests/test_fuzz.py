"""Damaged input of every kind ends in status 0, 1 or 2 with one line: no traceback, no signal, no warning, nothing half written.

The seed is printed; FUZZ_SEED takes another. What is damaged is drawn from it: scenes key by key and letter by letter, trajectories,
packed sets, checkpoints and records byte by byte, trajectories also array by array.
"""

import hashlib
import json
import os
import random
import shutil

import h5py
import numpy as np
import pytest
import tomli_w

import fidelity
from datagen.files.trajectory import problems, read_trajectory
from tests.fuzzing import run_all
from tests.test_cli_file_body import CONFIG, SCENE, write_part
from tests.test_cli_imports import PLATE, hanging, plane, write_set

pytestmark = pytest.mark.slow
SEED = int(os.environ.get("FUZZ_SEED", "0"))
BEAM = {"body": {"length": 0.06, "width": 0.02, "height": 0.02, "cells": [3, 1, 1], "cell": "hexahedron", "element": "standard"},
        "material": {"law": "neo-hookean", "young_modulus": 1e6, "poisson_ratio": 0.3, "density": 1e3}, "name": "beam",
        "support": [{"where": "x-min", "fixed": "xyz", "displacement": [0.0, 0.0, 0.0]}], "steps": {"count": 2}}
PATH = [[0.05, 0.01, 0.0305], [0.05, 0.01, 0.028]]
BASES = [
    BEAM | {"load": [{"where": "x-max", "traction": [0.0, 0.0, -10.0]}, {"acceleration": [0.0, 1.0, -1.0]}]},
    BEAM | {"obstacle": {"shape": "cylinder", "radius": 0.01, "axis": [0.0, 1.0, 0.0], "path": PATH, "contact": "nodes"}},
    BEAM | {"obstacle": {"shape": "box", "size": [0.02, 0.02, 0.02], "radius": 0.001, "path": PATH}},
    BEAM | {"obstacle": {"shape": "capsule", "radius": 0.01, "length": 0.02, "axis": [0.0, 1.0, 0.0], "path": PATH}},
    BEAM | {"obstacle": {"shape": "half-space", "normal": [0.0, 0.0, -1.0], "path": [[0.0, 0.0, 0.021], [0.0, 0.0, 0.0195]]}},
    BEAM | {"steps": {"count": 2, "dynamic": True, "duration": 0.01, "velocity": [0.0, 0.0, 0.1]},
            "load": [{"where": "x-max", "traction": [0.0, 0.0, -10.0], "sudden": True}]},
    BEAM | {"body": {"shape": "file", "path": "part.msh"}, "support": [{"where": "wall"}],
            "load": [{"where": "tip", "traction": [0.0, 0.0, 10.0]}]}]
VALUES = [float("nan"), float("inf"), 1e300, -1e300, 1e-300, 5e-324, 1.7e308, 0, 0.0, -0.0, -1, -1e-3, 1e9, 1e18, -1e9, 1e-9, 1e5, 2**63,
          10**400, -10**400, True, "", "x" * 300, "\0", "\n", "é", [], [[]], {}, {"a": 1}, [1e300] * 3, [1e-300] * 3, [0, 0, 0], ["x"] * 3,
          [1e9] * 3, [[1e300] * 3] * 2, [[0.05, 0.01, 0.0305], [1e9, 0.0, 0.0]], "x-min", "file", "channel", "triangle", 0.499999999999]


def damaged_scene(rng):
    """The bytes of a scene in which something is wrong, or nothing."""
    table = json.loads(json.dumps(rng.choice(BASES)))
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        at, key = table, None
        while True:
            key = rng.choice(list(at)) if isinstance(at, dict) else rng.randrange(len(at))
            if not isinstance(at[key], dict | list) or not at[key] or rng.random() < 0.2:
                break
            at = at[key]
        what = rng.random()
        if what < 0.75 or isinstance(at, list):
            scaled = type(at[key]) is float and rng.random() < 0.6
            at[key] = at[key] * 10.0 ** rng.uniform(-9, 9) if scaled else rng.choice(VALUES)
        elif what < 0.9:
            del at[key]
        else:
            at[rng.choice(("x", "é" * 300, "", "where", "path", "radius"))] = rng.choice(VALUES)
        if not table:
            break
    text = tomli_w.dumps(table).encode()
    what = rng.random()
    if what < 0.02:
        return b"\xef\xbb\xbf" + text
    if what < 0.05:
        deep = (b"a = " + b"[" * 20_000, b"a = " + b"{a = " * 20_000, b"a" + b".a" * 20_000 + b" = 1", b"a = " + b"9" * 5000)
        return text + rng.choice(deep)
    return damaged_bytes(rng, text) if what < 0.2 else text


def damaged_bytes(rng, data):
    """Bytes of which some are others, missing, zero or twice."""
    data, what = bytearray(data), rng.random()
    if what < 0.6:
        for _ in range(rng.choice((1, 2, 8, 64))):
            data[rng.randrange(len(data))] = rng.randrange(256)
    elif what < 0.8:
        del data[rng.randrange(len(data)):]
    else:
        start = rng.randrange(len(data))
        data[start:start + rng.choice((1, 8, 512))] = rng.choice((b"", bytes(8), bytes(512), b"\xff" * 8, bytes(data[:64])))
    return bytes(data)


def damaged_arrays(rng, path):
    """An array or attribute of an HDF5 file replaced by something else, or gone."""
    with h5py.File(path, "a") as file:
        names, other = [], rng.random()
        file.visititems(lambda name, found: names.append(name) if isinstance(found, h5py.Dataset) else None)
        if other < 0.3:
            name = rng.choice(list(file.attrs))
            file.attrs[name] = rng.choice(("", "x", "[" * 20_000, "null", "[1]", '{"a": 1}', 7, -1, np.nan, np.zeros(3)))
            return
        name = rng.choice(names)
        old = file[name][()]
        del file[name]
        real = old.astype(np.float64)
        new = rng.choice((None, old[:-1], old[:0], np.concatenate([old, old]), real * np.nan, real * 1e300,
                          old.astype(str).astype("S"), old[None], np.int64(3), -old.astype(np.int64), old + 10**6, old.astype(np.float16)))
        if new is not None:
            file[name] = new


def contents(folder, but=()):
    """SHA-256 of every file below a folder."""
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.rglob("*"))
            if path.is_file() and path.name not in ("said.out", "said.err", *but)}


def outcomes(tmp_path, cases, made):
    """Run the cases, folders and commands; what is wrong with how they end, a line each. `made`: what a command may write over."""
    before = [contents(folder) for folder, _ in cases]
    statuses = run_all([[str(folder), command] for folder, command in cases], tmp_path / "cases.json")
    wrong = []
    for (folder, command), status, there in zip(cases, statuses, before, strict=True):
        out, err = ((folder / name).read_text(errors="replace") for name in ("said.out", "said.err"))
        new = {name: digest for name, digest in contents(folder).items() if there.get(name) != digest}
        lines = err.splitlines()
        if status not in (0, 1, 2) or "Traceback" in err or "Warning" in err or (status and len(lines) != 1):
            wrong.append(f"{folder.name}: status {status} of {' '.join(command)}: {err[-700:]}")
        elif status and not lines[0].startswith("fidelity: "):
            wrong.append(f"{folder.name}: {lines[0]}")
        elif "NaN" in out or "Infinity" in out or (status == 0 and " nan" in err):
            wrong.append(f"{folder.name}: not a number in {out[:300]}")
        elif status == 2 and new:
            wrong.append(f"{folder.name}: status 2 left {list(new)}")
        elif status == 0 and "a.vtkhdf" in new and problems(read_trajectory(folder / "a.vtkhdf")):
            wrong.append(f"{folder.name}: status 0 wrote what is {problems(read_trajectory(folder / 'a.vtkhdf'))}")
        elif left := [name for name in new if name.endswith((".probe", ".new")) or ("/." in f"/{name}" and name.endswith(".part"))]:
            wrong.append(f"{folder.name}: left {left}")
        elif "--resume" not in command and (changed := [name for name in new if name in there and not (
                status == 0 and name.startswith(made) and name in command)]):
            wrong.append(f"{folder.name}: changed {changed}")
    found = {status: statuses.count(status) for status in sorted(set(statuses))}
    print(f"seed {SEED}: {len(cases)} cases in {tmp_path}, status: number of them {found}", *wrong, sep="\n")
    return wrong


def test_200_damaged_scenes(tmp_path):
    rng, cases = random.Random(f"scenes {SEED}"), []
    for number in range(200):
        folder = tmp_path / f"{number:03d}"
        folder.mkdir()
        write_part(folder / "part.msh")
        (folder / "scene.toml").write_bytes(damaged_scene(rng))
        verb = rng.choice((["simulate", "scene.toml", "--out", "a.vtkhdf"], ["simulate", "scene.toml", "--out", "a.vtkhdf"],
                           ["modes", "scene.toml", "--count", "2"]))
        cases.append((folder, [*verb, "--json"]))
    assert outcomes(tmp_path, cases, ()) == []


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A folder with one of everything: a solved file body, a set of its kind, a pack, a trained run, records."""
    folder = tmp_path_factory.mktemp("sound")
    write_part(folder / "part.msh")
    (folder / "family.toml").write_text(SCENE.format(modulus="{ uniform = [1e6, 2e6] }") + "[splits]\ntrain = 1\nvalid = 0\ntest = 1\n")
    (folder / "config.toml").write_text(CONFIG)
    write_set(folder / "records", plane(world_pos=hanging()), ["train"])
    assert len(PLATE.points) == 35
    os.chdir(folder)
    for command in ("generate family.toml --out data --workers 1", "dataset pack data --out data.pack",
                    "train config.toml --data data --out run"):
        assert fidelity.main(command.split()) == 0
    return folder


def test_100_damaged_trajectories_packs_checkpoints_and_records(tmp_path, sound, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng, cases, truth = random.Random(f"files {SEED}"), [], "data/test/0000.vtkhdf"
    for number in range(100):
        folder = tmp_path / f"{number:03d}"
        shutil.copytree(sound, folder)
        kind = ("trajectory", "arrays", "pack", "checkpoint", "records")[number % 5]
        if kind in ("trajectory", "arrays"):
            command = rng.choice((f"verify {truth} --reference {truth}", f"verify data/train/0000.vtkhdf --reference {truth}",
                                  f"verify {truth} --reference data/train/0000.vtkhdf", "dataset check data", "dataset stats data",
                                  f"rollout run {truth} --out p.vtkhdf", "train config.toml --data data --out run2",
                                  f"simulate scene.toml --out {truth}", "evaluate run --data data --out report",
                                  "dataset pack data --out p.pack", "dataset export data --out back --cells own"))
            if kind == "arrays":
                damaged_arrays(rng, folder / truth)
                if "train" in command:
                    shutil.copy(folder / truth, folder / "data/train/0000.vtkhdf")
            else:
                (folder / truth).write_bytes(damaged_bytes(rng, (folder / truth).read_bytes()))
            (folder / "scene.toml").write_text(SCENE.format(modulus=1e6))
        else:
            name, command = {
                "pack": ("data.pack", "dataset unpack data.pack --out unpacked"),
                "checkpoint": (rng.choice(("run/model.safetensors", "run/range.json", "run/last.safetensors")),
                               rng.choice((f"rollout run {truth} --out p.vtkhdf", "evaluate run --data data --out report",
                                           "train config.toml --data data --out run --steps 4 --resume"))),
                "records": (rng.choice(("records/train.tfrecord", "records/meta.json")), "dataset import records --out imported")}[kind]
            (folder / name).write_bytes(damaged_bytes(rng, (folder / name).read_bytes()))
        cases.append((folder, [*command.split(), *["--json"] * ("check" not in command)]))
    assert outcomes(tmp_path, cases, ("run", truth)) == []
