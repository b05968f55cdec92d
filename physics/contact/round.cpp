/* What shapes.py finds of a sphere, a cylinder or a capsule, in one pass. Each product and each sum is rounded by itself. */
#include <cmath>
#include <cstdint>
static inline void cross(const double *a, const double *b, double *out) {
  for (int k = 0; k < 3; ++k) out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}
static inline double length(const double *a) { return std::sqrt((a[0] * a[0] + a[1] * a[1]) + a[2] * a[2]); }
static inline double along(const double *p, const double *axis) { return (p[0] * axis[0] + p[1] * axis[1]) + p[2] * axis[2]; }

/* What is nearest to a point at p from the centre on p.a = -half .. half of the axis a, and the way from there. */
static inline double core(const double *p, const double *axis, double half, double *way) {
  const double at = std::fmin(std::fmax(along(p, axis), -half), half);
  for (int k = 0; k < 3; ++k) way[k] = p[k] - at * axis[k];
  return at;
}

/* Gaps and normals of points at offsets p from the centre to all that is nearer than the radius to such a core; on it the normal is
   `anywhere`. */
extern "C" void distances(int64_t points, const double *p, const double *axis, double half, double radius, const double *anywhere,
                          double *gap, double *normal) {
  for (int64_t q = 0; q < points; ++q, p += 3, normal += 3) {
    double way[3];
    core(p, axis, half, way);
    const double distance = length(way);
    gap[q] = distance - radius;
    for (int k = 0; k < 3; ++k) normal[k] = distance > 0 ? way[k] / distance : anywhere[k];
  }
}

/* out (points, 2, 3): t with sum t t^T = (1 - n n^T - s s^T) / d at distance d from the core, n the normal, and the direction s of the axis,
   but for where an end of the core, or its only point, is nearest: there the surface is a ball, without s. */
extern "C" void bends(int64_t points, const double *p, const double *axis, double half, const double *anywhere, double *out) {
  for (int64_t q = 0; q < points; ++q, p += 3, out += 6) {
    double way[3];
    const bool ball = core(p, axis, half, way) != along(p, axis) || half == 0;
    const double distance = length(way);
    double normal[3], first[3] = {axis[0], axis[1], axis[2]};
    for (int k = 0; k < 3; ++k) normal[k] = distance > 0 ? way[k] / distance : anywhere[k];
    if (ball) {
      int least = 0;
      for (int k = 1; k < 3; ++k) least = std::fabs(normal[k]) < std::fabs(normal[least]) ? k : least;
      double unit[3] = {}, across[3];
      unit[least] = 1;
      cross(normal, unit, across);
      const double norm = length(across);
      for (int k = 0; k < 3; ++k) first[k] = across[k] / norm;
    }
    const double size = distance > 0 ? std::sqrt(1 / distance) : 0;
    cross(first, normal, out);
    for (int k = 0; k < 3; ++k) {
      out[3 + k] = ball ? first[k] * size : 0;
      out[k] *= size;
    }
  }
}
