"""2D-3 by NGSolve, for benchmarks/flow.py: its IMEX scheme with backward differences of order two, run by an interpreter that has it.

    PYTHON -m pip install ngsolve==6.2.2608
    PYTHON benchmarks/flow_ngsolve.py ORDER SIZE SIZE_AT_THE_CYLINDER STEP

One line of JSON: vertices, cells, steps and ms of the processor for each 0.01 s, the largest drag and lift coefficient.
"""

import json
import sys
import time
from math import pi, sin

import numpy as np
from netgen.occ import Circle, OCCGeometry, Rectangle
from ngsolve import (
    BND,
    H1,
    BilinearForm,
    CoefficientFunction,
    Grad,
    GridFunction,
    InnerProduct,
    LinearForm,
    Mesh,
    SetNumThreads,
    VectorH1,
    div,
    dx,
    y,
)


def main() -> None:
    order, size, hole, step = int(sys.argv[1]), *map(float, sys.argv[2:5])
    SetNumThreads(1)
    shape = Rectangle(2.2, 0.41).Face()
    for edge, name in zip(shape.edges, ("wall", "outlet", "wall", "inlet"), strict=True):
        edge.name = name
    circle = Circle((0.2, 0.2), 0.05).Face()
    circle.edges.name, circle.edges.maxh = "cylinder", hole
    mesh = Mesh(OCCGeometry(shape - circle, dim=2).GenerateMesh(maxh=size))
    mesh.Curve(order)
    V = VectorH1(mesh, order=order, dirichlet="wall|cylinder|inlet")
    X = V * H1(mesh, order=order - 1)
    (u, p), (v, q) = X.TnT()
    nu = 1e-3
    stokes = nu * InnerProduct(Grad(u), Grad(v)) - div(u) * q - div(v) * p - 1e-10 * p * q  # a Cholesky factor wants no zero
    m = BilinearForm(InnerProduct(u, v) * dx).Assemble()
    bdf = BilinearForm((1.5 / step * InnerProduct(u, v) + stokes) * dx).Assemble()
    euler = BilinearForm((1.0 / step * InnerProduct(u, v) + stokes) * dx).Assemble()
    flow, wind = GridFunction(X), GridFunction(X)
    convection = LinearForm(X)
    convection += InnerProduct(Grad(wind.components[0]) * wind.components[0], v) * dx(bonus_intorder=order)
    tests = []
    for direction in ((1, 0), (0, 1)):
        test = GridFunction(X)
        test.components[0].Set(CoefficientFunction(direction), definedon=mesh.Boundaries("cylinder"))
        tests.append(test.vec)
    profile = GridFunction(X)
    profile.components[0].Set(CoefficientFunction((4 * 1.5 * y * (0.41 - y) / 0.41**2, 0)), BND, definedon=mesh.Boundaries("inlet"))
    start = time.process_time()
    inverse = bdf.mat.Inverse(X.FreeDofs(), "sparsecholesky")
    first = euler.mat.Inverse(X.FreeDofs(), "sparsecholesky")
    old, older, right, history = (flow.vec.CreateVector() for _ in range(4))
    old[:], older[:] = 0.0, 0.0
    count, forces = round(8 / step), []
    for n in range(1, count + 1):
        begin = n == 1
        wind.vec.data = old if begin else 2 * old - older
        history.data = 1 / step * old if begin else 2 / step * old - 0.5 / step * older
        convection.Assemble()
        right.data = m.mat * history - convection.vec
        flow.vec.data = sin(pi * n * step / 8) * profile.vec
        matrix, solver = (euler.mat, first) if begin else (bdf.mat, inverse)
        rest = right.CreateVector()
        rest.data = right - matrix * flow.vec
        flow.vec.data += solver * rest
        rest.data = right - matrix * flow.vec
        forces.append([20 * InnerProduct(rest, test) for test in tests])
        older.data = old
        old.data = flow.vec
        if not np.isfinite(forces[-1]).all():
            break
    seconds = time.process_time() - start
    drag, lift = np.array(forces).max(axis=0)
    print(json.dumps({"vertices": mesh.nv, "cells": mesh.ne, "steps": 0.01 / step, "ms": 1e3 * seconds / (len(forces) * step / 0.01),
                      "drag": drag, "lift": lift}))


if __name__ == "__main__":
    main()
