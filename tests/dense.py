"""Stiffnesses of tiny bodies as full matrices, for numpy.linalg."""

import numpy as np
import scipy.sparse


def stiffness(elasticity, u):
    """(3 N, 3 N) at displacements u (N, 3), in the order of u.ravel(); held rows and columns are those of the identity."""
    indptr, indices, values = elasticity.stiffness(u).getValuesCSR()
    place = elasticity.space.dofs.ravel()
    return scipy.sparse.csr_matrix((values, indices, indptr)).toarray()[np.ix_(place, place)]


def solved(elasticity, u, force):
    """K^-1 f (N, 3) with held components at rest."""
    right = np.where(elasticity.fixed, 0.0, force).ravel()
    return np.linalg.solve(stiffness(elasticity, u), right).reshape(-1, 3)
