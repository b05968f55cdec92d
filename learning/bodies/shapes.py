"""Smooth displacements of any body, and the few of them that the bodies of a training take.

Displacements are told by products of Legendre polynomials of the place in the body's box, P_i(x) P_j(y) P_k(z) with a factor that makes
their mean square over the box 1. Along the longest side they go up to a degree d; along the others to d times their share of its
length, 2 at the least; i + j + k is d + 1 at most. So meshes that share no node share coefficients.

    u(x) = sum over m of c_m f_m(x),    c (M, 3) by least squares over the nodes, with a little weight on c itself where nodes leave it open

Of these the bodies of a training take few combinations: the principal ones, by the motion of each trajectory alike, are its shapes.

Legend: N nodes, M functions, r shapes, T frames.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from learning.bodies.body import Body

Floats = NDArray[np.floating[Any]]
Powers = NDArray[np.int64]
RIDGE = 1e-6  # of the mean square of a function


def powers(extent: Floats, degree: int) -> Powers:
    """(M, 3) degrees along x, y, z for boxes about as long as (3,) along each."""
    most = np.maximum(np.round(degree * extent / extent.max()), min(2, degree)).astype(int)
    every = np.stack(np.meshgrid(*(np.arange(n + 1) for n in most), indexing="ij"), axis=-1).reshape(-1, 3)
    return every[every.sum(axis=1) <= degree + 1]


def functions(body: Body, degrees: Powers) -> Floats:
    """(N, M) the functions at the body's nodes."""
    place = body.box(body.points)
    along = [legvander(place[:, k], int(degrees[:, k].max())) * np.sqrt(2 * np.arange(degrees[:, k].max() + 1) + 1) for k in range(3)]
    return along[0][:, degrees[:, 0]] * along[1][:, degrees[:, 1]] * along[2][:, degrees[:, 2]]


def fit(values: Floats, displacement: Floats) -> Floats:
    """(T, M, 3) coefficients of displacements (T, N, 3) for functions (N, M)."""
    normal = values.T @ values / len(values) + RIDGE * np.eye(values.shape[1])
    work = np.tensordot(values, displacement, ((0,), (1,))) / len(values)  # (M, T, 3)
    found: Floats = np.linalg.solve(normal, work.reshape(len(work), -1)).reshape(work.shape)
    return found.swapaxes(0, 1)


def principal(coefficients: Floats, weight: Floats, count: int) -> Floats:
    """(r, M, 3) the principal combinations, orthonormal, of coefficients (T, M, 3), frames counting by a weight (T,)."""
    rows = (coefficients * weight[:, None, None]).reshape(len(coefficients), -1)
    _, vectors = np.linalg.eigh(rows.T @ rows)
    return np.ascontiguousarray(vectors[:, ::-1][:, :count].T).reshape(-1, *coefficients.shape[1:])


def mirror_signs(degrees: Powers, axis: int) -> Floats:
    """(M, 3) what a mirror normal to an axis makes of coefficients, as factors."""
    return np.where(degrees[:, axis] % 2, -1.0, 1.0)[:, None] * np.where(np.arange(3) == axis, -1.0, 1.0)
