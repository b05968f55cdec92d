"""The hard cases of the equilibrium solver, as the table in docs/verification.md; the cases stand in tests/hard_cases.py.

    .venv/bin/python -m benchmarks.hard_cases               about a minute
    .venv/bin/python -m benchmarks.hard_cases column arch   those whose name has one of these words in it
    .venv/bin/python -m benchmarks.hard_cases --siblings    some more scenes of each kind, the worst of them
    .venv/bin/python -m benchmarks.hard_cases --roughness   of the reaction against the path, by kind of contact
"""

from dataclasses import replace

from benchmarks import footing
from tests.hard_cases import CASES, SIBLINGS, roughness


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("words", nargs="*")
    parser.add_argument("--siblings", action="store_true")
    parser.add_argument("--roughness", action="store_true")
    options = parser.parse_args()
    table = footing.Table()
    if options.roughness:
        scene = footing.press()
        for contact in ("smooth", "facets", "nodes"):
            rough = roughness(replace(scene, obstacle=replace(scene.obstacle, contact=contact)))
            table.add({"contact at": contact, "force off a smooth curve, over its mean": f"{rough:.2%}"})
        return
    for name, run in CASES.items():
        if options.words and not any(word in name for word in options.words):
            continue
        if options.siblings:
            rows = [other() for other in SIBLINGS.get(name, ())]
            if rows:
                worst = max(rows, key=lambda row: row.error / row.limit)
                table.add({"case": name, "others": len(rows), "worst error": f"{worst.error:.1e}", "limit": f"{worst.limit:.1e}",
                           "held against": worst.reference, "outcome": "; ".join(sorted({row.outcome for row in rows}))})
        else:
            row = run()
            table.add({"case": name, "steps asked": row.asked, "halvings": row.halvings, "iterations": row.iterations,
                       "error": f"{row.error:.1e}", "held against": row.reference, "outcome": row.outcome})


if __name__ == "__main__":
    main()
