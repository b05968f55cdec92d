/* Polynomials through the last states, by Lagrange's form. Compiled so that each product and each sum is rounded by itself, as numpy's. */
#include <cstdint>

/* u(f) = sum_i u_i prod_j (f - f_j) / (f_i - f_j), j other than i, through the last n of some states (of `size` numbers u_i at f_i), for
   each n from `fewest` on: one row of `out` each. */
extern "C" void through(int64_t states, int64_t fewest, int64_t size, const double *at, const double *const *values, double fraction,
                        double *__restrict out) {
  for (int64_t first = states - fewest; first >= 0; --first, out += size) {
    for (int64_t k = 0; k < size; ++k) out[k] = 0;
    for (int64_t i = first; i < states; ++i) {
      double weight = 1;
      for (int64_t j = first; j < states; ++j)
        if (at[j] != at[i]) weight *= (fraction - at[j]) / (at[i] - at[j]);
      const double *value = values[i];
      for (int64_t k = 0; k < size; ++k) out[k] += weight * value[k];
    }
  }
}
