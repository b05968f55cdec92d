"""Some columns of a study's table, from a folder that `fidelity study` has filled, whole or not; nothing is trained.

    .venv/bin/python -m benchmarks.study main assets/study-main
    .venv/bin/python -m benchmarks.study main FOLDER --size check --columns rmse_1 rmse_all
    .venv/bin/python -m benchmarks.study main FOLDER --words        which rows the spread can tell apart

Beside them stand RMSE-all as a share of what a body that never moves has, and how many seeds there are. Rows without any are left out.
"""

import math

from benchmarks import footing
from learning.prediction.rivals import STILL
from learning.study.plan import SIZES
from learning.study.run import read_study
from learning.study.table import COST, FIGURE, Score
from physics.fidelity.figures import Column, shown

COLUMNS = ("gf_h", "mc", "rmse_1", "rmse_50", "rmse_all", "valid_equal", "train_ms", "test_ms", "memory", "hours")


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("study")
    parser.add_argument("folder")
    parser.add_argument("--size", choices=SIZES, default="small")
    parser.add_argument("--columns", nargs="+", default=COLUMNS)
    parser.add_argument("--words", action="store_true")
    options = parser.parse_args()
    result = read_study(options.study, options.folder, size=options.size)
    if options.words:
        print(*(f"- {line}" for test in result.plan.tests for line in result.apart(test.name)), sep="\n")
        return
    table, heads = footing.Table(), dict(zip(result.columns, result.heads()[1:], strict=True))
    for test in result.plan.tests:
        still = result.cells[STILL][test.name][FIGURE].mean
        for name, cells in result.cells.items():
            known, row = cells[test.name], {"": name} | ({"on": test.name} if len(result.plan.tests) > 1 else {})
            if not known[FIGURE].count:
                continue
            for key in options.columns:
                row[heads[key]] = told(known[key], result.columns[key]) if key in known else "–"
            share = known[FIGURE].mean / still
            table.add(row | {"of nothing moves": "–" if math.isnan(share) else f"{share:.1%}", "seeds": known[FIGURE].count})


def told(cell: Score, column: Column) -> str:
    value = column.factor * cell.mean
    if math.isnan(value):
        return "–"
    return shown(value) + ("" if math.isnan(cell.deviation) or column is COST["memory"] else f" ± {column.factor * cell.deviation:.2g}")


if __name__ == "__main__":
    main()
