/* The loops over cells and sample points: stands after the code for energy, stress and tangent, and after NODES and POINTS. */
enum { n = NODES, P = POINTS, d = 3 * n, row = d + 1 };
/* A tetrahedron of volume 1: FFCx multiplies by it. */
static const double unit[12] = {0, 0, 0, 6, 0, 0, 0, 1, 0, 0, 0, 1};
static inline void gather(const int32_t *cell, int64_t left, const double *u, pack *to) {
  for (int a = 0; a < n; ++a)
    for (int l = 0; l < L; ++l) {
      const double *p = u + 3 * int64_t(cell[(l < left ? l : 0) * n + a]);
      for (int k = 0; k < 3; ++k) to[3 * a + k].x[l] = p[k];
    }
}
#ifdef SHEET
/* The stretch across a thin sheet, by Newton's method: there is no stress across it, P_33 = 0. */
static inline void thin(pack *F, const double *c) {
  for (int i = 0; i < 40; ++i) {
    pack S[9], A[81];
    for (int k = 0; k < 9; ++k) S[k] = 0.0;
    for (int k = 0; k < 81; ++k) A[k] = 0.0;
    stress(S, F, c, unit, nullptr, nullptr);
    tangent(A, F, c, unit, nullptr, nullptr);
    const pack step = S[8] / A[80];
    double farthest = 0;
    for (int l = 0; l < L; ++l) {
      const double next = F[8].x[l] - step.x[l];
      F[8].x[l] = next < F[8].x[l] / 2 ? F[8].x[l] / 2 : next; /* a stretch is positive */
      farthest = std::fmax(farthest, std::fabs(step.x[l]));
    }
    if (farthest < 1e-13) return;
  }
}
/* The tangent in the plane when the stretch across follows. */
static inline void condense(pack *A) {
  for (int m = 0; m < 8; ++m)
    for (int k = 0; k < 8; ++k) A[9 * m + k] += -A[9 * m + 8] * A[72 + k] / A[80];
}
#endif
/* A function of F, given the gradients of one sample point. */
template <class Law> static inline void at(Law law, const pack *u, const pack *g, const double *c, int size, pack *out) {
  pack F[9];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      F[3 * i + j] = double(i == j);
      for (int a = 0; a < n; ++a) F[3 * i + j] += u[3 * a + i] * g[3 * a + j];
    }
#ifdef SHEET
  thin(F, c);
#endif
  for (int i = 0; i < size; ++i) out[i] = 0.0;
  law(out, F, c, unit, nullptr, nullptr);
}
/* The packs of L cells from `first`; the last one repeats a cell, whose results are not used. */
#define OVER_CELLS \
  for (int64_t first = 0; first < cells; first += L, table += P * row) { \
    const int64_t left = cells - first < L ? cells - first : L; \
    const int32_t *cell = nodes + first * n; \
    pack x[d]; \
    gather(cell, left, u, x);
#define OVER_POINTS \
    for (int p = 0; p < P; ++p) { \
      const pack *g = table + p * row, V = g[d]; \
      const double *lame = constants + 2 * p;
/* Stress and energy of one F, which have much in common. */
static inline void response(pack *SW, const pack *F, const double *c, const double *x, const int *, const uint8_t *) {
  stress(SW, F, c, x, nullptr, nullptr);
  energy(SW + 9, F, c, x, nullptr, nullptr);
}
extern "C" void forces(int64_t cells, const int32_t *nodes, const pack *table, const double *constants, const double *u,
                       double *out, double *energies) {
  OVER_CELLS
    pack f[d], W = 0.0;
    for (int i = 0; i < d; ++i) f[i] = 0.0;
    OVER_POINTS
      pack S[10];
      at(response, x, g, lame, 10, S);
      for (int i = 0; i < 9; ++i) S[i] = V * S[i];
      W += V * S[9];
      for (int a = 0; a < n; ++a)
        for (int i = 0; i < 3; ++i)
          for (int j = 0; j < 3; ++j) f[3 * a + i] += S[3 * i + j] * g[3 * a + j];
    }
    for (int l = 0; l < left; ++l) {
      energies[first + l] = W.x[l];
      for (int a = 0; a < n; ++a)
        for (int k = 0; k < 3; ++k) out[3 * int64_t(cell[l * n + a]) + k] += f[3 * a + k].x[l];
    }
  }
}
template <class Real> static inline void add(int64_t cells, const int32_t *nodes, const pack *table, const double *constants,
                                            const double *u, Real *out, const int32_t *slot) {
  OVER_CELLS
    pack K[d * d];
    for (int i = 0; i < d * d; ++i) K[i] = 0.0;
    OVER_POINTS
      pack A[81];
      at(tangent, x, g, lame, 81, A);
#ifdef SHEET
      condense(A);
#endif
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
        for (int j = i; j < d; ++j) out[*s++] += Real(K[d * i + j].x[l]);
  }
}
extern "C" void stiffnesses(int64_t cells, const int32_t *nodes, const pack *table, const double *constants, const double *u,
                            double *out, const int32_t *slot) {
  add(cells, nodes, table, constants, u, out, slot);
}
extern "C" void stiffnesses_single(int64_t cells, const int32_t *nodes, const pack *table, const double *constants, const double *u,
                                   float *out, const int32_t *slot) {
  add(cells, nodes, table, constants, u, out, slot);
}
