"""The command line: one small function for each verb, wiring only.

Every verb takes --json: one object on standard output and nothing else there; progress and remarks go to standard error.
Exit status: 0 done, 1 the work failed (with what was saved and where), 2 the input is wrong, 130 stopped by the keyboard.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from tqdm import tqdm

from datagen.files.prediction import finite
from datagen.verbs import VERBS, add_data_verbs
from learning.verbs import add_learning_verbs
from physics.schema import InputError, WorkError

Options = argparse.Namespace
# Under mpirun of Open MPI or MPICH, or under torchrun, which only train knows; only the first process speaks.
TOGETHER = "WORLD_SIZE" in os.environ
RANK = int(os.environ.get("OMPI_COMM_WORLD_RANK") or os.environ.get("PMI_RANK") or os.environ.get("RANK") or 0)
PROCESSES = int(os.environ.get("OMPI_COMM_WORLD_SIZE") or os.environ.get("PMI_SIZE") or os.environ.get("WORLD_SIZE") or 1)


def modes(options: Options) -> dict[str, Any]:
    """Elastic or Laplacian modes of a body."""
    out = _writable(options.out, ".vtu", ".vtkhdf")
    picture = _writable(options.picture)
    found = _elastic(options) if options.kind == "elastic" else _laplacian(options)
    elastic = options.kind == "elastic"
    values = list(found.frequencies_hz) if elastic else found.eigenvalues.tolist()
    for i, value in enumerate(values):
        _say(options, f"mode {i + 1:3d}  {value:12.6g} {'Hz' if elastic else '1/m2'}  residual {found.residuals[i]:.1e}")
    for text in (f"{found.dofs} unknowns, {found.cells}; {found.solver}", *found.remarks):
        _say(options, text)
    result = {"kind": options.kind, "residuals": found.residuals.tolist(), "dofs": found.dofs, "seconds": found.seconds,
              "cells": found.cells, "solver": found.solver, "clusters": [[i + 1 for i in members] for members in found.clusters],
              "remarks": list(found.remarks)} | found.report
    if RANK == 0 and out is not None:
        _write_modes(out, options, found)
    if RANK == 0 and picture is not None:
        from physics.view import mode_pictures

        result["pictures"] = mode_pictures(picture, found.mesh, found.shapes, names=[
            f"{'f' if elastic else 'lambda'} = {value:.5g} {'Hz' if elastic else '1/m2'}" for value in values])
        _say(options, f"{len(result['pictures'])} pictures: {picture}")
    return result


def _elastic(options: Options) -> Any:
    from physics.modes.elastic import elastic_modes
    from physics.scene import load_scene

    if options.dirichlet is not None:
        raise InputError("--dirichlet is for --kind laplacian; elastic modes take the supports of the scene")
    if Path(options.scene).suffix.lower() != ".toml":
        raise InputError(f"{options.scene}: elastic modes need a scene (.toml) with a material; its [body] may name a mesh file")
    return elastic_modes(load_scene(options.scene), count=options.count, spread=PROCESSES > 1)


def _laplacian(options: Options) -> Any:
    from physics.modes.laplacian import laplacian_modes
    from physics.scene import load_body

    names = options.dirichlet
    chosen = None if names is None else [name.strip() for name in names.split(",") if name.strip() not in ("", "none")]
    return laplacian_modes(load_body(options.scene), count=options.count, dirichlet=chosen, spread=PROCESSES > 1)


def _write_modes(out: Path, options: Options, found: Any) -> None:
    """The shapes as .vtu, or as a trajectory file of the rest state alone."""
    if out.suffix == ".vtkhdf":
        from datagen.files.trajectory import at_rest, write_trajectory

        elastic = options.kind == "elastic"
        shapes = found.pictured if elastic else found.pictured[:, :, None] * [0.0, 0.0, 1.0]
        text = Path(options.scene).read_text() if Path(options.scene).suffix.lower() == ".toml" else ""
        write_trajectory(out, at_rest(found.mesh, shapes, scene=text, frequencies_hz=found.frequencies_hz if elastic else (),
                                      extra={} if elastic else {"laplacian_eigenvalues": found.eigenvalues.tolist()}))
    else:
        from physics.mesh.files import write_mesh

        write_mesh(out, found.mesh, {f"mode_{i + 1}": shape for i, shape in enumerate(found.pictured)})
    _say(options, f"shapes: {out}")


def simulate(options: Options) -> dict[str, Any]:
    """The path of a scene, through equilibria or through time, by finite elements."""
    from datagen.files.trajectory import unfinished, write_trajectory
    from datagen.sets.generate import trajectory_of
    from physics.scene import load_scene
    from physics.solution import solve

    scene = load_scene(options.scene)
    if scene.body.order != 1 or scene.body.shape == "channel":
        raise InputError(f"{options.scene}: simulate takes solid bodies of first order; modes take others too")
    out = _writable(options.out, ".vtkhdf")
    if out.exists() and unfinished(out) not in (None, scene.to_toml()):
        raise InputError(f"--out {out}: an unfinished run of another scene; choose another name, or delete it to start anew")

    part = out.with_name(out.name + ".part")
    if PROCESSES > 1 and part.exists():
        raise InputError(f"--out {out}: {part.name} is of an unfinished run, which one process goes on with; delete it to start anew")
    with tqdm(total=scene.steps.count, disable=True if RANK else None, desc="simulate", unit="step") as bar:
        solution = solve(scene, on_step=lambda step: bar.update(step - bar.n), journal=part if PROCESSES == 1 else None,
                         spread=PROCESSES > 1)
    trajectory = trajectory_of(scene, solution=solution)
    if RANK == 0:
        write_trajectory(out, trajectory)
    steps = len(solution.displacement) - 1
    if solution.resumed:
        _say(options, f"went on after step {solution.resumed}, which an earlier run had reached")
    if solution.failure:
        again = f"; the same call tries again from there, without {part.name} from the start" if PROCESSES == 1 else ""
        raise WorkError(f"{solution.failure}; the {steps} steps before it are in {out}{again}")
    if PROCESSES == 1:
        part.unlink(missing_ok=True)
    result = {"steps": steps, "ms_per_step": 1e3 * solution.seconds / steps,
              "newton_iterations": int(solution.newton_iterations.sum()), "factorisations": solution.factorisations,
              "largest_relative_residual": float(solution.relative_residual.max()),
              "largest_penetration": float(solution.penetration.max()),
              "smallest_det_f": float(solution.smallest_det_f.min()), "reaction": solution.reaction[1:].tolist(),
              "model": trajectory.extra["model"], "linear_steps": solution.linear_steps, "seconds": solution.seconds,
              "resumed_after_step": solution.resumed}
    _say(options, f"{steps} steps in {solution.seconds:.2f} s, {result['newton_iterations']} Newton steps, "
                  f"{solution.factorisations} factorisations, largest reaction {abs(solution.reaction).max():.4g} N: {out}")
    for what, why in result["model"].items():
        _say(options, f"  {what}: {why}")
    return result


def generate(options: Options) -> dict[str, Any]:
    """Trajectories of a family of scenes."""
    from datagen.family.family import counts, load_family
    from datagen.sets.generate import generate as run
    from datagen.sets.plan import planned

    family = load_family(options.family)
    wanted = counts(family, count=options.count, split=options.split)
    if options.dry_run:
        result = planned(family, wanted, seed=options.seed)
        for name, value in result.items():
            _say(options, f"{name:15s} " + (", ".join(f"{key} {number:.6g}" for key, number in value.items())
                                            if isinstance(value, dict) else str(value)))
        return result
    if options.out is None:
        raise InputError("--out: give the folder, or --dry-run to see what would be made")
    result = run(family, wanted, _writable(options.out), seed=options.seed, workers=options.workers,
                 cluster=options.cluster, time_limit=options.time_limit)
    _say(options, ", ".join(f"{key} {value}" for key, value in result.items()) + f": {options.out}")
    return result


def of_data(options: Options) -> dict[str, Any]:
    """One of the verbs that work on a folder of trajectories."""
    return VERBS[options.what](options, say=lambda text: _say(options, text), writable=_writable)


def of_networks(function: Callable[..., dict[str, Any]]) -> Callable[[Options], dict[str, Any]]:
    """One of the verbs that work with networks."""
    return lambda options: function(options, say=lambda text: _say(options, text), writable=_writable)


def verify(options: Options) -> dict[str, Any]:
    """Any prediction in the trajectory format, held against its reference and against the equations."""
    from datagen.files.prediction import verify_files

    result = verify_files(options.prediction, options.reference, _writable(options.out))
    for name, value in result.items():
        _say(options, f"{name:20s} {value:.6g}")
    return result


def view(options: Options) -> dict[str, Any]:
    """A film of a trajectory."""
    from datagen.files.trajectory import read_sound
    from physics.view import Obstacle, film

    trajectory = read_sound(options.trajectory, complete=False)
    out = _writable(options.out or Path(options.trajectory).with_suffix(".gif"), ".gif")
    surface = None if trajectory.obstacle is None else Obstacle(*trajectory.obstacle)
    frames = film(out, trajectory.mesh, trajectory.displacement[:, trajectory.body], obstacle=surface)
    _say(options, f"{frames} pictures: {out}")
    return {"pictures": frames, "out": str(out)}


def demo(options: Options) -> dict[str, Any]:
    """The whole line: modes, data, segments, training, rollouts, report."""
    from learning.demo import run

    return run(_writable(options.out), say=lambda text: _say(options, text))


def main(arguments: list[str] | None = None) -> int:
    """Run one command; the exit status."""
    options = _parser().parse_args(arguments)
    try:
        if PROCESSES > 1 and options.verb not in (("train",) if TOGETHER else ("modes", "simulate")):
            raise InputError(f"{options.verb} runs as one process; several share modes and simulate (mpirun) and train (torchrun)")
        result = options.verb_function(options)
        if options.json and RANK == 0:
            print(json.dumps(finite(result)))
        return 0
    except InputError as error:
        return _fail(str(error), 2)
    except (FloatingPointError, RuntimeError) as error:
        if options.json and isinstance(error, WorkError) and error.result is not None:
            print(json.dumps(finite(error.result)))
        return _fail(str(error), 1)
    except MemoryError:
        return _fail("out of memory; finished files are kept", 1)
    except OSError as error:
        return _fail(f"{error.filename or 'cannot write'}: {error.strerror or error}", 1)
    except KeyboardInterrupt:
        return _fail("stopped; finished files are kept", 130)


def _fail(message: str, status: int) -> int:
    if RANK == 0:
        print("fidelity: " + " ".join(message.split("\n")), file=sys.stderr)
    return status


def _say(options: Options, text: str) -> None:
    """A line for the reader: on standard output, or on standard error when that is taken by JSON."""
    if RANK == 0:
        print(text, file=sys.stderr if options.json else sys.stdout, flush=True)


def _writable(path: str | Path | None, *suffixes: str) -> Any:
    """The path of an output that can be written, checked before any work; None stays None. Without suffixes: a folder.

    Folders that the check had to make are taken away again: wrong input leaves nothing behind.
    """
    if path is None:
        return None
    path = Path(path)
    suffix = bool(suffixes)
    if suffix and path.suffix not in suffixes:
        raise InputError(f"--out {path}: the name must end in {' or '.join(suffixes)}")
    if (suffix and path.is_dir()) or (not suffix and path.exists() and not path.is_dir()):
        raise InputError(f"--out {path}: is {'a folder' if path.is_dir() else 'not a folder'}")
    folder = path.parent if suffix else path
    missing = [place for place in (folder, *folder.parents) if not place.exists()]  # the deepest first
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".{path.name}.{os.getpid()}.probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(f"--out {path}: {error.strerror}") from None
    finally:
        for place in missing:
            if place.is_dir():
                place.rmdir()
    return path


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        raise SystemExit(_fail(message.replace(" (choose from", "; choose from").rstrip(")"), 2))


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="fidelity", description="Physics fidelity of learned mesh simulators, held against finite elements.")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB", parser_class=_Parser)

    def verb(name: str, function: Callable[[Options], dict[str, Any]], *positional: str, into: Any = verbs,
             about: str = "") -> argparse.ArgumentParser:
        about = about or (function.__doc__ or "").strip()
        added = into.add_parser(name, help=about, description=about)
        for argument in positional:
            added.add_argument(argument)
        added.add_argument("--json", action="store_true", help="one JSON object on standard output")
        added.set_defaults(verb_function=function)
        return added

    add = verb("modes", modes, "scene").add_argument
    add("--kind", choices=("elastic", "laplacian"), default="elastic", help="elastic, or laplacian: of the shape alone (elastic)")
    add("--count", type=_positive, default=10, help="how many (10)")
    add("--dirichlet", metavar="NAME,NAME", help="where Laplacian modes are zero; 'none': nowhere (all but a place named outlet)")
    add("--out", help="shapes as .vtu, or as .vtkhdf in the layout of a trajectory")
    add("--picture", metavar="FOLDER", help="a picture and a film of each mode")
    verb("simulate", simulate, "scene").add_argument("--out", required=True, help="trajectory, .vtkhdf")
    added = verb("generate", generate, "family")
    add = added.add_argument
    add("--out", help="folder")
    number = added.add_mutually_exclusive_group().add_argument
    number("--count", type=_positive, help="trajectories of all splits together (the family's own number)")
    number("--all", action="store_true", help="the family's own number, as without --count")
    add("--split", help="only train, valid or test")
    add("--seed", type=_seed, default=0)
    add("--workers", type=_positive, help="processes (one for each core)")
    add("--cluster", default="", metavar="tcp://...", help="a Dask scheduler, whose workers do it instead")
    add("--time-limit", type=float, default=math.inf, metavar="S", help="seconds for one scene, then another is drawn (none)")
    add("--dry-run", action="store_true", help="only draw the scenes: what the set will be like")
    data = verbs.add_parser("dataset", help="A folder of trajectories.").add_subparsers(dest="what", required=True, parser_class=_Parser)
    add_data_verbs(lambda name, about, *positional: verb(name, of_data, *positional, about=about, into=data), _positive, _count, _seed)
    add_learning_verbs(lambda name, function, *positional: verb(name, of_networks(function), *positional, about=function.__doc__),
                       _positive, _count)
    add = verb("verify", verify, "prediction").add_argument
    add("--reference", required=True, help="trajectory of finite elements, with its scene in it")
    add("--out", help="folder for the figures and a picture of the worst frame")
    verb("view", view, "trajectory").add_argument("--out", help="film, .gif")
    verb("demo", demo).add_argument("--out", default="demo", help="folder of everything it makes (demo)")
    return parser


def _seed(text: str) -> int:
    if not text.isdigit() or int(text) >= 2**63:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 to 2^63 - 1")
    return int(text)


def _count(text: str) -> int:
    return 0 if text == "0" else _positive(text)


def _positive(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number above 0")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
