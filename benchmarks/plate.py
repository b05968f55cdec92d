"""Bodies of second-order tetrahedra solved here and by other programs, on the same mesh: displacements, reaction, time.

    .venv/bin/python -m benchmarks.plate                          a plate bent and a bar turned, by CalculiX (apt-get install calculix-ccx)
    .venv/bin/python -m benchmarks.plate --ngsolve PYTHON         pressed by a sphere, by NGSolve, whose interpreter that is, and by
                                                                  plain Newton with dolfinx
    .venv/bin/python -m benchmarks.plate --family                 plates of the family `plate`, and of first order with cells half as large

A plate of four sides with a round hole is clamped at one edge.

Bent: the edge across is moved to (-8, 4, 40) mm, every component of it, in ten steps; Saint Venant and Kirchhoff's law, which is what
CalculiX's *ELASTIC is with NLGEOM. Its cells are C3D10, with four points of integration, as ours.

Pressed: a rigid sphere goes 30 mm down into it, in thirty steps; the neo-Hookean law. NGSolve minimises the same energy with a penalty
of contact, a thousand times Young's modulus over the cells' size; `plain` is that of benchmarks/equilibrium.py, full Newton with dolfinx
and MUMPS.

"displacement" is the largest difference of any node over the largest displacement, "reaction" that at the moved edge, or of the sphere,
both at the last step. Processor time of one thread, of a step; of other programs that of the whole process but for NGSolve's, whose
loading of libraries is left out.
"""

import json
import re
import resource
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import footing
from benchmarks.equilibrium import plain
from benchmarks.footing import cost
from datagen.family.family import draw, load_family
from physics.equilibrium.balance import Balance
from physics.mesh.build import build_mesh
from physics.mesh.mesh import Mesh
from physics.scene import Scene, read_scene
from physics.solution import Solution, solve

MOVE = (-0.008, 0.004, 0.04)  # [m]
YOUNG, POISSON = 1e6, 0.4
PENALTY = 100.0  # Young's moduli over the cells' size
CENTRE, RADIUS, DEPTH = (0.095, 0.05), 0.025, 0.03  # [m]


def scene_of(size: float, law: str, steps: int, **more: Any) -> Scene:
    body = {"shape": "panel", "outline": [[0.0, 0.0], [0.12, -0.01], [0.13, 0.09], [0.0, 0.1]], "holes": [[0.05, 0.05, 0.012]],
            "height": 0.012, "layers": 2, "cell_size": size, "cell": "tetrahedron", "order": 2}
    return read_scene({"name": "plate", "body": body, "steps": {"count": steps}, "support": [{"where": "edge-4"}],
                       "material": {"law": law, "young_modulus": YOUNG, "poisson_ratio": POISSON}, **more})


def bent(size: float) -> Scene:
    return scene_of(size, "saint-venant-kirchhoff", 10, support=[{"where": "edge-4"}, {"where": "edge-2", "displacement": list(MOVE)}])


def turned(cells: int) -> Scene:
    body = {"length": 0.1, "width": 0.02, "height": 0.02, "cells": [5 * cells, cells, cells], "cell": "tetrahedron", "order": 2}
    return read_scene({"name": "bar", "body": body, "steps": {"count": 10},
                       "material": {"law": "saint-venant-kirchhoff", "young_modulus": YOUNG, "poisson_ratio": POISSON},
                       "support": [{"where": "x-min"}, {"where": "x-max", "axis": [0.0, 1.0, 0.0], "angle": 45.0}]})


def pressed(size: float) -> Scene:
    path = [[*CENTRE, 0.012 + RADIUS + 1e-6 - down] for down in (0.0, DEPTH)]
    return scene_of(size, "neo-hookean", 30, obstacle={"shape": "sphere", "radius": RADIUS, "path": path})


def solved(scene: Scene) -> Solution:
    solution = solve(scene, partial=True)
    if solution.failure:
        raise SystemExit(solution.failure)
    return solution


def spent(words: list[str], folder: str) -> tuple[float, str]:
    """Processor seconds of a program that is run in a folder, and what it said."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(words, cwd=folder, stdout=subprocess.PIPE, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise SystemExit(f"{words[0]}: {(done.stderr or done.stdout)[-500:]}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout


def deck(mesh: Mesh, held: np.ndarray, moved: np.ndarray, far: np.ndarray, steps: int) -> str:
    """CalculiX's input, the moved nodes led to displacements (n, 3); both number the nodes of such a cell in the same order."""
    def rows(numbers: Any) -> str:
        return "".join(", ".join(map(str, row)) + "\n" for row in numbers)

    nodes = rows([i + 1, *map(repr, map(float, x))] for i, x in enumerate(mesh.points))
    cells = rows([i + 1, *cell] for i, cell in enumerate((mesh.cells + 1).tolist()))
    sets = [rows([node + 1] for node in those.tolist()) for those in (held, moved)]
    motion = "".join(f"{node + 1}, {i + 1}, {i + 1}, {u[i]:.12e}\n" for node, u in zip(moved, far, strict=True) for i in range(3))
    return (f"*NODE, NSET=ALL\n{nodes}*ELEMENT, TYPE=C3D10, ELSET=BODY\n{cells}*NSET, NSET=HELD\n{sets[0]}*NSET, NSET=MOVED\n{sets[1]}"
            f"*MATERIAL, NAME=SOFT\n*ELASTIC\n{YOUNG}, {POISSON}\n*SOLID SECTION, ELSET=BODY, MATERIAL=SOFT\n"
            f"*STEP, NLGEOM, INC=1000\n*STATIC, DIRECT\n{1 / steps}, 1.0\n*BOUNDARY\nHELD, 1, 3\n{motion}"
            f"*NODE PRINT, NSET=ALL, FREQUENCY=1000\nU\n*NODE PRINT, NSET=MOVED, FREQUENCY=1000, TOTALS=ONLY\nRF\n*END STEP\n")


def calculix(mesh: Mesh, *told_of: Any) -> tuple[np.ndarray, np.ndarray, float]:
    """Displacements (N, 3) and the force (3,) on the moved nodes at the last step, and processor seconds, of what `deck` takes."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "plate.inp").write_text(deck(mesh, *told_of))
        seconds, _ = spent(["ccx", "plate"], folder)
        told = Path(folder, "plate.dat").read_text()
    displacements, forces = re.split(r" total force", told)
    numbers = re.findall(r"^ +(\d+) +(\S+) +(\S+) +(\S+)$", displacements, re.MULTILINE)
    force = re.findall(r"^ +(\S+) +(\S+) +(\S+)$", forces, re.MULTILINE)
    assert [int(row[0]) for row in numbers] == list(range(1, len(mesh.points) + 1)) and len(force) == 1
    return np.array([row[1:] for row in numbers], float), np.array(force[0], float), seconds


def row(mesh: Mesh, of: str, u: np.ndarray, reaction: np.ndarray, ms: float, ours: tuple[np.ndarray, np.ndarray]) -> dict[str, Any]:
    """What a program found, beside ours."""
    mine, force = ours
    same = mine is u
    return {"nodes": len(mesh.points), "program": of, "reaction [N]": float(np.linalg.norm(reaction)),
            "displacement off": None if same else f"{100 * abs(u - mine).max() / abs(mine).max():.2g} %",
            "reaction off": None if same else f"{100 * np.linalg.norm(reaction - force) / np.linalg.norm(force):.2g} %", "ms a step": ms}


def against_calculix(table: footing.Table, sizes: list[float]) -> None:
    solved(bent(0.05))  # compile
    scenes = [("plate, bent", bent(size), "edge-4", "edge-2") for size in sizes]
    for name, scene, held, moved in [*scenes, ("bar, its end turned", turned(2), "x-min", "x-max"),
                                     ("bar, its end turned", turned(3), "x-min", "x-max")]:
        mesh, steps = build_mesh(scene.body), scene.steps.count
        seconds, solution = cost(solved, scene)
        u, there = solution.displacement[-1], mesh.place(moved)
        force = Balance(scene, mesh).elasticity.force(u)[there].sum(axis=0)
        table.add({"scene": name} | row(mesh, "this one", u, force, 1e3 * seconds / steps, (u, force)))
        other, reaction, seconds = calculix(mesh, mesh.place(held), there, u[there], steps)
        table.add({"scene": name} | row(mesh, "CalculiX, C3D10", other, reaction, 1e3 * seconds / steps, (u, force)))


def against_ngsolve(table: footing.Table, python: str, sizes: list[float]) -> None:
    for size in sizes:
        scene = pressed(size)
        mesh, steps = build_mesh(scene.body), scene.steps.count
        solved(pressed(0.05)), plain(pressed(0.05), 1)  # compile
        seconds, solution = cost(solved, scene)
        u, force = solution.displacement[-1], solution.reaction[-1]
        table.add(row(mesh, "this one", u, force, 1e3 * seconds / steps, (u, force)))
        with tempfile.TemporaryDirectory() as folder:
            np.savez(Path(folder, "mesh.npz"), points=mesh.points, cells=mesh.cells, held=mesh.place("edge-4"),
                     centres=np.linspace(*np.array(scene.obstacles[0].path), steps + 1)[1:], radius=RADIUS, young=YOUNG, poisson=POISSON,
                     penalty=PENALTY * YOUNG / size)
            _, said = spent([python, str(Path(__file__).with_name("plate_ngsolve.py").resolve()), "mesh.npz"], folder)
            other = np.load(Path(folder, "found.npz"))["u"]
        told = json.loads(said.splitlines()[-1])
        table.add(row(mesh, "NGSolve, penalty", other, np.array(told["reaction"]), told["ms"], (u, force)))
        seconds, (frames, _) = cost(plain, scene, steps)
        balance = Balance(scene, mesh)
        by_body = balance.elasticity.force(frames[-1])[mesh.place("edge-4")].sum(axis=0)
        table.add(row(mesh, "plain Newton, dolfinx, penalty", frames[-1], by_body, 1e3 * seconds / steps, (u, force)))


def of_family(table: footing.Table) -> None:
    """The first draws of seed 0 that are followed to their end, whole paths, set-up included."""
    family = load_family("plate")
    solved(draw(family, 0, 0))  # compile
    for index in (0, 2, 3, 7, 11):
        scene = draw(family, 0, index)
        coarse = replace(scene, body=replace(scene.body, order=1, cell_size=scene.body.cell_size / 2))
        for order, each in ((2, scene), (1, coarse)):
            seconds, solution = cost(solved, each)
            table.add({"plate": str(index), "order": str(order), "nodes": str(len(solution.mesh.points)),
                       "ms a frame": f"{1e3 * seconds / each.steps.count:.3g}"})


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("--ngsolve", metavar="PYTHON")
    parser.add_argument("--sizes", type=float, nargs="+", default=[0.02, 0.013], help="[m] of cells")
    parser.add_argument("--family", action="store_true")
    options = parser.parse_args()
    table = footing.Table()
    if options.family:
        of_family(table)
    elif options.ngsolve:
        against_ngsolve(table, options.ngsolve, options.sizes)
    else:
        against_calculix(table, options.sizes)


if __name__ == "__main__":
    main()
