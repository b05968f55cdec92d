"""The command line: one small function for each verb, wiring only.

Every verb takes --json: one object on standard output and nothing else there; progress and remarks go to standard error.
Exit status: 0 done, 1 the work failed (with what was saved and where), 2 the input is wrong, 130 stopped by the keyboard.
"""

from __future__ import annotations

import argparse
import errno
import json
import math
import os
import signal
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any, NoReturn

if __name__ == "__main__" and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # stopped while its libraries are loaded it ends at once, without a traceback

import numpy as np

from datagen.scene_verbs import add_scene_verbs
from datagen.verbs import VERBS, add_data_verbs
from datagen.ways import EXAMPLES, Completion, Version
from learning.verbs import add_learning_verbs
from physics.schema import InputError, WorkError, finite

Options = argparse.Namespace
# Under mpirun of Open MPI or MPICH, or under torchrun, which only train knows; only the first process speaks.
TOGETHER = "WORLD_SIZE" in os.environ
RANK = int(os.environ.get("OMPI_COMM_WORLD_RANK") or os.environ.get("PMI_RANK") or os.environ.get("RANK") or 0)
PROCESSES = int(os.environ.get("OMPI_COMM_WORLD_SIZE") or os.environ.get("PMI_SIZE") or os.environ.get("WORLD_SIZE") or 1)


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
                 cluster=options.cluster, tls=options.tls, time_limit=options.time_limit, stress=bool(options.fields))
    _say(options, ", ".join(f"{key} {value}" for key, value in result.items()) + f": {options.out}")
    if number := result.get("not_promised"):
        raise WorkError(f"the error asked is not promised of {number} of {result['trajectories']} trajectories; they are in {options.out}",
                        result)
    return result


def of_data(options: Options) -> dict[str, Any]:
    """One of the verbs that work on a folder of trajectories."""
    return VERBS[options.what](options, say=lambda text: _say(options, text), writable=_writable)


def of_scenes(function: Callable[..., dict[str, Any]]) -> Callable[[Options], dict[str, Any]]:
    """One of the verbs that work with a scene, in one process or several."""
    return lambda options: function(options, say=lambda text: _say(options, text), writable=_writable, rank=RANK, processes=PROCESSES)


def of_networks(function: Callable[..., dict[str, Any]]) -> Callable[[Options], dict[str, Any]]:
    """One of the verbs that work with networks."""
    return lambda options: function(options, say=lambda text: _say(options, text), writable=_writable)


def verify(options: Options) -> dict[str, Any]:
    """Any prediction in the trajectory format, or a folder of them, held against its reference and against the equations."""
    from datagen.files.prediction import lines, together
    from datagen.files.trajectory import read_trajectory
    from datagen.flow.prediction import flow_lines, verify_files

    for _, file, _ in together(Path(options.prediction), Path(options.reference)) if options.fields else ():
        if not {"stress", "von_mises"} & set(read_trajectory(file).fields):
            raise InputError(f'{file}: has no {options.fields}; a network tells it with [outputs] fields = ["von_mises"]')
    result = verify_files(options.prediction, options.reference, _writable(options.out))
    for line in (flow_lines if "nothing_changes" in result else lines)(result):
        _say(options, line)
    return result


def view(options: Options) -> dict[str, Any]:
    """A film of a trajectory (.gif), one frame of it (.png), or a page in which it is turned by hand (.html)."""
    from datagen.files.trajectory import read_sound
    from datagen.scene_verbs import write_path
    from physics.view import ObstacleSurface, film, flow_film, flow_picture, still_picture

    out = _writable(options.out or Path(options.trajectory).with_suffix(".gif"), ".gif", ".png", ".html")
    if options.frame is not None and out.suffix != ".png":
        raise InputError(f"--frame {options.frame}: is for a picture, --out NAME.png")
    trajectory = read_sound(options.trajectory, complete=False)
    if out.suffix == ".html":
        if trajectory.flows:
            raise InputError(f"--out {out}: a page is for solids; of a flow there is a picture, .png, and a film, .gif")
        write_path(out, Path(options.trajectory).name, trajectory)
        _say(options, f"page: {out}")
        return {"html": str(out)}
    surface = None if trajectory.obstacle is None else ObstacleSurface(*trajectory.obstacle)
    if out.suffix == ".png":
        last = len(trajectory.displacement) - 1
        frame = last if options.frame is None else options.frame
        if frame > last:
            raise InputError(f"--frame {frame}: the last one is {last}")
        if trajectory.flows:
            flow_picture(out, trajectory.mesh, trajectory.fields["velocity"], frame)
        else:
            still_picture(out, trajectory.mesh, trajectory.displacement[:, trajectory.body], frame, obstacle=surface)
        _say(options, f"frame {frame} of {last}: {out}")
        return {"frame": frame, "out": str(out)}
    frames = (flow_film(out, trajectory.mesh, trajectory.fields["velocity"]) if trajectory.flows else
              film(out, trajectory.mesh, trajectory.displacement[:, trajectory.body], obstacle=surface))
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
        # What overflows is found in the results, and said there in words. A predictor of the user's may print.
        with np.errstate(all="ignore"), redirect_stdout(sys.stderr if options.json else sys.stdout):
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
        return _fail(f"{error.filename or 'cannot write'}: {error.strerror or error}", 2 if error.errno == errno.ENAMETOOLONG else 1)
    except (KeyboardInterrupt, ImportError) as error:  # the latter where a library was being loaded
        if isinstance(error, ImportError) and not isinstance(error.__cause__, KeyboardInterrupt):
            raise
        return _fail("stopped; finished files are kept", 130)


def _fail(message: str, status: int) -> int:
    if RANK == 0:
        print("fidelity: " + "".join(letter if letter.isprintable() else " " for letter in message), file=sys.stderr)
    return status


def _say(options: Options, text: str) -> None:
    """A line for the reader: on standard output, or on standard error when that is taken by JSON."""
    if RANK == 0:
        print(text, file=sys.stderr if options.json else sys.stdout, flush=True)


def _writable(path: str | Path | None, *suffixes: str, option: str = "--out") -> Any:
    """The path of an output that can be written, checked before any work; None stays None. Without suffixes: a folder.

    Folders that the check had to make are taken away again: wrong input leaves nothing behind.
    """
    if path is None:
        return None
    path = Path(path)
    suffix = bool(suffixes)
    if suffix and path.suffix not in suffixes:
        raise InputError(f"{option} {path}: the name must end in {' or '.join(suffixes)}")
    if (suffix and path.is_dir()) or (not suffix and path.exists() and not path.is_dir()):
        raise InputError(f"{option} {path}: is {'a folder' if path.is_dir() else 'not a folder'}")
    folder = path.parent if suffix else path
    missing = [place for place in (folder, *folder.parents) if not place.exists()]  # the deepest first
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".{path.name}.{os.getpid()}.probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(f"{option} {path}: {error.strerror}") from None
    finally:
        for place in missing:
            if place.is_dir():
                place.rmdir()
    return path


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line; `more` is asked for the end of its help."""

    more: Callable[[], str] | None = None

    def format_help(self) -> str:
        verb = self.prog.removeprefix("fidelity ")
        example = f"\nexample:\n  fidelity {verb} {EXAMPLES[verb]}\n" if verb in EXAMPLES else ""
        return super().format_help() + (f"\n{self.more()}\n" if self.more else "") + example

    def error(self, message: str) -> NoReturn:
        raise SystemExit(_fail(message.replace(" (choose from", "; choose from").rstrip(")"), 2))


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="fidelity", description="Physics fidelity of learned mesh simulators, held against finite elements.")
    parser.add_argument("--version", action=Version, nargs=0, help="the version and the commit")
    parser.add_argument("--completion", action=Completion, nargs=0, help="what bash or zsh needs: source <(fidelity --completion)")
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

    add_scene_verbs(lambda name, function, *positional: verb(name, of_scenes(function), *positional, about=function.__doc__), _positive)
    added = verb("generate", generate, "family")
    add = added.add_argument
    add("--out", help="folder")
    add("--count", type=_positive, help="trajectories of all splits together (the family's own number)")
    add("--split", help="only train, valid or test")
    add("--seed", type=_seed, default=0)
    add("--workers", type=_positive, help="processes (one for each core)")
    add("--cluster", default="", metavar="tcp://...", help="a Dask scheduler, whose workers do it instead; tcp:// is for a trusted "
                                                            "network, tls:// for any")
    add("--tls", nargs=3, default=(), metavar=("CA", "CERT", "KEY"), help="for tls://, files of the authority's certificate, ours, its key")
    add("--time-limit", type=float, default=math.inf, metavar="S", help="seconds for one scene, then another is drawn (none)")
    add("--fields", choices=("stress",), help="stress: also the stress tensor and von Mises stress at the nodes, in all frames")
    add("--dry-run", action="store_true", help="only draw the scenes: what the set will be like")
    data = verbs.add_parser("dataset", help="A folder of trajectories.").add_subparsers(dest="what", required=True, parser_class=_Parser)
    add_data_verbs(lambda name, about, *positional: verb(name, of_data, *positional, about=about, into=data), _positive, _count, _seed)
    add_learning_verbs(lambda name, function, *positional: verb(name, of_networks(function), *positional, about=function.__doc__),
                       _positive, _count)
    add = verb("verify", verify, "prediction").add_argument
    add("--reference", required=True, help="trajectory of finite elements, with its scene in it; or a folder of them")
    add("--fields", choices=("stress",), help="stress: it must be predicted; where it is, it is compared in any case")
    add("--out", help="folder for the figures and a picture of the worst frame")
    add = verb("view", view, "trajectory").add_argument
    add("--out", help="film, .gif, one frame, .png, or page, .html")
    add("--frame", type=_count, help="of the picture, the rest state being 0 (the last)")
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
    if signal.getsignal(signal.SIGINT) == signal.SIG_DFL:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.exit(main())
