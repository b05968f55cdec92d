"""The one place that knows which dolfinx is installed: 0.5.2 (Debian 12) or 0.9.0 (Debian 13).

Outside of this file a vector field is an array (N, 3) over the nodes of our mesh. dolfinx renumbers both nodes and
cells; `Space` holds the way there and back. Every process works for itself (MPI.COMM_SELF), unless a space is asked to be
spread over all processes, each with the whole of our mesh. Legend: N nodes, B blocks of degrees of freedom of this process
(its own first, then copies of its neighbours'), D components.
"""

from __future__ import annotations

import gc
import hashlib
import logging
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import basix
import ffcx
import ffcx.compiler
import numpy as np
import ufl
from dolfinx import __version__, fem
from dolfinx import mesh as dolfinx_mesh
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from physics.mesh.cell import CELLS
from physics.mesh.mesh import Entities, Mesh
from physics.mesh.second import further, is_curved, middle_nodes
from physics.mesh.sound.rows import rows_in

Floats = NDArray[np.float64]
# A crash shall be a crash: PETSc's handler of signals may wait forever for a lock that the crash left behind.
PETSc.Sys.popSignalHandler()

FFCX_VERSION = ffcx.__version__
OLD = tuple(int(part) for part in __version__.split(".")[:2]) < (0, 8)
if not OLD:
    import basix.ufl

# dolfinx lists the corners of a hexahedron as a tensor product, gmsh and VTK go round each face.
FROM_GMSH = {"triangle": [0, 1, 2], "quadrilateral": [0, 1, 3, 2], "tetrahedron": [0, 1, 2, 3],
             "hexahedron": [0, 1, 3, 2, 4, 5, 7, 6], "prism": [0, 1, 2, 3, 4, 5]}
QUADRATURE_DEGREE = {"triangle": 1, "quadrilateral": 3, "tetrahedron": 1, "hexahedron": 3, "prism": 2}
MASS_DEGREE = {"triangle": 2, "quadrilateral": 4, "tetrahedron": 2, "hexahedron": 4, "prism": 4}
COMPILE = ["-O3", "-march=native", "-ffast-math", "-fno-finite-math-only"]


def cache_folder() -> Path:
    """A folder for compiled forms of this very processor: code made with -march=native may not run on another one."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        flags = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    except OSError:
        flags = ""
    name = hashlib.sha256(f"{platform.machine()} {platform.processor()} {flags}".encode()).hexdigest()[:12]
    return Path.home() / ".cache" / "fidelity" / f"forms-{name}"


def compile_form(form: Any) -> Any:
    """A UFL form compiled for this processor, or taken from the cache of compiled forms."""
    options = {"cffi_extra_compile_args": COMPILE, "cache_dir": cache_folder()}
    with _quiet():
        return fem.form(form, jit_params=options) if OLD else fem.form(form, jit_options=options)


@contextmanager
def _quiet() -> Iterator[None]:
    """Without the compiler's command lines."""
    logging.disable(logging.INFO)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)


def cell_function(form: Any) -> str:
    """FFCx's C function that tabulates a form on one cell."""
    if OLD:
        from ffcx.parameters import get_parameters

        options = {"parameters": get_parameters()}
    else:
        from ffcx.options import get_options

        options = {"options": get_options()}
    code = ffcx.compiler.compile_ufl_objects([form], prefix="fidelity", **options)[1]
    start = code.index("void tabulate_tensor")
    depth = 0
    for position in range(code.index("{", start), len(code)):
        depth += {"{": 1, "}": -1}.get(code[position], 0)
        if depth == 0:
            return str(code[start:position + 1])
    raise RuntimeError("FFCx wrote a function without an end")


def tensors() -> tuple[Any, Any]:
    """UFL's mesh of tetrahedra and its space of 3 x 3 tensors, one a cell: what functions of F alone are written with."""
    if OLD:
        cell = ufl.Cell("tetrahedron", geometric_dimension=3)
        domain = ufl.Mesh(ufl.VectorElement("Lagrange", cell, 1))
        element = ufl.TensorElement("DG", cell, 0, shape=(3, 3))
    else:
        domain = ufl.Mesh(basix.ufl.element("Lagrange", "tetrahedron", 1, shape=(3,)))
        element = basix.ufl.element("DG", "tetrahedron", 0, shape=(3, 3))
    return domain, ufl.FunctionSpace(domain, element)


def triangle(order: int, degree: int) -> tuple[Any, Floats, Floats]:
    """Lagrange's element of an order on the triangle (0, 0), (1, 0), (0, 1), and a rule of a degree: points (P, 2), weights (P,)."""
    element = basix.create_element(basix.ElementFamily.P, basix.CellType.triangle, order, basix.LagrangeVariant.equispaced)
    return element, *basix.make_quadrature(basix.CellType.triangle, degree)


class Space:
    """Lagrange fields on a mesh: scalars, or vectors with a component for each dimension.

    Attributes:
        domain: the dolfinx mesh
        V: its function space
        comm: MPI.COMM_SELF, or MPI.COMM_WORLD when the space is spread over all processes
        components: D; order: of the polynomials
        cells: (C, n) the blocks of each cell
        nodes: (B,) the node of our mesh behind each block of D degrees of freedom, -1 where it is none (order 2 on cells of first order)
        dofs: (N, D) the degrees of freedom of each node of our mesh; -1 for those of other processes
        owned: how many of the blocks are this process's own; degrees: of the quadrature of stiffness and mass
    """

    def __init__(self, mesh: Mesh, *, order: int = 1, components: int | None = None, spread: bool = False) -> None:
        dimension, own = mesh.dimension, CELLS[mesh.cell]
        kind, order = own.first or mesh.cell, 2 if own.first else order
        self.components, self.order = components or dimension, order
        D = self.components
        self.comm = MPI.COMM_WORLD if spread else MPI.COMM_SELF
        second = (2, 4) if kind in ("triangle", "tetrahedron") else (5, 5)
        self.degrees = (QUADRATURE_DEGREE[kind], MASS_DEGREE[kind]) if order == 1 else second
        cells, points = mesh.cells[:, FROM_GMSH[kind]], mesh.points
        if curved := order == 2 and is_curved(mesh):
            points, inside = further(mesh, _middles(kind))
            cells = np.concatenate([cells, inside], axis=1)
            self.degrees = (5, 7)
        points = points[:, :dimension]
        if self.comm.rank:  # the first process hands out the mesh
            cells, points = cells[:0], points[:0]
        cells, points = np.ascontiguousarray(cells), np.ascontiguousarray(points)
        if OLD:
            cell = ufl.Cell(kind, geometric_dimension=dimension)
            dolfinx_mesh._uflcell_to_dolfinxcell["prism"] = dolfinx_mesh.CellType.prism
            element = ufl.VectorElement("Lagrange", cell, 2 if curved else 1)
        else:
            element = basix.ufl.element("Lagrange", kind, 2 if curved else 1, shape=(dimension,))
        with _quiet():
            self.domain = dolfinx_mesh.create_mesh(self.comm, cells, points, ufl.Mesh(element))
        self.V = _lagrange(self.domain, order, D)
        geometry, blocks = self.domain.geometry.dofmap, self.V.dofmap.list
        if OLD:
            geometry = geometry.array.reshape(-1, cells.shape[1])
            blocks = blocks.array.reshape(len(geometry), -1)
        index_map = self.V.dofmap.index_map
        self.owned, self.cells = index_map.size_local, blocks
        corners = np.asarray(self.domain.geometry.input_global_indices)[geometry[:, :own.corners]]  # (cells, k) in dolfinx's order
        self._entities = _entities(corners, blocks, kind, self.V.dofmap.dof_layout) if order == 2 else {}
        first = blocks[:, : corners.shape[1]] if order == 1 else self._entities[1][0]
        self.nodes = np.full(self.owned + index_map.num_ghosts, -1, np.int64)
        self.nodes[first.ravel()] = corners.ravel() if order == 1 else self._entities[1][1].ravel()
        for k in self._entities.keys() - {1}:
            self.nodes[self._entities[k][0]] = middle_nodes(mesh, self._entities[k][1])
        self.dofs = np.full((len(mesh.points), D), -1, np.int64)
        ours = np.flatnonzero(self.nodes >= 0)
        self.dofs[self.nodes[ours]] = D * ours[:, None] + np.arange(D)

    def within(self, entities: Entities) -> NDArray[np.bool_]:
        """(B,) True on the blocks that lie on some vertices, edges, faces or cells of our mesh."""
        inside = np.zeros(len(self.dofs) + 1, bool)  # the last is for blocks that are no node
        inside[entities.get(1, np.empty((0, 1), np.int64)).ravel()] = True
        marked = inside[self.nodes]
        for k, (blocks, corners) in self._entities.items():
            if k > 1 and len(entities.get(k, ())):
                marked[blocks[rows_in(corners, entities[k])]] = True
        return marked

    def gather(self, vector: Floats) -> Floats:
        """(N, D) at the nodes of our mesh, on every process, from the degrees of freedom (owned D,) of each."""
        ours = np.flatnonzero(self.nodes[:self.owned] >= 0)
        field = np.zeros((len(self.dofs), self.components))
        for nodes, values in self.comm.allgather((self.nodes[ours], vector.reshape(-1, self.components)[ours])):
            field[nodes] = values
        return field

    def coordinates(self) -> Floats:
        """(owned, 3) where the blocks of this process lie [m]."""
        return self.V.tabulate_dof_coordinates()[:self.owned]

    def from_dofs(self, vector: Floats) -> Floats:
        """(D N,) in dolfinx's order -> (N, D) in ours; for one process, where every block is a node."""
        return vector[self.dofs]

    def to_dofs(self, field: Floats) -> Floats:
        """(N, D) in our order -> (D N,) in dolfinx's; for one process, where every block is a node."""
        return field[self.nodes].ravel()

    def constant(self, value: float) -> Any:
        """A number that may change without compiling the forms again."""
        return fem.Constant(self.domain, PETSc.ScalarType(value))

    def number(self, value: float | Floats) -> Any:
        """The same, or of a number for each cell of our mesh (C,) a function that is constant in each cell."""
        if not isinstance(value, np.ndarray):
            return self.constant(value)
        with _quiet():
            V = (fem.FunctionSpace if OLD else fem.functionspace)(self.domain, ("DG", 0))
            found = fem.Function(V)
        places = V.dofmap.list.array if OLD else V.dofmap.list.ravel()
        found.x.array[places] = value[np.asarray(self.domain.topology.original_cell_index)]
        return found


def _lagrange(domain: Any, order: int, components: int) -> Any:
    """dolfinx's space of scalars, or of vectors with a component for each dimension."""
    with _quiet():
        if OLD:
            return fem.FunctionSpace(domain, ("Lagrange", order)) if components == 1 else fem.VectorFunctionSpace(
                domain, ("Lagrange", order), dim=components)
        return fem.functionspace(domain, ("Lagrange", order) if components == 1 else ("Lagrange", order, (components,)))


def _entities(corners: NDArray[np.int64], blocks: Any, cell: str, layout: Any) -> dict[int, Any]:
    """For each number of corners k the blocks that lie inside of entities with k corners (n,), and these corners (n, k)."""
    topology = basix.topology(getattr(basix.CellType, cell))
    found: dict[int, list[Any]] = {}
    for dimension, entities in enumerate(topology):
        for i, local in enumerate(entities):
            for position in layout.entity_dofs(dimension, i):
                found.setdefault(len(local), []).append((blocks[:, position], corners[:, list(local)]))
    merged = {}
    for k, pairs in found.items():
        block, first = np.unique(np.concatenate([pair[0] for pair in pairs]), return_index=True)
        merged[k] = block, np.concatenate([pair[1] for pair in pairs])[first]
    return merged


def _middles(cell: str) -> list[tuple[int, ...]]:
    """The corners, as our mesh numbers them, of the edges, faces and cells inside of which a cell of second order has a node, in order."""
    element = basix.create_element(basix.ElementFamily.P, getattr(basix.CellType, cell), 2, basix.LagrangeVariant.equispaced)
    return [tuple(FROM_GMSH[cell][corner] for corner in local)
            for dimension, group in enumerate(basix.topology(getattr(basix.CellType, cell))) if dimension
            for i, local in enumerate(group) if len(element.entity_dofs[dimension][i])]


def matrix(form: Any) -> PETSc.Mat:
    """A UFL form of rank 2 as a matrix in dolfinx's order, nothing held."""
    compiled = compile_form(form)
    found = fem_petsc.create_matrix(compiled)
    found.zeroEntries()
    fem_petsc.assemble_matrix(found, compiled, bcs=[])
    found.assemble()
    return found


def mass_matrix(space: Space, density: float | Floats, like: PETSc.Mat) -> PETSc.Mat:
    """The consistent mass matrix of a space of vectors, with the sparsity of another matrix of that space.

    Each component has the mass matrix of the scalars, which is assembled once and spread: block (i, j) is m_ij times the
    identity. Where that cannot be done (several processes, or another numbering of the scalars) it is assembled whole.
    """
    dx = ufl.dx(metadata={"quadrature_degree": space.degrees[1]})
    D = space.components
    if space.comm.size == 1 and D > 1:
        scalars = _lagrange(space.domain, space.order, 1)
        lists = (V.dofmap.list.array if OLD else V.dofmap.list.ravel() for V in (scalars, space.V))
        if np.array_equal(*lists):
            u, v = ufl.TrialFunction(scalars), ufl.TestFunction(scalars)
            alone = matrix(space.number(density) * u * v * dx)
            rows, columns, values = alone.getValuesCSR()
            alone.destroy()
            starts, others, _ = like.getValuesCSR()
            if len(others) == D * D * len(columns):
                length = np.diff(rows)
                neighbour = np.arange(len(columns)) - np.repeat(rows[:-1], length)
                first = D * D * np.repeat(rows[:-1], length) + D * neighbour
                spread = np.zeros(len(others))
                for d in range(D):
                    spread[first + d * (D * np.repeat(length, length) + 1)] = values
                whole = like.duplicate()
                whole.setValuesCSR(starts, others, spread)
                whole.assemble()
                return whole
    u, v = ufl.TrialFunction(space.V), ufl.TestFunction(space.V)
    return matrix(space.number(density) * ufl.inner(u, v) * dx)


def release() -> None:
    """Free the memory of PETSc objects that are out of use; petsc4py only puts them aside (10 MB a scene of 1900 unknowns)."""
    gc.collect()
    PETSc.garbage_cleanup()
