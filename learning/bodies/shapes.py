"""Smooth displacements of any body, and the few of them that the bodies of a training take.

Displacements are told by products of Legendre polynomials of the place in the body's box, P_i(x) P_j(y) P_k(z) with a factor that makes
their mean square over the box 1. Along the longest side they go up to a degree d; along the others to d times their share of its
length, 2 at the least; i + j + k is d + 1 at most. So meshes that share no node share coefficients.

    u(x) = sum over m of c_m f_m(x),    c (M, 3) by least squares over the nodes, with a little weight on c itself where nodes leave it open

Of these the bodies of a training take few combinations: the principal ones, by the motion of each trajectory alike, are its shapes.

What they leave over is above all the dent below the obstacle, which is where the obstacle is. So there are functions about the touch, too:
with y = (x - the first touch) / H, H the shortest side, and s how far a point lies aside of that touch (body.aside), over H,

    exp(-s^2 / 2 w^2) y_1^i y_2^j y_3^k,    for each of some widths w, i + j + k <= 2,

and principal combinations of these, by what they do in the mean over the bodies, of what the first shapes leave over.

Legend: N nodes, M functions, r shapes, T frames.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import ArrayLike, NDArray

from learning.bodies.body import PressedBody

Floats = NDArray[np.floating[Any]]
Powers = NDArray[np.int64]
RIDGE = 1e-4  # of the mean square of a function: coefficients stay small where a body leaves the box empty
WIDTHS = (0.5, 1.0, 2.0)  # of the functions about the touch, in thicknesses
FLAT = 1e-9  # of the largest mean square, below which combinations of functions count as that large


def powers(extent: Floats, degree: int, touched: bool = False) -> Powers:
    """(M, 4) degrees along x, y, z for boxes about as long as (3,) along each, and 0; where it is asked for also those of functions about
    the touch, and the number of their width, from 1 on."""
    most = np.maximum(np.round(degree * extent / extent.max()), min(2, degree)).astype(int)
    every = _degrees(most, degree + 1, 0)
    return np.concatenate([every, *(_degrees([2] * 3, 2, 1 + k) for k in range(len(WIDTHS)) if touched)])


def _degrees(most: ArrayLike, total: int, width: int) -> Powers:
    every = np.stack(np.meshgrid(*(np.arange(n + 1) for n in np.asarray(most)), [width], indexing="ij"), axis=-1).reshape(-1, 4)
    return every[every[:, :3].sum(axis=1) <= total]


def functions(body: PressedBody, degrees: Powers) -> Floats:
    """(N, M) the functions at the body's nodes."""
    place, smooth = body.box(body.points), degrees[degrees[:, 3] == 0]
    along = [legvander(place[:, k], int(smooth[:, k].max())) * np.sqrt(2 * np.arange(smooth[:, k].max() + 1) + 1) for k in range(3)]
    values = along[0][:, smooth[:, 0]] * along[1][:, smooth[:, 1]] * along[2][:, smooth[:, 2]]
    about = degrees[degrees[:, 3] > 0]
    if not len(about):
        return values
    thick = body.extent.min()
    y, aside = (body.points - body.touch) / thick, body.aside(body.points) / thick**2
    near = np.exp(-aside[:, None] / (2 * np.square(WIDTHS)))[:, about[:, 3] - 1]
    return np.column_stack([values, near * np.prod(y[:, None] ** about[:, :3], axis=2)])


def fit(values: Floats, displacement: Floats) -> Floats:
    """(T, M, 3) coefficients of displacements (T, N, 3) for functions (N, M)."""
    work = np.tensordot(values, displacement, ((0,), (1,))) / len(values)  # (M, T, 3)
    return solved(values.T @ values / len(values), work).swapaxes(0, 1)


def solved(products: Floats, work: Floats) -> Floats:
    """(M, T, 3) coefficients that do some work (M, T, 3) for products (M, M) of functions, and a little weight on them."""
    found: Floats = np.linalg.solve(products + RIDGE * np.eye(len(products)), work.reshape(len(work), -1)).reshape(work.shape)
    return found


def principal(coefficients: Floats, weight: Floats, count: int, products: Floats | None = None) -> Floats:
    """(r, M, 3) the principal combinations of coefficients (T, M, 3), frames counting by a weight (T,); orthonormal, for functions with
    products (M, M), or such functions."""
    back = np.eye(coefficients.shape[1])
    if products is not None:
        square, vectors = np.linalg.eigh(products)
        root = np.sqrt(np.maximum(square, FLAT * square.max()))
        back = vectors / root
        coefficients = np.einsum("tmk,mn->tnk", coefficients, vectors * root, optimize=True)
    rows = (coefficients * weight[:, None, None]).reshape(len(coefficients), -1)
    _, vectors = np.linalg.eigh(rows.T @ rows)
    found = np.ascontiguousarray(vectors[:, ::-1][:, :count].T).reshape(-1, *coefficients.shape[1:])
    return np.einsum("mn,rnk->rmk", back, found)


def mirrors(axes: str) -> list[tuple[int, ...]]:
    """Every choice of some of the axes "xyz" to which mirrors are normal, none of them first."""
    normal = ["xyz".index(letter) for letter in axes]
    return [some for count in range(len(normal) + 1) for some in combinations(normal, count)]


def mirror_signs(degrees: Powers, axis: int) -> Floats:
    """(M, 3) what a mirror normal to an axis makes of coefficients, as factors."""
    return np.where(degrees[:, axis] % 2, -1.0, 1.0)[:, None] * np.where(np.arange(3) == axis, -1.0, 1.0)
