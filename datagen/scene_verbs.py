"""What the command line does with a scene: modes and simulate, wiring only.

Each function takes the options of its verb, `say` for lines to the reader, `writable`, which checks the path of an output before
any work, and which of how many processes this is: all of them compute, the first one writes. What it returns is printed as JSON
when that is asked for.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from physics.scene.parts import QUANTITIES
from physics.schema import InputError, WorkError

Options = argparse.Namespace
Say = Callable[[str], None]
Writable = Callable[..., Any]


def add_scene_verbs(verb: Callable[..., argparse.ArgumentParser], positive: Callable[[str], int]) -> None:
    """Declare the verbs to a parser: `verb(name, function, *positional)` adds one."""
    add = verb("modes", modes, "scene").add_argument
    add("--kind", choices=("elastic", "laplacian"), default="elastic", help="elastic, or laplacian: of the shape alone (elastic)")
    add("--count", type=positive, default=10, help="how many (10)")
    add("--at", metavar="FILE:FRAME", help="elastic modes of the body as it is in that frame of its trajectory, .vtkhdf")
    add("--dirichlet", metavar="NAME,NAME", help="where Laplacian modes are zero; 'none': nowhere (all but a place named outlet)")
    add("--out", help="shapes as .vtu, or as .vtkhdf in the layout of a trajectory")
    add("--picture", metavar="FOLDER", help="a picture and a film of each mode")
    add("--error", type=float, help="relative error of the frequencies: mesh and order of the cells are chosen for it")
    add("--no-films", action="store_true", help="pictures alone, in a twentieth of the time")
    add("--html", metavar="FILE", help="a page in which the modes are turned by hand, .html")
    _set(add)
    add = verb("simulate", simulate, "scene").add_argument
    add("--out", required=True, help="trajectory, .vtkhdf")
    add("--fields", choices=("stress",), help="stress: also the stress tensor and von Mises stress at the nodes, in all frames")
    add("--csv", help="a table with a row for each frame: obstacle, reaction, energy, penetration, .csv")
    add("--html", metavar="FILE", help="a page in which the path is turned and followed by hand, .html")
    add("--error", type=float, help="relative error: mesh and order of the cells are chosen for it, in place of the scene's own")
    add("--quantity", choices=QUANTITIES, help="that the error is of (displacement)")
    _set(add)


def _set(add: Callable[..., Any]) -> None:
    add("--set", nargs="+", action="extend", default=[], metavar="KEY=VALUE", help="values of the scene changed: obstacle.radius=0.012")


def modes(options: Options, *, say: Say, writable: Writable, rank: int = 0, processes: int = 1) -> dict[str, Any]:
    """Elastic or Laplacian modes of a body."""
    out = writable(options.out, ".vtu", ".vtkhdf")
    picture = writable(options.picture)
    html = writable(options.html, ".html", option="--html")
    elastic = options.kind == "elastic"
    found, chosen = _elastic(options, processes > 1) if elastic else (_laplacian(options, processes > 1), None)
    values = list(found.frequencies_hz) if elastic else found.eigenvalues.tolist()
    for i, value in enumerate(values):
        say(f"mode {i + 1:3d}  {value:12.6g} {'Hz' if elastic else '1/m2'}  residual {found.residuals[i]:.1e}")
    for text in (f"{found.dofs} unknowns, {found.cells}; {found.solver}", *found.remarks):
        say(text)
    result = {"kind": options.kind, "residuals": found.residuals.tolist(), "dofs": found.dofs, "seconds": found.seconds,
              "cells": found.cells, "solver": found.solver, "clusters": [[i + 1 for i in members] for members in found.clusters],
              "remarks": list(found.remarks)} | found.report
    if rank == 0 and out is not None:
        _write_modes(out, options, found, chosen)
        say(f"shapes: {out}")
    names = [f"{'f' if elastic else 'lambda'} = {value:.5g} {'Hz' if elastic else '1/m2'}" for value in values]
    if rank == 0 and picture is not None:
        from physics.view import mode_pictures

        result["pictures"] = mode_pictures(picture, found.mesh, found.shapes, names=names, films=not options.no_films, say=say)
        say(f"{len(result['pictures'])} pictures: {picture}")
    if rank == 0 and html is not None:
        from physics.view import mode_exhibit, write_page

        shown = mode_exhibit(found.mesh, found.pictured, [f"mode {i + 1}: {name}" for i, name in enumerate(names)])
        write_page(html, f"{options.kind.capitalize()} modes of {Path(options.scene).name}", [shown],
                   {"mesh": f"{len(found.mesh.points)} nodes, {found.cells}", "solver": found.solver, "remarks": "; ".join(found.remarks)})
        result["html"] = str(html)
        say(f"page: {html}")
    if chosen is not None:
        _judged(chosen.verdict, "the modes are those of that mesh", result, say)
    return result


def _judged(verdict: Any, made: str, result: dict[str, Any], say: Say) -> None:
    """Say what is known of an error that was asked for. Raises `WorkError` when it is not kept; made: what there is all the same."""
    result["accuracy"] = verdict.table()
    for text in verdict.lines():
        say(text)
    if not verdict.reached:
        raise WorkError(f"{verdict.not_kept()}; {made}", result)


def _elastic(options: Options, spread: bool) -> tuple[Any, Any]:
    """The modes of a scene, and where an error is asked for what was chosen (`ChosenModes`)."""
    from physics.modes.elastic import elastic_modes
    from physics.scene import load_solid

    if options.dirichlet is not None:
        raise InputError("--dirichlet is for --kind laplacian; elastic modes take the supports of the scene")
    if Path(options.scene).suffix.lower() != ".toml":
        raise InputError(f"{options.scene}: elastic modes need a scene (.toml) with a material; its [body] may name a mesh file")
    error = getattr(options, "error", None)
    asked = [] if error is None else [f"steps.error={error}"]
    scene = load_solid(options.scene, [*options.set, *asked], anew=bool(asked))
    if scene.steps.error is not None:
        from physics.accuracy.frequency import choose_modes

        if spread or options.at is not None:
            raise InputError("steps.error: the mesh is chosen in one process" if spread else
                             "--at: its mesh is there already; leave error out")
        chosen = choose_modes(scene, options.count)
        return chosen.modes, chosen
    if options.at is None:
        return elastic_modes(scene, count=options.count, spread=spread), None
    mesh, state = _state(scene, options.at)
    return elastic_modes(scene, count=options.count, spread=spread, mesh=mesh, at=state), None


def _state(scene: Any, at: str) -> tuple[Any, tuple[Any, float]]:
    """The mesh of a scene, and displacements and fraction of the loading in a frame of its trajectory. Raises `InputError`."""
    from datagen.files.solved import solved_on
    from datagen.files.trajectory import read_sound
    from physics.scene import Scene

    path, _, frame = at.rpartition(":")
    if not path or not frame.isdecimal():
        raise InputError(f"--at {at}: must be a trajectory and the number of a frame, as in press.vtkhdf:40")
    trajectory = read_sound(path, complete=False)
    own = Scene.from_toml(trajectory.scene) if trajectory.scene else None
    if own is None or replace(own, body=replace(own.body, path=scene.body.path)) != scene:
        raise InputError(f"--at {path}: is not a trajectory of this scene, whose loads and obstacle it takes; simulate it anew")
    frames, mesh = len(trajectory.displacement), solved_on(own, trajectory)
    if int(frame) >= frames:
        raise InputError(f"--at {at}: has frames 0 .. {frames - 1}")
    if not np.array_equal(trajectory.mesh.points, mesh.points):
        raise InputError(f"--at {path}: its mesh is not the one that the scene builds")
    return mesh, (trajectory.displacement[int(frame), trajectory.body].astype(np.float64), int(frame) / scene.steps.count)


def _laplacian(options: Options, spread: bool) -> Any:
    from physics.modes.laplacian import laplacian_modes
    from physics.scene import load_body

    if options.at is not None:
        raise InputError("--at is for elastic modes; those of a shape alone know no load")
    if getattr(options, "error", None) is not None:
        raise InputError("--error is for elastic modes and simulate")
    if options.set:
        raise InputError("--set is for elastic modes and simulate; a shape alone has nothing to change but its mesh")
    names = options.dirichlet
    chosen = None if names is None else [name.strip() for name in names.split(",") if name.strip() not in ("", "none")]
    return laplacian_modes(load_body(options.scene), count=options.count, dirichlet=chosen, spread=spread)


def _write_modes(out: Path, options: Options, found: Any, chosen: Any = None) -> None:
    """The shapes as .vtu, or as a trajectory file of the rest state alone."""
    if out.suffix == ".vtkhdf":
        from datagen.files.places import mesh_file, places_of
        from datagen.files.trajectory import at_rest, write_trajectory
        from physics.scene import load_solid

        elastic = options.kind == "elastic"
        shapes = found.pictured if elastic else found.pictured[:, :, None] * [0.0, 0.0, 1.0]
        about: dict[str, Any]
        if not elastic:
            about = {"extra": {"laplacian_eigenvalues": found.eigenvalues.tolist()}}
        else:
            scene = load_solid(options.scene, options.set) if chosen is None else chosen.scene
            about = {"scene": scene.to_toml(), "frequencies_hz": found.frequencies_hz}
            if scene.body.shape == "file":
                about |= {"places": places_of(found.mesh), "extra": {"mesh_file": mesh_file(scene)}}
        write_trajectory(out, at_rest(found.mesh, shapes, **about))
    else:
        from physics.mesh.files import write_mesh

        write_mesh(out, found.mesh, {f"mode_{i + 1}": shape for i, shape in enumerate(found.pictured)})


def simulate(options: Options, *, say: Say, writable: Writable, rank: int = 0, processes: int = 1) -> dict[str, Any]:
    """The path of a scene, through equilibria or through time, by finite elements."""
    from datagen.flow.verb import simulate_flow
    from physics.scene import FlowScene, load_scene

    asked = [f"steps.{name}={value}" for name in ("error", "quantity") if (value := getattr(options, name, None)) is not None]
    scene = load_scene(options.scene, [*options.set, *asked], anew=getattr(options, "error", None) is not None)
    if isinstance(scene, FlowScene):
        return simulate_flow(scene, options, say=say, writable=writable, processes=processes)
    return _simulate_solid(scene, options, say=say, writable=writable, rank=rank, processes=processes)


def _simulate_solid(scene: Any, options: Options, *, say: Say, writable: Writable, rank: int, processes: int) -> dict[str, Any]:
    from datagen.files.fields import stress_fields
    from datagen.files.inputs import write_table
    from datagen.files.trajectory import unfinished, write_trajectory
    from datagen.sets.generate import trajectory_of
    from physics.solution import solve

    if scene.body.shape == "channel":
        raise InputError(f"{options.scene}: simulate takes no channel; modes do")
    out, table = writable(options.out, ".vtkhdf"), writable(options.csv, ".csv", option="--csv")
    html = writable(options.html, ".html", option="--html")
    part = out.with_name(out.name + ".part")
    if processes > 1 and part.exists():
        raise InputError(f"--out {out}: {part.name} is of an unfinished run, which one process goes on with; delete it to start anew")

    def journal(solved: Any) -> Path:
        """Where the path of a scene is kept while it grows, unless another one's is there."""
        if out.exists() and unfinished(out) not in (None, solved.to_toml()):
            raise InputError(f"--out {out}: an unfinished run of another scene; choose another name, or delete it to start anew")
        return part

    with tqdm(total=scene.steps.count, disable=True if rank else None, desc="simulate", unit="step") as bar:
        def on_step(step: int) -> None:
            bar.update(step - bar.n)

        if scene.steps.error is None:
            verdict, place = None, journal(scene)
            solution = solve(scene, spread=processes > 1, on_step=on_step, partial=True, journal=place if processes == 1 else None)
        elif processes > 1:
            raise InputError("steps.error: the mesh is chosen in one process")
        else:
            from physics.accuracy.answer import answer

            scene, solution, verdict = answer(scene, on_step=on_step, journal=journal)
    if (largest := float(abs(solution.displacement).max())) > np.finfo(np.float32).max:
        part.unlink(missing_ok=True)
        raise WorkError(f"the body moves by up to {largest:.3g} m, and a file holds numbers up to 3.4e+38; nothing is written")
    trajectory = trajectory_of(scene, solution=solution)
    if verdict is not None:
        trajectory = replace(trajectory, extra=trajectory.extra | {"accuracy": verdict.table()})
    if rank == 0:
        if options.fields:
            trajectory = replace(trajectory, fields=stress_fields(scene, solution, trajectory))
        write_trajectory(out, trajectory)
        if table is not None:
            write_table(table, trajectory)
        if html is not None:
            write_path(html, f"The path of {Path(options.scene).name}", trajectory)
    steps = len(solution.displacement) - 1
    if solution.resumed:
        say(f"went on after step {solution.resumed}, which an earlier run had reached")
    if solution.failure:
        again = f"; the same call tries again from there, without {part.name} from the start" if processes == 1 else ""
        raise WorkError(f"{solution.failure}; the {steps} steps before it are in {out}{again}")
    if processes == 1:
        part.unlink(missing_ok=True)
    result = {"steps": steps, "ms_per_step": 1e3 * solution.seconds / steps,
              "newton_iterations": int(solution.newton_iterations.sum()), "factorisations": solution.factorisations,
              "largest_relative_residual": float(solution.relative_residual.max()),
              "largest_penetration": float(solution.penetration.max()),
              "smallest_det_f": float(solution.smallest_det_f.min()), "reaction": solution.reaction[1:].tolist(),
              **{name: rows[1:].tolist() for name, rows in trajectory.per_frame.items() if name.startswith(("obstacle", "reaction_"))},
              "model": trajectory.extra["model"], "linear_steps": solution.linear_steps, "seconds": solution.seconds,
              "resumed_after_step": solution.resumed, "remarks": [*solution.mesh.remarks, *solution.idle(scene), *solution.stiff(scene)]}
    say(f"{steps} steps in {solution.seconds:.2f} s, {result['newton_iterations']} Newton steps, "
        f"{solution.factorisations} factorisations, largest reaction {abs(solution.reaction).max():.4g} N: {out}")
    for what, why in result["model"].items():
        say(f"  {what}: {why}")
    for text in result["remarks"]:
        say(text)
    if html is not None:
        result["html"] = str(html)
        say(f"page: {html}")
    if verdict is not None:
        _judged(verdict, f"its path is in {out}", result, say)
    return result


def write_path(html: Path, title: str, trajectory: Any) -> None:
    """The page of a trajectory: its path to be turned and followed by hand, with stress where it has a scene. Raises `InputError`."""
    from datagen.files.solved import as_solved
    from physics.scene import Scene
    from physics.view import ObstacleSurface, path_exhibit, write_page

    path, obstacle, facts = trajectory.displacement[:, trajectory.body], trajectory.obstacle, trajectory.extra.get("model", {})
    steps, material = len(path) - 1, None
    if trajectory.scene:
        scene = Scene.from_toml(trajectory.scene)
        steps, material = scene.steps.count, as_solved(scene, trajectory, len(path) - 1).material
    shown = path_exhibit(html.stem, trajectory.mesh, {"path": path}, material,
                         obstacle=obstacle and ObstacleSurface(*obstacle), steps=steps,
                         step_seconds=trajectory.extra.get("step_seconds"))
    write_page(html, title, [shown], {
        "mesh": f"{len(trajectory.mesh.points)} nodes, {len(trajectory.mesh.cells)} cells of the kind {trajectory.mesh.cell}",
        "steps": f"{len(path) - 1} of {steps}", **facts})
