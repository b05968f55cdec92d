"""Is an error that is asked kept, and what does it cost? Random scenes solved for errors of 3, 1 and 0.3 % of the displacement.

    .venv/bin/python -m benchmarks.error                                       four scenes, some minutes
    .venv/bin/python -m benchmarks.error --seed 100 --count 40 --keep out.jsonl     goes on where it was stopped

Scenes (`draw`) are thick and thin beams, plates, plane sheets and panels with holes, of all laws, under all kinds of obstacles, forces,
weights and supports that move, in 400 steps, as a scene has that does not say. "True" is the error at four steps against a reference:
cells of second order, with numbers of cells along each direction of up to twice those that the smallest error came to, in a box under an
obstacle as long as wide and high, as far as LARGEST allows, and of 3/4 and 1/2 of that; it is what the two finer are extrapolated to by
the order that all three show, and "of the reference" is how far that is from what the two coarser are extrapolated to. A scene that takes
longer than --limit, or has no equilibrium, has one row that says so. The last rows are of the answers whose reference is ten times as
good as what is asked.

The uniform mesh has standard cells of first order (hexahedra; of a panel tetrahedra; of a sheet its own), as long as wide and high, and
is the first of L / 8, L / 12, L / 18, ... that has the error asked at those four steps. It alone is solved in all steps; "~ x" where it
was stopped after --longest seconds: what all steps would take as those after the first had (those that nothing touches take least).
">= x" where no mesh of at most --most nodes has the error: then it is the next one, whose error is not looked at.
Seconds are the processor's of all of it, search and checks included, in a process that has solved bodies of such cells before.
"""

import json
import math
import signal
import time
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks import footing
from physics.accuracy.between import solve_chosen
from physics.accuracy.choose import choose
from physics.accuracy.estimate import distance, observed_order
from physics.accuracy.meshes.ladder import families
from physics.accuracy.pilot import Pilot
from physics.accuracy.table import judge
from physics.equilibrium.newton import TOLERANCE
from physics.equilibrium.state import NoEquilibrium
from physics.mesh.build import build_mesh
from physics.scene import read_scene
from physics.solution import solve

ERRORS, MOST, STEPS = (0.03, 0.01, 0.003), 8000, 400
FINER, LARGEST = (2.0, 1.5, 1.2, 1.0, 0.8), 10000  # a reference's cells over an answer's, the first with at most so many nodes
LONG = range(12, 0, -1)  # a quarter of those along the longest side, where an obstacle rolls over a box
HEADS = ("scene", "asked", "estimated", "true", "of the reference", "promised", "mesh", "nodes", "seconds", "uniform, seconds", "its nodes")
FEWEST = 5  # steps of a uniform mesh
CELLS = 2, 3, 4  # its meshes, in parts of their numbers of cells


def draw(seed, steps=STEPS):
    """The name of a scene, and the scene, without a mesh."""
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
             "support": [clamped], "steps": {"count": steps}}
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
    solution = solve_chosen(choice)
    return choice, solution, judge(choice, solution), time.process_time() - start


def begun(scene):
    """Have the compiled forms of a scene's cells loaded, as those of the uniform mesh are before it is timed."""
    for family in families(scene):
        with suppress(NoEquilibrium, ValueError):
            own, mesh = family.rung(family.base)
            solve(replace(own, steps=replace(own.steps, count=1)), mesh=mesh, snaps=False)


def poses(count):
    """Four steps of a path, and where they are in it."""
    frames = [round(count * part / 4) for part in (1, 2, 3, 4)]
    return frames, np.array(frames) / count


def reference(scene, choice, solution):
    """(K, M, d) values at `poses` of three meshes much finer than an answer's, extrapolated, and about how far they are off."""
    climb, pilots = choice.climb, choice.pilots
    frames, fractions = poses(scene.steps.count)
    family = max(families(scene), key=lambda one: one.order)
    second = 0.6 if climb.family.order < family.order else 1.0
    extent = [side for side in scene.body.extent if side] if scene.body.shape in ("beam", "plate") else []
    rolls = scene.obstacles and extent
    for finer in LONG if rolls else FINER:
        numbers = [finer * side / max(extent) for side in extent] if rolls else [finer * second * n / CELLS[-1] for n in climb.sizes]
        parts = [family.whole(max(1, round(number) if rolls else math.ceil(number))) for number in numbers]
        if len(family.rung(tuple(CELLS[-1] * part for part in parts))[1].points) <= LARGEST:
            break
    near, found = Pilot(solution.mesh, np.zeros(0), solution.displacement[frames], 0.0), []
    for n in CELLS:
        near = pilots.beside(*family.rung(tuple(n * part for part in parts)), 1e-7, near, fractions)
        found.append(near.values)
    changes = [distance(one, other, pilots.weights) for one, other in pairwise(found)]
    order = max(1.0, observed_order(CELLS, changes, family.highest))
    ends = [fine + (fine - coarse) / ((m / n) ** order - 1) for (n, coarse), (m, fine) in pairwise(zip(CELLS, found, strict=True))]
    return ends[1], distance(*ends, pilots.weights)


class Uniform:
    """Uniform meshes of a scene, L / 8, L / 12, ..., each looked at once.

    near, values: an answer, and the true values, at `poses`
    """

    def __init__(self, scene, near, values, pilots, most):
        self.scene = replace(scene, steps=replace(scene.steps, error=None))
        self.near, self.values, self.pilots, self.most = near, values, pilots, most
        self.errors, self.ran = {}, {}

    def mesh(self, k):
        """The scene with a mesh, and about how many nodes that has."""
        body, extent = self.scene.body, [side for side in self.scene.body.extent if side]
        size = max(extent) / (8 * 1.5**k)
        numbers = tuple(max(1, round(side / size)) for side in extent)
        nodes = np.prod([n + 1 for n in numbers])
        return nodes, replace(self.scene, body=replace(body, cells=None, cell_size=size, layers=numbers[2], cell="tetrahedron")
                       if body.shape == "panel" else replace(body, cells=numbers, cell=body.cell if len(numbers) == 2 else "hexahedron"))

    def error(self, k, scene):
        """At a few poses."""
        if k not in self.errors:
            try:
                found = self.pilots.beside(scene, build_mesh(scene.body), TOLERANCE, self.near, poses(scene.steps.count)[1])
                self.errors[k] = distance(found.values, self.values, self.pilots.weights)
            except (RuntimeError, ValueError) as why:
                footing.say(f"uniform {scene.body}: {why}")
                self.errors[k] = math.inf
        return self.errors[k]

    def first(self, error, longest):
        """Processor seconds of all steps on the first mesh that has an error, its nodes, whether it has it, and whether it was done."""
        k, has = 0, False
        while True:
            nodes, scene = self.mesh(k)
            if nodes > self.most or (has := self.error(k, scene) <= error):
                break
            k += 1
        if k not in self.ran:
            self.ran[k] = timed(scene, longest)
        seconds, nodes, done = self.ran[k]
        return seconds, nodes, has, done


def timed(scene, longest):
    """Processor seconds of a scene, its nodes, and whether it was done in so many; else what it would take by the steps after the first."""
    start, mesh, ends = time.process_time(), build_mesh(scene.body), []

    def watch(step):
        ends.append(time.process_time() - start)
        if ends[-1] > longest and step > FEWEST:
            raise TimeoutError

    try:
        solve(scene, mesh=mesh, on_step=watch)
    except TimeoutError:
        return ends[0] + (ends[-1] - ends[0]) * (scene.steps.count - 1) / (len(ends) - 1), len(mesh.points), False
    return time.process_time() - start, len(mesh.points), True


def one(seed, options):
    """Rows of a scene, as they are kept."""
    name, scene = draw(seed, options.steps)
    footing.say(f"scene {seed}: {name}")
    begun(scene)
    answers, frames = [(error, *answer(scene, error, options.most)) for error in sorted(options.errors)], poses(options.steps)[0]
    choice, solution = answers[0][1:3]
    values, own = reference(scene, choice, solution)
    near = Pilot(solution.mesh, np.zeros(0), solution.displacement[frames], 0.0)
    uniform, rows = Uniform(scene, near, values, choice.pilots, options.most), []
    for error, choice, solution, verdict, seconds in answers:
        true = distance(choice.pilots.of(choice.scene, solution, frames), values, choice.pilots.weights)
        other, nodes, has, done = uniform.first(error, options.longest)
        rows.append({"scene": f"{seed}: {name}", "asked": error, "estimated": verdict.estimated, "true": true, "of the reference": own,
                     "promised": verdict.reached, "mesh": choice.climb.family.said(choice.climb.sizes), "nodes": len(choice.mesh.points),
                     "seconds": seconds, "uniform": other, "its nodes": nodes, "has": has, "done": done})
    return rows[::-1]


def shown(row):
    """A row for a reader."""
    if "true" not in row:
        return dict.fromkeys(HEADS) | row
    return {"scene": row["scene"], "asked": f"{row['asked']:.1%}", "estimated": f"{row['estimated']:.2%}", "true": f"{row['true']:.2%}",
            "of the reference": f"{row['of the reference']:.3%}", "promised": "yes" if row["promised"] else "no", "mesh": row["mesh"],
            "nodes": row["nodes"], "seconds": f"{row['seconds']:.2g}",
            "uniform, seconds": f"{'' if row['has'] else '>= '}{'' if row['done'] else '~ '}{row['uniform']:.2g}",
            "its nodes": f"{'' if row['has'] else '>= '}{row['its nodes']}"}


def summed(rows, asked):
    """What all answers with a reference ten times as good come to, as a last row."""
    good = [row for row in rows if "true" in row and row["of the reference"] <= row["asked"] / 10]
    kept = [row for row in good if row["true"] <= row["asked"]]
    promised = [row for row in good if row["promised"]]
    ratio = np.median([row["seconds"] / row["uniform"] for row in good]) if good else math.nan
    return {"scene": f"{len(good)} answers with a good reference", "asked": asked,
            "true": f"{len(kept)} have the error asked, {sum(row['true'] >= row['asked'] / 5 for row in kept)} within a factor of five",
            "promised": f"{len(promised)}, {sum(row in kept for row in promised)} of them kept",
            "seconds": f"median {ratio:.2f} of the uniform mesh's"}


def too_long(*_):
    raise TimeoutError("not done in the time for a scene")


def main():
    parser = footing.parser(__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=4)
    parser.add_argument("--errors", type=float, nargs="+", default=ERRORS)
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--most", type=int, default=MOST, help="nodes of a mesh, chosen or uniform")
    parser.add_argument("--longest", type=float, default=5, help="processor seconds of a uniform mesh, before it is reckoned")
    parser.add_argument("--limit", type=int, default=300, help="processor seconds for a scene")
    parser.add_argument("--minutes", type=float, default=math.inf, help="no scene is begun after so long")
    parser.add_argument("--keep", type=Path, help="a file of finished scenes, to go on from")
    options = parser.parse_args()
    start = time.monotonic()
    signal.signal(signal.SIGPROF, too_long)
    kept = {} if options.keep is None or not options.keep.exists() else dict(map(json.loads, options.keep.read_text().splitlines()))
    table, rows = footing.Table(), []
    for seed in range(options.seed, options.seed + options.count):
        if seed not in kept:
            if time.monotonic() - start > 60 * options.minutes:
                break
            try:
                signal.setitimer(signal.ITIMER_PROF, options.limit)
                kept[seed] = one(seed, options)
            except (NoEquilibrium, ValueError, TimeoutError) as why:
                kept[seed] = [{"scene": f"{seed}: {draw(seed)[0]}", "mesh": str(why)}]
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0)
            if options.keep is not None:
                with options.keep.open("a") as file:
                    file.write(json.dumps([seed, kept[seed]]) + "\n")
        rows += kept[seed]
        for row in kept[seed]:
            table.add(shown(row))
    for error in options.errors:
        table.add(summed([row for row in rows if row.get("asked") == error], f"{error:.1%}"))
    table.add(summed(rows, "all"))


if __name__ == "__main__":
    main()
