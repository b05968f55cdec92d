"""Elastic modes of a body: K phi = lambda M phi, lambda = (2 pi frequency)^2.

K is the stiffness of the rest state and M the consistent mass (elasticity.py), both restricted to the free components,
so that a support never shows up as a mode. SLEPc's Krylov-Schur method finds the pairs nearest to zero by shift and
invert; the shift lies a little below zero, so a body that is free to move has its rigid modes at zero and needs no
special treatment. Modes are M-orthonormal: phi_i . M phi_j = delta_ij [1/sqrt(kg)]; each one's largest component is
positive. Legend: N nodes, m modes.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from slepc4py import SLEPc

from physics.elasticity import Elasticity
from physics.mesh import Mesh, build_mesh
from physics.scene import Scene
from physics.schema import InputError
from physics.supports import held

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Modes:
    """The lowest modes of a body, in rising order."""

    mesh: Mesh
    eigenvalues: Floats  # (m,) [1/s2]
    shapes: Floats  # (m, N, 3) zero on held components
    residuals: Floats  # (m,) |K phi - lambda M phi| / |lambda M phi|, for a rigid mode over |shift M phi|
    dofs: int  # free components
    seconds: float

    @property
    def frequencies_hz(self) -> tuple[float, ...]:
        """Natural frequencies [Hz]; rounding below zero counts as zero."""
        return tuple(np.sqrt(np.maximum(self.eigenvalues, 0.0)) / (2 * np.pi))

    @property
    def pictured(self) -> Floats:
        """(m, N, 3) the shapes with their largest displacement 1: what a trajectory file holds."""
        return self.shapes / np.linalg.norm(self.shapes, axis=2).max(axis=1)[:, None, None]


def elastic_modes(scene: Scene, *, count: int = 10, mesh: Mesh | None = None) -> Modes:
    """The lowest elastic modes of a scene's body on its supports; loads and obstacle play no part.

    Raises:
        InputError: more modes are asked for than the body has free components
        RuntimeError: SLEPc found fewer pairs than asked for
    """
    started = time.perf_counter()
    mesh = mesh or build_mesh(scene.body)
    fixed = held(scene, mesh)
    elasticity = Elasticity(mesh, scene.material, np.zeros_like(fixed))
    free = np.sort(elasticity.space.dofs[~fixed]).astype(np.int32)
    if count > len(free):
        raise InputError(f"{count} modes asked for, the body has {len(free)} free components")
    keep = PETSc.IS().createGeneral(free, comm=PETSc.COMM_SELF)
    stiffness = elasticity.stiffness(np.zeros_like(mesh.points)).createSubMatrix(keep, keep)
    whole = elasticity.mass()
    mass = whole.createSubMatrix(keep, keep)

    shift = -_first_bending(scene, mesh) / 10
    solver = _solver(stiffness, mass, count, shift)
    solver.solve()
    if solver.getConverged() < count:
        raise RuntimeError(f"SLEPc found {solver.getConverged()} of {count} modes")

    values, vectors, residuals = np.empty(count), np.zeros((count, 3 * len(mesh.points))), np.empty(count)
    phi, work = stiffness.createVecs()
    for i in range(count):
        values[i] = solver.getEigenpair(i, phi).real
        mass.mult(phi, work)
        scale = max(abs(values[i]), abs(shift)) * work.norm()
        residuals[i] = (stiffness * phi - work * float(values[i])).norm() / scale
        vectors[i, free] = phi.array * np.sign(phi.array[np.argmax(abs(phi.array))])
    for used in (solver, stiffness, mass, whole, phi, work):  # dolfinx hands out matrices that nobody else destroys
        used.destroy()
    shapes = vectors[:, elasticity.space.dofs]
    return Modes(mesh=mesh, eigenvalues=values, shapes=shapes, residuals=residuals, dofs=len(free),
                 seconds=time.perf_counter() - started)


def euler_bernoulli_hz(scene: Scene, count: int) -> tuple[float, ...]:
    """Bending frequencies [Hz] of a slender cantilever beam of the scene's body, both planes, in rising order.

    f = (beta L)^2 / (2 pi L^2) sqrt(E I / (rho A)) with cos(beta L) cosh(beta L) = -1 (Blevins, table 8-1).
    """
    length, width, height = scene.body.extent
    material = scene.material
    guess = (np.arange(count) + 0.5) * np.pi
    guess[0] = 1.8751040687
    for _ in range(20):  # Newton on cos(x) + 1 / cosh(x)
        slope = -np.sin(guess) - np.tanh(guess) / np.cosh(guess)
        guess = guess - (np.cos(guess) + 1 / np.cosh(guess)) / slope
    speed = np.sqrt(material.young_modulus / material.density)
    radius = np.array([width, height]) / np.sqrt(12)  # of gyration
    hz = np.outer(radius, guess**2) * speed / (2 * np.pi * length**2)
    return tuple(np.sort(hz.ravel())[:count])


def _first_bending(scene: Scene, mesh: Mesh) -> float:
    """The order of magnitude of a body's first eigenvalue [1/s2]: that of a slender cantilever of its extent."""
    extent = np.ptp(mesh.points, axis=0)
    slenderness = extent[extent > 0].min() / extent.max() ** 2
    return float(scene.material.young_modulus / scene.material.density * slenderness**2)


def _solver(stiffness: PETSc.Mat, mass: PETSc.Mat, count: int, shift: float) -> SLEPc.EPS:
    solver = SLEPc.EPS().create(PETSc.COMM_SELF)
    solver.setOperators(stiffness, mass)
    solver.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    solver.setDimensions(count)
    solver.setTarget(shift)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_REAL)
    solver.setTolerances(1e-10, 1000)
    transform = solver.getST()
    transform.setType(SLEPc.ST.Type.SINVERT)
    transform.setShift(shift)
    ksp = transform.getKSP()
    ksp.setType(PETSc.KSP.Type.PREONLY)
    ksp.getPC().setType(PETSc.PC.Type.CHOLESKY)
    ksp.getPC().setFactorSolverType("mumps")
    return solver
