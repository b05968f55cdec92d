/* Sums over triangles of velocities of NODES nodes and pressures of CORNERS, at POINTS points a cell, four cells side by side.

   Comes after the tables of the shape functions, N (POINTS, NODES), R and S (their slopes) and Q (POINTS, CORNERS). `metric` holds of
   four cells, at each point, the weight times det J, and the weight times det J inv(J)^T, row by row. */
#include <cstdint>
typedef double pack __attribute__((vector_size(32)));
enum { n = NODES, m = CORNERS, P = POINTS, side = 4 };
struct Metric { pack w, a, b, c, d; };  /* w d/dx = a d/dr + b d/ds, w d/dy = c d/dr + d d/ds */
#define OVER_CELLS \
  for (int64_t first = 0; first < cells; first += side, metric += P) { \
    const int left = cells - first < side ? int(cells - first) : side; \
    const int32_t *node = nodes + first * n, *corner = corners + first * m;
/* The numbers at the nodes of four cells, the last one again where there are fewer; of vectors one component. */
template <int size, int step> static inline void gather(const int32_t *cell, int left, const double *u, pack *to) {
  const int32_t *of[side];
  for (int l = 0; l < side; ++l) of[l] = cell + (l < left ? l : left - 1) * size;
  for (int i = 0; i < size; ++i) {
    const double *z[side];
    for (int l = 0; l < side; ++l) z[l] = u + step * int64_t(of[l][i]);
    for (int k = 0; k < step; ++k) to[step * i + k] = pack{z[0][k], z[1][k], z[2][k], z[3][k]};
  }
}
template <int size, int step> static inline void scatter(const int32_t *cell, int left, const pack *from, double *out) {
  for (int l = 0; l < left; ++l, cell += size)
    for (int i = 0; i < size; ++i)
      for (int k = 0; k < step; ++k) out[step * int64_t(cell[i]) + k] += from[step * i + k][l];
}

/* out += (g, v) - (u . grad u + SKEW div u u, v) + (p, div v) for all test functions v. */
extern "C" void momentum(int64_t cells, const int32_t *nodes, const int32_t *corners, const Metric *metric, const double *u,
                         const double *g, const double *p, double *out) {
  OVER_CELLS
    pack x[2 * n], y[2 * n], q[m], f[2 * n] = {};
    gather<n, 2>(node, left, u, x);
    gather<n, 2>(node, left, g, y);
    gather<m, 1>(corner, left, p, q);
    for (int k = 0; k < P; ++k) {
      pack u0 = {}, u1 = {}, g0 = {}, g1 = {}, r0 = {}, r1 = {}, s0 = {}, s1 = {}, z = {};
      for (int i = 0; i < n; ++i) {
        const double N = ::N[k][i], R = ::R[k][i], S = ::S[k][i];
        u0 += N * x[2 * i]; u1 += N * x[2 * i + 1];
        g0 += N * y[2 * i]; g1 += N * y[2 * i + 1];
        r0 += R * x[2 * i]; r1 += R * x[2 * i + 1];
        s0 += S * x[2 * i]; s1 += S * x[2 * i + 1];
      }
      for (int i = 0; i < m; ++i) z += Q[k][i] * q[i];
      const Metric t = metric[k];
      const pack along = u0 * t.a + u1 * t.c, across = u0 * t.b + u1 * t.d;
      const pack half = SKEW * (t.a * r0 + t.b * s0 + t.c * r1 + t.d * s1);
      const pack e0 = t.w * g0 - along * r0 - across * s0 - half * u0, e1 = t.w * g1 - along * r1 - across * s1 - half * u1;
      const pack a = z * t.a, b = z * t.b, c = z * t.c, d = z * t.d;
      for (int i = 0; i < n; ++i) {
        const double N = ::N[k][i], R = ::R[k][i], S = ::S[k][i];
        f[2 * i] += N * e0 + R * a + S * b;
        f[2 * i + 1] += N * e1 + R * c + S * d;
      }
    }
    scatter<n, 2>(node, left, f, out);
  }
}

/* out += (q, div u) for all test functions q of the pressure. */
extern "C" void divergence(int64_t cells, const int32_t *nodes, const int32_t *corners, const Metric *metric, const double *u,
                           double *out) {
  OVER_CELLS
    pack x[2 * n], f[m] = {};
    gather<n, 2>(node, left, u, x);
    for (int k = 0; k < P; ++k) {
      pack r0 = {}, r1 = {}, s0 = {}, s1 = {};
      for (int i = 0; i < n; ++i) {
        const double R = ::R[k][i], S = ::S[k][i];
        r0 += R * x[2 * i]; r1 += R * x[2 * i + 1];
        s0 += S * x[2 * i]; s1 += S * x[2 * i + 1];
      }
      const Metric t = metric[k];
      const pack e = t.a * r0 + t.b * s0 + t.c * r1 + t.d * s1;
      for (int i = 0; i < m; ++i) f[i] += Q[k][i] * e;
    }
    scatter<m, 1>(corner, left, f, out);
  }
}
