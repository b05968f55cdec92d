"""Many obstacle paths for one body in one call: what a predictor of beams, or of bodies, says of each at some frames and nodes.

    SWEEP.h5    displacement (n, F, M, 3) [m], single precision, of the nodes (M,) at the frames (F,), datasets of these names
                largest (n, F) [m] displacement of any node of the body at the frame
                force (n, F) [N] of the obstacle: beam theory's, which is less than the elements' (docs/network.md), or theirs; nan
                of bodies by shapes, of which there is no theory
                bar (n, F) [m] error bar, and unsure (n, F), as in a rollout (docs/network.md): what the predictor says of itself
                state (n,) 0 predicted, 1 solved by finite elements, -1 they found no equilibrium and the prediction stands
                path (n, 2, 3) [m] ends of the obstacle's path
                varied/KEY (n,) what was drawn; attributes: scene (TOML, with its ranges), seed, run, SHA-256 of its weights

A draw depends on its number and the seed alone. All draws are read and judged before anything is predicted. What is predicted goes batch
by batch into a journal beside the file, which a later call of the same sweep goes on from.

Legend: n paths, F frames, M nodes of N.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from datagen.family.family import LARGEST_SPLIT
from datagen.family.vary import Variation, load_variation
from learning.bodies.at_once import AtOnce
from learning.bodies.body import see as see_body
from learning.bodies.model import Bodies
from learning.bodies.path import predict_many as predict_bodies
from learning.prediction.checkpoint import load_model
from learning.slender.beam import see
from learning.slender.many import PathFrames, alike, per_batch, predict_many
from learning.slender.model import Slender
from learning.slender.path import check_points
from physics.contact.obstacles import Rigid
from physics.journal import Journal
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.scene import Scene
from physics.schema import InputError
from physics.solution import solve
from physics.whole import written_whole

Floats = NDArray[np.floating[Any]]
BODIES = 16  # paths of bodies by shapes in a batch
LARGEST = 4e9  # bytes of displacements in one sweep
TOUCHES = 1e-6  # of the body's extent: how far inside an obstacle may start that is meant to touch
PREDICTED, SOLVED, UNSOLVED = 0, 1, -1


@dataclass(frozen=True)
class Rows:
    """Of n paths: the arrays of the module's docstring."""

    displacement: NDArray[np.float32]
    largest: Floats
    force: Floats
    bar: Floats
    unsure: NDArray[np.bool_]
    state: NDArray[np.int8]


@dataclass(frozen=True)
class Sweep:
    """What the module's docstring says; varied: by key, numbers or strings (n,); scene(i) is the scene of path i."""

    variation: Variation
    seed: int
    frames: NDArray[np.int64]
    nodes: NDArray[np.int64]
    varied: dict[str, NDArray[Any]]
    path: Floats
    rows: Rows
    about: dict[str, str]

    def scene(self, number: int) -> Scene:
        """The scene of a path, drawn again."""
        return self.variation.scene(self.seed, number)[0]


def sweep(scene: str | Path | dict[str, Any], run: str | Path, *, vary: Sequence[str] = (), changes: Sequence[str] = (),
          count: int | None = None, seed: int = 0, frames: Sequence[int] | None = None, nodes: str | Sequence[int] | None = None,
          solve_unsure: bool = False, journal: str | Path | None = None, say: Callable[[str], None] = lambda text: None) -> Sweep:
    """Predict many paths of one body.

    Args:
        scene: a file, or a table as TOML gives it: a scene or a family
        run: folder of a trained predictor of beams, or of bodies by shapes
        vary, changes: KEY=LOW:HIGH or KEY=A,B, and KEY=VALUE, see datagen/family/vary.py
        count: of paths; all points of the grids where there are any and no number is given
        frames: which are kept, the rest state being 0; the last alone when None
        nodes: which are kept: numbers, or the name of a place; all when None
        solve_unsure: solve paths by finite elements that have a kept frame of which the predictor is unsure
        journal: a file that keeps what was found, to go on from after a kill; it is left for the caller to delete

    Raises:
        InputError: before anything is predicted: wrong texts, a draw that is no scene or not of the predictor's kind, a run of another kind
    """
    variation = load_variation(scene, vary, changes, seed=seed)
    count = _count(variation, count)
    model, mesh = _model(run), build_mesh(variation.first.body)
    look = partial(see_body, mesh=mesh) if isinstance(model, Bodies) else see
    kept, chosen = _frames(variation.first, frames), _nodes(mesh, nodes)
    if 12 * count * len(kept) * len(chosen) > LARGEST:
        raise InputError(f"{count} paths, {len(kept)} frames and {len(chosen)} nodes are {12e-9 * count * len(kept) * len(chosen):.3g} GB: "
                         f"at most {1e-9 * LARGEST:g} GB; ask for fewer frames, or for the nodes of one place")
    if isinstance(model, Slender):
        check_points(see(variation.first), mesh.points)
    surface = mesh.points[np.unique(np.concatenate([facets.ravel() for facets in mesh.boundary]))]
    seen, values, ends = [], [], []
    for number in tqdm(range(count), desc="draw", unit="path", disable=None, leave=False):
        one, value = variation.scene(seed, number)
        try:
            _outside(one, surface)
            seen.append(look(one))
        except InputError as error:
            raise InputError(f"number {number}: {error}") from None
        values.append(value)
        ends.append(one.obstacles[0].path)
    varied = {key: np.array(column) for key, column in zip(variation.keys, zip(*values, strict=True), strict=True)}
    weights = hashlib.sha256(Path(run, "model.safetensors").read_bytes()).hexdigest()
    about = {"scene": variation.family.text, "seed": str(seed), "run": str(run), "weights": weights}
    kind = json.dumps([about["scene"], seed, weights, count, kept.tolist(), chosen.tolist()])
    with _store(journal, f"sweep {hashlib.sha256(kind.encode()).hexdigest()}", count) as store:
        fractions = kept / variation.first.steps.count
        with tqdm(total=count, desc="predict", unit="path", disable=None, leave=False) as bar:
            for some, predicted in _batches(model, seen, fractions, len(mesh.points)):
                if not store.has(some):
                    found = predicted()
                    far = np.sqrt(np.square(found.displacement).sum(axis=3).max(axis=2)).astype(float)
                    force = variation.first.stiffest * found.force
                    store.add(some, Rows(found.displacement[:, :, chosen], far, force, found.bar, found.unsure,
                                         np.full(len(some), PREDICTED, np.int8)))
                bar.update(len(some))
        if solve_unsure:
            _solve(variation, seed, mesh, kept, chosen, store, say)
        return Sweep(variation, seed, kept, chosen, varied, np.array(ends), store.rows, about)


def write_sweep(path: str | Path, found: Sweep) -> None:
    """The file of the module's docstring, whole or not at all. Raises OSError."""
    with written_whole(path) as part, h5py.File(part, "w") as file:
        file.attrs.update({"format": "fidelity sweep 1"} | found.about)
        for name in ("frames", "nodes", "path"):
            file[name] = getattr(found, name)
        for field in fields(Rows):
            file[field.name] = getattr(found.rows, field.name)
        for key, values in found.varied.items():
            file[f"varied/{key}"] = values if values.dtype.kind == "f" else values.astype(object)


def _outside(scene: Scene, surface: Floats) -> None:
    """Raises `InputError` for an obstacle that starts inside the body, whose equilibria nobody can solve for."""
    rigid = Rigid(scene.obstacles[0])
    start = rigid.position(0.0)
    for axis, (low, high) in zip(np.eye(3), zip(surface.min(axis=0), surface.max(axis=0), strict=True), strict=True):
        if start @ axis - rigid.shape.reach(-axis) >= high or start @ axis + rigid.shape.reach(axis) <= low:
            return  # beside the box of the body
    inside = -float(rigid.gap(surface, start)[0].min())
    if inside > TOUCHES * float(np.ptp(surface, axis=0).max()):
        raise InputError(f"obstacle.path: the obstacle starts {inside:.3g} m inside the body; start it outside")


def _count(variation: Variation, count: int | None) -> int:
    if count is None and variation.points == 1:
        raise InputError("--count: how many paths? Only grids alone say that themselves")
    count = variation.points if count is None else count
    if not 1 <= count <= LARGEST_SPLIT:
        raise InputError(f"--count {count}: must be from 1 to {LARGEST_SPLIT}")
    return count


def _model(run: str | Path) -> AtOnce:
    model = load_model(run)
    if not isinstance(model, AtOnce):
        raise InputError(f"{run}: is a network that walks through one mesh at a time; a sweep takes a predictor of beams by sections or of "
                         "bodies by shapes")
    return model


def _batches(model: AtOnce, seen: Sequence[Any], frames: Floats,
             nodes: int) -> Iterator[tuple[NDArray[np.int64], Callable[[], PathFrames]]]:
    """Numbers of paths that are predicted together, and what does so."""
    if isinstance(model, Bodies):
        for begin in range(0, len(seen), BODIES):
            some = seen[begin:begin + BODIES]
            yield np.arange(begin, begin + len(some)), partial(predict_bodies, model, some, frames)
        return
    batch = per_batch(model, frames, nodes)
    for members, paths in alike(seen):
        for begin in range(0, len(members), batch):
            yield members[begin:begin + batch], partial(predict_many, model, paths[begin:begin + batch], frames)


def _frames(scene: Scene, frames: Sequence[int] | None) -> NDArray[np.int64]:
    last = scene.steps.count
    chosen = np.array([last] if frames is None else frames, np.int64)
    if not len(chosen) or chosen.min() < 0 or chosen.max() > last:
        raise InputError(f"--frames {','.join(map(str, chosen.tolist()))}: must be from 0 to {last}")
    return chosen


def _nodes(mesh: Mesh, nodes: str | Sequence[int] | None) -> NDArray[np.int64]:
    if isinstance(nodes, str):
        return np.asarray(mesh.place(nodes), np.int64)
    chosen = np.arange(len(mesh.points)) if nodes is None else np.array(nodes, np.int64)
    if not len(chosen) or chosen.min() < 0 or chosen.max() >= len(mesh.points):
        raise InputError(f"--nodes {','.join(map(str, chosen.tolist()))}: must be from 0 to {len(mesh.points) - 1}, or the name of a place")
    return chosen


class _Store:
    """Rows as they are found, by the number of their path, a journal of them on disk where one is asked for."""

    def __init__(self, count: int, journal: Journal | None) -> None:
        self._count, self._journal = count, journal
        self._arrays: dict[str, NDArray[Any]] = {}
        self._found = np.zeros(count, bool)
        if journal is not None and journal.frames:
            self._put(journal.frames["number"], {name: journal.frames[name] for name in (field.name for field in fields(Rows))})

    def has(self, numbers: NDArray[np.int64]) -> bool:
        return bool(self._found[numbers].all())

    @property
    def rows(self) -> Rows:
        return Rows(**self._arrays)

    def add(self, numbers: NDArray[np.int64], rows: Rows) -> None:
        """Keep rows, later ones in the place of earlier ones, and have them on disk before going on."""
        arrays = {field.name: getattr(rows, field.name) for field in fields(Rows)}
        self._put(numbers, arrays)
        if self._journal is not None:
            for k, number in enumerate(numbers):
                self._journal.add({"number": number} | {name: array[k] for name, array in arrays.items()}, lambda: {"rows": np.array(1)})
            self._journal.save()

    def _put(self, numbers: NDArray[np.int64], arrays: dict[str, NDArray[Any]]) -> None:
        for name, array in arrays.items():
            whole = self._arrays.setdefault(name, np.zeros((self._count, *array.shape[1:]), array.dtype))
            for number, row in zip(numbers, array, strict=True):  # in their order: the last one of a number stays
                whole[number] = row
        self._found[numbers] = True


@contextmanager
def _store(journal: str | Path | None, identity: str, count: int) -> Iterator[_Store]:
    if journal is None:
        yield _Store(count, None)
        return
    kept = Journal(journal, identity)
    try:
        yield _Store(count, kept)
    finally:
        kept.close()


def _solve(variation: Variation, seed: int, mesh: Mesh, frames: NDArray[np.int64], nodes: NDArray[np.int64], store: _Store,
           say: Callable[[str], None]) -> None:
    """Finite elements for the paths with a frame of which the predictor is unsure: to their end alone where only that is kept."""
    rows = store.rows
    left = np.flatnonzero(rows.unsure.any(axis=1) & (rows.state == PREDICTED))
    say(f"{len(left)} of {len(rows.state)} paths have a frame of which the predictor is unsure: to be solved by finite elements")
    for number in tqdm(left.tolist(), desc="solve", unit="path", disable=None, leave=False):
        one = variation.scene(seed, number)[0]
        final = bool((frames == one.steps.count).all())
        solution = solve(one, mesh=mesh, final=final, partial=True)
        state, some = UNSOLVED, slice(number, number + 1)
        displacement, largest, force = rows.displacement[some], rows.largest[some], rows.force[some]
        if not solution.failure:
            state, kept = SOLVED, np.full(len(frames), -1) if final else frames
            path, force = solution.displacement[kept], np.linalg.norm(solution.reaction[kept], axis=1)[None]
            displacement, largest = path[None][:, :, nodes].astype(np.float32), np.sqrt((path**2).sum(axis=2).max(axis=1))[None]
        store.add(np.array([number]), Rows(displacement, largest, force, rows.bar[some], rows.unsure[some], np.array([state], np.int8)))
