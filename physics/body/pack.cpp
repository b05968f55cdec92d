/* As many numbers side by side as this processor has lanes, that behave like one: stands before the code that FFCx writes for a law. */
#include <cmath>
#include <cstdint>
#if defined __AVX512F__
enum { L = 8 };
#elif defined __AVX__
enum { L = 4 };
#else
enum { L = 2 };
#endif
/* Wider ones than the registers would be kept in memory, which takes three times as long. */
extern "C" const int64_t lanes = L;
typedef double wide __attribute__((vector_size(8 * L)));
struct pack {
  wide x;
  pack() = default;
  pack(double s) : x(s - wide{}) {}
  pack(wide y) : x(y) {}
  pack &operator+=(pack b) { x += b.x; return *this; }
};
static inline pack operator+(pack a, pack b) { return a.x + b.x; }
static inline pack operator-(pack a, pack b) { return a.x - b.x; }
static inline pack operator*(pack a, pack b) { return a.x * b.x; }
static inline pack operator/(pack a, pack b) { return a.x / b.x; }
static inline pack operator-(pack a) { return -a.x; }
#define EACH(name, expression) \
  static inline pack name(pack a) { pack r; for (int l = 0; l < L; ++l) { double s = a.x[l]; r.x[l] = expression; } return r; }
EACH(sqrt, std::sqrt(s)) EACH(fabs, std::fabs(s))
/* glibc's libmvec has these for several numbers at once. As they are said to be const, what FFCx writes out again and again is found once. */
#ifdef __x86_64__
#if defined __AVX512F__
#define VECTOR(name) _ZGVeN8v_##name
#elif defined __AVX2__
#define VECTOR(name) _ZGVdN4v_##name
#elif defined __AVX__
#define VECTOR(name) _ZGVcN4v_##name
#else
#define VECTOR(name) _ZGVbN2v_##name
#endif
extern "C" wide VECTOR(log)(wide) noexcept __attribute__((const));
extern "C" wide VECTOR(exp)(wide) noexcept __attribute__((const));
static inline pack log(pack a) { return VECTOR(log)(a.x); }
static inline pack exp(pack a) { return VECTOR(exp)(a.x); }
#else
EACH(log, std::log(s)) EACH(exp, std::exp(s))
#endif
static inline pack pow(pack a, double e) {
  if (e == 2) return a * a;
  if (e == -1) return 1.0 / a;
  return exp(e * log(a));
}
