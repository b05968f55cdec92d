/* Points of a body's surface and the nodes behind them. Weights w_qa stand in compressed rows: those of point q from first[q] to
   first[q + 1], with the node a of each. Compiled so that each product and each sum is rounded by itself, but where fma says otherwise. */
#include <cmath>
#include <cstdint>
#include <vector>

/* x_q = sum_a w_qa (X_a + u_n), n = number[a] of node a among all nodes. */
extern "C" void positions(int64_t points, const int32_t *first, const int32_t *node, const double *weight, const int64_t *number,
                          const double *rest, const double *u, double *x) {
  for (int64_t q = 0; q < points; ++q, x += 3) {
    double sum[3] = {0, 0, 0};
    for (int32_t j = first[q]; j < first[q + 1]; ++j)
      for (int k = 0; k < 3; ++k) sum[k] = std::fma(weight[j], rest[3 * node[j] + k] + u[3 * number[node[j]] + k], sum[k]);
    for (int k = 0; k < 3; ++k) x[k] = sum[k];
  }
}

/* f_a += sum_q w_qa p_q n_q */
extern "C" void forces(int64_t points, const int32_t *first, const int32_t *node, const double *weight, const double *pressure,
                       const double *normal, double *f) {
  for (int64_t q = 0; q < points; ++q)
    for (int32_t j = first[q]; j < first[q + 1]; ++j)
      for (int k = 0; k < 3; ++k) f[3 * node[j] + k] = std::fma(weight[j], pressure[q] * normal[3 * q + k], f[3 * node[j] + k]);
}

/* Row r of out (rows, 3 n), zero before: w_qa v_r at the components of a, q = point[r]; the n nodes are some of all m. */
extern "C" void spread(int64_t rows, const int64_t *point, const double *v, const int32_t *first, const int32_t *node,
                       const double *weight, int64_t m, int64_t n, const int64_t *nodes, double *out) {
  std::vector<int64_t> place(m);
  for (int64_t a = 0; a < n; ++a) place[nodes[a]] = a;
  for (int64_t r = 0; r < rows; ++r, v += 3, out += 3 * n)
    for (int32_t j = first[point[r]]; j < first[point[r] + 1]; ++j)
      for (int k = 0; k < 3; ++k) out[3 * place[node[j]] + k] = weight[j] * v[k];
}

/* max |u_a - v_a| over nodes */
extern "C" double farthest(int64_t nodes, const double *u, const double *v) {
  double most = 0;
  for (int64_t a = 0; a < 3 * nodes; a += 3) {
    const double x = u[a] - v[a], y = u[a + 1] - v[a + 1], z = u[a + 2] - v[a + 2], square = (x * x + y * y) + z * z;
    most = square <= most ? most : square; /* of no number too */
  }
  return std::sqrt(most);
}
