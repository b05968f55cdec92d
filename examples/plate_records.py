"""Plates for code that reads DeepMind's deforming_plate: made, exported with stress, and read back by hand, with numpy alone.

Such code takes meta.json and train.tfrecord as they are. What it finds at each node (place, kind and von Mises' stress) is compared
with the trajectory's own file. A set worth training on comes from

    ./run fidelity generate plate --fields stress --out plates
    ./run fidelity dataset export plates --out records
"""

import json
import struct
from pathlib import Path

import numpy as np

from datagen import export_records, generate, load_family, read_trajectory

Path("few.toml").write_text("""
material = { young_modulus = 1e6, poisson_ratio = 0.4 }
support = [{ where = "edge-4" }]
steps = { count = 5 }
obstacle = { shape = "sphere", radius = 0.03, path = [[0.09, { uniform = [0.03, 0.07] }, 0.0421], [0.09, 0.05, 0.032]] }
body = { shape = "panel", height = 0.012, layers = 1, cell_size = 0.03, cell = "tetrahedron", order = 2, outline = %s }
""" % [[0, 0], [0.12, 0], [0.12, 0.1], [0, 0.1]])
generate(load_family("few.toml"), {"train": 2}, "plates", workers=1, stress=True)
export_records("plates", "records")


def number(data, at):
    """A number of protobuf, seven bits a byte, and where it ends."""
    found = shift = 0
    while data[at] > 127:
        found, shift, at = found | (data[at] & 127) << shift, shift + 7, at + 1
    return found | data[at] << shift, at + 1


def parts(data):
    """The messages within a protobuf message, whose fields are all of the kind that tells its length."""
    at = 0
    while at < len(data):
        length, at = number(data, at + 1)
        yield data[at:(at := at + length)]


features = json.loads(Path("records/meta.json").read_text())["features"]
data, at, plates = Path("records/train.tfrecord").read_bytes(), 0, []
while at < len(data):  # length, checksum, an Example of one Features of pairs (name, Feature of one BytesList), checksum
    length = struct.unpack_from("<Q", data, at)[0]
    pairs = [list(parts(pair)) for pair in parts(next(parts(data[at + 12:at + 12 + length])))]
    raw = {name.decode(): next(parts(next(parts(feature)))) for name, feature in pairs}
    plates.append({name: np.frombuffer(raw[name], about["dtype"]).reshape(about["shape"]) for name, about in features.items()})
    at += length + 16

for i, plate in enumerate(plates):
    mine = read_trajectory(f"plates/train/{i:04d}.vtkhdf")
    assert abs(plate["world_pos"] - (mine.points + mine.exact)).max() < 2e-8 and np.array_equal(plate["node_type"][0, :, 0], mine.node_kind)
    assert np.array_equal(plate["stress"], mine.fields["von_mises"]) and set(np.unique(plate["node_type"])) == {0, 1, 3}
print(f"{len(plates)} plates, {plate['mesh_pos'].shape[1]} nodes, {len(plate['stress'])} frames, up to {plate['stress'].max():.3g} Pa")
