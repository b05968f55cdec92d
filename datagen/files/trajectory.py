"""One trajectory file: a body and its obstacles over all steps.

The file is VTKHDF (HDF5 by another name): ParaView opens it with a time slider, h5py reads it as arrays. PyVista shows the first
frame; `reader = pyvista.get_reader(path); reader.reader.SetStep(7); mesh = reader.read()` is frame 7.
Legend: T frames (step 0 is the rest state, so T = steps + 1), N nodes (body first, obstacle last), C cells, m modes.

    /VTKHDF                     @Type "UnstructuredGrid", @Version [2, 1]
      Points                    (N, 3) float64  rest positions [m]
      Connectivity, Offsets     (sum of cell sizes,), (C + 1,) int64
      Types                     (C,) uint8      VTK cell types: 13 prism, 10 tetrahedron, 12 hexahedron, 5 triangle, 9 quadrilateral; of
                                                second order 24 tetrahedron, 29 hexahedron, 22 triangle, 28 quadrilateral
      NumberOfPoints, NumberOfCells, NumberOfConnectivityIds   (1,) int64: the mesh is stored once
      PointData
        displacement            (T N, 3) float32  [m], frame after frame, one chunk a frame
        remainder               (T N, 3) float32  [m] what rounding it took, to 12 bits; a file may lack it. Second-order cells have it
        node_kind               (N,) uint8       NORMAL 0, OBSTACLE 1, HANDLE 3: held in all components (the numbers of the
                                                 public mesh data sets, which also have AIRFOIL 2, INFLOW 4, OUTFLOW 5, WALL 6)
        mode_1 ... mode_m       (N, 3) float32   elastic modes, zero on the obstacle; largest displacement 1
        segment                 (N,) int32       optional
        NAME                    (T N, k) float32  optional: whatever else changes, such as stress (fields.py, or that of
                                                  an imported set); @fields
      FieldData                 one row for each frame
        obstacle                (T, 3) float64   [m] its centre; a file may lack it. Of several obstacle_1, obstacle_2, ...
        reaction                (T, 3) float64   [N] force of the body on the obstacle (without one: on its supports). Of several
                                                 the sum; of each reaction_1, reaction_2, ...
        energy                  (T,) float64     [J] stored
        penetration             (T,) float64     [m] largest, 0 without contact
        smallest_det_f          (T,) float64
        newton_iterations       (T,) int64
        relative_residual       (T,) float64     |residual force| / |reaction|
        snap                    (T,) float64     [m] farthest way of a node without equilibria between, mostly 0 (equilibrium/snap.py)
        released                (T,) float64     [J] stored energy and work of dead loads lost on that way
        kinetic_energy          (T,) float64     [J] of dynamic scenes
      Steps                     @NSteps T; Values (T,) 0 .. steps, of dynamic scenes the times [s]; offsets that tell a reader
                                where each frame starts
    /places                     of a body from a mesh file: @names (JSON), and under 0, 1, ... of each place nodes (n,) and what it
                                is made of, such as triangle (n, 3); int64 node numbers (places.py)
    /                           @schema, @scene (TOML), @seed, @index, @versions (JSON), @commit, @complete, @frequencies_hz,
                                @extra (JSON: whatever else the writer knows, such as the run that made a rollout)

A rollout of a learned simulator has the same layout; the FieldData that it does not know are absent.
A file is written under another name, flushed to disk and renamed: a reader never sees half of one.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from datagen.files.layout import exact, is_remainder, misshapen, of_nodes
from datagen.files.places import Places, read_places, with_places, write_places, wrong_places
from physics.mesh.cell import CELLS, OF_VTK
from physics.mesh.mesh import Mesh
from physics.schema import InputError, missing
from physics.whole import write_whole

SCHEMA = 1
NORMAL, OBSTACLE, AIRFOIL, HANDLE, INFLOW, OUTFLOW, WALL = range(7)
KINDS = (NORMAL, OBSTACLE, AIRFOIL, HANDLE, INFLOW, OUTFLOW, WALL)


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """The content of one file; shapes as in the module's docstring."""

    points: NDArray[np.float64]
    connectivity: NDArray[np.int64]
    offsets: NDArray[np.int64]
    types: NDArray[np.uint8]
    node_kind: NDArray[np.uint8]
    displacement: NDArray[np.float32]  # (T, N, 3)
    modes: NDArray[np.float32]  # (m, N, 3)
    frequencies_hz: tuple[float, ...] = ()
    segment: NDArray[np.int32] | None = None
    per_frame: dict[str, NDArray[Any]] = field(default_factory=dict)
    fields: dict[str, NDArray[np.float32]] = field(default_factory=dict)  # (T, N, k) each
    scene: str = ""
    seed: int = 0
    index: int = 0
    versions: dict[str, str] = field(default_factory=dict)
    commit: str = ""
    complete: bool = True
    extra: dict[str, Any] = field(default_factory=dict)
    places: Places | None = None  # of a body from a mesh file
    remainder: NDArray[np.float32] | None = None  # (T, N, 3)

    @property
    def body(self) -> NDArray[np.bool_]:
        """(N,) True on the nodes of the body."""
        return self.node_kind != OBSTACLE

    @property
    def exact(self) -> NDArray[np.float64]:
        """(T, N, 3) [m] displacements as they were solved for, as far as the file knows them."""
        return exact(self.displacement, self.remainder)

    @property
    def flows(self) -> bool:
        """Whether this is a flow: a velocity on a mesh at rest."""
        return "velocity" in self.fields and not self.displacement.any()

    @property
    def free(self) -> NDArray[np.bool_]:
        """(N,) True on the nodes that the simulation moves: neither obstacle nor held."""
        return self.node_kind == NORMAL

    @property
    def mesh(self) -> Mesh:
        """The body at rest; its places are known where it came from a mesh file."""
        cells = self.cells_of(self.types[0])
        mesh = Mesh(self.points[self.body], cells[self.body[cells].all(axis=1)], OF_VTK[int(self.types[0])].name, {})
        return mesh if self.places is None else with_places(mesh, self.places)

    @property
    def obstacle(self) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
        """The obstacle's surface in all frames: points (T, M, 3) [m] and triangles (F, 3) among them; None without one."""
        if self.body.all():
            return None
        triangles = self.cells_of(CELLS["triangle"].vtk)
        triangles = triangles[~self.body[triangles].any(axis=1)] - np.count_nonzero(self.body)
        return self.points[~self.body] + self.displacement[:, ~self.body], triangles

    def cells_of(self, vtk_type: int) -> NDArray[np.int64]:
        """(C, n) node numbers of the cells of one VTK type."""
        first = self.offsets[:-1][self.types == vtk_type]
        return self.connectivity[first[:, None] + np.arange(OF_VTK[vtk_type].nodes)]


def at_rest(mesh: Mesh, modes: NDArray[np.floating[Any]], **attributes: Any) -> Trajectory:
    """A mesh with its modes (m, N, 3) and no motion: one frame, the rest state."""
    corners = mesh.cells.shape[1]
    return Trajectory(
        points=mesh.points, connectivity=mesh.cells.ravel(), offsets=corners * np.arange(len(mesh.cells) + 1),
        types=np.full(len(mesh.cells), CELLS[mesh.cell].vtk, np.uint8), node_kind=np.zeros(len(mesh.points), np.uint8),
        displacement=np.zeros((1, len(mesh.points), 3), np.float32), modes=np.asarray(modes, np.float32), **attributes)


def write_trajectory(path: str | Path, trajectory: Trajectory) -> None:
    """Write a whole file, or none: it appears under its name only when it is complete on disk.

    Raises:
        InputError: displacements of the wrong shape, or positions in place of them
        OSError: it cannot be written
    """
    trajectory = replace(trajectory, displacement=of_nodes(trajectory))
    # The file is made in memory: on a full disk HDF5 would fill pages with its complaints, and later on again.
    with h5py.File(f"{path} in memory", "w", driver="core", backing_store=False, libver=("earliest", "v110")) as file:
        _write(file, trajectory)
        file.flush()
        image = file.id.get_file_image()
    write_whole(path, image)


def _write(file: h5py.File, trajectory: Trajectory) -> None:
    frames, nodes = trajectory.displacement.shape[:2]
    root = file.create_group("VTKHDF")
    root.attrs["Version"] = np.array([2, 1])
    root.attrs.create("Type", np.bytes_("UnstructuredGrid"))
    mesh = {"Points": trajectory.points, "Connectivity": trajectory.connectivity, "Offsets": trajectory.offsets,
            "Types": trajectory.types, "NumberOfPoints": np.array([nodes]),
            "NumberOfCells": np.array([len(trajectory.types)]),
            "NumberOfConnectivityIds": np.array([len(trajectory.connectivity)])}
    for name, array in mesh.items():
        root.create_dataset(name, data=array)

    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = frames
    steps.create_dataset("Values", data=np.arange(frames) * float(trajectory.extra.get("step_seconds", 1.0)))
    steps.create_dataset("NumberOfParts", data=np.ones(frames, np.int64))
    for name in ("PartOffsets", "PointOffsets"):
        steps.create_dataset(name, data=np.zeros(frames, np.int64))
    for name in ("CellOffsets", "ConnectivityIdOffsets"):
        steps.create_dataset(name, data=np.zeros((frames, 1), np.int64))

    points = root.create_group("PointData")
    offsets = steps.create_group("PointDataOffsets")
    rest = {} if trajectory.remainder is None else {"remainder": trajectory.remainder}
    for name, moving in {"displacement": trajectory.displacement, **rest, **trajectory.fields}.items():
        points.create_dataset(name, data=moving.reshape(frames * nodes, -1), chunks=(nodes, moving.shape[2]),
                              compression="gzip", compression_opts=4, shuffle=True, fletcher32=True)
        offsets.create_dataset(name, data=nodes * np.arange(frames, dtype=np.int64))
    static: dict[str, NDArray[Any]] = {"node_kind": trajectory.node_kind}
    static |= {f"mode_{i + 1}": mode for i, mode in enumerate(trajectory.modes)}
    if trajectory.segment is not None:
        static["segment"] = trajectory.segment
    for name, array in static.items():
        points.create_dataset(name, data=array)
        offsets.create_dataset(name, data=np.zeros(frames, np.int64))

    fields = root.create_group("FieldData")
    offsets, sizes = steps.create_group("FieldDataOffsets"), steps.create_group("FieldDataSizes")
    for name, array in trajectory.per_frame.items():
        fields.create_dataset(name, data=array)
        offsets.create_dataset(name, data=np.arange(frames, dtype=np.int64))
        sizes.create_dataset(name, data=np.tile([array.shape[1] if array.ndim == 2 else 1, 1], (frames, 1)))

    file.attrs.update(schema=SCHEMA, scene=trajectory.scene, seed=trajectory.seed, index=trajectory.index,
                      versions=json.dumps(trajectory.versions), commit=trajectory.commit, complete=trajectory.complete,
                      frequencies_hz=np.array(trajectory.frequencies_hz, np.float64), extra=json.dumps(trajectory.extra))
    if trajectory.places is not None:
        write_places(file, trajectory.places)
    if trajectory.fields:
        file.attrs["fields"] = json.dumps(list(trajectory.fields))


def read_trajectory(path: str | Path) -> Trajectory:
    """Read a whole file. Raises `InputError` in one line when it is missing, cut short, damaged or of another kind."""
    path = Path(path)
    if why := missing(path):
        raise InputError(f"{path}: {why}")
    try:
        with h5py.File(path, "r") as file:
            found = _read(file)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (OSError, KeyError, IndexError, ValueError, TypeError, AttributeError, OverflowError, RuntimeError) as error:
        raise InputError(f"{path}: not a whole trajectory file: {f'{error}'.strip().partition(chr(10))[0]}") from None
    if wrong := misshapen(found):
        raise InputError(f"{path}: not a whole trajectory file: {wrong}")
    return found


def unfinished(path: str | Path) -> str | None:
    """The scene of a file whose solver stopped before the last step; None for a finished one. Raises `InputError`."""
    try:
        with h5py.File(path, "r") as file:
            return None if file.attrs["complete"] else str(file.attrs["scene"])
    except (OSError, KeyError) as error:
        raise InputError(f"{path}: not a trajectory file: {f'{error}'.strip().partition(chr(10))[0]}") from None


def _read(file: h5py.File) -> Trajectory:
    if file.attrs.get("schema") != SCHEMA:
        raise InputError(f"trajectory schema {file.attrs.get('schema')}, this program reads {SCHEMA}")
    root, points = file["VTKHDF"], file["VTKHDF/PointData"]
    frames, nodes = int(root["Steps"].attrs["NSteps"]), int(root["NumberOfPoints"][0])
    modes = [points[f"mode_{i + 1}"][()] for i in range(sum(name.startswith("mode_") for name in points))]
    attributes = file.attrs
    return Trajectory(
        points=root["Points"][()], connectivity=root["Connectivity"][()], offsets=root["Offsets"][()],
        types=root["Types"][()], node_kind=points["node_kind"][()],
        displacement=points["displacement"][()].reshape(frames, nodes, 3),
        remainder=points["remainder"][()].reshape(frames, nodes, 3) if "remainder" in points else None,
        modes=np.array(modes, np.float32).reshape(len(modes), nodes, 3),
        frequencies_hz=tuple(attributes["frequencies_hz"].tolist()),
        segment=points["segment"][()] if "segment" in points else None,
        per_frame={name: array[()] for name, array in root["FieldData"].items()},
        fields={name: points[name][()].reshape(frames, nodes, -1) for name in json.loads(attributes.get("fields", "[]"))},
        scene=str(attributes["scene"]), seed=int(attributes["seed"]), index=int(attributes["index"]),
        versions=json.loads(attributes["versions"]), commit=str(attributes["commit"]),
        complete=bool(attributes["complete"]), extra=json.loads(attributes["extra"]), places=read_places(file))


def read_sound(path: str | Path, *, complete: bool = True) -> Trajectory:
    """Read a whole file with nothing wrong in it as data. Raises `InputError` in one line otherwise.

    complete: False lets a trajectory pass whose solver stopped before the last step
    """
    trajectory = read_trajectory(path)
    for wrong in problems(trajectory if complete else replace(trajectory, complete=True)):
        raise InputError(f"{path}: {wrong}")
    return trajectory


def problems(trajectory: Trajectory) -> list[str]:
    """What is wrong with a trajectory as data, a line each; empty when nothing is. Its physics is checked elsewhere."""
    found = []
    nodes = len(trajectory.points)
    kinds = trajectory.node_kind
    ends = np.cumsum([OF_VTK[int(kind)].nodes if int(kind) in OF_VTK else 0 for kind in trajectory.types])
    if not trajectory.complete:
        found.append("the solver stopped before the last step")
    if not np.array_equal(trajectory.offsets, np.concatenate([[0], ends])) or ends[-1] != len(trajectory.connectivity):
        found.append("the offsets of the cells do not fit their types")
    if trajectory.connectivity.min() < 0 or trajectory.connectivity.max() >= nodes:
        found.append(f"a cell names a node outside of 0 .. {nodes - 1}")
    if not np.isin(kinds, KINDS).all() or (np.diff((kinds == OBSTACLE).astype(int)) < 0).any():
        found.append("the node kinds are not body first, obstacle last")
    arrays: dict[str, NDArray[Any]] = {"points": trajectory.points, "displacement": trajectory.displacement, "modes": trajectory.modes}
    for name, array in (arrays | trajectory.per_frame | trajectory.fields).items():
        if not np.isfinite(array).all():
            found.append(f"{name} is not finite everywhere")
    found += [f"{name} has {len(array)} rows for {len(trajectory.displacement)} frames"
              for name, array in trajectory.per_frame.items() if len(array) != len(trajectory.displacement)]
    if trajectory.places is not None and (wrong := wrong_places(trajectory.places, int(trajectory.body.sum()))):
        found.append(wrong)
    if trajectory.remainder is not None and not is_remainder(trajectory.remainder, trajectory.displacement):
        found.append("remainder is not what rounding took from displacement")
    if trajectory.scene and trajectory.displacement[0].any():
        found.append("the first frame is not the rest state")
    return found
