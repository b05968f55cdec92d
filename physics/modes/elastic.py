"""Elastic modes of a body: K phi = lambda M phi, lambda = (2 pi frequency)^2.

K is the stiffness of the rest state, Hooke's law with the material's E and nu (the tangent of all laws in material.py there)
or its orthotropic constants,
and M the consistent mass, both restricted to the free components, so that a support never shows up as a mode. A body that
its supports leave free to move has its rigid modes at zero; their number is compared with what the supports leave. Modes are
M-orthonormal: phi_i . M phi_j = delta_ij [1/sqrt(kg)]; each one's largest component is positive.

A plane body deforms in its plane, with no strain across it (a slice of a long body), or with no stress across it (a thin
sheet), where lambda_L is replaced by 2 mu lambda_L / (lambda_L + 2 mu) (Timoshenko and Goodier, art. 16).

Participation of mode i in a motion of the supports along axis d: L_id = phi_i . M r_d with r_d = 1 on the free components
along d; its effective mass is L_id^2 [kg]. Over all modes these add up to the mass that is free to move along d, r_d . M r_d.

Sign and choice. An eigenvector is fixed up to its sign, those of a multiple eigenvalue (or of nearly equal ones, which a mesh
splits at will) up to a rotation among them. What has a meaning is what does not change under either: the sum of phi phi^T
over a cluster, whose diagonal says how much each node moves.

Legend: N nodes, m modes, g clusters.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import ufl
from numpy.typing import NDArray

from physics import fem
from physics.body.elasticity import small_strain_stiffness
from physics.body.material import cellwise, hooke, lame
from physics.body.supports import held, pieces_held, rigid_motions_left
from physics.linalg.eigen.lowest import lowest_pairs
from physics.linalg.eigen.pairs import GOAL, Pairs, Problem, clusters
from physics.mesh.build import build_mesh
from physics.mesh.cell import CELLS
from physics.mesh.mesh import Mesh, pieces
from physics.modes import locking
from physics.modes.loaded import loaded_stiffness
from physics.scene import Scene
from physics.schema import InputError

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Modes:
    """The lowest modes of a body, in rising order."""

    mesh: Mesh
    eigenvalues: Floats  # (m,) [1/s2]
    shapes: Floats  # (m, N, 3) at the nodes of the mesh [1/sqrt(kg)], zero on held components
    residuals: Floats  # (m,) |K phi - lambda M phi| / |lambda M phi|, see eigen/pairs.py for rigid modes
    participation: Floats  # (m, 3) [sqrt(kg)]
    free_mass: Floats  # (3,) [kg] mass free to move along x, y and z: the sum of all effective masses
    dofs: int  # free components
    rigid: int  # modes at zero among these
    rigid_expected: int  # rigid motions that the supports leave, of every piece of the mesh
    cells: str  # what the body was meshed with
    solver: str  # how the pairs were found, and why so
    remarks: tuple[str, ...]  # what the reader should know
    seconds: float

    @property
    def frequencies_hz(self) -> tuple[float, ...]:
        """Natural frequencies [Hz]; rounding below zero counts as zero."""
        return tuple(np.sqrt(np.maximum(self.eigenvalues, 0.0)) / (2 * np.pi))

    @property
    def effective_masses(self) -> Floats:
        """(m, 3) [kg]"""
        return self.participation**2

    @property
    def pictured(self) -> Floats:
        """(m, N, 3) the shapes with their largest displacement 1: what a trajectory file holds."""
        return self.shapes / np.linalg.norm(self.shapes, axis=2).max(axis=1)[:, None, None]

    @property
    def clusters(self) -> tuple[range, ...]:
        """The modes that belong together: rigid ones, and those whose frequencies lie within 1 % of each other."""
        return clusters(self.eigenvalues, self.rigid)

    @property
    def report(self) -> dict[str, Any]:
        """What elastic modes have and Laplacian ones do not, as plain values."""
        return {"frequencies_hz": [float(hz) for hz in self.frequencies_hz], "rigid_modes": self.rigid,
                "rigid_modes_expected": self.rigid_expected, "participation_factors": self.participation.tolist(),
                "effective_masses": self.effective_masses.tolist(), "free_mass": self.free_mass.tolist()}


def elastic_modes(scene: Scene, *, count: int = 10, mesh: Mesh | None = None, spread: bool = False,
                  method: str | None = None, at: tuple[Floats, float] | None = None) -> Modes:
    """The lowest elastic modes of a scene's body on its supports; loads and obstacle play no part, unless `at` a loaded state.

    Args:
        at: displacements (N, 3) [m] of a state, and its fraction of the loading: the modes are of the body as it then is (loaded.py)
        mesh: of the body, if it has been built already
        spread: over all processes of an MPI run; every one gets the whole answer
        method: "direct" or "multigrid" instead of the choice by size

    Raises:
        InputError: more modes are asked for than the body has free components, or a support names no place
        RuntimeError: fewer pairs were found than asked for, or there is no stable equilibrium beside the state
    """
    started = time.perf_counter()
    mesh = mesh or build_mesh(scene.body)
    problem, space = elastic_problem(scene, mesh, spread=spread)
    loaded: tuple[str, ...] = ()
    if at is not None:
        problem, space, loaded = _at(problem, space, scene, mesh, at, spread)
    dofs = space.comm.allreduce(int(problem.free.sum()))
    if count > dofs:
        raise InputError(f"{count} modes asked for, the body has {dofs} free components")
    pairs = lowest_pairs(problem, count, method=method)
    thickness = 1.0 if mesh.dimension == 3 else scene.body.thickness or 1.0
    motions = _translations(space) * problem.free
    weighted = _times(problem.mass, motions)
    participation = space.comm.allreduce(pairs.vectors @ weighted.T)
    free_mass = space.comm.allreduce((motions * weighted).sum(axis=1))
    for matrix in (problem.stiffness, problem.mass):  # dolfinx hands out matrices that nobody else destroys
        matrix.destroy()
    shapes = np.stack([np.pad(space.gather(vector), ((0, 0), (0, 3 - mesh.dimension))) for vector in pairs.vectors])
    largest = np.take_along_axis(shapes.reshape(count, -1), abs(shapes).reshape(count, -1).argmax(axis=1)[:, None], axis=1)
    sign = np.where(largest < 0, -1.0, 1.0)  # (m, 1)
    still = np.zeros((3 - mesh.dimension,))
    stiff = locking.said(mesh, shapes, pairs.zeros, scene)
    cells = f"{CELLS[mesh.cell].plural} of order {scene.body.order}" + (
        "" if scene.body.element == "standard" else f", {scene.body.element} element")
    return Modes(
        mesh=mesh, eigenvalues=pairs.values, shapes=shapes * sign[:, :, None] / np.sqrt(thickness), residuals=pairs.residuals,
        participation=np.pad(participation * sign, ((0, 0), (0, len(still)))) * np.sqrt(thickness),
        free_mass=np.concatenate([free_mass, still]) * thickness, dofs=dofs, rigid=pairs.zeros,
        rigid_expected=problem.zeros, cells=cells, solver=pairs.solver,
        remarks=(*loaded, *remarks(pairs, problem, mesh), *pieces_held(scene, mesh), *stiff), seconds=time.perf_counter() - started)


def elastic_problem(scene: Scene, mesh: Mesh, *, spread: bool = False) -> tuple[Problem, fem.Space]:
    """Stiffness and mass of a scene's body with its supports, and the space that they live in, to be kept as long as they are used. Per
    metre of a plane body."""
    fixed = held(scene, mesh)
    space = fem.Space(mesh, order=scene.body.order, spread=spread)
    u, v = ufl.TrialFunction(space.V), ufl.TestFunction(space.V)
    lmbda, mu = (cellwise(scene.material, mesh, lambda own, i=i: lame(own)[i]) for i in (0, 1))  # type: ignore[misc]
    if mesh.dimension == 2 and scene.body.plane == "stress":
        lmbda = 2 * mu * lmbda / (lmbda + 2 * mu)
    if scene.body.element != "standard":
        if _orthotropic(scene):
            raise InputError(f"body.element = {scene.body.element!r}: for isotropic materials only; leave it or orthotropic out")
        if space.comm.size > 1:
            raise InputError(f"body.element = {scene.body.element!r}: for one process only; leave mpirun or the element out")
        stiffness = small_strain_stiffness(space, mesh, scene.material, scene.body.element)
    elif _orthotropic(scene):
        stiffness = fem.matrix(_orthotropic_form(space, scene, mesh))
    else:
        first, second = space.number(lmbda), space.number(mu)
        dx = ufl.dx(metadata={"quadrature_degree": space.degrees[0]})
        strain = ufl.sym(ufl.grad(v))
        stiffness = fem.matrix((first * ufl.div(u) * ufl.div(v) + 2 * second * ufl.inner(ufl.sym(ufl.grad(u)), strain)) * dx)
    mass = fem.mass_matrix(space, _density(scene, mesh), stiffness)

    free = np.ones((space.owned, mesh.dimension), bool)
    for support in scene.support:
        entities = mesh.entities(support.where) if space.order > 1 else {1: mesh.place(support.where)[:, None]}
        inside = space.within(entities)[:space.owned]
        for letter in support.fixed:
            if "xyz".index(letter) < mesh.dimension:
                free[inside, "xyz".index(letter)] = False
    graph = (space.coordinates(), space.cells) if mesh.dimension == 3 and space.comm.size == 1 else None
    zeros = sum(rigid_motions_left(replace(mesh, points=mesh.points[part]), fixed[part]) for part in pieces(mesh))
    return Problem(stiffness=stiffness, mass=mass, free=free.ravel(), zeros=zeros, scale=_first_bending(scene, mesh),
                   dimension=mesh.dimension, near_null=_rigid_motions(space), graph=graph), space


def _orthotropic(scene: Scene) -> bool:
    return any(material.orthotropic is not None for material in scene.materials)


def _density(scene: Scene, mesh: Mesh) -> float | Floats:
    """[kg/m3], of several materials that of each cell."""
    return cellwise(scene.material, mesh, lambda own: own.density)


def _orthotropic_form(space: fem.Space, scene: Scene, mesh: Mesh) -> Any:
    """The stiffness of an orthotropic body as a UFL form, whose constants may change without compiling it again."""
    D = space.components
    plane = None if D == 3 else scene.body.plane or "strain"

    def constant(part: int, *index: int) -> Any:
        return space.number(cellwise(scene.material, mesh, lambda own: float(np.asarray(hooke(own, plane)[part])[index])))

    e, d = (ufl.sym(ufl.grad(of)) for of in (ufl.TrialFunction(space.V), ufl.TestFunction(space.V)))
    density = sum(constant(0, i, j) * e[i, i] * d[j, j] for i in range(D) for j in range(D))
    for shear, (i, j) in enumerate(((0, 1), (1, 2), (0, 2))[:1 if plane else 3]):
        density += 4 * constant(1, shear) * e[i, j] * d[i, j]
    return density * ufl.dx(metadata={"quadrature_degree": space.degrees[0]})


def _at(problem: Problem, space: fem.Space, scene: Scene, mesh: Mesh, at: tuple[Floats, float],
        spread: bool) -> tuple[Problem, fem.Space, tuple[str, ...]]:
    """A problem of the body at rest, made that of a loaded state, its space, and a remark. Of a plane body per metre, in its plane."""
    if spread:
        raise InputError("modes of a loaded body are found by one process; leave mpirun out")
    for matrix in (problem.stiffness, problem.mass):
        matrix.destroy()
    stiffness, whole, said = loaded_stiffness(scene, mesh, *at)
    if mesh.dimension == 2:
        inside = fem.PETSc.IS().createGeneral(whole.dofs[space.nodes, :2].ravel().astype(np.int32))
        stiffness, of_all = stiffness.createSubMatrix(inside, inside), stiffness
        of_all.destroy()
        stiffness.scale(1 / (scene.body.thickness or 1.0))
    else:
        space = whole
    return replace(problem, stiffness=stiffness, mass=fem.mass_matrix(space, _density(scene, mesh), stiffness)), space, (said,)


def remarks(pairs: Pairs, problem: Problem, mesh: Mesh) -> tuple[str, ...]:
    """What should be said about some pairs: a cut cluster, unexpected zeros, residuals at the limit of rounding."""
    said = list(mesh.remarks)
    *_, last = clusters(pairs.values, pairs.zeros)
    upper = pairs.values[-1]
    cut_zeros = len(pairs.values) <= pairs.zeros < problem.zeros
    if cut_zeros:
        said.append(f"the last is one of {problem.zeros} zeros: ask for {problem.zeros} to have them all")
    elif pairs.beyond - upper <= 0.02 * pairs.beyond:
        said.append(f"the last {'cluster' if len(last) > 1 else 'one'} is cut: the next eigenvalue is {pairs.beyond:.6g}, "
                    f"{100 * (1 - upper / pairs.beyond):.2g} % above the last; ask for more to have the whole cluster")
    if pairs.zeros > problem.zeros:
        said.append(f"{pairs.zeros} eigenvalues are zero, {problem.zeros} were expected: parts of the mesh hang together too loosely")
    if pairs.residuals.max() > GOAL:
        said.append(f"the largest residual is {pairs.residuals.max():.1e}; rounding alone leaves about {pairs.floor:.1e} on this mesh")
    return tuple(said)


def euler_bernoulli_hz(scene: Scene, count: int) -> tuple[float, ...]:
    """Bending frequencies [Hz] of a slender cantilever beam of the scene's body, both planes, in rising order.

    f = (beta L)^2 / (2 pi L^2) sqrt(E I / (rho A)) with cos(beta L) cosh(beta L) = -1 (Blevins, table 8-1).
    """
    length, width, height = scene.body.extent
    (material,) = scene.materials
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
    fastest = max(material.young_modulus / material.density for material in scene.materials)
    return float(fastest * slenderness**2)


def _translations(space: fem.Space) -> Floats:
    """(D, local) unit motions along each axis."""
    return np.stack([np.tile(axis, space.owned) for axis in np.eye(space.components)])


def _rigid_motions(space: fem.Space) -> Floats:
    """(3 or 6, local) translations and rotations, which strain nothing."""
    x = space.coordinates()
    turns: Iterable[Floats] = (np.cross(axis, x) for axis in (np.eye(3) if space.components == 3 else np.eye(3)[2:]))
    return np.concatenate([_translations(space), [turn[:, :space.components].ravel() for turn in turns]])


def _times(matrix: fem.PETSc.Mat, rows: Floats) -> Floats:
    """(k, local) a matrix times each of some vectors."""
    right, left = matrix.createVecs()
    product = np.empty_like(rows, float)
    for row, out in zip(rows, product, strict=True):
        right.array[:] = row
        matrix.mult(right, left)
        out[:] = left.array
    return product
