"""A body in a small space: its displacement is Phi q, its energy a polynomial of q.

    W(q) = 1/2 s^T G s,    s = (q_1 .. q_r, all products q_i q_j)

is the energy of Saint Venant-Kirchhoff's law, exact in rotations: the strain E is linear and quadratic in q, so the matrix G
of the energies between its parts is all that remains of the mesh. It is summed over some points of integration, chosen by how much
they count in the energies of the space (leverage scores); linear and quadratic strains of a point stay together, as only then a
rotation costs nothing. What the small space cannot do, local indentation above all,
is left to the rest stiffness: K^-1 - Phi Phi^T (Phi is orthonormal in K).

The space is spanned by the answers to loads around the first touching point, and by the second and third derivatives along them,
which hold what finite rotation adds (foreshortening, and the change of bending as the body turns):

    K u_i = l_i,    K u_ij = -f2(u_i, u_j),    K u_11j = -2 f2(u_j, u_11) - 4 f2(u_1, u_1j) - 3 f3(u_1, u_1, u_j)

Legend: M = 3 N components, Q points of integration, r size of the space, m = r + r (r + 1) / 2.

Source: Barbic and James 2005 (reduced polynomials, modal derivatives); Noor and Peters 1980 (path derivatives as a space); Drineas,
Magdon-Ismail, Mahoney and Woodruff 2012 (leverage scores by random combinations).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physics.reduced.elastic import Elastic, symmetric

Floats = NDArray[np.float64]
POINTS = 1000  # of integration that the polynomial is made from, about
DRAWN = 4  # displacements by which points are chosen
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # components of a strain
INDEPENDENT = 1e-9  # of the energy of normed vectors: what lies below is rounding


class Reduced:
    """Attributes: space Phi (M, r), orthonormal in the rest stiffness."""

    def __init__(self, elastic: Elastic, vectors: Sequence[Floats]) -> None:
        """Args: vectors, (M,) each, zero on held components."""
        self._elastic = elastic
        self.space = self._orthonormal(np.stack(vectors, axis=1))
        self._points, weights = self._sample()
        lmbda, mu = elastic.lame[:, self._points]
        # where only a negative lambda counts, it is left to what the body's own law has beyond the polynomial
        self._scale = np.sqrt(weights * np.maximum(lmbda + 2 * mu / 3, 0)).astype(np.float32), np.sqrt(weights * mu).astype(np.float32)
        self._build()

    def _orthonormal(self, vectors: Floats) -> Floats:
        stiffness = self._elastic.stiffness
        norm = np.sqrt(np.einsum("mi,mi->i", vectors, stiffness @ vectors))
        vectors = vectors[:, norm > 0] / norm[norm > 0]
        energy, turn = np.linalg.eigh(vectors.T @ (stiffness @ vectors))
        keep = energy > INDEPENDENT * energy[-1]
        return vectors @ (turn[:, keep] / np.sqrt(energy[keep]))

    def _sample(self) -> tuple[NDArray[np.int64], Floats]:
        """Points of integration that stand for all, and the volume [m3] that each stands for.

        A point is taken as often as it counts: by its mean share in the volume and in the energies of displacements drawn at random. Points
        at even distances would not do: on a mesh of rows they may all lie in some of these.
        """
        elastic, r = self._elastic, self.space.shape[1]
        volumes, (lmbda, mu) = elastic.weights, elastic.lame
        if len(volumes) <= POINTS:
            return np.arange(len(volumes)), volumes
        strain = symmetric(elastic.gradients(self.space @ np.random.default_rng(0).normal(size=(r, DRAWN)), slice(None)).T)  # (Q, k, 3, 3)
        energy = lmbda[:, None] * np.einsum("qkii->qk", strain) ** 2 + 2 * mu[:, None] * np.einsum("qkij,qkij->qk", strain, strain)
        energy = abs(energy) * volumes[:, None]
        share = volumes / volumes.sum() + (energy / energy.sum(axis=0)).sum(axis=1)
        often = np.minimum(POINTS * share / (DRAWN + 1), 1)
        points = np.flatnonzero(np.diff(np.floor(np.cumsum(often) + 0.5), prepend=0))
        stands = volumes[points] / often[points]
        return points, stands * (volumes.sum() / stands.sum())

    def _build(self) -> None:
        r = self.space.shape[1]
        h = self._elastic.gradients(self.space, self._points).astype(np.float32)  # (3, 3, r, Q)
        self._first, self._second = np.triu_indices(r)
        components = np.empty((r + len(self._first), 6, h.shape[-1]), np.float32)  # (m, 6, Q)
        self._weigh([(h[i, j] + h[j, i]) / 2 for i, j in PAIRS], components[:r])
        at = r
        for i in range(r):  # products q_i q_j of all j >= i
            one, others = h[:, :, i], h[:, :, i:]
            product = [sum(one[k, a] * others[k, b] + one[k, b] * others[k, a] for k in range(3)) / 2 for a, b in PAIRS]
            for part in product:
                part[0] *= 0.5
            self._weigh(product, components[at:at + r - i])
            at += r - i
        flat = components.reshape(len(components), -1)
        self._gram = (flat @ flat.T).astype(np.float64)
        self._pair, self._twice = np.empty((r, r), np.int64), 1.0 + np.eye(r)
        self._pair[self._first, self._second] = self._pair[self._second, self._first] = np.arange(r, len(flat))  # the row of q_i q_j
        self._columns = (self._gram[:, self._pair] * self._twice).reshape(-1, r)  # (m r, r) so that times q it is G's part of products

    def _weigh(self, strain: Sequence[NDArray[np.float32]], out: NDArray[np.float32]) -> None:
        """Strains, the six PAIRS of components (k, Q) each, as six numbers whose squares add up to twice the energy: into (k, 6, Q)."""
        bulk, shear = self._scale
        mean = (strain[0] + strain[1] + strain[2]) / 3
        # tr^2 (lambda + 2 mu / 3) + 2 mu |dev|^2, the deviator's diagonal as two numbers
        x, y = strain[0] - mean, strain[1] - mean
        out[:, 0] = 3 * mean * bulk
        out[:, 1] = (2 * x + y) * shear
        out[:, 2] = np.float32(np.sqrt(3)) * y * shear
        for slot in (3, 4, 5):
            out[:, slot] = 2 * strain[slot] * shear

    def slope(self, q: Floats) -> Floats:
        """dW/dq (r,) at q (r,)."""
        forces = self._forces(q)
        return forces[:len(q)] + (forces[self._pair] * self._twice) @ q

    def hessian(self, q: Floats) -> Floats:
        """Second derivatives (r, r) of W at q (r,): (ds/dq)^T G ds/dq, and what the forces on products add."""
        r = len(q)
        turned = self._gram[:, :r] + (self._columns @ q).reshape(-1, r)  # G ds/dq
        products = np.einsum("ijk,ij,j->ik", turned[self._pair], self._twice, q, optimize=True)
        return turned[:r] + products + self._forces(q)[self._pair] * self._twice

    def _forces(self, q: Floats) -> Floats:
        """G s (m,)"""
        return self._gram @ np.concatenate([q, q[self._first] * q[self._second]])


def derivatives(elastic: Elastic, loads: Floats, scale: float) -> list[Floats]:
    """The vectors (M,) of the docstring's three kinds.

    Args:
        loads: (M, k); the first is the main one
        scale: [m] largest displacement that each answer to a load is brought to
    """
    first = elastic.solve(loads)
    first *= scale / abs(first).max(axis=0)
    h = [elastic.gradient(u) for u in first.T]
    count = len(h)
    pairs = [(0, j) for j in range(count)] + [(j, j) for j in range(1, count)]
    second = elastic.solve(np.stack([-elastic.second(h[i], h[j]) for i, j in pairs], axis=1))
    h2 = [elastic.gradient(u) for u in second[:, :count].T]
    third = elastic.solve(np.stack([-2 * elastic.second(h[j], h2[0]) - 4 * elastic.second(h[0], h2[j])
                                    - 3 * elastic.third(h[0], h[0], h[j]) for j in range(count)], axis=1))
    return [*first.T, *second.T, *third.T]
