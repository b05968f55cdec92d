/* Solutions with a banded factor: L_ij, j <= i <= j + b, stands at L[(b + 1) j + i - j], column after column. Eight columns are taken at a
   time, so a right side is read and written once for all of these, and each of many right sides before the next columns. */
#include <algorithm>
#include <cstdint>
#include <cstring>
enum { W = 8 };
typedef double wide __attribute__((vector_size(8 * W)));
typedef int64_t whole __attribute__((vector_size(8 * W)));
static inline wide load(const double *p) {
  wide found;
  std::memcpy(&found, p, sizeof found);
  return found;
}
static inline void store(double *p, wide x) { std::memcpy(p, &x, sizeof x); }

/* Rows i to i + W of column c of a block whose columns end in row b + c: zero beyond. */
static inline wide within(const double *L, int64_t b, int64_t c, int64_t i) {
  const whole row = i + whole{0, 1, 2, 3, 4, 5, 6, 7};
  return row <= b + c ? load(L + b * c + i) : wide{};
}

static inline wide inverses(const double *L, int64_t b) {
  wide found;
  for (int c = 0; c < W; ++c) found[c] = L[b * c + c];
  return 1 / found;
}

/* The sum of each of eight. */
static inline wide sums(const wide *x) {
  wide two[4], four[2];
  for (int k = 0; k < 4; ++k)
    two[k] = __builtin_shuffle(x[2 * k], x[2 * k + 1], whole{0, 8, 2, 10, 4, 12, 6, 14}) +
             __builtin_shuffle(x[2 * k], x[2 * k + 1], whole{1, 9, 3, 11, 5, 13, 7, 15});
  for (int k = 0; k < 2; ++k)
    four[k] = __builtin_shuffle(two[2 * k], two[2 * k + 1], whole{0, 1, 8, 9, 4, 5, 12, 13}) +
              __builtin_shuffle(two[2 * k], two[2 * k + 1], whole{2, 3, 10, 11, 6, 7, 14, 15});
  return __builtin_shuffle(four[0], four[1], whole{0, 1, 2, 3, 8, 9, 10, 11}) +
         __builtin_shuffle(four[0], four[1], whole{4, 5, 6, 7, 12, 13, 14, 15});
}

/* A block of W columns from L on, y from their first row on: L_ic, both counted from there, stands at L[b c + i]. */
static inline void down(const double *L, int64_t b, double *y) {
  const wide inverse = inverses(L, b);
  wide x[W];
  for (int c = 0; c < W; ++c) {
    y[c] *= inverse[c];
    for (int i = c + 1; i < W; ++i) y[i] -= L[b * c + i] * y[c];
    x[c] = y[c] - wide{};
  }
  int64_t i = W;
  for (; i + W <= b + 1; i += W) {
    wide sum = load(y + i);
    for (int c = 0; c < W; ++c) sum -= load(L + b * c + i) * x[c];
    store(y + i, sum);
  }
  for (; i < b + W; i += W) {
    wide sum = load(y + i);
    for (int c = 0; c < W; ++c) sum -= within(L, b, c, i) * x[c];
    store(y + i, sum);
  }
}
static inline void up(const double *L, int64_t b, double *y) {
  wide sum[W] = {};
  int64_t i = W;
  for (; i + W <= b + 1; i += W)
    for (int c = 0; c < W; ++c) sum[c] += load(L + b * c + i) * load(y + i);
  for (; i < b + W; i += W)
    for (int c = 0; c < W; ++c) sum[c] += within(L, b, c, i) * load(y + i);
  const wide rest = load(y) - sums(sum), inverse = inverses(L, b);
  for (int c = W - 1; c >= 0; --c) {
    y[c] = rest[c];
    for (int k = W - 1; k > c; --k) y[c] -= L[b * c + k] * y[k];
    y[c] *= inverse[c];
  }
}

/* One column, of which `rows` follow the diagonal. */
static inline void down_one(const double *L, int64_t rows, double *y) {
  y[0] /= L[0];
  for (int64_t i = 1; i <= rows; ++i) y[i] -= L[i] * y[0];
}
/* The compiler may sum in vectors from where y lies on a multiple of their size; so that no bit hangs on that, it may not. */
__attribute__((noinline, optimize("no-tree-vectorize"))) static void up_one(const double *L, int64_t rows, double *y) {
  double rest = y[0];
  for (int64_t i = 1; i <= rows; ++i) rest -= L[i] * y[i];
  y[0] = rest / L[0];
}

/* Columns that are taken in blocks: all whose blocks end, with what is read beside them, before the last row. */
static inline int64_t blocked(int64_t n, int64_t b) { return b < W ? 0 : std::max<int64_t>(0, (n - b - W) / W * W); }

/* L y = f, and L^T y = f: f becomes y, n numbers of each right side. */
extern "C" void forward(int64_t n, int64_t b, const double *L, int64_t rights, double *y) {
  const int64_t split = blocked(n, b);
  for (int64_t j = 0; j < split; j += W)
    for (int64_t r = 0; r < rights; ++r) down(L + (b + 1) * j, b, y + n * r + j);
  for (int64_t j = split; j < n; ++j)
    for (int64_t r = 0; r < rights; ++r) down_one(L + (b + 1) * j, std::min(b, n - 1 - j), y + n * r + j);
}
extern "C" void backward(int64_t n, int64_t b, const double *L, int64_t rights, double *y) {
  const int64_t split = blocked(n, b);
  for (int64_t j = n - 1; j >= split; --j)
    for (int64_t r = 0; r < rights; ++r) up_one(L + (b + 1) * j, std::min(b, n - 1 - j), y + n * r + j);
  for (int64_t j = split - W; j >= 0; j -= W)
    for (int64_t r = 0; r < rights; ++r) up(L + (b + 1) * j, b, y + n * r + j);
}
