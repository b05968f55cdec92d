"""The figures of docs/results.md: what `fidelity pareto` measures, with some of its columns.

    .venv/bin/python -m benchmarks.pareto demo/data --run demo/run --out demo/pareto     after ./run demo

The whole report stands in the folder after --out; the verb's other choices are left as they are.
"""

from benchmarks import footing
from learning.report.compare import compare
from learning.report.table import COLUMNS, heads, shown

SHOWN = {key: COLUMNS[key] for key in ("ms_per_step", "ms_per_step_alone", "rmsd_all", "rmsd_refined", "relative_residual", "stress_error",
                                       "iterations")}


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("what")
    parser.add_argument("--run", nargs="+", default=[])
    parser.add_argument("--out", required=True)
    options = parser.parse_args()
    table = footing.Table()
    for row in compare(options.what, options.run, options.out, say=footing.say)["rows"]:
        found = [(row["scores"].get(key), column.factor) for key, column in SHOWN.items()]
        entries = [row["name"], *(None if score is None else shown(score * factor) for score, factor in found)]
        table.add(dict(zip(heads(SHOWN), entries, strict=True)))


if __name__ == "__main__":
    main()
