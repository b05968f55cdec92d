"""What a trajectory keeps of a mesh file: the places that supports and loads are at, and which file it was.

The mesh of a shape follows from its scene. That of a file is as in the trajectory: points and cells stand there anyway, and beside
them each named place with its nodes and with the vertices, lines, faces and cells that it is made of, so the scene's equations can be
computed anew wherever the trajectory is. The file's path and the SHA-256 of its bytes tell whether it is still the same.

Legend: n things, k corners of one.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from physics.mesh.cell import CELLS
from physics.mesh.mesh import Mesh
from physics.scene import FlowScene, Scene
from physics.schema import InputError

# Of each place its "nodes" (n,), and under the names of cells (n, k) what it is made of; a place of nodes alone has no more.
Places = dict[str, dict[str, NDArray[np.int64]]]


def places_of(mesh: Mesh) -> Places:
    """The places of a mesh."""
    found: Places = {}
    for name, nodes in mesh.places.items():
        found[name] = {"nodes": np.asarray(nodes, np.int64)}
        parts = mesh.parts.get(name, [])
        for kind in dict.fromkeys(kind for kind, _ in parts):
            found[name][kind] = np.concatenate([cells for other, cells in parts if other == kind])
    return found


def with_places(mesh: Mesh, places: Places) -> Mesh:
    """The mesh with these places."""
    parts = {name: [(kind, array) for kind, array in place.items() if kind != "nodes"] for name, place in places.items()}
    return replace(mesh, places={name: place["nodes"] for name, place in places.items()},
                   parts={name: made for name, made in parts.items() if made})


def write_places(file: h5py.Group, places: Places) -> None:
    """Into the group /places: @names (JSON), and a group 0, 1, ... for each, whose datasets are named as in `Places`."""
    group = file.create_group("places")
    group.attrs["names"] = json.dumps(list(places))
    for number, place in enumerate(places.values()):
        for kind, array in place.items():
            group.create_dataset(f"{number}/{kind}", data=array)


def read_places(file: h5py.Group) -> Places | None:
    """What `write_places` wrote; None where it wrote nothing. Raises `InputError` for something else."""
    if "places" not in file:
        return None
    group = file["places"]
    found: Places = {}
    for number, name in enumerate(json.loads(group.attrs["names"])):
        found[name] = {kind: array[()] for kind, array in group[str(number)].items()}
    return found


def wrong_places(places: Places, nodes: int) -> str:
    """What is wrong with the places of a body of so many nodes; empty when nothing is."""
    for name, place in places.items():
        if "nodes" not in place:
            return f"place {name!r} has no nodes"
        for kind, array in place.items():
            width = () if kind == "nodes" else (CELLS[kind].nodes,) if kind in CELLS else None
            if width is None or array.dtype != np.int64 or array.ndim != 1 + len(width) or array.shape[1:] != width:
                return f"place {name!r} has {kind!r} of an unknown form"
            if array.size and not (array.min() >= 0 and array.max() < nodes):
                return f"place {name!r} names a node outside of 0 .. {nodes - 1}"
    return ""


def mesh_file(scene: Scene | FlowScene) -> dict[str, str]:
    """The path of the mesh file of a scene and the SHA-256 of its bytes. Raises `InputError` when it cannot be read."""
    assert scene.body.path is not None
    try:
        return {"path": scene.body.path, "sha256": hashlib.sha256(Path(scene.body.path).read_bytes()).hexdigest()}
    except OSError as error:
        raise InputError(f"{scene.body.path}: {error.strerror}") from None


def remarks_on_file(extra: dict[str, Any]) -> list[str]:
    """A line when the mesh file that a trajectory was solved on, in its `extra`, is not there as it was, seen from this folder."""
    known = extra.get("mesh_file")
    if not isinstance(known, dict) or not isinstance(path := known.get("path"), str):
        return []
    try:
        same = hashlib.sha256(Path(path).read_bytes()).hexdigest() == known.get("sha256")
    except (OSError, ValueError):
        return [f"the mesh file {path} is not to be found from here; what counts is the mesh in the trajectory"]
    return [] if same else [f"the mesh file {path} has changed since; what counts is the mesh in the trajectory"]
