"""How stiff are first-order cells in bending, and what does it cost to do better? Error against time, element by element.

    .venv/bin/python -m benchmarks.elements                     all meshes, some four minutes of processor time
    .venv/bin/python -m benchmarks.elements --picture a.png     and the picture of error against time

Cantilevers of square section, 5, 20 and 100 times as long as thick, under a dead traction on the end face, neo-Hookean:
a small one, P L^2 / E I = 0.01, and a large one, 2, that turns the end by some 45 degrees, in 8 steps (the latter with
nu = 0.4 alone: plain Newton, which makes the reference, finds no equilibrium with 0.499 in steps so large). The error is that of
the mean displacement of the end face along the load. First-order cells are solved by physics/equilibrium/path.py, those of second
order by plain Newton with dolfinx's assembly and MUMPS. The reference is 40 x 3 x 3 hexahedra of second
order, crowded at the clamped face; how far 20 x 3 x 3 of them are from it is in the JSON.

The press scene in 100 steps: reaction and displacement of the end face at the last of them, against what standard prisms on the two
finest meshes say, extrapolated with the square of the cell size; the same from the reduced element is in the JSON.

Seconds have the set-up in them, compiling not. The table has the errors on one mesh, that of the press scene.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import ufl

from benchmarks import footing
from physics import fem
from physics.body.kernel import energy_density
from physics.body.material import lame
from physics.body.supports import nodal_areas
from physics.mesh.build import build_mesh
from physics.scene import Scene, read_scene
from physics.solution import solve

SIDE, STEPS = 0.02, 8
MESHES = [(10, 2, 2), (20, 3, 3), (40, 5, 5), (60, 8, 8)]
SECOND = [(6, 1, 1), (10, 2, 2), (20, 3, 3)]
REFERENCE = [(20, 3, 3), (40, 3, 3)]  # crowded at the clamped face
MEAN = "mean-dilatation"
ON = "40x5x5"  # the mesh of the table
CASES = {"5 times": (5, 0.4, 0.01), "20 times": (20, 0.4, 0.01), "100 times": (100, 0.4, 0.01), "20 times, ν = 0.499": (20, 0.499, 0.01),
         "100 times, end turned by 45°": (100, 0.4, 2.0)}
KINDS = {"prism": {"cell": "prism"}, "prism, mean dilatation": {"cell": "prism", "element": MEAN},
         "prism, reduced": {"cell": "prism", "element": "reduced"}, "hexahedron": {"cell": "hexahedron"},
         "hexahedron, mean dilatation": {"cell": "hexahedron", "element": MEAN}, "tetrahedron": {"cell": "tetrahedron"},
         "hexahedron, order 2": {"cell": "hexahedron", "order": 2}, "tetrahedron, order 2": {"cell": "tetrahedron", "order": 2}}
COLOURS = ("tab:blue", "tab:cyan", "tab:red", "tab:green", "tab:olive", "tab:orange", "tab:green", "tab:orange")


def cantilever(slenderness: float, poisson_ratio: float, load: float, cells: tuple[int, ...], body: dict) -> Scene:
    """Load in units of E I / L^2."""
    length = SIDE * slenderness
    traction = load * 1e6 * SIDE**2 / 12 / length**2
    return read_scene({
        "body": {"length": length, "width": SIDE, "height": SIDE, "cells": list(cells)} | body,
        "material": footing.MATERIAL | {"poisson_ratio": poisson_ratio}, "support": [{"where": "x-min", "fixed": "xyz"}],
        "load": [{"where": "x-max", "traction": [0.0, 0.0, -traction]}], "steps": {"count": 1 if load < 0.1 else STEPS}})


def deflection(scene: Scene) -> tuple[float, float]:
    """Mean displacement [m] of the end face along the load, and seconds of the processor."""
    if scene.body.order == 2:
        seconds, moved = footing.cost(second_order, scene)
        return moved, seconds
    seconds, solution = footing.cost(lambda of: solve(of, partial=True), scene)
    return float("nan") if solution.failure else face_mean(solution, "x-max")[2], seconds


def face_mean(solution, place: str) -> np.ndarray:
    """(3,) displacement [m] at the last step, averaged over the area of a face."""
    weight = nodal_areas(solution.mesh, place)
    return weight @ solution.displacement[-1] / weight.sum()


def second_order(scene: Scene, crowding: float = 1.0) -> float:
    """The same mean displacement by cells of second order: plain Newton, every tangent factored by MUMPS."""
    from dolfinx import fem as dolfinx_fem
    from petsc4py import PETSc

    from tests.dolfinx_elasticity import assemble_matrix, assemble_vector

    mesh, length = build_mesh(scene.body), scene.body.extent[0]
    along = length * (mesh.points[:, 0] / length) ** crowding
    mesh = replace(mesh, points=np.column_stack([along, mesh.points[:, 1:]]))
    space = fem.Space(mesh, order=2)
    u, v, w = dolfinx_fem.Function(space.V), ufl.TestFunction(space.V), ufl.TrialFunction(space.V)
    lmbda, mu = (space.constant(value) for value in lame(scene.material))
    traction = space.constant(0.0)
    inside = {"metadata": {"quadrature_degree": space.degrees[0]}}
    end = ufl.conditional(ufl.gt(ufl.SpatialCoordinate(space.domain)[0], length * (1 - 1e-9)), 1.0, 0.0)
    face = end * v[2] * ufl.ds(metadata={"quadrature_degree": 4})
    energy = energy_density(scene.material.law, ufl.Identity(3) + ufl.grad(u), lmbda, mu) * ufl.dx(**inside)
    force = ufl.derivative(energy, u, v)
    stiffness = fem.compile_form(ufl.derivative(force, u, w))
    residual, mean = fem.compile_form(force - traction * face), fem.compile_form(face)
    held = np.flatnonzero(space.within(mesh.entities("x-min"))).astype(np.int32)
    fixed = [dolfinx_fem.dirichletbc(dolfinx_fem.Function(space.V), held)]
    free = np.ones(3 * len(space.nodes), bool)
    free[(3 * held[:, None] + np.arange(3)).ravel()] = False
    matrix = dolfinx_fem.petsc.create_matrix(stiffness)
    solver = PETSc.KSP().create(PETSc.COMM_SELF)
    solver.setType("preonly")
    solver.getPC().setType("cholesky")
    solver.getPC().setFactorSolverType("mumps")
    solver.setOperators(matrix)
    step, right = matrix.createVecs()
    out, average = np.empty(len(free)), np.empty(len(free))
    assemble_vector(mean, average)
    assert scene.load[0].traction is not None
    floor = 1e3 * float(np.finfo(float).eps) * scene.material.young_modulus * SIDE / 2 * length  # of rounding
    last = before = np.zeros(len(free))
    for count in range(1, scene.steps.count + 1):
        traction.value = scene.load[0].traction[2] * count / scene.steps.count
        now = 2 * last - before
        for _ in range(20):
            u.x.array[:] = now
            assemble_vector(residual, out)
            if np.linalg.norm(out[free]) < max(1e-6 * abs(float(traction.value)) * SIDE**2, floor):
                break
            assemble_matrix(matrix, stiffness, fixed)
            right.array[:] = np.where(free, out, 0.0)
            solver.solve(right, step)
            now = now - step.array
        else:
            return float("nan")
        before, last = last, now
    return float(average @ last) / SIDE**2


def cantilevers() -> list[dict]:
    """One row for each case, kind of cell and mesh."""
    rows = []
    for load, poisson_ratio in ((0.01, 0.4), (0.01, 0.499), (2.0, 0.4)):
        for slenderness in (5, 20, 100):
            case = (slenderness, poisson_ratio, load)
            coarse, reference = (second_order(cantilever(*case, cells, KINDS["hexahedron, order 2"]), 2.0) for cells in REFERENCE)
            for kind, body in KINDS.items():
                for cells in SECOND if "order" in body else MESHES:
                    scene = cantilever(*case, cells, body)
                    if not rows or rows[-1]["kind"] != kind:
                        deflection(scene)  # compile
                    found, seconds = deflection(scene)
                    rows.append({"slenderness": slenderness, "poisson_ratio": poisson_ratio, "load": load, "kind": kind,
                                 "cells": "x".join(map(str, cells)), "error": found / reference - 1, "seconds": seconds,
                                 "reference_m": reference, "reference_error": coarse / reference - 1})
            footing.say(json.dumps(rows[-1]))
    return rows


def press() -> list[dict]:
    """The press scene by first-order cells; errors of the reaction, and of the displacement of the end face over its size."""
    found = {}
    for kind in (kind for kind, body in KINDS.items() if "order" not in body):
        for cells in MESHES:
            seconds, solution = footing.cost(lambda of: solve(of, partial=True), footing.press(cells, 100, **KINDS[kind]))
            if not solution.failure:
                found[kind, cells] = solution.reaction[-1, 2], face_mean(solution, "x-max"), seconds
    limits = {}
    for kind in ("prism", "prism, reduced"):
        # The square of the cell size, along the beam and across it, from (40, 5, 5) to (60, 8, 8): a factor of 0.42 on average.
        rest = ((40 / 60) ** 2 + (5 / 8) ** 2) / 2
        (a, u, _), (b, v, _) = found[kind, MESHES[2]], found[kind, MESHES[3]]
        limits[kind] = (b - rest * a) / (1 - rest), (v - rest * u) / (1 - rest)
    reaction, moved = limits["prism"]
    return [{"kind": kind, "cells": "x".join(map(str, cells)), "reaction_error": r / reaction - 1,
             "displacement_error": float(np.linalg.norm(u - moved) / np.linalg.norm(moved)), "seconds": seconds,
             "reference_reaction_N": reaction, "reference_by_reduced": limits["prism, reduced"][0] / reaction - 1,
             "reference_displacement_by_reduced": float(np.linalg.norm(limits["prism, reduced"][1] - moved) / np.linalg.norm(moved))}
            for (kind, cells), (r, u, seconds) in found.items()]


def draw(rows: list[dict], pressed: list[dict], path: str) -> None:
    """Error against time, four of the cases."""
    import matplotlib.pyplot as plt

    panels = {"20 times as long as thick, small load, ν = 0.4": (20, 0.4, 0.01), "the same, ν = 0.499": (20, 0.499, 0.01),
              "100 times, end turned by 45°, ν = 0.4": (100, 0.4, 2.0), "press scene, reaction at the last step": None}
    figure, axes = plt.subplots(1, 4, figsize=(14, 4.4), sharey=True, layout="constrained")
    for axis, (title, case) in zip(axes, panels.items(), strict=True):
        rows_of_case = [row for row in rows if (row["slenderness"], row["poisson_ratio"], row["load"]) == case] if case else pressed
        for kind, colour in zip(KINDS, COLOURS, strict=True):
            part = [row for row in rows_of_case if row["kind"] == kind]
            error = [100 * abs(row["error" if case else "reaction_error"]) for row in part]
            axis.loglog([row["seconds"] for row in part], error, "o--" if "order" in kind else "o-", color=colour, label=kind,
                        mfc="white" if "order" in kind else colour)
        seconds = [row["seconds"] for row in rows_of_case]
        axis.set(xlabel="processor time [s]", xlim=(10 ** np.floor(np.log10(min(seconds))), 10 ** np.ceil(np.log10(max(seconds)))))
        axis.set_title(title, fontsize=10)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("error [%]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=9)
    figure.savefig(path, dpi=80)


def main() -> None:
    parser = footing.parser(__doc__)
    parser.add_argument("--picture", help="a .png of error against time")
    parser.add_argument("--json", type=Path, help="a file for all numbers")
    options = parser.parse_args()
    table, beams, pressed = footing.Table(), cantilevers(), press()
    for kind in (kind for kind, body in KINDS.items() if "order" not in body):
        own = {(row["slenderness"], row["poisson_ratio"], row["load"]): row["error"] for row in beams
               if (row["kind"], row["cells"]) == (kind, ON)}
        own["press"] = next((row["reaction_error"] for row in pressed if (row["kind"], row["cells"]) == (kind, ON)), np.nan)
        table.add({"element": kind} | {head: f"{100 * own[case]:+.2g} %" for head, case in (CASES | {"press scene": "press"}).items()})
    if options.json:
        options.json.write_text(json.dumps({"cantilevers": beams, "press": pressed}, indent=1))
    if options.picture:
        draw(beams, pressed, options.picture)


if __name__ == "__main__":
    main()
