"""The card of a data set: README.md in its folder, a YAML header and what a reader wants to know before the first byte.

Beside it trajectories.csv has a row of numbers for each file, with its own noise floor (see statistics.py). Everything comes
from the manifest, the files and the statistics; nothing is typed by hand.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import tomllib
import typing
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from datagen.family.family import RANGES, SPLITS
from datagen.family.place import Place
from datagen.files.provenance import machine
from datagen.files.trajectory import read_trajectory
from datagen.sets import dataset
from datagen.sets.plan import spread
from datagen.sets.statistics import rows_of, statistics
from physics.scene import FlowScene, Scene
from physics.schema import Bound
from physics.whole import write_whole

LICENSE = "mit"
HISTOGRAMS = ("nodes", "graph_diameter", "displacement_largest", "reaction_largest", "reynolds_number", "velocity_largest", "ms_per_step")
UNITS = {"xy_extent": "m²", "displacement_rms": "m", "displacement_largest": "m", "change_rms": "m", "change_of_change_rms": "m",
         "storage_noise": "m", "solver_noise": "m", "energy_largest": "J", "penetration_largest": "m", "reaction_largest": "N",
         "seconds": "s", "ms_per_step": "ms", "megabytes": "MB", "mesh_rmse": "m", "mesh_largest": "m", "solver_largest": "m"}
OF_FLOWS = {"storage_noise": "m/s", "velocity_rms": "m/s", "velocity_change_rms": "m/s", "velocity_largest": "m/s", "pressure_rms": "Pa",
            "drag_largest": "N/m", "lift_largest": "N/m", "pressure_difference_largest": "Pa", "kinetic_energy_largest": "J/m",
            "divergence_largest": "1/s", "step_size_largest": "s"}


def write_card(folder: str | Path, *, refined: int | None = None) -> Path:
    """Write the card of a data set and its table of trajectories; the card's path.

    Args:
        refined: how many trajectories are solved again on finer cells for the noise floor, as for `statistics`; by default 10, of flows 1

    Raises:
        InputError: the folder holds no data set
        OSError: the folder cannot be written
    """
    folder = Path(folder)
    manifest, rows = dataset.read_manifest(folder), rows_of(folder)
    flows = read_trajectory(folder / manifest.trajectories[0].file).flows
    found = statistics(folder, rows, refined=(1 if flows else 10) if refined is None else refined)
    table = io.StringIO()
    writer = csv.DictWriter(table, list(dict.fromkeys(name for row in rows for name in row)))
    writer.writeheader()
    writer.writerows(rows)
    write_whole(folder / "trajectories.csv", table.getvalue().encode())
    said = [*_header(manifest, found, flows=flows), *_body(folder, manifest, found, rows), ""]
    write_whole(folder / "README.md", "\n".join(said).encode())
    return folder / "README.md"


KINDS_OF_SOLIDS = "NORMAL 0, OBSTACLE 1, HANDLE 3. The obstacle's surface is part of every mesh."
KINDS_OF_FLOWS = """NORMAL 0, INFLOW 4, OUTFLOW 5, WALL 6, the cylinder
and the corners being walls. Beside velocity [m/s] and pressure [Pa] at the nodes, FieldData has drag and lift [N/m],
the difference of pressure [Pa] and the kinetic energy [J/m] of each frame, and `extra` has density, viscosity, inflow, the
cylinder's centre and radius, and the Reynolds number with its definition."""
VALUES_OF_SOLIDS = """Displacements are
of free nodes, as lengths of vectors; a change is that from one step to the next."""
VALUES_OF_FLOWS = """Velocities are
those inside and at the outflow, as lengths of vectors; a change is that from one step to the next, once the fluid moves.
A wake counts as shedding when the lift coefficient varies by more than 0.02 in the last third."""
NOISE_OF_SOLIDS = """Storage and solver: for every trajectory, from the precision of the file and
from the largest residual force (|R| over the reaction, times the root mean square displacement); trajectories.csv has both
for each file."""
NOISE_OF_FLOWS = """Storage: for every trajectory, of the velocity, from the precision of
the file; `unresolved` is the share of the velocity that only its highest order holds, 0.03 being fair, past the start."""


AGAIN_OF_SOLIDS = """; `solver_largest`: the
difference to the same mesh solved in fewer steps, which is the solver's own."""
AGAIN_OF_FLOWS = """. Where vortices are
shed the two drift apart in phase, so the first 50 frames stand beside all of them, and drag, range of lift and frequency of
the second half as shares of the finer ones."""


def _name(manifest: dataset.Manifest) -> str:
    return str(tomllib.loads(manifest.family).get("name", "scenes"))


def _header(manifest: dataset.Manifest, found: dict[str, Any], *, flows: bool = False) -> list[str]:
    """The YAML header; strings are written as JSON, which YAML contains."""
    number = found["count"]
    size = "n<1K" if number < 1000 else "1K<n<10K" if number < 10_000 else "10K<n<100K"
    said = ["---", f"pretty_name: {json.dumps(_name(manifest))}", f"license: {LICENSE}",
            f"tags: [mesh, finite-elements, {'fluid' if flows else 'contact'}, simulation]", f"size_categories: [{json.dumps(size)}]",
            f"trajectories: {number}", "splits:"]
    said += [f"  {split}: {count}" for split, count in found["split"].items()]
    for key in ("nodes", "graph_diameter", "steps", "xy_extent"):
        said.append(f"{key}: {{mean: {found[key]['mean']:.6g}, std: {found[key]['std']:.6g}, min: {found[key]['min']:.6g}, "
                    f"max: {found[key]['max']:.6g}}}")
    return [*said, f"seed: {manifest.seed}", f"failed_attempts: {found['failed_attempts']}", "---", ""]


def _body(folder: Path, manifest: dataset.Manifest, found: dict[str, Any], rows: list[dict[str, Any]]) -> Iterator[str]:
    family, first = tomllib.loads(manifest.family), read_trajectory(folder / manifest.trajectories[0].file)
    comment = [line.lstrip("# ") for line in manifest.family.splitlines()[:1] if line.startswith("#")]
    yield f"# {_name(manifest)}\n"
    splits = ", ".join(f"{split} {found['split'][split]}" for split in SPLITS if split in found["split"])
    yield f"{' '.join([*comment, str(found['count'])])} trajectories of {found['steps']['mean']:.0f} steps ({splits}),"
    yield f"{found['gigabytes']:.3g} GB, made by Fidelity (commit {first.commit or 'unknown'}) on {date.today().isoformat()}.\n"
    yield "Each file is VTKHDF: ParaView opens it with a time slider, h5py reads it as arrays. The layout stands in"
    yield "`datagen/files/trajectory.py`; node kinds are " + (KINDS_OF_FLOWS if first.flows else KINDS_OF_SOLIDS) + "\n"
    yield "## Ranges\n"
    yield "| key | values | unit |\n|---|---|---|"
    units = _units(FlowScene if first.flows else Scene)
    for key, value in _leaves({name: value for name, value in family.items() if name not in ("splits", "name")}):
        yield f"| {key} | {value} | {units.get(key.split('.')[-1].split('[')[0], '')} |"
    if not first.flows:
        yield "\nA depth is measured in the unit that `depth_in` names; tables under `case` are drawn together."
    yield "\n## Statistics\n"
    yield "Graph diameter: of the graph of the body's mesh edges. Standard deviations are those of the set itself. " + (
        VALUES_OF_FLOWS if first.flows else VALUES_OF_SOLIDS) + "\n"
    yield from _table(found)
    yield from _words(found)
    yield "\n## Histograms\n\n```"
    for name in HISTOGRAMS:
        if name in found:
            yield from _histogram(name, np.array([row[name] for row in rows]))
    yield "```\n\n## What the numbers are good for\n"
    yield "Errors below these say nothing about a model. " + (NOISE_OF_FLOWS if first.flows else NOISE_OF_SOLIDS) + "\n"
    noise = ("storage_noise", "solver_noise", "change_rms", "velocity_change_rms")
    yield from _table({name: found[name] for name in noise if name in found})
    if asked := [entry.promised for entry in manifest.trajectories if entry.promised is not None]:
        yield (f"\nThe mesh of each was chosen for the error that the family asks for (`steps.error`). It is promised of {sum(asked)} of "
               f"{len(asked)}; each file says under `accuracy` what is estimated.")
    if "refined" in found:
        sample = found["refined"]
        yield (f"\nThe mesh, against the same scene on cells of half the size, for a sample of {sample['count']}"
               f"{AGAIN_OF_FLOWS if first.flows else AGAIN_OF_SOLIDS}\n")
        yield from _table(sample)
        yield from (f"\nNot solved on the finer cells: {reason}" for reason in sample["failures"])
    yield "\n## Cost\n"
    yield f"{found['solver_hours']:.3g} hours of the solver, {found['ms_per_step']['mean']:.3g} ms a step on average; card written on"
    yield f"{machine()}. The solver of the original " + (
        "CylinderFlow was published with 820 ms a step" if first.flows else "DeformingBeam was published with 3261 ms a step"
    ) + ", on another machine."
    number = found["failed_attempts"]
    failed = f"{number} scene{'s' * (number != 1)} had no solution, replaced by other draws:\n"
    yield f"\n{failed if found['reasons'] else 'No scene failed.'}"
    yield from (f"- {reason}" for reason in found["reasons"])
    yield "\n## Versions\n\n" + ", ".join(f"{name} {version}" for name, version in first.versions.items())
    yield "\n## Licence and citation\n\nMIT, as the program that made it. Cite the program (CITATION.cff) with its commit, the family and"
    yield f"the seed: `fidelity generate` of family {_name(manifest)} with seed {manifest.seed} makes the same arrays again:\n"
    yield f"```toml\n{manifest.family.rstrip()}\n```"


def _leaves(value: Any, where: str = "") -> Iterator[tuple[str, str]]:
    """Every key of a family with its value or range in words."""
    if isinstance(value, dict):
        kind = next((name for name in RANGES if name in value), None)
        if kind == "choice":
            yield where, "one of " + ", ".join(json.dumps(entry) for entry in value[kind])
        elif kind:
            low, high = value[kind]
            yield where, f"{low:g} to {high:g}" + (" (log-uniform)" if kind == "log-uniform" else "")
        else:
            for name, entry in value.items():
                yield from _leaves(entry, f"{where}.{name}" if where else name)
    elif isinstance(value, list) and any(isinstance(entry, dict) for entry in value):
        for i, entry in enumerate(value):
            yield from _leaves(entry, f"{where}[{i}]")
    else:
        yield where, f"{value:g}" if isinstance(value, float) else json.dumps(value).strip('"')


def _units(kind: type) -> dict[str, str]:
    """The unit of every key of a scene, and of the places of its obstacle."""
    found: dict[str, str] = {}
    waiting: list[Any] = [kind, Place]
    while waiting:
        one = waiting.pop()
        for field in dataclasses.fields(one):
            bound = field.metadata.get("bound")
            if isinstance(bound, Bound) and field.name != "depth":
                found.setdefault(field.name, bound.unit)
        for hint in typing.get_type_hints(one).values():
            waiting += [inner for inner in (hint, *typing.get_args(hint)) if dataclasses.is_dataclass(inner)]
    return found


def _table(found: dict[str, Any]) -> Iterator[str]:
    yield "| | mean | std | min | max | unit |\n|---|---|---|---|---|---|"
    units = UNITS | (OF_FLOWS if "velocity_rms" in found or "velocity_change_rms" in found else {})
    for name, value in found.items():
        if isinstance(value, dict) and "mean" in value:
            numbers = " | ".join(f"{value[key]:.4g}" for key in ("mean", "std", "min", "max"))
            yield f"| {name.replace('_', ' ')} | {numbers} | {units.get(name, '')} |"


def _words(found: dict[str, Any]) -> Iterator[str]:
    for name in ("obstacle", "support", "wake"):
        if name in found:
            yield f"\n{name}: " + ", ".join(f"{key} {number}" for key, number in found[name].items())


def _histogram(name: str, values: np.ndarray[Any, Any], bins: int = 12, width: int = 50) -> Iterator[str]:
    """A histogram in characters."""
    counts, edges = np.histogram(values, bins)
    yield f"{name.replace('_', ' ')} [{(UNITS | OF_FLOWS).get(name, '-')}], mean {spread(values)['mean']:.4g}"
    for count, low, high in zip(counts, edges[:-1], edges[1:], strict=True):
        yield f"{low:10.4g} .. {high:<10.4g} {'#' * round(width * count / counts.max())} {count}"
    yield ""
