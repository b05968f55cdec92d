"""The kernel of a form for eight cells at a time.

FFCx turns a form into C code that works on one cell, number by number. Nothing in it depends on the cell but its
arguments, so with every `double` that varies replaced by a pack of eight the same code works on eight cells at once, and
the compiler finds the wide instructions that it cannot find in the code for one. The loops over cells, gathering
positions and displacements and adding up the results, stand below in C++ as well. Numbers agree with dolfinx's assembly to
rounding.

Legend: N nodes, C cells, n nodes of a cell (in dolfinx's order), d = 3 n.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import re
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics import fem

Floats = NDArray[np.float64]

PACK = r"""
#include <cmath>
#include <cstdint>
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
enum { n = %(nodes)d, d = 3 * n, size = %(size)d };
static inline void gather(const int32_t *cell, int64_t left, const double *from, pack *to) {
  for (int a = 0; a < n; ++a)
    for (int l = 0; l < 8; ++l) {
      const double *p = from + 3 * int64_t(cell[(l < left ? l : 0) * n + a]);
      for (int k = 0; k < 3; ++k) to[3 * a + k].x[l] = p[k];
    }
}
/* The packs of eight cells from `first`; the last pack repeats a cell, whose results are not used. */
#define OVER_CELLS(use) \
  for (int64_t first = 0; first < cells; first += 8) { \
    const int64_t left = cells - first < 8 ? cells - first : 8; \
    const int32_t *cell = nodes + first * n; \
    pack x[d], w[d], A[size]; \
    gather(cell, left, points, x); \
    gather(cell, left, u, w); \
    for (int i = 0; i < size; ++i) A[i] = 0.0; \
    kernel(A, w, c, x, nullptr, nullptr); \
    for (int l = 0; l < left; ++l) { use } \
  }
extern "C" void run(int64_t cells, const int32_t *nodes, const double *points, const double *u, const double *c,
                    const int32_t *slot, double *out) {
#if %(rank)d == 0
  (void)slot;
  OVER_CELLS(out[first + l] = A[0].x[l];)
#elif %(rank)d == 1
  (void)slot;
  OVER_CELLS(for (int a = 0; a < n; ++a) for (int k = 0; k < 3; ++k) out[3 * int64_t(cell[l * n + a]) + k] += A[3 * a + k].x[l];)
#else
  OVER_CELLS(const int32_t *s = slot + (first + l) * size; for (int i = 0; i < size; ++i) out[s[i]] += A[i].x[l];)
#endif
}
"""


class Kernel:
    """One form for one type of cell, compiled for this processor; its only coefficient is a vector field of first order."""

    def __init__(self, form: Any, nodes: int) -> None:
        """Args: form of rank 0, 1 or 2; nodes of a cell."""
        rank = len(form.arguments())
        loops = LOOPS % {"nodes": nodes, "size": (3 * nodes) ** rank, "rank": rank}
        self._run = _library(form, loops).run
        self._run.restype = None

    def __call__(self, cells: NDArray[np.int32], points: Floats, u: Floats, constants: Floats, out: Floats,
                 slot: NDArray[np.int32] | None = None) -> Floats:
        """Rank 0: the value of each cell into out (C,). Rank 1: added to out (N, 3). Rank 2: added to out[slot (C, d * d)].

        Args:
            cells: (C, n) in dolfinx's order of nodes
            points, u: (N, 3)
            constants: in the order in which they were made
        """
        u = np.ascontiguousarray(u)
        self._run(ctypes.c_int64(len(cells)), *(_pointer(a) for a in (cells, points, u, constants)),
                  _pointer(slot) if slot is not None else None, _pointer(out))
        return out


def _pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)


def _packed(function: str) -> str:
    """The function with packs for all numbers that vary from cell to cell; tables and constants of the form stay numbers."""
    body = function.index("{")
    head = ("static inline void kernel(pack *__restrict A, const pack *__restrict w, const double *__restrict c,\n"
            "    const pack *__restrict coordinate_dofs, const int *, const uint8_t *)\n")
    return head + re.sub(r"(?<!static const )\bdouble\b", "pack", function[body:])


def _library(form: Any, loops: str) -> ctypes.CDLL:
    """The compiled kernel of a form."""
    return compiled(lambda: PACK + _packed(fem.cell_function(form)) + loops, fem.FFCX_VERSION, form.signature(), PACK, loops)


def compiled(source: Callable[[], str] | str, *key: str) -> ctypes.CDLL:
    """C++ source compiled for this processor, from the cache or into it; a source that is costly to write needs a key."""
    folder = fem.cache_folder()
    folder.mkdir(parents=True, exist_ok=True)
    name = hashlib.sha256("\n".join([*fem.COMPILE, *(key or (str(source),))]).encode()).hexdigest()[:32]
    library = folder / f"kernel_{name}.so"
    if not library.exists():
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            (Path(scratch) / "kernel.cpp").write_text(source if isinstance(source, str) else source())
            command = ["g++", *fem.COMPILE, "-shared", "-fPIC", "-Wno-psabi", "-o", "kernel.so", "kernel.cpp"]
            made = subprocess.run(command, cwd=scratch, capture_output=True, text=True)
            if made.returncode:
                raise RuntimeError(f"g++ could not compile a kernel: {made.stderr.strip().splitlines()[0]}")
            os.replace(Path(scratch) / "kernel.so", library)  # whole or not at all, whoever else is compiling the same
    return ctypes.CDLL(str(library))
