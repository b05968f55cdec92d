/* Distances from round shapes, and how surfaces curve; shapes.py says what the shapes are. Each product and each sum is rounded by itself. */
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

/* out (2, 3): t with sum t t^T = (1 - n n^T - s s^T) / d at distance d from the centre of curvature, 0 where the surface is flat, and for
   the straight direction s, which a ball has not. */
static inline void bend(const double *normal, double distance, const double *straight, bool ball, double *out) {
  const double size = distance > 0 ? std::sqrt(1 / distance) : 0;
  double first[3] = {straight[0], straight[1], straight[2]};
  if (ball) {
    int least = 0;
    for (int k = 1; k < 3; ++k) least = std::fabs(normal[k]) < std::fabs(normal[least]) ? k : least;
    double unit[3] = {}, across[3];
    unit[least] = 1;
    cross(normal, unit, across);
    const double norm = length(across);
    for (int k = 0; k < 3; ++k) first[k] = across[k] / norm;
  }
  cross(first, normal, out);
  for (int k = 0; k < 3; ++k) {
    out[3 + k] = ball ? first[k] * size : 0;
    out[k] *= size;
  }
}
extern "C" void bends(int64_t points, const double *normal, const double *distance, const double *straight, const bool *ball, double *out) {
  for (int64_t q = 0; q < points; ++q) bend(normal + 3 * q, distance[q], straight + 3 * q, ball[q], out + 6 * q);
}

/* The same around a core: of a ball where an end of it, or its only point, is nearest. */
extern "C" void bends_around(int64_t points, const double *p, const double *axis, double half, const double *anywhere, double *out) {
  for (int64_t q = 0; q < points; ++q, p += 3, out += 6) {
    double way[3];
    const bool ball = core(p, axis, half, way) != along(p, axis) || half == 0;
    const double distance = length(way);
    for (int k = 0; k < 3; ++k) way[k] = distance > 0 ? way[k] / distance : anywhere[k];
    bend(way, distance, axis, ball, out);
  }
}
