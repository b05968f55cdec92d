"""The figures of docs/results.md: what `fidelity pareto` measures, with some of its columns.

    .venv/bin/python -m benchmarks.pareto demo/data --run demo/run demo/fast --out demo/pareto     after ./run demo
    .venv/bin/python -m benchmarks.pareto blind --run assets/m4gn-fast assets/m4gn-beam --many 12 --out blind/pareto

The whole report stands in the folder after --out. With --many it is of so many trajectories, each timed once and none on finer cells,
and the table tells the clock on the wall, and what predictors say of themselves.
"""

from benchmarks import footing
from learning.report.compare import compare
from learning.report.table import COLUMNS, heads, shown

SHOWN = {key: COLUMNS[key] for key in ("ms_per_step", "ms_per_step_alone", "rmsd_all", "rmsd_refined", "relative_residual", "stress_error",
                                       "iterations")}
OF_MANY = {key: COLUMNS[key] for key in ("ms_per_step", "wall_ms_per_step", "ms_per_step_alone", "rmsd_all", "of_motion",
                                         "relative_residual", "iterations", "covered", "unsure", "paid_back")}


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("what")
    parser.add_argument("--run", nargs="+", default=[])
    parser.add_argument("--many", type=int)
    parser.add_argument("--out", required=True)
    options = parser.parse_args()
    columns = OF_MANY if options.many else SHOWN
    how = {"count": options.many, "refined": 0, "repeats": 1} if options.many else {}
    table = footing.Table()
    for row in compare(options.what, options.run, options.out, **how, say=footing.say)["rows"]:
        found = [(row["scores"].get(key), column.factor) for key, column in columns.items()]
        entries = [row["name"], *(None if score is None else shown(score * factor) for score, factor in found)]
        table.add(dict(zip(heads(columns), entries, strict=True)))


if __name__ == "__main__":
    main()
