"""A plate pressed by a sphere, by NGSolve, for benchmarks/plate.py: run by an interpreter that has it.

    PYTHON -m pip install ngsolve==6.2.2608
    PYTHON benchmarks/plate_ngsolve.py MESH.npz

Quadratic displacements on the straight cells of the file; mu/2 (J^(-2/3) tr C - 3) + K/4 (J^2 - 1 - 2 ln J) in the body, and on the
face that the sphere meets penalty/2 min(gap, 0)^2. Full Newton from the last two steps gone on with, its steps halved where energy would
not fall, every tangent factored.
Writes found.npz, with the displacements u (N, 3) of the file's nodes; says one line of JSON: ms of the processor a step, reaction [N].
"""

import json
import sys
import time

import netgen.meshing as netgen
import numpy as np
from ngsolve import (
    BND,
    BilinearForm,
    CoefficientFunction,
    Det,
    Grad,
    GridFunction,
    Id,
    IfPos,
    InnerProduct,
    Integrate,
    Mesh,
    Parameter,
    SetNumThreads,
    Trace,
    Variation,
    VectorH1,
    ds,
    dx,
    log,
    sqrt,
    x,
    y,
    z,
)


def meshed(points: np.ndarray, cells: np.ndarray, held: set[int]) -> Mesh:
    """The tetrahedra, their boundary in three parts: held, top, and the rest."""
    mesh = netgen.Mesh(dim=3)
    number = [mesh.Add(netgen.MeshPoint(netgen.Pnt(*point))) for point in points]
    for k, name in enumerate(("held", "top", "rest")):
        mesh.Add(netgen.FaceDescriptor(surfnr=k + 1, domin=1, bc=k + 1))
        mesh.SetBCName(k, name)
    seen: dict[tuple[int, ...], tuple[int, ...]] = {}
    for cell in cells.tolist():
        mesh.Add(netgen.Element3D(1, [number[i] for i in cell]))
        for a, b, c in ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)):
            facet = cell[a], cell[b], cell[c]
            key = tuple(sorted(facet))
            if seen.pop(key, None) is None:
                seen[key] = facet
    top = points[:, 2].max()
    for facet in seen.values():
        kind = 1 if set(facet) <= held else 2 if (points[list(facet), 2] > top - 1e-9).all() else 3
        mesh.Add(netgen.Element2D(kind, [number[i] for i in facet]))
    return Mesh(mesh)


def main() -> None:
    given = np.load(sys.argv[1])
    SetNumThreads(1)
    corners = given["cells"][:, :4]
    count = int(corners.max()) + 1
    mesh = meshed(given["points"][:count], corners, set(given["held"].tolist()))
    young, poisson, radius, penalty = (float(given[name]) for name in ("young", "poisson", "radius", "penalty"))
    mu, bulk = young / (2 * (1 + poisson)), young / (3 * (1 - 2 * poisson))
    V = VectorH1(mesh, order=2, dirichlet="held")
    u = V.TrialFunction()
    centre = [Parameter(0.0) for _ in range(3)]
    F = Id(3) + Grad(u)
    J = Det(F)
    a = BilinearForm(V, symmetric=True)
    a += Variation((mu / 2 * (J ** (-2 / 3) * Trace(F.trans * F) - 3) + bulk / 4 * (J**2 - 1 - 2 * log(J))).Compile() * dx)

    def gap(of):
        away = CoefficientFunction((x, y, z)) + of - CoefficientFunction(tuple(centre))
        return sqrt(InnerProduct(away, away)) - radius, away

    depth, _ = gap(u)
    a += Variation((IfPos(-depth, penalty / 2 * depth**2, 0)).Compile() * ds("top", bonus_intorder=4))
    found = GridFunction(V)
    right, step, before, last, older = (found.vec.CreateVector() for _ in range(5))
    last[:], older[:] = 0.0, 0.0
    start = time.process_time()
    for position in given["centres"]:
        for parameter, value in zip(centre, position, strict=True):
            parameter.Set(float(value))
        found.vec.data = 2 * last - older
        for _ in range(60):
            a.Apply(found.vec, right)
            a.AssembleLinearization(found.vec)
            step.data = a.mat.Inverse(V.FreeDofs(), "sparsecholesky") * right
            decrement = InnerProduct(step, right)
            if abs(decrement) < 1e-16 * young * radius**3:
                break
            before.data, energy, size = found.vec, a.Energy(found.vec), 1.0
            found.vec.data = before - step
            while not a.Energy(found.vec) <= energy + 1e-12 * abs(energy) and size > 1e-4:
                size /= 2
                found.vec.data = before - size * step
        else:
            raise SystemExit("no equilibrium")
        older.data, last.data = last, found.vec
    seconds = time.process_time() - start
    depth, away = gap(found)
    pressure = IfPos(-depth, -penalty * depth, 0)
    reaction = Integrate(pressure * away / sqrt(InnerProduct(away, away)), mesh, BND, definedon=mesh.Boundaries("top"), order=8)
    np.savez("found.npz", u=np.array([found(mesh(*point)) for point in given["points"]]))
    print(json.dumps({"ms": 1e3 * seconds / len(given["centres"]), "reaction": [-float(part) for part in reaction]}))


if __name__ == "__main__":
    main()
