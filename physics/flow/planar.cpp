/* Triangular solves with the Cholesky factor of a dissected plane mesh with one unknown a node; planar.py says what the tables hold. */
#include <cstdint>
#include <cstring>
typedef int64_t I;
struct Part { I s, b, panel, first, boundary, child, last, made, kept; };

/* x := L^-T L^-1 x for K right-hand sides of n numbers each; the vectors of a part lie in `scratch`, `most` numbers each. */
template <int K> static void through(I parts, const Part *part, const int32_t *boundary, const double *panels, double *x, I n,
                                     double *scratch, I most) {
  double *__restrict y[K];
  for (int k = 0; k < K; ++k) y[k] = scratch + k * most;
  for (I t = 0; t < parts; ++t) {
    const Part p = part[t];
    const I s = p.s, b = p.b, f = s + b;
    const double *F = panels + p.panel;
    const int32_t *to = boundary + p.boundary;
    for (int k = 0; k < K; ++k) {
      memcpy(y[k], x + k * n + p.first, sizeof(double) * s);
      memset(y[k] + s, 0, sizeof(double) * b);
    }
    I j = 0;
    for (; j + 4 <= s; j += 4) {  /* four columns at a time */
      const double *__restrict A = F + j * f, *__restrict B = A + f, *__restrict C = B + f, *__restrict D = C + f;
      double v[K][4];
      for (int k = 0; k < K; ++k) {
        double *z = y[k] + j;
        v[k][0] = z[0] /= A[j];
        v[k][1] = z[1] = (z[1] - A[j + 1] * z[0]) / B[j + 1];
        v[k][2] = z[2] = (z[2] - A[j + 2] * z[0] - B[j + 2] * z[1]) / C[j + 2];
        v[k][3] = z[3] = (z[3] - A[j + 3] * z[0] - B[j + 3] * z[1] - C[j + 3] * z[2]) / D[j + 3];
      }
      for (I i = j + 4; i < f; ++i)
        for (int k = 0; k < K; ++k) y[k][i] -= A[i] * v[k][0] + B[i] * v[k][1] + C[i] * v[k][2] + D[i] * v[k][3];
    }
    for (; j < s; ++j) {
      const double *__restrict A = F + j * f;
      for (int k = 0; k < K; ++k) {
        const double v = y[k][j] /= A[j];
        for (I i = j + 1; i < f; ++i) y[k][i] -= A[i] * v;
      }
    }
    for (int k = 0; k < K; ++k) {
      memcpy(x + k * n + p.first, y[k], sizeof(double) * s);
      for (I i = 0; i < b; ++i) x[k * n + to[i]] += y[k][s + i];
    }
  }
  for (I t = parts - 1; t >= 0; --t) {
    const Part p = part[t];
    const I s = p.s, b = p.b, f = s + b;
    const double *F = panels + p.panel;
    const int32_t *from = boundary + p.boundary;
    for (int k = 0; k < K; ++k) {
      memcpy(y[k], x + k * n + p.first, sizeof(double) * s);
      for (I i = 0; i < b; ++i) y[k][s + i] = x[k * n + from[i]];
    }
    I j = s;
    for (; j >= 4; j -= 4) {
      const double *__restrict A = F + (j - 4) * f, *__restrict B = A + f, *__restrict C = B + f, *__restrict D = C + f;
      for (int k = 0; k < K; ++k) {
        double *z = y[k], a0 = 0, a1 = 0, a2 = 0, a3 = 0;
        for (I i = j; i < f; ++i) {
          a0 += A[i] * z[i];
          a1 += B[i] * z[i];
          a2 += C[i] * z[i];
          a3 += D[i] * z[i];
        }
        z += j - 4;
        z[3] = (z[3] - a3) / D[j - 1];
        z[2] = (z[2] - a2 - C[j - 1] * z[3]) / C[j - 2];
        z[1] = (z[1] - a1 - B[j - 1] * z[3] - B[j - 2] * z[2]) / B[j - 3];
        z[0] = (z[0] - a0 - A[j - 1] * z[3] - A[j - 2] * z[2] - A[j - 3] * z[1]) / A[j - 4];
      }
    }
    for (; j > 0; --j) {
      const double *__restrict A = F + (j - 1) * f;
      for (int k = 0; k < K; ++k) {
        double sum = y[k][j - 1];
        for (I i = j; i < f; ++i) sum -= A[i] * y[k][i];
        y[k][j - 1] = sum / A[j - 1];
      }
    }
    for (int k = 0; k < K; ++k) memcpy(x + k * n + p.first, y[k], sizeof(double) * s);
  }
}

/* out := K^-1 right for fields of `count`, 1 or 2, numbers a node, of which `order` says the node at each of n places; x is for n count numbers. */
extern "C" void solve(I parts, const Part *part, const int32_t *boundary, const double *panels, I n, const I *order, I count,
                      const double *right, double *out, double *x, double *scratch, I most) {
  for (I i = 0; i < n; ++i)
    for (I k = 0; k < count; ++k) x[k * n + i] = right[order[i] * count + k];
  (count == 2 ? through<2> : through<1>)(parts, part, boundary, panels, x, n, scratch, most);
  for (I i = 0; i < n; ++i)
    for (I k = 0; k < count; ++k) out[order[i] * count + k] = x[k * n + i];
}
