"""A data set of four tiny trajectories, made once, for all tests that need one."""

import subprocess

import pytest

from datagen.family.family import load_family
from datagen.sets import generate

SMALL = """
name = "small"
[body]
length = { uniform = [0.08, 0.1] }
width = 0.02
height = 0.02
cells = [6, 2, 2]
[material]
young_modulus = 1e6
poisson_ratio = 0.4
[[support]]
where = "x-min"
[obstacle]
shape = "cylinder"
radius = 0.01
place = { along = 0.8, gap = 0.001, depth = 0.01 }
[steps]
count = 6
[splits]
train = 2
valid = 1
test = 1
"""
COUNTS = {"train": 2, "valid": 1, "test": 1}
FILES = ["train/0000.vtkhdf", "train/0001.vtkhdf", "valid/0000.vtkhdf", "test/0000.vtkhdf"]


@pytest.fixture(scope="session")
def family(tmp_path_factory):
    path = tmp_path_factory.mktemp("family") / "small.toml"
    path.write_text(SMALL)
    return load_family(path)


@pytest.fixture(scope="session")
def original(family, tmp_path_factory):
    """A small data set made by two workers; tests copy it before they change it."""
    folder = tmp_path_factory.mktemp("original")
    report = generate.generate(family, COUNTS, folder, workers=2)
    assert (report["trajectories"], report["new"], report["failed_attempts"]) == (4, 4, 0)
    return folder


@pytest.fixture
def folder(original, tmp_path):
    subprocess.run(["cp", "-r", original, tmp_path / "data"], check=True)
    return tmp_path / "data"
