/* The multifrontal Cholesky factor of a dissected mesh, and its triangular solves; dissection.py says what the tables hold. */
#include <cstdint>
#include <cstring>
typedef int64_t I;
struct Part { I s, b, panel, first, boundary, child, last, made, kept; };
typedef void (*Potrf)(const char *, const int *, double *, const int *, int *);
typedef void (*Trsm)(const char *, const char *, const char *, const char *, const int *, const int *, const double *, const double *,
                     const int *, double *, const int *);
typedef void (*Syrk)(const char *, const char *, const int *, const int *, const double *, const double *, const int *, const double *,
                     double *, const int *);
typedef void (*Gemm)(const char *, const char *, const int *, const int *, const int *, const double *, const double *, const int *,
                     const double *, const int *, const double *, double *, const int *);
typedef void (*Trsv)(const char *, const char *, const char *, const int *, const double *, const int *, double *, const int *);
typedef void (*Gemv)(const char *, const int *, const int *, const double *, const double *, const int *, const double *, const int *,
                     const double *, double *, const int *);
static const double one = 1, none = 0, minus = -1;
static const int unit = 1;

/* With W unknowns a node: panels (s + b, s), by columns, hold K's lower entries and become L's; 1 + the part without a factor, or 0. */
template <int W> static I factored(I parts, const Part *part, const I *children, const int32_t *place, double *panels, double *work,
                                   Potrf potrf, Trsm trsm, Syrk syrk) {
  for (I t = 0; t < parts; ++t) {
    const Part p = part[t];
    const int s = p.s, b = p.b, f = s + b;
    double *F = panels + p.panel, *U = work + p.made;
    memset(U, 0, sizeof(double) * b * b);
    for (I i = p.child; i < p.last; ++i) {
      const Part c = part[children[i]];
      const int32_t *at = place + c.boundary;  /* where its boundary nodes stand in this part */
      const double *from = work + c.kept;
      for (I j = 0; j < c.b / W; ++j)
        for (int k = 0; k < W; ++k, from += c.b) {
          const I column = W * I(at[j]) + k;
          double *to = column < s ? F + column * f : U + (column - s) * b - s;
          for (int d = k; d < W; ++d) to[W * I(at[j]) + d] += from[W * j + d];
          for (I r = j + 1; r < c.b / W; ++r)
            for (int d = 0; d < W; ++d) to[W * I(at[r]) + d] += from[W * r + d];
        }
    }
    int info = 0;
    if (s) potrf("L", &s, F, &f, &info);
    if (info) return t + 1;
    if (!b) continue;
    if (s) {
      trsm("R", "L", "T", "N", &b, &s, &one, F, &f, F + s, &f);
      syrk("L", "N", &b, &s, &minus, F + s, &f, &one, U, &b);
    }
    memmove(work + p.kept, U, sizeof(double) * b * b);
  }
  return 0;
}

/* The same for 3 or 1 unknowns a node. */
extern "C" I factor(int each, I parts, const Part *part, const I *children, const int32_t *place, double *panels, double *work,
                    Potrf potrf, Trsm trsm, Syrk syrk) {
  return (each == 3 ? factored<3> : factored<1>)(parts, part, children, place, panels, work, potrf, trsm, syrk);
}

/* X := L^-1 X for k right-hand sides, each unknown's k numbers together; `row` says where each node's unknowns stand. */
extern "C" void forward(I count, const I *chosen, const Part *part, const int32_t *boundary, const I *row, int k, const double *panels,
                        double *X, double *scratch, Trsm trsm, Gemm gemm, Trsv trsv, Gemv gemv) {
  for (I i = 0; i < count; ++i) {
    const Part p = part[chosen[i]];
    const int s = p.s, b = p.b, f = s + b;
    const double *F = panels + p.panel;
    double *x = X + 3 * k * row[p.first];
    if (k == 1) trsv("L", "N", "N", &s, F, &f, x, &unit);
    else trsm("R", "L", "T", "N", &k, &s, &one, F, &f, x, &k);
    if (!b) continue;
    if (k == 1) gemv("N", &b, &s, &one, F + s, &f, x, &unit, &none, scratch, &unit);
    else gemm("N", "T", &k, &b, &s, &one, x, &k, F + s, &f, &none, scratch, &k);
    for (I j = 0; j < b / 3; ++j) {
      double *to = X + 3 * k * row[boundary[p.boundary + j]];
      for (I d = 0; d < 3 * k; ++d) to[d] -= scratch[3 * k * j + d];
    }
  }
}

/* x := L^-T x for one right-hand side. */
extern "C" void backward(I parts, const Part *part, const int32_t *boundary, const double *panels, double *x, double *scratch, Trsv trsv,
                         Gemv gemv) {
  for (I t = parts - 1; t >= 0; --t) {
    const Part p = part[t];
    const int s = p.s, b = p.b, f = s + b;
    const double *F = panels + p.panel;
    if (b) {
      for (I j = 0; j < b / 3; ++j) memcpy(scratch + 3 * j, x + 3 * I(boundary[p.boundary + j]), 3 * sizeof(double));
      gemv("T", &b, &s, &minus, F + s, &f, scratch, &unit, &one, x + 3 * p.first, &unit);
    }
    trsv("L", "T", "N", &s, F, &f, x + 3 * p.first, &unit);
  }
}
