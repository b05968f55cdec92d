"""Is an error that is asked kept, and what does it cost? Random scenes solved for errors of 3, 1 and 0.3 % of the displacement.

    .venv/bin/python -m benchmarks.error                       four scenes, some minutes
    .venv/bin/python -m benchmarks.error --seed 100 --count 40

The scenes are those of tests/test_physics_random_scenes.py, whose meshes are left to the program. "True" is the error against hexahedra
of second order with 1.6 times the cells each way of what the smallest error took at that order; "of the reference" is how far a mesh
with 1.2 times the cells is from that. The uniform mesh has standard hexahedra of first order, as long as wide and high, and is the first of
L / 8, L / 12, L / 18, ... that has the error asked; one with more than MOST nodes is not tried. Times are all of it, search included. A
scene that ends in no answer is told of.
"""

import time
from dataclasses import replace

import numpy as np

from benchmarks import footing
from physics.accuracy.choose import choose
from physics.accuracy.estimate import distance
from physics.accuracy.ladder import families
from physics.accuracy.table import judge
from physics.solution import solve
from tests.test_physics_random_scenes import draw

ERRORS, MOST = (0.03, 0.01, 0.003), 12_000


def answer(scene, error):
    """The choice, its solution and verdict, and processor seconds."""
    start = time.process_time()
    choice = choose(replace(scene, steps=replace(scene.steps, error=error)))
    solution = solve(choice.scene, mesh=choice.mesh, tolerance=choice.tolerance, small_strain=choice.small_strain)
    return choice, solution, judge(choice, solution), time.process_time() - start


def reference(scene, climb):
    """Values at all frames of second-order cells, and those of a mesh to hold them against, by the mesh that a climb came to."""
    family = families(scene)[0]
    found = []
    for times in (1.2, 1.6):
        own, mesh = family.rung(tuple(int(np.ceil(times * n)) for n in climb.sizes))
        found.append(solve(own, mesh=mesh, tolerance=1e-7))
    return found


def uniform(scene, error, values, frames, pilots, known):
    """Processor seconds of the first uniform mesh that has an error, and its nodes; what is known of the meshes is kept."""
    for k in range(12):
        if k not in known:
            size = max(scene.body.extent) / (8 * 1.5**k)
            numbers = tuple(max(1, round(side / size)) for side in scene.body.extent)
            nodes = int(np.prod([n + 1 for n in numbers]))
            if nodes > MOST:
                return None, nodes
            body = replace(scene.body, cells=numbers, cell_size=None, cell="hexahedron", order=1, element="standard")
            try:
                seconds, found = footing.cost(solve, replace(scene, body=body))
                known[k] = seconds, distance(pilots.of(scene, found, frames), values, pilots.weights), nodes
            except (RuntimeError, ValueError) as why:
                footing.say(f"uniform {numbers}: {why}")
                known[k] = 0.0, np.inf, nodes
        if known[k][1] <= error:
            return known[k][0], known[k][2]
    return None, 0


def one(table, seed, errors):
    scene, known = draw(seed), {}
    scene = replace(scene, body=replace(scene.body, cells=None, cell="prism"))
    frames = list(range(1, scene.steps.count + 1))
    footing.say(f"scene {seed}")
    answers = [(error, *answer(scene, error)) for error in sorted(errors)]
    tightest = answers[0][1]
    second = tightest.climb if tightest.climb.family.order == 2 else tightest.other
    middle, finest = reference(scene, second)
    rows = []
    for error, choice, solution, verdict, seconds in reversed(answers):
        pilots = choice.pilots
        values = pilots.of(scene, finest, frames)
        own = distance(pilots.of(scene, middle, frames), values, pilots.weights)
        true = distance(pilots.of(scene, solution, frames), values, pilots.weights)
        other, nodes = uniform(scene, error, values, frames, pilots, known)
        rows.append((error, true, verdict.reached))
        table.add({"scene": str(seed), "asked": f"{error:.1%}", "estimated": f"{verdict.estimated:.2%}", "true": f"{true:.2%}",
                   "true over asked": f"{true / error:.2f}", "of the reference": f"{own:.2%}",
                   "promised": "yes" if verdict.reached else "no",
                   "mesh": choice.climb.family.said(choice.climb.sizes), "nodes": len(choice.mesh.points), "seconds": f"{seconds:.2g}",
                   "uniform, seconds": "more" if other is None else f"{other:.2g}", "its nodes": f"{'>' if other is None else ''}{nodes}"})
    return rows


def main():
    parser = footing.parser(__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=4)
    parser.add_argument("--errors", type=float, nargs="+", default=ERRORS)
    options = parser.parse_args()
    table, rows, failed = footing.Table(), [], 0
    for seed in range(options.seed, options.seed + options.count):
        try:
            rows += one(table, seed, options.errors)
        except (RuntimeError, ValueError) as why:
            failed += 1
            footing.say(f"scene {seed}: {why}")
    below = sum(true <= error for error, true, _ in rows)
    promised = sum(reached for *_, reached in rows)
    near = sum(error / 5 <= true <= error for error, true, _ in rows)
    footing.say(f"{len(rows)} answers of {options.count - failed} scenes, {promised} promised, {below} with a true error of at most what "
                f"was asked, {near} of them within a factor of five; {failed} scenes without an answer")


if __name__ == "__main__":
    main()
