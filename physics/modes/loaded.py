"""The stiffness that a loaded body swings with: the tangent of a state of equilibrium, contact included.

    K = d2W/du2 - symmetric part of df/du of pressures that follow their faces + G^T diag(1/c) G - B^T B

at the displacements of the state: its stress is in the first term, so a beam under tension swings faster and a column near its load
slowly. G (k, 3 n) are the gradients of the gaps of the k points that press, c their softness [m/N], B what a round obstacle takes
(contact/touch.py): these points stay on the obstacle, along which they are free to slide. The small swing neither opens nor closes
contact.

The law is that of finite strain also where small strain was enough to find the state: what is small in displacements may be all of a
slender body's stiffness.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from physics import fem
from physics.equilibrium.balance import Balance
from physics.equilibrium.newton import Newton
from physics.equilibrium.state import State
from physics.linalg.multigrid import Felt
from physics.mesh.mesh import Mesh
from physics.scene import Scene
from physics.schema import InputError

Floats = NDArray[np.float64]


def loaded_stiffness(scene: Scene, mesh: Mesh, u: Floats, fraction: float) -> tuple[PETSc.Mat, fem.Space, str]:
    """The tangent stiffness at the equilibrium beside a state, the space it lives in, and what it is in words.

    Args:
        u: (N, 3) displacements [m], as a trajectory holds them; fraction: of the loading, 0 .. 1

    Returns:
        a matrix that the caller destroys; held rows and columns are those of the identity

    Raises:
        InputError: the law has no tangent but that of rest, the body is in motion or free to move
        NoEquilibrium: there is no stable equilibrium beside the state
    """
    if scene.linear:
        raise InputError("material.law = 'linear': its stiffness is that of rest whatever the load; take a law of finite strain")
    if scene.steps.dynamic:
        raise InputError("steps.dynamic = true: a body in motion is in no equilibrium to swing about")
    balance = Balance(scene, mesh)
    points = 0 if balance.contact is None else len(balance.contact.surface.area)
    state, felt = State(fraction, np.asarray(u, np.float64), np.zeros(points)), None
    if state.u.any() or not balance.rests(fraction):
        newton = Newton(balance)
        state = newton.polished(fraction, State(fraction, np.where(balance.fixed, balance.moved(fraction), u), np.zeros(points)))
        felt = newton.pressing(state)
    stiffness = balance.body.stiffness(state.u).copy()
    said = f"of the body as it is at {fraction:.4g} of the loading"
    if felt is not None:
        _add(stiffness, balance, felt)
        said += f", {len(felt.gap)} points of it staying on the obstacle, along which they slide"
    return stiffness, balance.body.space, said


def _add(stiffness: PETSc.Mat, balance: Balance, felt: Felt) -> None:
    """Add what contact does to free components."""
    block = felt.gradient.T @ (felt.gradient / felt.softness[:, None]) - felt.bend.T @ felt.bend
    dofs, free = balance.body.space.dofs[felt.nodes].ravel(), ~balance.fixed[felt.nodes].ravel()
    for row in np.flatnonzero(free):
        columns = np.flatnonzero((block[row] != 0) & free)
        stiffness.setValues([dofs[row]], dofs[columns].astype(np.int32), block[row, columns], addv=True)
    stiffness.assemble()
