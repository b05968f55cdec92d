"""Energy, forces and stiffness of all cells, eight at a time.

    W_c = sum_p V_p W(F_p)        F_p = I + sum_a u_a (x) g_ap        (sample points p as element.py gives them)
    f_a = sum_p V_p P g_ap        P = dW/dF
    K_ab = sum_p V_p g_ap . A . g_bp        A = dP/dF

UFL differentiates W(F) and FFCx turns W, P and A into C code that works on one F, number by number. Nothing in it
depends on the cell but its arguments, so with every `double` that varies replaced by a pack of eight the same code works on
eight cells at once, and the compiler finds the wide instructions that it cannot find in the code for one. The sums over nodes
and the loops over cells stand below in C++. Numbers agree with dolfinx's assembly to rounding.

Legend: N nodes, C cells, n nodes of a cell, P sample points of a cell, d = 3 n.
"""

from __future__ import annotations

import ctypes
import re
from functools import cache
from typing import Any

import numpy as np
import ufl
from numpy.typing import NDArray

from physics import fem
from physics.body.element import Samples
from physics.body.material import LAWS
from physics.linalg.native import compiled, pointer

Floats = NDArray[np.float64]

PACK = r"""
#include <cmath>
#include <cstdint>
#ifdef __x86_64__  /* libmvec has these for eight numbers at once; glibc's header says so only where nan is ruled out */
extern "C" __attribute__((simd("notinbranch"))) double log(double) noexcept;
extern "C" __attribute__((simd("notinbranch"))) double exp(double) noexcept;
#endif
typedef double v8 __attribute__((vector_size(64)));
struct pack {
  v8 x;
  pack() = default;
  pack(double s) : x(s - v8{}) {}
  pack(v8 y) : x(y) {}
  pack &operator+=(pack b) { x += b.x; return *this; }
};
static inline pack operator+(pack a, pack b) { return a.x + b.x; }
static inline pack operator-(pack a, pack b) { return a.x - b.x; }
static inline pack operator*(pack a, pack b) { return a.x * b.x; }
static inline pack operator/(pack a, pack b) { return a.x / b.x; }
static inline pack operator-(pack a) { return -a.x; }
#define EACH(name, expression) \
  static inline pack name(pack a) { pack r; for (int l = 0; l < 8; ++l) { double s = a.x[l]; r.x[l] = expression; } return r; }
EACH(log, std::log(s)) EACH(exp, std::exp(s)) EACH(sqrt, std::sqrt(s)) EACH(fabs, std::fabs(s))
static inline pack pow(pack a, double e) {
  if (e == 2) return a * a;
  if (e == -1) return 1.0 / a;
  return exp(e * log(a));
}
"""

LOOPS = r"""
enum { n = %(nodes)d, P = %(points)d, d = 3 * n, row = d + 1 };
/* A tetrahedron of volume 1: FFCx multiplies by it. */
static const double unit[12] = {0, 0, 0, 6, 0, 0, 0, 1, 0, 0, 0, 1};
static inline void gather(const int32_t *cell, int64_t left, const double *u, pack *to) {
  for (int a = 0; a < n; ++a)
    for (int l = 0; l < 8; ++l) {
      const double *p = u + 3 * int64_t(cell[(l < left ? l : 0) * n + a]);
      for (int k = 0; k < 3; ++k) to[3 * a + k].x[l] = p[k];
    }
}
/* A function of F, given the gradients of one sample point. */
template <class Law> static inline void at(Law law, const pack *u, const pack *g, const double *c, int size, pack *out) {
  pack F[9];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      F[3 * i + j] = double(i == j);
      for (int a = 0; a < n; ++a) F[3 * i + j] += u[3 * a + i] * g[3 * a + j];
    }
  for (int i = 0; i < size; ++i) out[i] = 0.0;
  law(out, F, c, unit, nullptr, nullptr);
}
/* The packs of eight cells from `first`; the last one repeats a cell, whose results are not used. */
#define OVER_CELLS \
  for (int64_t first = 0; first < cells; first += 8, table += P * row) { \
    const int64_t left = cells - first < 8 ? cells - first : 8; \
    const int32_t *cell = nodes + first * n; \
    pack x[d]; \
    gather(cell, left, u, x);
#define OVER_POINTS \
    for (int p = 0; p < P; ++p) { \
      const pack *g = table + p * row, V = g[d]; \
      const double *lame = constants + 2 * p;
extern "C" void energies(int64_t cells, const int32_t *nodes, const pack *table, const double *constants, const double *u,
                         double *out) {
  OVER_CELLS
    pack sum = 0.0;
    OVER_POINTS
      pack W;
      at(energy, x, g, lame, 1, &W);
      sum += V * W;
    }
    for (int l = 0; l < left; ++l) out[first + l] = sum.x[l];
  }
}
extern "C" void forces(int64_t cells, const int32_t *nodes, const pack *table, const double *constants, const double *u,
                       double *out) {
  OVER_CELLS
    pack f[d];
    for (int i = 0; i < d; ++i) f[i] = 0.0;
    OVER_POINTS
      pack S[9];
      at(stress, x, g, lame, 9, S);
      for (int i = 0; i < 9; ++i) S[i] = V * S[i];
      for (int a = 0; a < n; ++a)
        for (int i = 0; i < 3; ++i)
          for (int j = 0; j < 3; ++j) f[3 * a + i] += S[3 * i + j] * g[3 * a + j];
    }
    for (int l = 0; l < left; ++l)
      for (int a = 0; a < n; ++a)
        for (int k = 0; k < 3; ++k) out[3 * int64_t(cell[l * n + a]) + k] += f[3 * a + k].x[l];
  }
}
extern "C" void stiffnesses(int64_t cells, const int32_t *nodes, const pack *table, const double *constants, const double *u,
                            double *out, const int32_t *slot) {
  OVER_CELLS
    pack K[d * d];
    for (int i = 0; i < d * d; ++i) K[i] = 0.0;
    OVER_POINTS
      pack A[81];
      at(tangent, x, g, lame, 81, A);
      for (int a = 0; a < n; ++a) {
        pack G[3], T[27];
        for (int j = 0; j < 3; ++j) G[j] = V * g[3 * a + j];
        for (int i = 0; i < 3; ++i)
          for (int m = 0; m < 9; ++m) T[9 * i + m] = G[0] * A[27 * i + m] + G[1] * A[27 * i + 9 + m] + G[2] * A[27 * i + 18 + m];
        for (int b = a; b < n; ++b)
          for (int i = 0; i < 3; ++i)
            for (int k = 0; k < 3; ++k) {
              const pack *t = T + 9 * i + 3 * k, *h = g + 3 * b;
              K[(3 * a + i) * d + 3 * b + k] += t[0] * h[0] + t[1] * h[1] + t[2] * h[2];
            }
      }
    }
    const int32_t *s = slot + first * (d * (d + 1) / 2);
    for (int l = 0; l < left; ++l)
      for (int i = 0; i < d; ++i)
        for (int j = i; j < d; ++j) out[*s++] += K[d * i + j].x[l];
  }
}
"""


class Kernel:
    """The sample points of one mesh, ready for a law. Every call adds to, or fills, the array that it returns."""

    def __init__(self, law: str, cells: NDArray[np.int64], samples: Samples) -> None:
        """Args: law of material.py; cells (C, n)."""
        self.cells = np.ascontiguousarray(cells, np.int32)
        self._table, self._parts = _packs(samples), samples.parts
        self._library = _library(law, self.cells.shape[1], len(samples.volumes))

    def energies(self, u: Floats, lame: tuple[float, float]) -> Floats:
        """(C,) [J] at displacements (N, 3) [m], for Lame's parameters (lambda, mu) [Pa]."""
        return self._run("energies", u, lame, np.empty(len(self.cells)))

    def forces(self, u: Floats, lame: tuple[float, float]) -> Floats:
        """(N, 3) internal nodal forces [N]."""
        return self._run("forces", u, lame, np.zeros(u.shape))

    def add_stiffness(self, u: Floats, lame: tuple[float, float], slot: NDArray[np.int32], out: Floats) -> None:
        """Add the upper half of each cell's tangent stiffness, row by row, to out[slot], slot (C, d (d + 1) / 2)."""
        assert slot.shape[1] == 3 * self.cells.shape[1] * (3 * self.cells.shape[1] + 1) // 2
        self._run("stiffnesses", u, lame, out, pointer(slot))

    def _run(self, name: str, u: Floats, lame: tuple[float, float], out: Floats, *more: ctypes.c_void_p) -> Floats:
        u, constants = np.ascontiguousarray(u), self._parts * lame
        getattr(self._library, name)(ctypes.c_int64(len(self.cells)), *(pointer(a) for a in (self.cells, self._table, constants, u, out)),
                                     *more)
        return out


def _packs(samples: Samples) -> Floats:
    """(packs, P, d + 1, 8) gradients and volumes of eight cells side by side, on an address that is a multiple of 64."""
    points, cells = samples.volumes.shape
    values = np.concatenate([samples.gradients.reshape(points, cells, -1), samples.volumes[:, :, None]], axis=2)
    values = np.pad(values, ((0, 0), (0, -cells % 8), (0, 0)))
    values = values.reshape(points, -1, 8, values.shape[2]).transpose(1, 0, 3, 2)
    room = np.empty(values.size + 8)
    start = -room.ctypes.data // 8 % 8
    packs = room[start:start + values.size].reshape(values.shape)
    packs[:] = values
    return packs


def _packed(name: str, form: Any) -> str:
    """FFCx's function with packs for all numbers that vary from cell to cell; tables and constants of the form stay numbers."""
    function = fem.cell_function(form)
    head = (f"static inline void {name}(pack *__restrict A, const pack *__restrict w, const double *__restrict c,\n"
            "    const double *__restrict coordinate_dofs, const int *, const uint8_t *)\n")
    return head + re.sub(r"(?<!static const )\bdouble\b", "pack", function[function.index("{"):]) + "\n"


@cache
def _library(law: str, nodes: int, points: int) -> ctypes.CDLL:
    """The compiled loops."""
    domain, tensors = fem.tensors()
    F, S, T = ufl.Coefficient(tensors), ufl.TestFunction(tensors), ufl.TrialFunction(tensors)
    energy = LAWS[law](F, ufl.Constant(domain), ufl.Constant(domain)) * ufl.dx(metadata={"quadrature_degree": 0})
    loops = LOOPS % {"nodes": nodes, "points": points}

    def source() -> str:
        stress = ufl.derivative(energy, F, S)
        forms = {"energy": energy, "stress": stress, "tangent": ufl.derivative(stress, F, T)}
        return PACK + "".join(_packed(*form) for form in forms.items()) + loops

    loaded = compiled(source, fem.FFCX_VERSION, energy.signature(), PACK, loops)
    for name in ("energies", "forces", "stiffnesses"):
        getattr(loaded, name).restype = None
    return loaded
