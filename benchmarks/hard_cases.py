"""The hard cases of the equilibrium solver, as the table in docs/verification.md; the cases stand in tests/hard_cases.py.

    .venv/bin/python -m benchmarks.hard_cases               about a minute
    .venv/bin/python -m benchmarks.hard_cases column arch   those whose name has one of these words in it
    .venv/bin/python -m benchmarks.hard_cases --siblings    some more scenes of each kind, the worst of them
    .venv/bin/python -m benchmarks.hard_cases --roughness [--picture docs/pictures/contact.png]   of the force, by kind of contact
"""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks import footing
from tests.hard_cases import CASES, SIBLINGS, force_on_obstacle, roughness


def draw(forces: dict[str, NDArray[np.float64]], path: str) -> None:
    """How much the forces (T,) [N] of each kind of contact grow in a step."""
    figure = Figure(figsize=(8, 4), layout="constrained")
    axes = figure.subplots()
    for contact, force in forces.items():
        axes.plot(np.diff(force), label={"smooth": "smooth surface", "facets": "points of facets"}.get(contact, contact),
                  linewidth=2 if contact == "smooth" else 1)
    axes.set(xlabel="step of the press scene", ylabel="growth of the force in a step [N]", ylim=(0, None))
    axes.legend(frameon=False)
    figure.savefig(path, dpi=80)


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("words", nargs="*")
    parser.add_argument("--siblings", action="store_true")
    parser.add_argument("--roughness", action="store_true")
    parser.add_argument("--picture", help="a .png of how steeply each force rises")
    options = parser.parse_args()
    table = footing.Table()
    if options.roughness:
        scene, forces = footing.press(), {}
        for contact in ("smooth", "facets", "nodes"):
            own = replace(scene, obstacle=replace(scene.obstacle, contact=contact))
            forces[contact] = force_on_obstacle(own)
            table.add({"contact at": contact, "force off a smooth curve, over its mean": f"{roughness(own, forces[contact]):.2%}"})
        if options.picture:
            draw(forces, options.picture)
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
