/* Points of a body's surface and the nodes behind them. Weights w_qa stand in compressed rows: those of point q from first[q] to
   first[q + 1], with the node a of each. Compiled so that each product and each sum is rounded by itself, but where fma says otherwise. */
#include <algorithm>
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

/* f_a += w_qa p n for the force p on one point q along n, at the places of its nodes in f. */
static inline void push(const int32_t *node, const int32_t *end, const double *weight, const int64_t *place, double p, const double *n, double *f) {
  for (; node < end; ++node, ++weight)
    for (int k = 0; k < 3; ++k) f[3 * place[*node] + k] = std::fma(*weight, p * n[k], f[3 * place[*node] + k]);
}

/* f_a += sum_q w_qa p_q n_q */
extern "C" void forces(int64_t points, const int32_t *first, const int32_t *node, const double *weight, const int64_t *place,
                       const double *pressure, const double *normal, double *f) {
  for (int64_t q = 0; q < points; ++q)
    push(node + first[q], node + first[q + 1], weight + first[q], place, pressure[q], normal + 3 * q, f);
}

/* Takes the forces of contact from f, and finds how far points are from their conditions and how far inside, at most: wrong (2). */
extern "C" void judge(int64_t points, const int32_t *first, const int32_t *node, const double *weight, const int64_t *place,
                      const double *gap, const double *normal, const double *softness, const double *pressure, double *f, double *wrong) {
  wrong[0] = wrong[1] = 0;
  for (int64_t q = 0; q < points; ++q) {
    const double inside = gap[q] >= 0 ? 0 : -gap[q], off = pressure[q] > 0 ? std::fabs(gap[q] + softness[q] * pressure[q]) : inside;
    wrong[0] = off <= wrong[0] ? wrong[0] : off; /* of no number too */
    wrong[1] = inside <= wrong[1] ? wrong[1] : inside;
    if (pressure[q] != 0) push(node + first[q], node + first[q + 1], weight + first[q], place, -pressure[q], normal + 3 * q, f);
  }
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

/* out (k + b, k + b) = R C R^T, R the k rows of G on the b rows of B, all (n) and mostly zero, C (n, n) symmetric; and c on the diagonal of
   the first k. */
extern "C" void condense(int64_t k, int64_t b, int64_t n, const double *G, const double *B, const double *C, const double *c, double *out) {
  const int64_t rows = k + b;
  std::vector<int64_t> first{0}, column;
  std::vector<double> value, product(n), products(n * rows); /* C R^T */
  for (int64_t r = 0; r < rows; ++r) {
    const double *row = r < k ? G + n * r : B + n * (r - k);
    std::fill(product.begin(), product.end(), 0.0);
    for (int64_t i = 0; i < n; ++i)
      if (row[i] != 0) {
        column.push_back(i);
        value.push_back(row[i]);
        for (int64_t j = 0; j < n; ++j) product[j] += row[i] * C[n * i + j];
      }
    first.push_back(int64_t(column.size()));
    for (int64_t j = 0; j < n; ++j) products[rows * j + r] = product[j];
  }
  std::fill(out, out + rows * rows, 0.0);
  for (int64_t r = 0; r < rows; ++r) {
    for (int64_t j = first[r]; j < first[r + 1]; ++j)
      for (int64_t s = 0; s < rows; ++s) out[rows * r + s] += value[j] * products[rows * column[j] + s];
    if (r < k) out[rows * r + r] += c[r];
  }
}
