"""The one place that knows which dolfinx is installed: 0.5.2 (Debian 12) or 0.9.0 (Debian 13).

Outside of this file a vector field is an array (N, 3) over the nodes of our mesh. dolfinx renumbers both nodes and
cells; `Space` holds the way there and back. Every process works for itself (MPI.COMM_SELF).
"""

from __future__ import annotations

import gc
import hashlib
import logging
import platform
from pathlib import Path
from typing import Any

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

from physics.mesh import Mesh

Floats = NDArray[np.float64]
# A crash shall be a crash: PETSc's handler of signals may wait forever for a lock that the crash left behind.
PETSc.Sys.popSignalHandler()

FFCX_VERSION = ffcx.__version__
OLD = tuple(int(part) for part in __version__.split(".")[:2]) < (0, 8)

# dolfinx lists the corners of a hexahedron as a tensor product, gmsh and VTK go round each face.
FROM_GMSH = {"tetrahedron": [0, 1, 2, 3], "hexahedron": [0, 1, 3, 2, 4, 5, 7, 6], "prism": [0, 1, 2, 3, 4, 5]}
# One point a prism would let hourglass modes through; two degrees integrate the stiffness of straight cells well.
QUADRATURE_DEGREE = {"tetrahedron": 1, "hexahedron": 3, "prism": 2}
# dolfinx's rule of degree 2 for prisms has eight points; three on the triangle times Gauss's two do the same with six.
PRISM_POINTS = np.array([(r, s, t) for t in (0.5 - 12**-0.5, 0.5 + 12**-0.5) for r, s in ((1/6, 1/6), (2/3, 1/6), (1/6, 2/3))])
PRISM_WEIGHTS = np.full(6, 1 / 12)
MASS_DEGREE = {"tetrahedron": 2, "hexahedron": 4, "prism": 4}
COMPILE = ["-O3", "-march=native", "-ffast-math", "-fno-finite-math-only"]


def quadrature(cell: str) -> dict[str, Any]:
    """UFL's metadata for the integrals of energy, force and stiffness."""
    if cell != "prism":
        return {"quadrature_degree": QUADRATURE_DEGREE[cell]}
    logging.getLogger("UFL").setLevel(logging.ERROR)  # it is not sure that arrays can be metadata; FFCx reads them there
    return {"quadrature_degree": QUADRATURE_DEGREE[cell], "quadrature_rule": "custom", "quadrature_points": PRISM_POINTS,
            "quadrature_weights": PRISM_WEIGHTS}


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
    logging.disable(logging.INFO)  # the compiler's command lines
    try:
        return fem.form(form, jit_params=options) if OLD else fem.form(form, jit_options=options)
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


def symbols(cell: str) -> tuple[Any, Any]:
    """UFL's mesh and space of first-order vector fields on any mesh of one type of cell: what forms are written with."""
    if OLD:
        element = ufl.VectorElement("Lagrange", ufl.Cell(cell, geometric_dimension=3), 1)
    else:
        import basix.ufl

        element = basix.ufl.element("Lagrange", cell, 1, shape=(3,))
    domain = ufl.Mesh(element)
    return domain, ufl.FunctionSpace(domain, element)


class Space:
    """First-order Lagrange vector fields on a mesh.

    Attributes:
        domain: the dolfinx mesh
        V: its function space
        nodes: (N,) the node of our mesh behind each block of three degrees of freedom
        dofs: (N, 3) the degrees of freedom of each node of our mesh
    """

    def __init__(self, mesh: Mesh) -> None:
        cell = ufl.Cell(mesh.cell, geometric_dimension=3) if OLD else ufl.Cell(mesh.cell)
        cells = mesh.cells[:, FROM_GMSH[mesh.cell]]
        if OLD:
            dolfinx_mesh._uflcell_to_dolfinxcell["prism"] = dolfinx_mesh.CellType.prism
            element = ufl.VectorElement("Lagrange", cell, 1)
            self.domain = dolfinx_mesh.create_mesh(MPI.COMM_SELF, cells, mesh.points, ufl.Mesh(element))
            self.V = fem.VectorFunctionSpace(self.domain, ("Lagrange", 1))
            geometry = self.domain.geometry.dofmap.array.reshape(cells.shape)
        else:
            import basix.ufl

            element = basix.ufl.element("Lagrange", mesh.cell, 1, shape=(3,))
            self.domain = dolfinx_mesh.create_mesh(MPI.COMM_SELF, cells, mesh.points, ufl.Mesh(element))
            self.V = fem.functionspace(self.domain, ("Lagrange", 1, (3,)))
            geometry = self.domain.geometry.dofmap
        blocks = np.array([self.V.dofmap.cell_dofs(c) for c in range(len(cells))])
        self.nodes = np.empty(len(mesh.points), np.int64)
        self.nodes[blocks.ravel()] = np.asarray(self.domain.geometry.input_global_indices)[geometry.ravel()]
        self.dofs = 3 * np.argsort(self.nodes)[:, None] + np.arange(3)

    def from_dofs(self, vector: Floats) -> Floats:
        """(3 N,) in dolfinx's order -> (N, 3) in ours."""
        return vector[self.dofs]

    def to_dofs(self, field: Floats) -> Floats:
        """(N, 3) in our order -> (3 N,) in dolfinx's."""
        return field[self.nodes].ravel()

    def function(self) -> Any:
        """A new dolfinx function, zero everywhere."""
        return fem.Function(self.V)

    def constant(self, value: float) -> Any:
        """A number that may change without compiling the forms again."""
        return fem.Constant(self.domain, PETSc.ScalarType(value))


def set_function(function: Any, values: Floats) -> None:
    """Give a dolfinx function its degrees of freedom (3 N,)."""
    function.x.array[:] = values


def assemble_scalar(form: Any) -> float:
    """The value of a compiled form of rank 0."""
    return float(fem.assemble_scalar(form))


def assemble_vector(form: Any, out: Floats) -> Floats:
    """A compiled form of rank 1 assembled into an array (3 N,) in dolfinx's order."""
    out[:] = 0.0
    fem.assemble_vector(out, form)
    return out


def create_matrix(form: Any) -> PETSc.Mat:
    """An empty matrix with the sparsity of a compiled form of rank 2."""
    return fem_petsc.create_matrix(form)


def assemble_matrix(matrix: PETSc.Mat, form: Any, fixed: list[Any]) -> PETSc.Mat:
    """A compiled form of rank 2 assembled into a matrix; fixed rows and columns become those of the identity."""
    matrix.zeroEntries()
    fem_petsc.assemble_matrix(matrix, form, bcs=fixed)
    matrix.assemble()
    return matrix


def fix(space: Space, fixed: NDArray[np.bool_]) -> list[Any]:
    """Dirichlet conditions for `assemble_matrix` from a mask (N, 3) of held components."""
    dofs = np.sort(space.dofs[fixed]).astype(np.int32)
    if not len(dofs):
        return []
    zero = fem.Function(space.V)
    if fixed[fixed.any(axis=1)].all():
        return [fem.dirichletbc(zero, dofs[::3] // 3)]
    return [fem.dirichletbc(PETSc.ScalarType(0), dofs[dofs % 3 == i], space.V.sub(i)) for i in range(3)]


def release() -> None:
    """Free the memory of PETSc objects that are out of use; petsc4py only puts them aside (10 MB a scene of 1900 unknowns)."""
    gc.collect()
    PETSc.garbage_cleanup()
