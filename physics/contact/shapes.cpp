/* Distances from round shapes, and how surfaces curve; shapes.py says what the shapes are. Each product and each sum is rounded by itself. */
#include <cmath>
#include <cstdint>
static inline void cross(const double *a, const double *b, double *out) {
  for (int k = 0; k < 3; ++k) out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}
static inline double length(const double *a) { return std::sqrt((a[0] * a[0] + a[1] * a[1]) + a[2] * a[2]); }
static inline double along(const double *p, const double *axis) { return (p[0] * axis[0] + p[1] * axis[1]) + p[2] * axis[2]; }

/* Gaps and normals of points at offsets p from the centre to all that is nearer than the radius to p.a = -half .. half on the axis a;
   on the axis itself the normal is `anywhere`. */
extern "C" void distances(int64_t points, const double *p, const double *axis, double half, double radius, const double *anywhere,
                          double *gap, double *normal) {
  for (int64_t q = 0; q < points; ++q, p += 3, normal += 3) {
    const double core = std::fmin(std::fmax(along(p, axis), -half), half);
    double way[3];
    for (int k = 0; k < 3; ++k) way[k] = p[k] - core * axis[k];
    const double distance = length(way);
    gap[q] = distance - radius;
    for (int k = 0; k < 3; ++k) normal[k] = distance > 0 ? way[k] / distance : anywhere[k];
  }
}

/* Whether the nearest place of the core is an end of it, around which the surface is a ball: 1 or 0. */
extern "C" void ends(int64_t points, const double *p, const double *axis, double half, bool *ball) {
  for (int64_t q = 0; q < points; ++q, p += 3) ball[q] = half == 0 || std::fabs(along(p, axis)) > half;
}

/* out (points, 2, 3): t with sum t t^T = (1 - n n^T - s s^T) / d, at distance d from the centre of curvature, 0 where the surface is flat,
   and for a straight direction s, which a ball has not. */
extern "C" void bends(int64_t points, const double *normal, const double *distance, const double *straight, const bool *ball, double *out) {
  for (int64_t q = 0; q < points; ++q, normal += 3, straight += 3, out += 6) {
    const double size = distance[q] > 0 ? std::sqrt(1 / distance[q]) : 0;
    double first[3] = {straight[0], straight[1], straight[2]};
    if (ball[q]) {
      int least = 0;
      for (int k = 1; k < 3; ++k) least = std::fabs(normal[k]) < std::fabs(normal[least]) ? k : least;
      double unit[3] = {}, across[3];
      unit[least] = 1;
      cross(normal, unit, across);
      const double size = length(across);
      for (int k = 0; k < 3; ++k) first[k] = across[k] / size;
    }
    cross(first, normal, out);
    for (int k = 0; k < 3; ++k) {
      out[3 + k] = ball[q] ? first[k] * size : 0;
      out[k] *= size;
    }
  }
}
