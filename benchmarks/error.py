"""Is an error that is asked kept, and what does it cost? Random scenes solved for errors of 3 and 1 % of the displacement.

    .venv/bin/python -m benchmarks.error                                       four scenes, some minutes
    .venv/bin/python -m benchmarks.error --seed 100 --count 40 --keep out.jsonl     goes on where it was stopped

Scenes (`draw`) are thick and thin beams, plates, plane sheets and panels with holes, of all laws, under all kinds of obstacles, forces,
weights and supports that move, in 40 steps, a tenth of what a scene has that does not say. "True" is the error at four steps against a
reference: cells of second order (of a sheet: its own), with the numbers of cells along each direction that the smallest error came to,
times REFERENCE; "of the reference" what its change from a mesh 1.5 times coarser leaves by an error that falls as h^1.5. A scene that
takes longer than --limit is left out and counted. One whose reference is not ten times as good as what is asked is shown, and counted
apart. The uniform mesh has standard cells of first order (hexahedra; of a panel tetrahedra; of a sheet its own), as long as wide and
high, and is the first of L / 8, L / 12, L / 18, ... that has the error asked; where none of at most --most nodes has, its time is that of
the finest one tried, which is less than it would take. Times are processor seconds of all of it, search and checks included.
"""

import json
import math
import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks import footing
from physics.accuracy.choose import choose
from physics.accuracy.estimate import distance
from physics.accuracy.ladder import families
from physics.accuracy.pilot import Pilot
from physics.accuracy.table import judge
from physics.equilibrium.state import NoEquilibrium
from physics.scene import read_scene
from physics.solution import solve

ERRORS, MOST, STEPS = (0.03, 0.01), 4000, 40
FRAMES = [10, 20, 30, 40]
REFERENCE = {1: 0.9, 2: 1.6}  # times the cells of an answer of first and of second order


def draw(seed):
    """A scene without a mesh."""
    random = np.random.default_rng(seed)
    number = random.uniform

    def one_of(*options):
        return options[random.integers(len(options))]

    shape = one_of("beam", "beam", "thin", "plate", "panel", "sheet")
    length, young = number(0.06, 0.12), 10 ** number(5.5, 6.5)
    width = length * (number(0.5, 1.0) if shape in ("plate", "panel") else number(0.15, 0.3))
    height = length * (number(0.03, 0.08) if shape in ("thin", "plate", "panel") else number(0.15, 0.3))
    body = {"beam": {"length": length, "width": width, "height": height}, "thin": {"length": length, "width": width, "height": height},
            "plate": {"shape": "plate", "length": length, "width": width, "height": height},
            "sheet": {"shape": "plate", "length": length, "width": width, "cell": one_of("triangle", "quadrilateral")},
            "panel": {"shape": "panel", "height": height, "outline": [[0, 0], [length, 0], [length, width], [0, width]],
                      "holes": [[0.45 * length, 0.5 * width, 0.15 * width]]}}[shape]
    clamped = {"where": "edge-4" if shape == "panel" else "x-min", "fixed": "xy" if shape == "sheet" else "xyz"}
    end = "edge-2" if shape == "panel" else "x-max"
    across = 1 if shape == "sheet" else 2
    way = [0.0, 0.0, 0.0]
    way[across] = -height * number(0.3, 1.0) if shape != "sheet" else -width * number(0.1, 0.3)
    stiff = young * (height / length) ** 2 if shape != "sheet" else young * (width / length) ** 2  # pressure that bends a strip visibly
    scene = {"body": body, "material": {"law": one_of("neo-hookean", "neo-hookean-log", "saint-venant-kirchhoff"), "young_modulus": young,
                                        "poisson_ratio": number(0.2, 0.45), "density": 1000.0},
             "support": [clamped], "steps": {"count": STEPS}}
    kind = one_of("obstacle", "obstacle", "force", "weight", "moved")
    if kind == "obstacle" and shape != "sheet":
        radius = length * number(0.1, 0.2)
        name = one_of("sphere", "cylinder", "capsule", "box", "half-space")
        tool = {"sphere": {"radius": radius}, "cylinder": {"radius": radius, "axis": [number(-0.3, 0.3), 1, 0]},
                "capsule": {"radius": radius, "axis": [number(-1, 1), 1, 0], "length": radius},
                "box": {"size": [2 * radius, 2 * radius, 2 * radius]}, "half-space": {"normal": [0.02, number(-0.02, 0.02), -1]}}[name]
        above = height + 0.03 * length + radius * (name != "half-space")
        centre = np.array([length * number(0.6, 0.9), width * number(0.35, 0.65), above])
        depth = 0.03 * length + height * number(0.3, 0.8)
        scene["obstacle"] = tool | {"shape": name, "path": [centre.tolist(), (centre + [0, 0, -depth]).tolist()]}
    elif kind == "moved":
        scene["support"].append({"where": end, "fixed": "y" if shape == "sheet" else "z", "displacement": way})
    elif kind == "weight":
        push = np.zeros(3)
        push[across] = -0.3 * stiff / 1000 / (width if shape == "sheet" else height) * number(0.3, 1.0) * (height if shape != "sheet" else
                                                                                                         width) / length
        scene["load"] = [{"acceleration": push.tolist()}]
    else:
        push = random.normal(size=3) * 0.05
        push[2] *= shape != "sheet"
        push[across] += 0.1
        scene["load"] = [{"where": end, "traction": (push * stiff * number(0.3, 1.0)).tolist()}]
    scene["steps"]["error"] = 0.01
    return f"{shape}, {scene['obstacle']['shape'] if 'obstacle' in scene else 'force' if kind == 'obstacle' else kind}", read_scene(scene)


def answer(scene, error, most):
    """The choice, its solution and verdict, and processor seconds."""
    start = time.process_time()
    choice = choose(replace(scene, steps=replace(scene.steps, error=error)), most=most)
    solution = solve(choice.scene, mesh=choice.mesh, tolerance=choice.tolerance, small_strain=choice.small_strain)
    return choice, solution, judge(choice, solution), time.process_time() - start


def reference(scene, choice, solution):
    """(K, M, d) values at FRAMES on a mesh much finer than an answer's, and about how far they are off."""
    climb, pilots = choice.climb, choice.pilots
    family = max(families(scene), key=lambda one: one.order)
    times = REFERENCE[climb.family.order] if family.order == 2 else 2.5
    fractions, found = np.array(FRAMES) / STEPS, []
    near = Pilot(solution.mesh, np.zeros(0), solution.displacement[FRAMES], 0.0)
    for ratio in (times / 1.5, times):
        sizes = tuple(max(1, math.ceil(ratio * n)) for n in climb.sizes)
        found.append(pilots.beside(*family.rung(sizes), 1e-7, near, fractions))
    left = 1.5**-1.5
    return found[1].values, distance(found[0].values, found[1].values, pilots.weights) * left / (1 - left), len(found[1].mesh.points)


def uniform(scene, error, values, pilots, known, most):
    """Processor seconds of the first uniform mesh that has an error, its nodes, and whether one had it; what is known of meshes is kept."""
    body, extent = scene.body, [side for side in scene.body.extent if side]
    for k in range(12):
        if k not in known:
            size = max(extent) / (8 * 1.5**k)
            numbers = tuple(max(1, round(side / size)) for side in extent)
            if np.prod([n + 1 for n in numbers]) > most:
                break
            asked = (replace(body, cells=None, cell_size=size, layers=numbers[2], cell="tetrahedron") if body.shape == "panel"
                     else replace(body, cells=numbers, cell=body.cell if len(numbers) == 2 else "hexahedron"))
            try:
                seconds, found = footing.cost(solve, replace(scene, body=asked, steps=replace(scene.steps, error=None)))
                known[k] = seconds, distance(pilots.of(scene, found, FRAMES), values, pilots.weights), len(found.mesh.points)
            except (RuntimeError, ValueError) as why:
                footing.say(f"uniform {numbers}: {why}")
                known[k] = 0.0, math.inf, 0
        if known[k][1] <= error:
            return known[k][0], known[k][2], True
    last = known[max(known)] if known else (0.0, 0.0, 0)
    return last[0], last[2], False


def one(seed, errors, most):
    """Rows of a scene, as they are kept."""
    name, scene = draw(seed)
    footing.say(f"scene {seed}: {name}")
    answers, known, rows = [(error, *answer(scene, error, most)) for error in sorted(errors)], {}, []
    values, own, _ = reference(scene, answers[0][1], answers[0][2])
    for error, choice, solution, verdict, seconds in reversed(answers):
        true = distance(choice.pilots.of(choice.scene, solution, FRAMES), values, choice.pilots.weights)
        other, nodes, had = uniform(scene, error, values, choice.pilots, known, most)
        rows.append({"scene": f"{seed}: {name}", "asked": error, "estimated": verdict.estimated, "true": true, "of the reference": own,
                     "promised": verdict.reached, "mesh": choice.climb.family.said(choice.climb.sizes), "nodes": len(choice.mesh.points),
                     "seconds": seconds, "uniform": other, "its nodes": nodes, "had": had})
    return rows


def shown(row):
    """A row for a reader."""
    more = "" if row["had"] else "> "
    return {name: row[name] for name in ("scene",)} | {
        "asked": f"{row['asked']:.1%}", "estimated": f"{row['estimated']:.2%}", "true": f"{row['true']:.2%}",
        "of the reference": f"{row['of the reference']:.2%}", "promised": "yes" if row["promised"] else "no", "mesh": row["mesh"],
        "nodes": row["nodes"], "seconds": f"{row['seconds']:.2g}", "uniform, seconds": f"{more}{row['uniform']:.2g}",
        "its nodes": f"{more}{row['its nodes']}"}


def too_long(*_):
    raise TimeoutError("not done in the time for a scene")


def main():
    parser = footing.parser(__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=4)
    parser.add_argument("--errors", type=float, nargs="+", default=ERRORS)
    parser.add_argument("--most", type=int, default=MOST, help="nodes of a mesh, chosen or uniform")
    parser.add_argument("--limit", type=int, default=60, help="processor seconds for a scene")
    parser.add_argument("--minutes", type=float, default=math.inf, help="no scene is begun after so long")
    parser.add_argument("--keep", type=Path, help="a file of finished scenes, to go on from")
    options = parser.parse_args()
    start = time.monotonic()
    signal.signal(signal.SIGPROF, too_long)
    kept = {} if options.keep is None or not options.keep.exists() else dict(map(json.loads, options.keep.read_text().splitlines()))
    table, rows, failed, done = footing.Table(), [], 0, 0
    for seed in range(options.seed, options.seed + options.count):
        if seed not in kept and time.monotonic() - start > 60 * options.minutes:
            break
        if seed not in kept:
            try:
                signal.setitimer(signal.ITIMER_PROF, options.limit)
                kept[seed] = one(seed, options.errors, options.most)
            except (NoEquilibrium, ValueError, TimeoutError) as why:
                footing.say(f"scene {seed}: {why}")
                kept[seed] = []
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0)
            if options.keep is not None:
                with options.keep.open("a") as file:
                    file.write(json.dumps([seed, kept[seed]]) + "\n")
        done += 1
        failed += not kept[seed]
        rows += kept[seed]
        for row in kept[seed]:
            table.add(shown(row))
    good = [row for row in rows if row["of the reference"] <= row["asked"] / 10]
    for words, some in (("all", rows), ("those with a reference ten times as good", good), *(
            (f"{error:.1%} asked, such a reference", [row for row in good if row["asked"] == error]) for error in options.errors)):
        below = [row for row in some if row["true"] <= row["asked"]]
        near = [row for row in below if row["true"] >= row["asked"] / 5]
        ratios = [row["seconds"] / row["uniform"] for row in some if row["uniform"]]
        footing.say(f"{words}: {len(some)} answers, {sum(row['promised'] for row in some)} promised, {len(below)} with at most the error "
                    f"asked, {len(near)} of them within a factor of five; time over the uniform mesh's: median "
                    f"{float(np.median(ratios)) if ratios else math.nan:.2f} at most")
        promised = [row for row in some if row["promised"]]
        footing.say(f"    of those promised {sum(row['true'] <= row['asked'] for row in promised)} of {len(promised)} are kept")
    footing.say(f"{done} scenes, {failed} without an answer")


if __name__ == "__main__":
    main()
