"""How time grows with the mesh: a trained network, finite elements and their cheap forms on one scene at 1.5 k, 5 k and 15 k nodes.

    .venv/bin/python -m benchmarks.growth [--run RUN] [--picture growth.png] [--steps 100]

The same pressed beam with finer and finer cells. The table has milliseconds a step, set-up included, and in brackets the error [mm]
over whole rollouts to the reference of the same mesh. A network sees cells smaller than it was trained on: read its error here as
that of an alien, and its time as what any network of its size would take.
"""

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks import footing
from datagen.sets.generate import trajectory_of
from learning.prediction.checkpoint import load_model
from learning.prediction.predictor import Case, LeftOut
from learning.prediction.rivals import REFERENCE, elements
from learning.prediction.surrogates import corrected, estimated, learned
from learning.report.evaluate import warm_up
from learning.report.pareto import COLOURS, MARKERS
from physics.fem import release
from physics.mesh.build import build_mesh
from physics.mesh.quality import rmsd

CELLS = ((40, 5, 5), (60, 8, 8), (90, 12, 12))


def press(cells: tuple[int, int, int], steps: int) -> Case:
    """The scene solved on these cells."""
    scene = footing.press(cells, steps, heights=(0.0305, 0.0105))
    return Case("x".join(map(str, cells)), trajectory_of(scene), scene, build_mesh(scene.body))


def measure(run: str | None, steps: int) -> list[dict]:
    """A row for each predictor and mesh."""
    model = load_model(run) if run else None
    networks = [learned(model, single_steps=False), corrected(model, 1)] if model else []
    predictors = [*networks, elements("FE, cells twice as large", halvings=1),
                  elements("FE, a tenth of the steps", fewer=10), estimated("reduced-order model"), elements(REFERENCE)]
    rows = []
    for cells in CELLS:
        case = press(cells, steps)
        warm_up(case)
        for predictor in predictors:
            try:
                seconds, found = footing.cost(predictor.predict, case)
            except LeftOut as reason:
                footing.say(f"{predictor.name}, {case.name}: left out, because {reason}")
                continue
            rows.append({"predictor": predictor.name, "kind": predictor.kind, "nodes": len(case.mesh.points),
                         "ms_per_step": 1e3 * seconds / steps,
                         "rmsd_all_mm": 1e3 * rmsd(found.path[1:], case.truth[1:], case.free)})
            footing.say("  ".join(f"{value:.4g}" if isinstance(value, float) else str(value) for value in rows[-1].values()))
        release()
    return rows


def picture(path: Path, rows: list[dict]) -> None:
    """Time per step against nodes, a line for each predictor."""
    figure = Figure(figsize=(9, 5.6), dpi=110, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.set(xscale="log", yscale="log", xlabel="nodes of the body", ylabel="processor time per step [ms], set-up included")
    for number, name in enumerate(dict.fromkeys(row["predictor"] for row in rows)):
        own = [row for row in rows if row["predictor"] == name]
        kind, nodes, ms = own[0]["kind"], [row["nodes"] for row in own], [row["ms_per_step"] for row in own]
        power = f"  (nodes^{footing.exponent(nodes, ms):.2f})" if len(nodes) > 1 else ""
        axes.plot(nodes, ms, color=COLOURS[kind], marker=MARKERS[kind], ls=("-", "--", ":")[number % 3], label=name + power)
    axes.grid(which="major", color="#ececec", lw=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9)
    figure.savefig(path)


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("--run", help="folder of a training")
    parser.add_argument("--picture", type=Path, help="a .png of time against nodes")
    parser.add_argument("--steps", type=int, default=100)
    options = parser.parse_args()
    rows, table = measure(options.run, options.steps), footing.Table()
    for name in dict.fromkeys(row["predictor"] for row in rows):
        own = {row["nodes"]: row for row in rows if row["predictor"] == name}
        table.add({"": name} | {f"{nodes} nodes": f"{own[nodes]['ms_per_step']:.3g}" + (
            f" ({own[nodes]['rmsd_all_mm']:.2g})" if name != REFERENCE else "") if nodes in own else None
            for nodes in dict.fromkeys(row["nodes"] for row in rows)})
    if options.picture:
        picture(options.picture, rows)


if __name__ == "__main__":
    main()
