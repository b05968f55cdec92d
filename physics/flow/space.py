"""Taylor-Hood spaces on a mesh of triangles with straight or curved sides, and the sums over cells that a flow needs.

Velocities are Lagrange functions of order k = 2 or 3 in each component, pressures of order k - 1: a stable pair (Boffi, Brezzi and
Fortin, Mixed Finite Element Methods, section 8.8). A cell is the image of the reference triangle under a quadratic map, so a side on
a round wall is a parabola through three points of it. With v, q test functions, all forms are of unit density:

    mass (u, v),  viscosity (grad u, grad v),  divergence (q, div u),
    momentum (g, v) - (u . grad u + (div u) u / 2, v) + (p, div v)

The half of the divergence makes convection skew but for what passes the boundary: it can neither feed nor drain energy inside where
div u is zero only in the mean (Temam 1968).

Legend: N velocity nodes, M pressure nodes, C cells, n and m nodes of a cell, P points of the quadrature, V vertices of the mesh.
"""

from __future__ import annotations

import ctypes
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from physics import fem
from physics.linalg.native import aligned, compiled, pointer
from physics.mesh.mesh import Mesh

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

OPPOSITE = ((1, 2), (0, 2), (0, 1))  # the corners of the edges in the order of their nodes
SKEW = 0.5
LOOPS = (Path(__file__).parent / "loops.cpp").read_text()


class Nodes:
    """Lagrange's nodes of one order on a mesh.

    Attributes:
        cells: (C, n) node numbers, vertices first, then those inside edges, then those inside cells
        points: (N, 2) where they lie [m]
        inner: (E, order - 1) those inside the edges of the mesh, from the lower vertex on
    """

    def __init__(self, mesh: Mesh, order: int, geometry: Floats) -> None:
        """Args: geometry (C, 6, 2) nodes of the quadratic map."""
        vertices, cells = len(mesh.points), mesh.cells
        key = mesh.edges[:, 0] * vertices + mesh.edges[:, 1]
        self.inner = vertices + np.arange(len(key) * (order - 1)).reshape(len(key), order - 1)
        columns = [cells]
        for a, b in OPPOSITE:
            low, high = np.sort(cells[:, [a, b]], axis=1).T
            found = self.inner[np.searchsorted(key, low * vertices + high)]
            columns.append(np.where((cells[:, a] == low)[:, None], found, found[:, ::-1]))
        start, inside = vertices + self.inner.size, (order - 1) * (order - 2) // 2
        columns.append(start + np.arange(len(cells) * inside).reshape(len(cells), inside))
        self.cells = np.ascontiguousarray(np.concatenate(columns, axis=1), np.int32)
        self.points = np.zeros((start + len(cells) * inside, 2))
        self.points[self.cells] = np.einsum("qg,cgd->cqd", table(2, fem.triangle(order, 1)[0].points)[0], geometry)

    def along_edges(self, mesh: Mesh, edges: Integers) -> Integers:
        """(F, order + 1) the nodes of some edges (F, 2) in a row, from the lower vertex on."""
        low, high = np.sort(edges.reshape(-1, 2), axis=1).T
        key, base = mesh.edges[:, 0] * len(mesh.points) + mesh.edges[:, 1], len(mesh.points)
        inside = self.inner[np.searchsorted(key, low * base + high)]
        return np.concatenate([low[:, None], inside, high[:, None]], axis=1)

    def on_edges(self, mesh: Mesh, edges: Integers) -> Integers:
        """The nodes of some edges (F, 2), each once."""
        return np.unique(self.along_edges(mesh, edges))


class FlowSpace:
    """Velocity and pressure on a mesh.

    Attributes:
        velocity, pressure: their nodes
        metric: (P, C, 5) weight times det J, and a, b, c, d of loops.cpp
    """

    def __init__(self, mesh: Mesh, order: int) -> None:
        self.mesh, self.order = mesh, order
        geometry = geometry_of(mesh)
        self.velocity, self.pressure = Nodes(mesh, order, geometry), Nodes(mesh, order - 1, geometry)
        _, points, weights = fem.triangle(order, 3 * order - 1)
        self.values, self.slopes = table(order, points)
        self.pressures = table(order - 1, points)[0]
        J = np.einsum("pgr,cgd->pcdr", table(2, points)[1], geometry)
        w, (xr, xs), (yr, ys) = weights[:, None], np.moveaxis(J[..., 0, :], -1, 0), np.moveaxis(J[..., 1, :], -1, 0)
        self.metric = np.stack([w * (xr * ys - xs * yr), w * ys, -w * yr, -w * xs, w * xr], axis=-1)
        self._packs = packed(self.metric)
        self._library = _library(order, len(points))
        self._where = (ctypes.c_int64(len(mesh.cells)), pointer(self.velocity.cells), pointer(self.pressure.cells),
                       pointer(self._packs))

    # Sums over cells, eight at a time.

    def momentum(self, u: Floats, g: Floats, p: Floats) -> Floats:
        """(N, 2) of the form `momentum`, at velocities u and g (N, 2) and a pressure p (M,)."""
        return self._run("momentum", np.zeros(u.shape), u, g, p)

    def divergence(self, u: Floats) -> Floats:
        """(M,) of the form `divergence`."""
        return self._run("divergence", np.zeros(len(self.pressure.points)), u)

    def _run(self, name: str, out: Floats, *fields: Floats) -> Floats:
        given = [np.ascontiguousarray(field) for field in fields]
        getattr(self._library, name)(*self._where, *(pointer(field) for field in given), pointer(out))
        return out

    def rate(self, u: Floats) -> float:
        """[1/s] how often the fastest fluid crosses its cell: |inv(J) u| at the nodes, J the mean of the cell, in the worst direction."""
        w, a, b, c, d = np.moveaxis(self.metric.sum(axis=0), -1, 0)[..., None]
        x, y = np.moveaxis(u[self.velocity.cells], -1, 0)
        r, s = (a * x + c * y) / w, (b * x + d * y) / w
        return float(np.maximum(np.maximum(abs(r), abs(s)), abs(r + s)).max())

    def finest(self, u: Floats) -> float:
        """How much of a velocity only the functions of the highest order hold: |u - its interpolant of one order less| over |u|, in L2."""
        sizes, cells = self.metric[..., 0].sum(axis=0), u[self.velocity.cells].transpose(0, 2, 1)  # (C,), (C, 2, n)
        parts = [float((((cells @ form) ** 2).sum(axis=(1, 2)) * sizes).sum()) for form in self._finest]
        return float(np.sqrt(parts[0] / parts[1])) if parts[1] > 0 else 0.0

    @cached_property
    def _finest(self) -> tuple[Floats, Floats]:
        """(n, P) what the highest order adds, and the whole, at points of the reference triangle, times the root of their weights."""
        _, points, weights = fem.triangle(self.order, 2 * self.order)
        whole, lower = table(self.order, points)[0], table(self.order - 1, points)[0]
        added = whole - lower @ table(self.order, fem.triangle(self.order - 1, 1)[0].points)[0]
        return added.T * np.sqrt(2 * weights), whole.T * np.sqrt(2 * weights)

    # Matrices, cell by cell.

    @cached_property
    def gradients(self) -> Floats:
        """(P, C, n, 2) of the velocity's functions, times the weight times det J."""
        a, b, c, d = np.moveaxis(self.metric[..., 1:], -1, 0)[..., None]
        r, s = self.slopes[:, None, :, 0], self.slopes[:, None, :, 1]
        return np.stack([a * r + b * s, c * r + d * s], axis=-1)

    @cached_property
    def mass(self) -> Floats:
        """(C, n, n)"""
        return np.einsum("pc,pi,pj->cij", self.metric[..., 0], self.values, self.values, optimize=True)

    @cached_property
    def viscosity(self) -> Floats:
        """(C, n, n) of each component."""
        return _stiffness(self.gradients, self.metric[..., 0])

    def stiffness_of_pressure(self) -> Floats:
        """(C, m, m) (grad p, grad q)"""
        a, b, c, d = np.moveaxis(self.metric[..., 1:], -1, 0)[..., None]
        slopes = table(self.order - 1, fem.triangle(1, 3 * self.order - 1)[1])[1]
        r, s = slopes[:, None, :, 0], slopes[:, None, :, 1]
        return _stiffness(np.stack([a * r + b * s, c * r + d * s], axis=-1), self.metric[..., 0])

    def mass_of_pressure(self) -> Floats:
        """(C, m, m)"""
        return np.einsum("pc,pi,pj->cij", self.metric[..., 0], self.pressures, self.pressures, optimize=True)

    def divergence_blocks(self) -> Floats:
        """(C, m, n, 2)"""
        return np.einsum("pi,pcjd->cijd", self.pressures, self.gradients, optimize=True)

    def matrix(self, blocks: Floats) -> scipy.sparse.csr_matrix:
        """(N, N) the sum of blocks (C, n, n) of one component of the velocity."""
        cells, count = self.velocity.cells, len(self.velocity.points)
        rows, columns = (np.broadcast_to(x, blocks.shape).ravel() for x in (cells[:, :, None], cells[:, None, :]))
        return scipy.sparse.csr_matrix((blocks.ravel(), (rows, columns)), (count, count))


def geometry_of(mesh: Mesh) -> Floats:
    """(C, 6, 2) the nodes of the quadratic map of each cell: corners, then the middles of the edges opposite to them."""
    vertices, points = len(mesh.points), mesh.points[:, :2]
    middle = points[mesh.edges].mean(axis=1)
    key = mesh.edges[:, 0] * vertices + mesh.edges[:, 1]
    if mesh.middles:
        edges, at = mesh.middles[2]
        middle[np.searchsorted(key, edges[:, 0] * vertices + edges[:, 1])] = at[:, :2]
    sides = [np.sort(mesh.cells[:, pair], axis=1) for pair in OPPOSITE]
    inside = [middle[np.searchsorted(key, side[:, 0] * vertices + side[:, 1])] for side in sides]
    return np.concatenate([points[mesh.cells], np.stack(inside, axis=1)], axis=1)


def _stiffness(gradients: Floats, weights: Floats) -> Floats:
    return np.einsum("pcid,pcjd->cij", gradients / weights[..., None, None], gradients, optimize=True)


def table(order: int, points: Floats) -> tuple[Floats, Floats]:
    """Values (P, n) and slopes (P, n, 2) of Lagrange's functions of an order."""
    found = fem.triangle(order, 1)[0].tabulate(1, points)[..., 0]
    return found[0], np.moveaxis(found[1:], 0, -1)


def packed(metric: Floats) -> Floats:
    """(packs, P, 5, 4) four cells side by side, on an address that is a multiple of 64."""
    points, cells, size = metric.shape
    values = np.pad(metric, ((0, 0), (0, -cells % 4), (0, 0)), mode="edge").reshape(points, -1, 4, size).transpose(1, 0, 3, 2)
    found = aligned(values.size).reshape(values.shape)
    found[:] = values
    return found


def _library(order: int, points: int) -> ctypes.CDLL:
    values, slopes = table(order, fem.triangle(1, 3 * order - 1)[1])
    pressures = table(order - 1, fem.triangle(1, 3 * order - 1)[1])[0]
    head = f"#define NODES {values.shape[1]}\n#define CORNERS {pressures.shape[1]}\n#define POINTS {points}\n#define SKEW {SKEW}\n"
    tables = "".join(f"static const double {name}{''.join(f'[{n}]' for n in table.shape)} = {_braces(table)};\n"
                     for name, table in (("N", values), ("R", slopes[..., 0]), ("S", slopes[..., 1]), ("Q", pressures)))
    return compiled(head + tables + LOOPS)


def _braces(table: Floats) -> str:
    return "{" + ", ".join(map(_braces, table)) + "}" if table.ndim else repr(float(table))
