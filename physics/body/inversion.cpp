/* The smallest det F of a mesh, frame by frame; stands after NODES, PLANE and AT_ONCE. Each product and each sum is rounded by itself, but for
   those of fma. */
#include <cmath>
#include <cstdint>
enum { n = NODES, L = AT_ONCE }; /* L cells side by side: a pack */

/* det J, J_kd the derivative of component k in direction d; of plane cells that of the first two. */
static inline void determinants(const double (*J)[3][L], double *det) {
  const auto &x = J[0], &y = J[1], &z = J[2];
  for (int l = 0; l < L; ++l)
    det[l] = PLANE ? x[0][l] * y[1][l] - x[1][l] * y[0][l]
                   : x[0][l] * (y[1][l] * z[2][l] - y[2][l] * z[1][l]) + x[1][l] * (y[2][l] * z[0][l] - y[0][l] * z[2][l])
                         + x[2][l] * (y[0][l] * z[1][l] - y[1][l] * z[0][l]);
}

/* out_t = min over cells and their points q of det J_q / rest_q, J_q = sum_a x_a (x) slope_qa, x = X + u_t.
   cell: (packs L, n); X: (nodes, 3); u: (frames, nodes, 3); slope: (points, n, 3); rest: (packs, points, L), nan where there is no ratio */
extern "C" void smallest(int64_t frames, int64_t nodes, int64_t packs, int64_t points, const int32_t *cell, const double *X,
                         const double *u, const double *slope, const double *rest, double *out) {
  for (int64_t t = 0; t < frames; ++t, u += 3 * nodes) {
    double least[L];
    for (int l = 0; l < L; ++l) least[l] = INFINITY;
    for (int64_t p = 0; p < packs; ++p) {
      double x[3][n][L];
      for (int l = 0; l < L; ++l)
        for (int a = 0; a < n; ++a)
          for (int k = 0; k < 3; ++k) {
            const int64_t at = 3 * int64_t(cell[(p * L + l) * n + a]) + k;
            x[k][a][l] = X[at] + u[at];
          }
      for (int64_t q = 0; q < points; ++q) {
        double J[3][3][L], det[L];
        for (int k = 0; k < 3; ++k)
          for (int d = 0; d < 3; ++d) {
            double sum[L] = {};
            for (int a = 0; a < n; ++a)
              for (int l = 0; l < L; ++l) sum[l] = std::fma(slope[3 * (q * n + a) + d], x[k][a][l], sum[l]);
            for (int l = 0; l < L; ++l) J[k][d][l] = sum[l];
          }
        determinants(J, det);
        for (int l = 0; l < L; ++l) {
          const double ratio = det[l] / rest[(p * points + q) * L + l];
          least[l] = ratio < least[l] ? ratio : least[l];
        }
      }
    }
    out[t] = least[0];
    for (int l = 1; l < L; ++l) out[t] = least[l] < out[t] ? least[l] : out[t];
  }
}
