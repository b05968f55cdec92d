"""What the command line does with networks: segment, train, calibrate, rollout, sweep, evaluate, pareto, study; wiring only.

Each function takes the options of its verb, `say` for lines to the reader, and `writable`, which checks the path of an output
before any work; what it returns is printed as JSON when that is asked for.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from physics.schema import InputError

Options = argparse.Namespace
Say = Callable[[str], None]
Writable = Callable[..., Any]


def add_learning_verbs(verb: Callable[..., argparse.ArgumentParser], positive: Callable[[str], int], count: Callable[[str], int]) -> None:
    """Declare the verbs to a parser: `verb(name, function, *positional)` adds one."""
    def seconds(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0 < value < math.inf:
            raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds above 0")
        return value

    def segments(text: str) -> int | str:
        return text if text == "auto" else positive(text)

    add = verb("segment", segment, "trajectory").add_argument
    add("--segments", type=segments, default=19, metavar="K", help="how many (19); auto: the number of the best silhouette")
    add("--method", default="slic-mdod-e", help="metis, slic-od, slic-od-l, slic-od-e, slic-md, slic-mdod-l or slic-mdod-e (the last)")
    add("--tau", type=float, default=0.5, help="weight of place against obstacle and modes (0.5)")
    add("--modes", default="elastic", help="elastic, or laplacian for fluids (elastic)")
    add("--mode-count", type=positive, default=1, metavar="M", help="how many modes (1)")
    add("--picture", help="segments on the body at rest, .png")
    added = verb("train", train, "config")
    added.more = _keys  # type: ignore[attr-defined]  # of the help, which alone needs torch for it
    add = added.add_argument
    add("--data", required=True, help="folder of a data set")
    add("--out", required=True, help="folder of the run")
    add("--steps", type=positive, help="stop after this training step")
    add("--seconds", type=seconds, metavar="S", help="of training, in place of the config's budget_seconds")
    add("--resume", action="store_true", help="go on from the run's last checkpoint, or begin where there is none")
    _device(add)
    add = verb("calibrate", calibrate, "run").add_argument
    add("--data", required=True, help="folder of a data set that the run was not trained on")
    add("--split", default="valid")
    add = verb("rollout", rollout, "run", "trajectory").add_argument
    add("--out", required=True, help="trajectory, .vtkhdf")
    add("--correct", type=positive, metavar="K",
        help="correct each predicted frame by Newton steps, about one for each of K orders of magnitude, and go on from there")
    _device(add)
    add = verb("sweep", sweep, "scene").add_argument
    add("--predictor", required=True, metavar="RUN", help="folder of a trained predictor of beams by sections, or of bodies by shapes")
    add("--out", required=True, help="results, .h5")
    add("--vary", nargs="+", action="extend", default=[], metavar="KEY=LOW:HIGH", help="a value of the obstacle that varies: "
                                                                                      "between two numbers, or KEY=A,B,C in turn")
    add("--set", nargs="+", action="extend", default=[], metavar="KEY=VALUE", help="values of the scene changed: body.length=0.12")
    add("--count", type=positive, help="paths (all points, where values vary in turn alone)")
    add("--seed", type=count, default=0)
    add("--frames", metavar="N,N", help="frames that are kept, the rest state being 0 (the last)")
    add("--nodes", metavar="PLACE", help="nodes that are kept: the name of a place, x-max, or numbers N,N (all)")
    add("--unsure", choices=("keep", "solve"), default="keep", help="solve paths by finite elements where the predictor is unsure at "
                                                                    "a kept frame (keep)")
    add = verb("evaluate", evaluate, "run").add_argument
    add("--data", required=True, help="folder of a data set")
    add("--split", help="of the data set (test; where there is none, valid or train)")
    add("--correct", type=positive, default=1, metavar="K", help="orders of magnitude by which Newton steps correct each frame (1)")
    add("--refined", type=count, default=1, metavar="N", help="test scenes that are solved on finer cells as well (1)")
    add("--out", help="folder of the report (RUN/report)")
    _own(add)
    add = verb("pareto", pareto, "what").add_argument
    add("--run", nargs="+", action="extend", default=[], help="folders of trainings (none: the classical methods alone)")
    add("--count", type=positive, default=5, help="trajectories of a data set, evenly spaced (5)")
    add("--split", help="of the data set (test; where there is none, valid or train)")
    add("--refined", type=count, help="scenes that are solved on finer cells as well (all)")
    add("--repeats", type=positive, default=3, help="of each timing; medians are shown (3)")
    add("--out", default="pareto", help="folder of the report (pareto)")
    _own(add)
    add("--only", default="", metavar="KIND,KIND", help="of our own only these: learned, hybrid, trivial, fe, reduced (all); the "
                                                        "reference comes along")
    _study(verb, positive)


def _study(verb: Callable[..., argparse.ArgumentParser], positive: Callable[[str], int]) -> None:
    add = verb("study", study, "study").add_argument
    add("--size", default="small", choices=("check", "small", "paper"), help="minutes, hours on a few cores, or a GPU (small)")
    add("--out", required=True, help="folder of everything it makes; where it holds this study already, it goes on")
    add("--data", help="folder of a data set to train and test on, in place of the one that would be made")
    add("--workers", type=positive, help="trainings at once (one for each core)")
    add("--cluster", default="", metavar="tcp://...", help="a Dask scheduler, whose workers do it instead")
    add("--tls", nargs=3, default=(), metavar=("CA", "CERT", "KEY"), help="for tls://, files of the authority's certificate, ours, its key")
    _device(add)


def _device(add: Callable[..., Any]) -> None:
    add("--device", default="cpu", metavar="WHERE", help="where the network runs: cpu, cuda, cuda:1; auto: a GPU where there is one (cpu)")


def _own(add: Callable[..., Any]) -> None:
    """Declare what users bring along, and where networks run."""
    _device(add)
    add("--prediction", nargs="+", action="append", default=[], metavar=("FOLDER", "NAME MS"),
        help="predictions of another program, files named as their truths; on request a name and milliseconds a step")
    add("--predictor", nargs="+", action="append", default=[], metavar=("MODULE:FUNCTION", "NAME"),
        help="a function that takes the inputs of a scene and gives displacements (T, N, 3) [m] of the body; timed as the rest are")


def segment(options: Options, *, say: Say, writable: Writable) -> dict[str, Any]:
    """Segments of a trajectory's mesh, written into its file."""
    from learning.segments.file import segment_file

    return segment_file(options.trajectory, options.segments, writable(options.picture, ".png"), say,
                        method=options.method, tau=options.tau, modes=options.modes, mode_count=options.mode_count)


def train(options: Options, *, say: Say, writable: Writable) -> dict[str, Any]:
    """A network, trained on a data set."""
    from datagen.sets.dataset import files
    from learning.config import load_config
    from learning.training.kinds import train as run

    config = load_config(options.config)
    if options.seconds is not None:
        config = replace(config, budget_seconds=options.seconds)
    out = writable(options.out)
    valid = files(options.data, "valid") if Path(options.data, "valid").is_dir() else []
    result = run(config, files(options.data, "train"), valid, out, steps=options.steps, resume=options.resume, device=options.device)
    error = result["best_error"]
    size = "" if error is None else f"{error:.4g} m/s" if valid and _flows(valid[0]) else f"{1e3 * error:.3f} mm"
    say(f"{result['steps']} steps in {result['seconds']:.0f} s, loss {result['loss']:.4g}"
        + (f", best validation error {size} (RMSD of whole rollouts over {len(valid)} validation "
           f"trajector{'y' if len(valid) == 1 else 'ies'}, free nodes)" if error is not None else "") + f": {out}")
    return result


def _keys() -> str:
    from learning.keys import help_text

    return help_text()


def calibrate(options: Options, *, say: Say, writable: Writable) -> dict[str, Any]:
    """The error bar of a trained run, found anew from other trajectories."""
    from datagen.sets.dataset import files
    from learning.training.calibrate import calibrate as run

    writable(options.run)
    result = run(options.run, files(options.data, options.split))
    say(f"an error bar is {result['factor']:.3g} times the expected error (before: {result['before']:.3g}): within it lie "
        f"{100 * result['coverage']:.3g} % of the frames of {result['trajectories']} trajectories: {options.run}")
    return result


def rollout(options: Options, *, say: Say, writable: Writable) -> dict[str, Any]:
    """A trained network's prediction of a whole trajectory, on request corrected by Newton steps; without these no solver is needed."""
    from datagen.files.trajectory import read_sound, write_trajectory
    from datagen.flow.figures import predicted_nodes, resting
    from learning.prediction.checkpoint import load_model
    from learning.prediction.rollout import rollout as run
    from physics.mesh.quality import rmsd, rmse

    model = load_model(options.run, options.device)
    truth = None
    if options.correct:
        from datagen.files.prediction import read_truth

        truth = read_truth(options.trajectory)
    trajectory = truth[0] if truth else read_sound(options.trajectory)
    out = writable(options.out, ".vtkhdf")
    if out.resolve() == Path(options.trajectory).resolve():
        raise InputError(f"--out {out}: is the trajectory itself, which the prediction would overwrite")
    if truth:
        from learning.prediction.surrogates import corrected_rollout

        prediction = corrected_rollout(model, *truth, options.correct)[0]
    else:
        prediction = run(model, trajectory)
    write_trajectory(out, prediction)
    if trajectory.flows:
        start, nodes = resting(trajectory) + 1, predicted_nodes(trajectory)
        error = rmse(prediction.fields["velocity"][start:], trajectory.fields["velocity"][start:], nodes, space=2)
        say(f"{len(prediction.displacement) - start} steps, RMSE of the velocity over all of them {error:.4g} m/s: {out}")
        return {"steps": len(prediction.displacement) - start, "velocity_rmse_all": error, **prediction.extra}
    error = rmsd(prediction.displacement[1:], trajectory.displacement[1:], trajectory.free)
    unsure = prediction.extra.get("unsure_frames")
    say(f"{len(prediction.displacement) - 1} steps, RMSD over all of them {1e3 * error:.3f} mm"
        + ("" if unsure is None else f"; the predictor is unsure of {unsure}") + f": {out}")
    return {"steps": len(prediction.displacement) - 1, "rmsd_all": error, **prediction.extra}


def sweep(options: Options, *, say: Say, writable: Writable) -> dict[str, Any]:
    """Many obstacle paths for one body, predicted at once."""
    import time

    from learning.prediction.sweep import sweep as run
    from learning.prediction.sweep import write_sweep

    out, start = writable(options.out, ".h5"), time.perf_counter()
    part = out.with_name(out.name + ".part")
    found = run(options.scene, options.predictor, vary=options.vary, changes=options.set, count=options.count, seed=options.seed,
                frames=None if options.frames is None else _numbers("--frames", options.frames),
                nodes=_numbers("--nodes", options.nodes) if options.nodes and options.nodes[0].isdigit() else options.nodes,
                solve_unsure=options.unsure == "solve", journal=part, say=say)
    write_sweep(out, found)
    part.unlink()
    rows, seconds = found.rows, time.perf_counter() - start
    result = {"paths": len(rows.state), "varied": list(found.varied), "frames": found.frames.tolist(), "nodes": len(found.nodes),
              "unsure": int(rows.unsure.any(axis=1).sum()), "solved": int((rows.state == 1).sum()),
              "unsolved": int((rows.state == -1).sum()), "largest": float(rows.largest.max()), "seconds": seconds}
    say(f"{result['paths']} paths in {seconds:.1f} s, largest displacement {1e3 * result['largest']:.4g} mm; the predictor is unsure of "
        f"{result['unsure']}, {result['solved']} solved by finite elements"
        + (f", {result['unsolved']} without an equilibrium that they found" if result["unsolved"] else "") + f": {out}")
    return result


def _numbers(option: str, text: str) -> list[int]:
    entries = [entry.strip() for entry in text.split(",")]
    if not all(entry.isdigit() and len(entry) < 10 for entry in entries):
        raise InputError(f"{option} {text}: must be whole numbers with commas between")
    return [int(entry) for entry in entries]


def evaluate(options: Options, *, say: Say, writable: Writable) -> dict[str, Any]:
    """Rollouts of a trained run, its rivals and the FE solver, in one report."""
    from datagen.sets.dataset import files
    from learning.report.evaluate import evaluate as run

    out = writable(options.out or Path(options.run) / "report")
    chosen = files(options.data, _split(options, options.data, say))
    if _flows(chosen[0]):
        return _of_flows(options, chosen, [options.run], out, say)
    return run(options.run, chosen, out, correct=options.correct, refined=options.refined,
               predictions=options.prediction, functions=options.predictor, device=options.device, say=say)


def pareto(options: Options, *, say: Say, writable: Writable) -> dict[str, Any]:
    """Speed against error: trained runs, finite elements made cheaper, a reduced-order model and trivial predictors."""
    from datagen.sets.dataset import files
    from learning.report.compare import compare
    from learning.report.evaluate import evenly

    out, only = writable(options.out), [kind.strip() for kind in options.only.split(",") if kind.strip()]
    split = _split(options, options.what, say)
    if Path(options.what, split).is_dir():
        found = files(options.what, split)
        if _flows(found[0]):
            chosen = [found[i] for i in evenly(options.count, len(found))]
            return _of_flows(options, chosen, options.run, out, say, repeats=options.repeats, only=only)
    return compare(options.what, options.run, out, count=options.count, split=split, refined=options.refined,
                   repeats=options.repeats, predictions=options.prediction, functions=options.predictor, device=options.device,
                   only=only, say=say)


def _split(options: Options, folder: str, say: Say) -> str:
    """The split that is asked for; else the test split or, with a remark, what a set has that has none."""
    from datagen.sets.dataset import splits

    there = splits(folder)
    if options.split or not there or "test" in there:
        return options.split or "test"
    say(f"{folder} has no test split: these are of {there[-1]}, and a network may have learned from them")
    return there[-1]


def study(options: Options, *, say: Say, writable: Writable) -> dict[str, Any]:
    """Trainings that differ in one thing, a table of them with deviations over seeds and published figures, and their curves."""
    from learning.study.run import run_study

    return run_study(options.study, writable(options.out), size=options.size, data=options.data, workers=options.workers,
                     cluster=options.cluster, tls=options.tls, device=options.device, say=say)


def _flows(path: Path) -> bool:
    """Whether a file holds a flow; one that cannot be read is left to whoever needs it."""
    from datagen.files.trajectory import read_trajectory

    try:
        return read_trajectory(path).flows
    except InputError:
        return False


def _of_flows(options: Options, files: list[Path], runs: list[str], out: Path, say: Say, *, repeats: int = 1,
              only: list[str] | None = None) -> dict[str, Any]:
    """Everything that predicts a flow, in one report."""
    from learning.flows.compare import compare_flows

    if options.predictor:
        raise InputError(f"--predictor {' '.join(options.predictor[0])}: is for solids; of flows give --prediction FOLDER")
    return compare_flows(files, runs, out, repeats=repeats, predictions=options.prediction, only=only or [], device=options.device, say=say)
