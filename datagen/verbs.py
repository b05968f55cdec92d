"""What the command line does with a folder of trajectories: `fidelity dataset check | stats | card | pack | ...`, wiring only.

Each function takes the options of its verb, `say` for lines to the reader, and `writable`, which checks the path of an output
before any work; what it returns is printed as JSON when that is asked for.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from physics.schema import WorkError

Options = argparse.Namespace
Say = Callable[[str], None]
Writable = Callable[..., Any]


def add_data_verbs(verb: Callable[..., argparse.ArgumentParser], positive: Callable[[str], int], count: Callable[[str], int],
                   seed: Callable[[str], int]) -> None:
    """Declare the verbs to a parser: `verb(name, about, *positional)` adds one."""
    def declared(name: str, *positional: str) -> Callable[..., Any]:
        return verb(name, VERBS[name].__doc__, *positional).add_argument

    add = declared("check", "folder")
    add("--steps", type=positive, default=5, help="of each trajectory whose equilibrium is computed anew (5)")
    add = declared("stats", "folder")
    add("--refined", type=count, default=0, help="trajectories solved again with twice the cells each way (0)")
    add("--seed", type=seed, default=0, help="of the choice of these")
    add = declared("card", "folder")
    add("--refined", type=count, help="as for stats (10, of flows 1)")
    add = declared("pack", "folder")
    add("--tolerance", type=float, help="largest error of a displacement [m] (1e-6)")
    add("--share", type=float, help="of flows: largest error of velocity and pressure, over their largest value in the "
                                                  "median frame (1e-3)")
    add("--out", required=True, help="file, .pack")
    declared("unpack", "file")("--out", required=True, help="folder")
    add = declared("import", "folder")
    add("--out", required=True, help="folder")
    add("--count", type=positive, help="at most so many of each split (all)")
    add = declared("export", "folder")
    add("--out", required=True, help="folder")
    add("--cells", choices=("tetrahedra", "own"), default="tetrahedra", help="tetrahedra, as DeepMind's readers expect, or our own")


def check(options: Options, *, say: Say, writable: Writable) -> dict[str, Any]:
    """Every file of a data set: layout, checksums, physics."""
    from datagen.sets.check import check as run

    problems = run(options.folder, steps=options.steps, remark=lambda text: say(f"remark: {text}"))
    for problem in problems:
        say(problem)
    if problems:
        raise WorkError(f"{len(problems)} problem{'s' if len(problems) > 1 else ''} in {options.folder}: {problems[0]}",
                        {"problems": problems})
    say(f"{options.folder}: nothing wrong")
    return {"problems": problems}


def stats(options: Options, *, say: Say, writable: Writable) -> dict[str, Any]:
    """What a data set holds, in numbers."""
    from datagen.sets.statistics import lines, statistics

    result = statistics(options.folder, refined=options.refined, seed=options.seed)
    for line in lines(result):
        say(line)
    return result


def card(options: Options, *, say: Say, writable: Writable) -> dict[str, Any]:
    """README.md of a data set: ranges, statistics, cost, licence."""
    from datagen.sets.card import write_card

    path = write_card(options.folder, refined=options.refined)
    say(f"card: {path}")
    return {"out": str(path)}


def pack(options: Options, *, say: Say, writable: Writable) -> dict[str, Any]:
    """A data set in one small file, its displacements within a tolerance."""
    from datagen.sets.pack import pack as run

    out = writable(options.out, ".pack")
    result = run(options.folder, out, tolerance=options.tolerance, share=options.share)
    error = f"{result['largest_error']:.3g} m" if "share" not in result else f"{result['largest_share']:.3g} of velocity and pressure"
    say(f"{result['trajectories']} trajectories, {result['bytes'] / 1e6:.2f} MB, {result['ratio']:.0f} times smaller, "
        f"largest error {error}: {out}")
    return result


def unpack(options: Options, *, say: Say, writable: Writable) -> dict[str, Any]:
    """The data set in a packed file."""
    from datagen.sets.pack import unpack as run

    result = run(options.file, writable(options.out))
    say(f"{result['trajectories']} trajectories: {options.out}")
    return result


def import_(options: Options, *, say: Say, writable: Writable) -> dict[str, Any]:
    """A data set in DeepMind's format (TFRecord and meta.json) as trajectory files."""
    from datagen.sets.deepmind import import_records

    result = import_records(options.folder, writable(options.out), count=options.count)
    say(f"{result['trajectories']} trajectories: {options.out}")
    return result


def export(options: Options, *, say: Say, writable: Writable) -> dict[str, Any]:
    """A data set in DeepMind's format (TFRecord and meta.json)."""
    from datagen.sets.deepmind import export_records

    result = export_records(options.folder, writable(options.out), cells=options.cells)
    say(f"{result['trajectories']} trajectories: {options.out}")
    return result


VERBS = {"check": check, "stats": stats, "card": card, "pack": pack, "unpack": unpack, "import": import_, "export": export}
