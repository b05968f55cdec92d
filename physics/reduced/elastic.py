"""The elasticity of a body in numpy: stiffness at rest with its factor, stress, and nodal forces at any displacement.

    H = grad u,  F = I + H,  E = (H + H^T + H^T H) / 2        at the points of integration
    f(u) = sum over points of  w grad(N) P(F)                 nodal forces, P the first Piola-Kirchhoff stress
    K = df/du (0)                                             held nodes left out, factored once

Forces are in units of Young's modulus times area: the displacement of a body that is pressed by a rigid obstacle depends on
Poisson's ratio alone.

Legend: N nodes, C cells, n nodes of a cell, g points of integration in a cell, Q = C g, M = 3 N components.
Laws: physics/body/material.py; elements: physics/body/element.py; solver: SuperLU through scipy.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from physics.body.element import samples
from physics.body.material import lame, law_of, stress
from physics.linalg.ordering.nested import dissect
from physics.mesh.mesh import Mesh
from physics.scene import Material

Floats = NDArray[np.float64]
NARROW = 250  # half bandwidth of K up to which a numbering along the body fills its factor least; past it nested dissection's does


class Elastic:
    """One body, held at some nodes.

    Attributes:
        size: M; held: (M,) True on components that do not move
        stiffness: K (M, M) of all components
        columns: of K^-1, as rows (.., M): those of the nodes that were learnt
        weights: (Q,) [m3] of the points of integration, those of a cell one after another; per_cell: g
        lame: lambda and mu over Young's modulus (2, Q), as far as they count at each
    """

    def __init__(self, mesh: Mesh, held: NDArray[np.bool_], material: Material, element: str = "standard") -> None:
        """Args: held (N,) nodes. Raises `InputError` for an unknown law, or an element that is not for such cells."""
        self._law = law_of(material.law)
        nodes, (cells, n) = len(mesh.points), mesh.cells.shape
        self.size, self.held = 3 * nodes, np.repeat(held, 3)
        chosen = samples(mesh, element)
        gradient, weight = chosen.gradients.swapaxes(0, 1), chosen.volumes.T  # (C, g, n, 3), (C, g)
        self.weights, self.per_cell = weight.ravel(), weight.shape[1]
        self.lame = np.tile((chosen.parts * lame(replace(material, young_modulus=1.0))).T, cells)
        columns = np.broadcast_to(mesh.cells[:, None, :], (3, cells, self.per_cell, n)).ravel()
        entries = gradient.transpose(3, 0, 1, 2).ravel()
        self._gradient = sparse.csr_matrix((entries, columns, np.arange(0, len(entries) + 1, n)), shape=(3 * len(self.weights), nodes))
        self._directions = [self._gradient[i * len(self.weights):(i + 1) * len(self.weights)] for i in range(3)]
        self._divergence = self._gradient.T.tocsr()
        node = np.repeat(mesh.cells, self.per_cell, axis=0).reshape(-1)  # each point's nodes
        near = sparse.csr_matrix((np.repeat(self.weights, n), (node, np.repeat(np.arange(len(self.weights)), n))))
        around = sparse.diags(1 / np.asarray(near.sum(axis=1)).ravel()) @ near  # (N, Q) mean over the points around a node
        self._mean_gradient = sparse.vstack([around @ part for part in self._directions]).tocsr()
        self.stiffness = self._assemble(mesh.cells, gradient)
        free = np.flatnonzero(~self.held)
        self._order = free[reverse_cuthill_mckee(self.stiffness[free][:, free].tocsr(), symmetric_mode=True)]
        matrix = self.stiffness[self._order][:, self._order].tocoo()
        if abs(matrix.row - matrix.col).max() > NARROW:
            self._order = components(dissect(mesh.points, mesh.cells.astype(np.int32)).order)
            self._order = self._order[~self.held[self._order]]
            matrix = self.stiffness[self._order][:, self._order]
        self._factor = splu(matrix.tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        self._known, self.columns = np.full(nodes, -1), np.zeros((0, self.size))

    def _assemble(self, cells: NDArray[np.int64], gradient: Floats) -> sparse.csc_matrix:
        count, points, n, _ = gradient.shape
        b = gradient.reshape(count, points, 3 * n)
        first, second = (np.matmul((b * share[:, :, None]).transpose(0, 2, 1), b).reshape(count, n, 3, n, 3)
                         for share in (self.weights * self.lame).reshape(2, count, points))
        block = first + second.transpose(0, 1, 4, 3, 2)
        laplace = np.einsum("cajbj->cab", second)
        for i in range(3):
            block[:, :, i, :, i] += laplace
        component = (3 * cells[:, :, None] + np.arange(3)).reshape(count, 3 * n)
        rows, columns = np.repeat(component, 3 * n, axis=1).ravel(), np.tile(component, (1, 3 * n)).ravel()
        return sparse.coo_matrix((block.ravel(), (rows, columns)), shape=(self.size, self.size)).tocsc()

    def solve(self, force: Floats) -> Floats:
        """K^-1 of forces (M, ..), zero on held components."""
        out = np.zeros_like(force)
        out[self._order] = self._factor.solve(np.ascontiguousarray(force[self._order]))
        return out

    def gradient(self, u: Floats) -> Floats:
        """H (Q, 3, 3) of displacements (M,): H_ij = du_i/dX_j."""
        found = np.array([self._gradient @ component for component in u.reshape(-1, 3).T])
        return found.reshape(3, 3, -1).transpose(2, 0, 1)  # one component after another in memory, which is faster

    def gradients(self, u: Floats, points: NDArray[np.int64] | slice) -> Floats:
        """H (3, 3, r, q) of r displacements (M, r) at some points of integration."""
        parts = [part[points] @ u.reshape(len(u) // 3, -1) for part in self._directions]
        return np.array(parts).reshape(3, -1, 3, u.shape[1]).transpose(2, 0, 3, 1)

    def force(self, stress: Floats) -> Floats:
        """(M,) nodal forces of a first Piola-Kirchhoff stress (Q, 3, 3), zero on held components."""
        weighted = (stress.transpose(1, 2, 0) * self.weights).reshape(3, -1)
        force = np.stack([self._divergence @ row for row in weighted], axis=1).ravel()
        force[self.held] = 0.0
        return force

    def hooke(self, strain: Floats) -> Floats:
        """lambda tr(E) I + 2 mu E for strains (Q, 3, 3)."""
        lmbda, mu = self.lame
        stress = 2 * mu[:, None, None] * strain
        trace = lmbda * np.einsum("qii->q", strain)
        for i in range(3):
            stress[:, i, i] += trace
        return stress

    def internal(self, u: Floats) -> Floats:
        """f(u) (M,) of displacements (M,), by the body's own law; not finite where a cell is inside out."""
        return self.force(stress(self._law, self.gradient(u), *self.lame))

    def learn(self, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
        """Where in `columns` those of n nodes stand, three for each (3 n,); what is not there yet is solved for."""
        new = nodes[self._known[nodes] < 0]
        if len(new):
            forces = np.zeros((self.size, 3 * len(new)))
            forces[components(new), np.arange(3 * len(new))] = 1.0
            forces[self.held] = 0.0
            self._known[new] = len(self.columns) // 3 + np.arange(len(new))
            self.columns = np.concatenate([self.columns, self.solve(forces).T])
        return components(self._known[nodes])

    def answers(self, u: Floats, force: Floats) -> Floats:
        """R K^-1 R^T of forces (k, M) on the body at displacements (k, M): the rest stiffness, turned with each node."""
        turns = np.array([self._rotations(one) for one in u])  # (k, N, 3, 3)
        turned = np.einsum("knji,knj->kni", turns, force.reshape(len(u), -1, 3)).reshape(len(u), -1)
        solved = self.solve(turned.T).T.reshape(len(u), -1, 3)
        return np.einsum("knij,knj->kni", turns, solved).reshape(len(u), -1)

    def _rotations(self, u: Floats) -> Floats:
        """R (N, 3, 3) of the nodes, as far as strains are small: from the mean of H around them, whose skew part is sin(angle)
        times the axis."""
        h = (self._mean_gradient @ u.reshape(-1, 3)).reshape(3, -1, 3).transpose(1, 2, 0)
        skew = (h - h.transpose(0, 2, 1)) / 2
        square = skew @ skew
        cosine = np.sqrt(np.maximum(1 + np.trace(square, axis1=1, axis2=2) / 2, 0.0))
        return np.eye(3) + skew + square / (1 + cosine)[:, None, None]

    def second(self, a: Floats, b: Floats) -> Floats:
        """(M,) the part of second order of f by Saint Venant-Kirchhoff's law, as a symmetric bilinear form of two H (Q, 3, 3)."""
        return self.force((self.hooke(_square(a, b)) + _product(a, self.hooke(symmetric(b))) + _product(b, self.hooke(symmetric(a)))) / 2)

    def third(self, a: Floats, b: Floats, c: Floats) -> Floats:
        """(M,) the part of third order, as a symmetric form of three H (Q, 3, 3)."""
        return self.force((_product(a, self.hooke(_square(b, c))) + _product(b, self.hooke(_square(a, c)))
                           + _product(c, self.hooke(_square(a, b)))) / 6)


def components(nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """(3 n,) the components of some nodes."""
    return (3 * nodes[:, None] + np.arange(3)).ravel()


def symmetric(h: Floats) -> Floats:
    """The symmetric part of (.., 3, 3)."""
    return (h + h.swapaxes(-1, -2)) / 2


def _square(a: Floats, b: Floats) -> Floats:
    return symmetric(_product(a.transpose(0, 2, 1), b))


def _product(a: Floats, b: Floats) -> Floats:
    """a b of (Q, 3, 3), summed component by component."""
    return np.asarray(a[:, :, 0, None] * b[:, None, 0] + a[:, :, 1, None] * b[:, None, 1] + a[:, :, 2, None] * b[:, None, 2], float)
