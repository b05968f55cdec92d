"""A prediction's file held against that of the trajectory it predicts: whoever made it, in the same format."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.files.layout import holds_positions
from datagen.files.places import remarks_on_file
from datagen.files.solved import as_solved, solved_on
from datagen.files.trajectory import Trajectory, read_sound, read_trajectory
from physics.fidelity.figures import FIGURES, Column, field_columns, gathered, of_field, shown, verdict
from physics.fidelity.verify import as_table, verify
from physics.mesh.mesh import Mesh
from physics.scene import Scene
from physics.schema import InputError, finite
from physics.whole import write_whole


def read_truth(path: str | Path) -> tuple[Trajectory, Scene, Mesh]:
    """A trajectory that predictions can be held against, with the scene as its last step was solved, and the mesh of this.

    Raises:
        InputError: something is wrong in the file, it holds no scene or a dynamic one, or its mesh is not the one that its scene builds
    """
    trajectory, scene, mesh = read_reference(path)
    if scene is None:
        raise InputError(f"{path}: holds no scene, so there are no equations to hold a prediction against")
    return trajectory, scene, mesh


def read_reference(path: str | Path) -> tuple[Trajectory, Scene | None, Mesh]:
    """The same, with None for the scene of a trajectory that holds none, such as an imported one: errors can be told, no more."""
    trajectory = read_sound(path)
    if trajectory.flows:
        raise InputError(f"{path}: a flow, and this is for solids")
    if len(trajectory.displacement) < 2:
        raise InputError(f"{path}: a single frame, so there is no step to predict")
    if not trajectory.free[trajectory.body].any():
        raise InputError(f"{path}: no node is free to move, so there is nothing to predict")
    if not trajectory.scene:
        return trajectory, None, trajectory.mesh
    try:
        scene = Scene.from_toml(trajectory.scene)
    except InputError as error:
        raise InputError(f"{path}: its scene is wrong: {error}") from None
    if scene.steps.dynamic:
        raise InputError(f"{path}: a body in motion; predictions are held against the equations of equilibrium, which it does not obey")
    mesh, own = solved_on(scene, trajectory), trajectory.mesh
    if not (np.array_equal(own.points, mesh.points) and np.array_equal(own.cells, mesh.cells)):
        raise InputError(f"{path}: its mesh is not the one that its scene builds")
    return trajectory, as_solved(scene, trajectory, len(trajectory.displacement) - 1), mesh


def read_prediction(path: str | Path, truth: Trajectory, reference: str | Path) -> tuple[NDArray[np.float64], Trajectory]:
    """(T, N, 3) the displacements of the body in a prediction's file, which stand for those of a truth, and all that the file holds.

    Raises:
        InputError: it is damaged, not finite, of another mesh or number of frames, in millimetres, or holds positions
    """
    made = read_trajectory(path)
    if made.displacement.shape != truth.displacement.shape or not np.array_equal(made.points, truth.points):
        raise InputError(f"{path}: its mesh or number of frames is not that of {reference}: {_shape(made)}, there {_shape(truth)}")
    finite_frames = np.isfinite(made.displacement).all(axis=(1, 2))
    if not finite_frames.all():
        raise InputError(f"{path}: its displacement is not finite at frame {int(finite_frames.argmin())}")
    u = made.exact[:, truth.body]
    if doubt := mistaken(u, truth.displacement[:, truth.body], truth.points[truth.body]):
        raise InputError(f"{path}: {doubt}")
    return u, made


def field_errors(fields: dict[str, NDArray[Any]], truth: Trajectory) -> dict[str, float]:
    """Root mean square errors of the further fields (T or 1, N, k) that a prediction and a truth have in common, by their keys, over all
    frames but the first, all numbers, and the nodes of the body."""
    found = {}
    for name, values in fields.items():
        true = truth.fields.get(name)
        if true is not None and values.shape[1:] == true.shape[1:]:
            error: NDArray[np.float64] = (np.broadcast_to(values, true.shape)[1:] - true[1:].astype(np.float64))[:, truth.body]
            found[of_field(name)] = float(np.sqrt((error**2).mean()))
    return found


def mistaken(u: NDArray[Any], truth: NDArray[Any], points: NDArray[Any]) -> str:
    """What a prediction (T, N, 3) is in place of displacements [m], by its looks beside a truth; empty when nothing is odd."""
    v = truth.astype(np.float64)
    if holds_positions(u, points):
        return "holds positions, it seems, not displacements: take the rest positions away (u - points)"
    size, true = np.linalg.norm(u), np.linalg.norm(v)
    if true and 300 < size / true < 3000 and np.vdot(u, v) > 0.5 * size * true:
        return f"its displacements are {size / true:.3g} times those of the truth: are they in millimetres? The file takes metres"
    return ""


def _shape(trajectory: Trajectory) -> str:
    frames, nodes = trajectory.displacement.shape[:2]
    return f"{frames} frames of {nodes} nodes"


def verify_files(prediction: str | Path, reference: str | Path, out: Path | None = None) -> dict[str, Any]:
    """A prediction's file, or a folder of them, held against its truths; with a folder for it, verify.json and the worst frame.

    Args:
        prediction, reference: two files, or two folders in which files of one name belong together

    Returns:
        the figures of `physics.fidelity.verify.Fidelity` in SI units, of several files their means, of extremes the extreme;
        "nothing_moves": those of a body that stays at rest, its further fields as in frame 0; "units",
        "verdict" in words, "remarks" on mesh files, and for folders "files": the figures of each

    Where the reference has no scene, those of the equations are not numbers.

    Raises:
        InputError: a file is damaged or not finite, or they are not of the same mesh and steps
    """
    pairs = together(Path(prediction), Path(reference))
    several, each, still, worst = Path(prediction).is_dir(), {}, [], None
    remarks: dict[str, None] = {}
    for name, file, truth_file in pairs:
        truth, scene, mesh = read_reference(truth_file)
        (u, made), body = read_prediction(file, truth, truth_file), truth.body
        v, free = truth.exact[:, body], truth.free[body]
        remarks |= dict.fromkeys(remarks_on_file(truth.extra))
        found = as_table(verify(u, v, scene=scene, mesh=mesh, free=free)) | field_errors(made.fields, truth)
        first = field_errors({field: truth.fields[field][:1] for field in made.fields if field in truth.fields}, truth)
        still.append(as_table(verify(np.where(free[:, None], 0, v), v, scene=scene, mesh=mesh, free=free)) | first)
        each[name] = found
        if worst is None or found["rmsd_all"] > worst[0]:
            worst = found["rmsd_all"], mesh, u, v, found["worst_step"], truth.obstacle
    figures = over_files(list(each.values())) if several else next(iter(each.values()))
    idle = over_files(still)
    result = {**figures, "nothing_moves": idle, "units": {name: column.si for name, column in _figures(figures).items()},
              "verdict": verdict(figures, idle), "remarks": list(remarks)} | ({"files": each} if several else {})
    if out is not None:
        from physics.view import ObstacleSurface, frame_picture

        assert worst is not None
        _, mesh, u, v, step, surface = worst
        write_whole(out / "verify.json", json.dumps(finite(result), indent=1).encode())
        frame_picture(out / "worst.png", mesh, prediction=u[step], truth=v[step], step=step, steps=len(v) - 1,
                      obstacle=None if surface is None else ObstacleSurface(*surface).at(step))
    return result


def lines(result: dict[str, Any]) -> list[str]:
    """What `verify_files` found, for a terminal: each figure in the unit of the reports beside that of a body at rest, and the verdict."""
    said = [f"{'':24s} {'prediction':>12s} {'nothing moves':>14s}"]
    for name, column in _figures(result).items():
        head = f"{column.head} [{column.unit}]" if column.unit else column.head
        values = [shown(column.factor * result[of][name] if of else column.factor * result[name]) for of in ("", "nothing_moves")]
        said.append(f"{head:24s} {values[0]:>12s} {values[1]:>14s}")
    return said + ending(result, 24, lambda of: f"RMSD-all {shown(1e3 * of['rmsd_all'])} mm, residual {shown(of['relative_residual'])}")


def ending(result: dict[str, Any], width: int, of_file: Callable[[dict[str, Any]], str]) -> list[str]:
    """What stands below a table whose first column is so wide: the worst frame, a line for each file, the verdict, remarks."""
    said = [f"{'farthest off at frame':{width}s} {result['worst_step']:12d}"] if "worst_step" in result else []
    said += [f"{name}: {of_file(figures)}" for name, figures in result.get("files", {}).items()]
    return [*said, result["verdict"], *(f"remark: {text}" for text in result["remarks"])]


def _figures(found: dict[str, Any]) -> dict[str, Column]:
    return FIGURES | field_columns(found)


def over_files(each: list[dict[str, Any]]) -> dict[str, float]:
    """What `gathered` makes of the figures of some files, of which each has a worst frame of its own."""
    return gathered([{key: value for key, value in figures.items() if key != "worst_step"} for figures in each])


def together(prediction: Path, reference: Path) -> list[tuple[str, Path, Path]]:
    """Name, prediction and truth of what belongs together. Raises `InputError`."""
    if not (prediction.is_dir() or reference.is_dir()):
        return [(prediction.stem, prediction, reference)]
    if missing := [path for path in (prediction, reference) if not path.exists()]:
        raise InputError(f"{missing[0]}: no such file or folder")
    if not (prediction.is_dir() and reference.is_dir()):
        one, other = (prediction, reference) if prediction.is_dir() else (reference, prediction)
        raise InputError(f"{one} is a folder and {other} is not one: give two files, or two folders with files of the same names")
    files = sorted(prediction.rglob("*.vtkhdf"))
    if not files:
        raise InputError(f"{prediction}: no trajectory files (.vtkhdf) in it")
    return [(str(file.relative_to(prediction).with_suffix("")), file, _named(reference, file.relative_to(prediction))) for file in files]


def _named(folder: Path, name: Path) -> Path:
    """The file of a name in a folder, or the only one of that name in the folders within. Raises `InputError`."""
    if (folder / name).is_file():
        return folder / name
    found = sorted(folder.rglob(name.name))
    if len(found) != 1:
        what = "several files" if found else "no file"
        raise InputError(f"{folder}: holds {what} of the name {name.name}, which is to be compared; a prediction is named as its truth")
    return found[0]


def find_prediction(folder: Path, truth: Path) -> Path:
    """The prediction in a folder that is named as a truth's file, or the file itself. Raises `InputError`."""
    return folder if folder.is_file() else _named(folder, Path(truth.parent.name, truth.name) if (folder / truth.parent.name).is_dir()
                                                  else Path(truth.name))
