"""Energy, forces and stiffness of all cells, as many at a time as the processor has lanes; and whether a path turns cells inside out.

    W_c = sum_p V_p W(F_p)        F_p = I + sum_a u_a (x) g_ap        (sample points p as element.py gives them)
    f_a = sum_p V_p P g_ap        P = dW/dF
    K_ab = sum_p V_p g_ap . A . g_bp        A = dP/dF

UFL differentiates W(F) and FFCx turns W, P and A into C code that works on one F, number by number. Nothing in it
depends on the cell but its arguments, so with every `double` that varies replaced by a pack of L the same code works on
L cells at once, and the compiler finds the wide instructions that it cannot find in the code for one. The sums over nodes
and the loops over cells stand in loops.cpp. Numbers agree with dolfinx's assembly to rounding. Energies are found with the
forces, with which they have most in common. Where threads are allowed (threads.py) they share the cells of a body that is
large enough, with the same bits for any number of them.

Legend: N nodes, C cells, n nodes of a cell, P sample points of a cell, d = 3 n, L lanes: 8 with AVX-512, 4 with AVX, else 2.
"""

from __future__ import annotations

import ctypes
import re
from functools import cache
from itertools import pairwise
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import ufl
from numpy.typing import NDArray

from physics import fem
from physics.body.element import Samples
from physics.body.material import law_of
from physics.linalg.native import aligned, compiled, pointer
from physics.mesh.mesh import Mesh
from physics.mesh.quality import rest_jacobians, slopes

Floats = NDArray[np.float64]

PACK, LOOPS = ((Path(__file__).parent / name).read_text() for name in ("pack.cpp", "loops.cpp"))
SHARED = 40_000  # sample points from which on several threads share the forces: some 4 k nodes
AT_ONCE = 4  # cells whose det F is found together


class Kernel:
    """The sample points of one mesh, ready for a law. Every call adds to, or fills, the array that it returns."""

    def __init__(self, law: str, cells: NDArray[np.int64], samples: Samples, *, sheet: bool = False, threads: int = 1) -> None:
        """Args: law of material.py; cells (C, n); sheet: no stress across it, along z. Raises `InputError` for an unknown law."""
        law_of(law)
        self.cells = np.ascontiguousarray(cells, np.int32)
        self._library, self._parts = _library(law, self.cells.shape[1], len(samples.volumes), sheet), samples.parts
        lanes = ctypes.c_int64.in_dll(self._library, "lanes").value
        self._table = _packs(samples, lanes)
        self._mesh = ctypes.c_int64(len(self.cells)), pointer(self.cells), pointer(self._table)
        self._numbered, self._late, starts = _shared(self.cells, lanes, threads)
        self._ranges = [(first, (ctypes.c_int64(last - first), pointer(self._numbered[first:]), pointer(self._table[first // lanes:])))
                        for first, last in pairwise(starts)]

    def energies(self, u: Floats, lame: tuple[float, float]) -> Floats:
        """(C,) [J] at displacements (N, 3) [m], for Lame's parameters (lambda, mu) [Pa]."""
        found = np.empty(len(self.cells))
        self.forces(u, lame, energies=found)
        return found

    def forces(self, u: Floats, lame: tuple[float, float], out: Floats | None = None, energies: Floats | None = None) -> Floats:
        """(N, 3) internal nodal forces [N], added to others where there are some; on the way (C,) energies [J], if they are wanted."""
        out = np.zeros(u.shape) if out is None else out
        energies = np.empty(len(self.cells)) if energies is None else energies
        if len(self._ranges) == 1:
            return self._run("forces", u, lame, out, pointer(energies))
        constants, late = self._parts * lame, len(self._late)
        moved, found = np.concatenate([u[self._late], u]), np.concatenate([np.full((late, 3), -0.0), out])  # -0 + f is f
        given = pointer(constants), pointer(moved), pointer(found)
        jobs = [Thread(target=self._library.forces, args=(*each, *given, pointer(energies[first:]))) for first, each in self._ranges]
        for job in jobs[1:]:
            job.start()
        jobs[0].run()
        for job in jobs[1:]:
            job.join()
        out[:] = found[late:]
        np.add.at(out.reshape(-1), (3 * self._late[:, None] + np.arange(3)).ravel(), found[:late].ravel())
        return out

    def add_stiffness(self, u: Floats, lame: tuple[float, float], slot: NDArray[np.int32], out: NDArray[Any]) -> None:
        """Add the upper half of each cell's tangent stiffness, row by row, to out[slot], slot (C, d (d + 1) / 2).

        out: of single or double precision
        """
        assert slot.shape[1] == 3 * self.cells.shape[1] * (3 * self.cells.shape[1] + 1) // 2
        self._run("stiffnesses" if out.dtype == np.float64 else "stiffnesses_single", u, lame, out, pointer(slot))

    def _run(self, name: str, u: Floats, lame: tuple[float, float], out: Floats, *more: ctypes.c_void_p) -> Floats:
        u, constants = np.ascontiguousarray(u), self._parts * lame
        getattr(self._library, name)(*self._mesh, pointer(constants), pointer(u), pointer(out), *more)
        return out


def _packs(samples: Samples, lanes: int) -> Floats:
    """(packs, P, d + 1, L) gradients and volumes of L cells side by side, on an address that is a multiple of 64."""
    points, cells = samples.volumes.shape
    values = np.concatenate([samples.gradients.reshape(points, cells, -1), samples.volumes[:, :, None]], axis=2)
    values = np.pad(values, ((0, 0), (0, -cells % lanes), (0, 0)))
    values = values.reshape(points, -1, lanes, values.shape[2]).transpose(1, 0, 3, 2)
    packs = aligned(values.size).reshape(values.shape)
    packs[:] = values
    return packs


def _shared(cells: NDArray[np.int32], lanes: int, threads: int) -> tuple[NDArray[np.int32], NDArray[np.int32], list[int]]:
    """Cells (C, n) in one range for each thread, so that none adds to what another one adds to, and all sums are in the order of the cells.

    Returns:
        cells (C, n) in another numbering of the nodes: where an earlier range has the same node, each place has a number of its own,
            from 0; the other nodes follow in their order
        nodes (M,) at these places; where each range begins, and the end
    """
    packs = -(-len(cells) // lanes)
    starts = [*(packs * thread // threads * lanes for thread in range(threads)), len(cells)]
    late, seen = np.zeros(cells.shape, bool), np.zeros(int(cells.max(initial=0)) + 1, bool)
    for first, last in pairwise(starts):
        late[first:last] = seen[cells[first:last]]
        seen[cells[first:last]] = True
    nodes = cells[late]
    numbered = cells + np.int32(len(nodes))
    numbered[late] = np.arange(len(nodes))
    return numbered, nodes, starts


def _packed(name: str, form: Any) -> str:
    """FFCx's function with packs for all numbers that vary from cell to cell; tables and constants of the form stay numbers."""
    function = fem.cell_function(form)
    head = (f"static inline void {name}(pack *__restrict A, const pack *__restrict w, const double *__restrict c,\n"
            "    const double *__restrict coordinate_dofs, const int *, const uint8_t *)\n")
    return head + re.sub(r"(?<!static const )\bdouble\b", "pack", function[function.index("{"):]) + "\n"


def energy_density(law: str, F: Any, lmbda: Any, mu: Any) -> Any:
    """W(F) of a law of material.py in UFL."""
    known = law_of(law)
    if known.invariants == "stretch":
        return known.energy(ufl.inner(F, F), ufl.det(F), lmbda, mu, ufl.ln)
    strain = (F.T * F - ufl.Identity(3)) / 2 if known.invariants == "strain" else (F + F.T) / 2 - ufl.Identity(3)
    return known.energy(ufl.tr(strain), ufl.inner(strain, strain), lmbda, mu, ufl.ln)


@cache
def _library(law: str, nodes: int, points: int, sheet: bool) -> ctypes.CDLL:
    """The compiled loops."""
    domain, tensors = fem.tensors()
    F, S, T = ufl.Coefficient(tensors), ufl.TestFunction(tensors), ufl.TrialFunction(tensors)
    energy = energy_density(law, F, ufl.Constant(domain), ufl.Constant(domain)) * ufl.dx(metadata={"quadrature_degree": 0})
    loops = f"#define NODES {nodes}\n#define POINTS {points}\n" + "#define SHEET\n" * sheet + LOOPS

    def source() -> str:
        stress = ufl.derivative(energy, F, S)
        forms = {"energy": energy, "stress": stress, "tangent": ufl.derivative(stress, F, T)}
        return PACK + "".join(_packed(*form) for form in forms.items()) + loops

    loaded = compiled(source, fem.FFCX_VERSION, energy.signature(), PACK, loops)
    for name in ("forces", "stiffnesses", "stiffnesses_single"):
        getattr(loaded, name).restype = None
    return loaded


def smallest_det_f(mesh: Mesh, displacement: Floats) -> Floats:
    """(T,) smallest det F of a mesh that is sound at rest, at displacements (T, N, 3) [m] without a nan.

    What `mesh.quality.det_f` finds without a compiler, in a third of its time for all frames of a path.
    """
    rest, u = rest_jacobians(mesh.points, mesh.cells, mesh.cell), np.ascontiguousarray(displacement, float)
    more = -len(mesh.cells) % AT_ONCE
    packs = np.pad(rest, ((0, 0), (0, more)), constant_values=np.nan).reshape(len(rest), -1, AT_ONCE).transpose(1, 0, 2).copy()
    cells = np.pad(mesh.cells, ((0, more), (0, 0))).astype(np.int32)
    points, slope, found = np.ascontiguousarray(mesh.points), np.ascontiguousarray(slopes(mesh.cell)), np.empty(len(u))
    sizes = map(ctypes.c_int64, (len(u), len(points), len(packs), len(slope)))
    arrays = (pointer(array) for array in (cells, points, u, slope, packs, found))
    _inversion(cells.shape[1], mesh.dimension == 2).smallest(*sizes, *arrays)
    return found


@cache
def _inversion(nodes: int, plane: bool) -> ctypes.CDLL:
    source = (Path(__file__).parent / "inversion.cpp").read_text()
    return compiled(f"#define NODES {nodes}\n#define PLANE {int(plane)}\n#define AT_ONCE {AT_ONCE}\n{source}", rounded=True)
