/* The multifrontal Cholesky factor of a dissected mesh, and its triangular solves; dissection.py says what the tables hold, and what Real is. */
#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <cstdint>
#include <cstring>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>
typedef int64_t I;
struct Part { I s, b, panel, first, boundary, child, last, made, kept; };
/* Parts from first to last that one thread eliminates, for how many tasks it waits and which waits for it, and its operations. */
struct Task { I first, last, waits, next, work; };
typedef void (*Potrf)(const char *, const int *, Real *, const int *, int *);
typedef void (*Trsm)(const char *, const char *, const char *, const char *, const int *, const int *, const Real *, const Real *,
                     const int *, Real *, const int *);
typedef void (*Syrk)(const char *, const char *, const int *, const int *, const Real *, const Real *, const int *, const Real *,
                     Real *, const int *);
typedef void (*Gemm)(const char *, const char *, const int *, const int *, const int *, const Real *, const Real *, const int *,
                     const Real *, const int *, const Real *, Real *, const int *);
typedef void (*Sytrf)(const char *, const int *, Real *, const int *, int *, Real *, const int *, int *);
typedef void (*Sytrs)(const char *, const int *, const int *, Real *, const int *, const int *, Real *, const int *, Real *, int *);
typedef void (*Trsv)(const char *, const char *, const char *, const int *, const Real *, const int *, Real *, const int *);
typedef void (*Gemv)(const char *, const int *, const int *, const Real *, const Real *, const int *, const Real *, const int *,
                     const Real *, Real *, const int *);
/* One thread's. */
struct Blas { Potrf potrf; Trsm trsm; Syrk syrk; Gemm gemm; Trsv trsv; Gemv gemv; Sytrf sytrf; Sytrs sytrs; };
static const Real one = 1, none = 0, minus = -1;
static const int unit = 1;

/* F_SS (s, s), lower, that has no Cholesky factor: how many of its eigenvalues are negative, by L D L^T with blocks of one and two in D (a
   block of two has one of each sign), and U - F_BS F_SS^-1 F_SB in place of U; -1 where F_SS is singular. */
static I counted(int s, int b, Real *F_SS, const Real *F_BS, int f, Real *U, const Blas &blas) {
  std::vector<int> pivot(s);
  const int room = 64 * s;
  std::vector<Real> work(room), X(I(s) * b);
  int info = 0;
  blas.sytrf("L", &s, F_SS, &s, pivot.data(), work.data(), &room, &info);
  if (info) return -1;
  I negative = 0;
  for (int i = 0; i < s; ++i) {
    if (pivot[i] < 0) ++negative, ++i;
    else if (F_SS[I(i) * s + i] < 0) ++negative;
  }
  if (!b) return negative;
  for (I i = 0; i < s; ++i)
    for (I j = 0; j < b; ++j) X[j * s + i] = F_BS[i * f + j];
  blas.sytrs("L", &s, &b, F_SS, &s, pivot.data(), X.data(), &s, work.data(), &info);
  blas.gemm("N", "N", &b, &b, &s, &minus, F_BS, &f, X.data(), &s, &one, U, &b);
  return negative;
}

/* With W unknowns a node: panels (s + b, s), by columns, hold K's lower entries and become L's; false where there is no factor. Where
   `negative` is given, a part without one is no end: `counted` goes on, and `grown` is by how much the diagonal of U changed at most. */
template <int W> static bool eliminate(I t, const Part *part, const I *children, const int32_t *place, Real *panels, Real *work,
                                       I *negative, double *grown, const Blas &blas) {
  const Part p = part[t];
  const int s = p.s, b = p.b, f = s + b;
  Real *F = panels + p.panel, *U = work + p.made;
  for (I i = 0; i < b; ++i) memset(U + i * b + i, 0, sizeof(Real) * (b - i));  /* what stands above the diagonal is not used */
  for (I i = p.child; i < p.last; ++i) {
    const Part c = part[children[i]];
    const int32_t *at = place + c.boundary;  /* where its boundary nodes stand in this part */
    const Real *from = work + c.kept;
    for (I j = 0; j < c.b / W; ++j)
      for (int k = 0; k < W; ++k, from += c.b) {
        const I column = W * I(at[j]) + k;
        Real *to = column < s ? F + column * f : U + (column - s) * b - s;
        for (int d = k; d < W; ++d) to[W * I(at[j]) + d] += from[W * j + d];
        for (I r = j + 1; r < c.b / W; ++r)
          for (int d = 0; d < W; ++d) to[W * I(at[r]) + d] += from[W * r + d];
      }
  }
  int info = 0;
  std::vector<Real> whole, diagonal;
  if (negative) {
    whole.resize(I(s) * s);
    for (I i = 0; i < s; ++i) memcpy(whole.data() + i * s + i, F + i * f + i, sizeof(Real) * (s - i));
    for (I i = 0; i < b; ++i) diagonal.push_back(U[i * b + i]);
  }
  if (s) blas.potrf("L", &s, F, &f, &info);
  if (info && !negative) return false;
  if (info) {
    if ((negative[t] = counted(s, b, whole.data(), F + s, f, U, blas)) < 0) return false;
  } else {
    for (I i = 0; i < s; ++i)
      if (!(F[i * f + i] < HUGE_VAL)) return false;  /* what is no number anywhere gets to the diagonal, and passes LAPACK */
    if (s && b) {
      blas.trsm("R", "L", "T", "N", &b, &s, &one, F, &f, F + s, &f);
      blas.syrk("L", "N", &b, &s, &minus, F + s, &f, &one, U, &b);
    }
  }
  for (I i = 0; i < I(diagonal.size()); ++i) grown[t] = std::max(grown[t], double(std::fabs(U[i * b + i] - diagonal[i])));
  if (!b) return true;
  if (p.kept != p.made)
    for (I i = 0; i < b; ++i) memmove(work + p.kept + i * b + i, U + i * b + i, sizeof(Real) * (b - i));
  return true;
}

/* Tasks on several threads, those with the most work first: all of them, each after those that it waits for, or only those that wait
   for none. False as soon as one is. */
template <class Work> static bool share(I tasks, const Task *task, bool all, int threads, Work work) {
  std::mutex lock;
  std::condition_variable news;
  std::vector<I> ready, waits(tasks);
  for (I t = 0; t < tasks; ++t)
    if (!(waits[t] = task[t].waits)) ready.push_back(t);
  I open = all ? tasks : I(ready.size());
  bool good = true;
  const auto run = [&](int thread) {
    std::unique_lock<std::mutex> mine(lock);
    while (open && good) {
      if (ready.empty()) {
        news.wait(mine);
        continue;
      }
      const auto most = std::max_element(ready.begin(), ready.end(), [&](I a, I b) { return task[a].work < task[b].work; });
      const I t = *most, next = task[t].next;
      ready.erase(most);
      mine.unlock();
      const bool well = work(thread, task[t]);
      mine.lock();
      good = good && well;
      --open;
      if (all && next >= 0 && !--waits[next]) ready.push_back(next);
      news.notify_all();
    }
  };
  std::vector<std::thread> others;
  try {
    for (int i = 1; i < threads; ++i) others.emplace_back(run, i);
  } catch (const std::system_error &) {  /* the system gives no more threads: fewer do it */
  }
  run(0);
  for (auto &other : others) other.join();
  return good;
}

/* Parts with 3 or 1 unknowns a node, on as many threads as there are of Blas; 1 when there is a factor. With `negative` and
   `grown`, of each part and zero before, there is only a count. */
extern "C" int factor(int each, I tasks, const Task *task, int threads, const Blas *blas, const Part *part, const I *children,
                      const int32_t *place, Real *panels, Real *work, I *negative, double *grown) {
  const auto run = [&](int thread, const Task &task) {
    for (I t = task.first; t < task.last; ++t)
      if (!(each == 3 ? eliminate<3> : eliminate<1>)(t, part, children, place, panels, work, negative, grown, blas[thread])) return false;
    return true;
  };
  return threads == 1 ? run(0, {0, task[tasks - 1].last, 0, 0, 0}) : share(tasks, task, true, threads, run);
}

/* X := L^-1 X for k right-hand sides, each unknown's k numbers together; `row` says where each node's unknowns stand. */
extern "C" void forward(I count, const I *chosen, const Part *part, const int32_t *boundary, const I *row, int k, const Real *panels,
                        Real *X, Real *scratch, const Blas *blas) {
  for (I i = 0; i < count; ++i) {
    const Part p = part[chosen[i]];
    const int s = p.s, b = p.b, f = s + b;
    const Real *F = panels + p.panel;
    Real *x = X + 3 * k * row[p.first];
    if (k == 1) blas->trsv("L", "N", "N", &s, F, &f, x, &unit);
    else blas->trsm("R", "L", "T", "N", &k, &s, &one, F, &f, x, &k);
    if (!b) continue;
    if (k == 1) blas->gemv("N", &b, &s, &one, F + s, &f, x, &unit, &none, scratch, &unit);
    else blas->gemm("N", "T", &k, &b, &s, &one, x, &k, F + s, &f, &none, scratch, &k);
    for (I j = 0; j < b / 3; ++j) {
      Real *to = X + 3 * k * row[boundary[p.boundary + j]];
      for (I d = 0; d < 3 * k; ++d) to[d] -= scratch[3 * k * j + d];
    }
  }
}

/* The same for one right-hand side and all parts, on several threads: what a task leaves behind at later nodes waits in `left`, for each
   boundary node its own place, until it is taken off in the order in which one thread would. */
extern "C" void forward_shared(I tasks, const Task *task, int threads, const Blas *blas, const Part *part, const int32_t *boundary,
                               const Real *panels, Real *x, Real *left) {
  const auto take = [&](const Part &p, int from, int to) {
    for (I j = from; j < to; ++j)
      for (int d = 0; d < 3; ++d) x[3 * I(boundary[p.boundary + j]) + d] -= left[3 * (p.boundary + j) + d];
  };
  const auto within = [&](const Part &p, const Task &task) {  /* boundary nodes that the same task eliminates */
    const int32_t *first = boundary + p.boundary, end = part[task.last - 1].first + part[task.last - 1].s / 3;
    return int(std::lower_bound(first, first + p.b / 3, end) - first);
  };
  const auto run = [&](int thread, const Task &task) {
    for (I t = task.first; t < task.last; ++t) {
      const Part p = part[t];
      const int s = p.s, b = p.b, f = s + b;
      const Real *F = panels + p.panel;
      blas[thread].trsv("L", "N", "N", &s, F, &f, x + 3 * p.first, &unit);
      if (b) blas[thread].gemv("N", &b, &s, &one, F + s, &f, x + 3 * p.first, &unit, &none, left + 3 * p.boundary, &unit);
      take(p, 0, within(p, task));
    }
    return true;
  };
  share(tasks, task, false, threads, run);
  for (I i = 0; i < tasks; ++i) {
    if (task[i].waits) run(0, task[i]);
    for (I t = task[i].first; t < task[i].last; ++t) take(part[t], within(part[t], task[i]), part[t].b / 3);
  }
}

/* x := L^-T x for one right-hand side: what waits for others, then on several threads what others wait for. */
extern "C" void backward(I tasks, const Task *task, int threads, const Blas *blas, const Part *part, const int32_t *boundary,
                         const Real *panels, Real *x) {
  const auto run = [&](int thread, const Task &task) {
    std::vector<Real> own;
    for (I t = task.last - 1; t >= task.first; --t) {
      const Part p = part[t];
      const int s = p.s, b = p.b, f = s + b;
      const Real *F = panels + p.panel;
      if (b) {
        own.resize(b);
        for (I j = 0; j < b / 3; ++j) memcpy(own.data() + 3 * j, x + 3 * I(boundary[p.boundary + j]), 3 * sizeof(Real));
        blas[thread].gemv("T", &b, &s, &minus, F + s, &f, own.data(), &unit, &one, x + 3 * p.first, &unit);
      }
      blas[thread].trsv("L", "T", "N", &s, F, &f, x + 3 * p.first, &unit);
    }
    return true;
  };
  if (threads == 1) run(0, {0, task[tasks - 1].last, 0, 0, 0});
  else {
    for (I i = tasks - 1; i >= 0; --i)
      if (task[i].waits) run(0, task[i]);
    share(tasks, task, false, threads, run);
  }
}

/* What eight right-hand sides, which a pass through the factor takes along, have at one unknown. */
typedef Real Row __attribute__((vector_size(8 * sizeof(Real)), aligned(sizeof(Real))));

/* C columns of a panel of f rows, from their diagonal down, with the rows Y there: Y := L^-1 Y for the first C, the rest less L times these. */
template <int C> static void down(const Real *F, I f, I below, Row *Y) {
  Row x[C];
  for (int j = 0; j < C; ++j) {
    x[j] = Y[j];
    for (int i = 0; i < j; ++i) x[j] -= F[i * f + j] * x[i];
    Y[j] = x[j] = x[j] * (1 / F[j * f + j]);
  }
  for (I r = C; r < below; ++r) {
    Row y = Y[r];
    for (int j = 0; j < C; ++j) y -= F[j * f + r] * x[j];
    Y[r] = y;
  }
}

/* The same columns with L^T: the first C rows of Y less those below times L^T, and L^-T of that. */
template <int C> static void up(const Real *F, I f, I below, Row *Y) {
  Row x[C];
  for (int j = 0; j < C; ++j) x[j] = Y[j];
  for (I r = C; r < below; ++r) {
    const Row y = Y[r];
    for (int j = 0; j < C; ++j) x[j] -= F[j * f + r] * y;
  }
  for (int j = C - 1; j >= 0; --j) {
    for (int i = j + 1; i < C; ++i) x[j] -= F[j * f + i] * x[i];
    Y[j] = x[j] = x[j] * (1 / F[j * f + j]);
  }
}

/* X := (L L^T)^-1 X for eight right-hand sides, whose numbers at an unknown are a row; Y has room for the rows
   of the largest part. */
extern "C" void solve_block(I parts, const Part *part, const int32_t *boundary, const Real *panels, Row *X, Row *Y) {
  for (I t = 0; t < parts; ++t) {
    const Part p = part[t];
    const I s = p.s, b = p.b, f = s + b;
    const Real *F = panels + p.panel;
    Row *x = X + 3 * p.first;
    memcpy(Y, x, s * sizeof(Row));
    memset(static_cast<void *>(Y + s), 0, b * sizeof(Row));
    I j = 0;
    for (; j + 8 <= s; j += 8) down<8>(F + j * f + j, f, f - j, Y + j);
    if (j + 4 <= s) down<4>(F + j * f + j, f, f - j, Y + j), j += 4;
    for (; j < s; ++j) down<1>(F + j * f + j, f, f - j, Y + j);
    memcpy(x, Y, s * sizeof(Row));
    for (j = 0; j < b; ++j) X[3 * I(boundary[p.boundary + j / 3]) + j % 3] += Y[s + j];
  }
  for (I t = parts - 1; t >= 0; --t) {
    const Part p = part[t];
    const I s = p.s, b = p.b, f = s + b;
    const Real *F = panels + p.panel;
    Row *x = X + 3 * p.first;
    memcpy(Y, x, s * sizeof(Row));
    for (I j = 0; j < b; ++j) Y[s + j] = X[3 * I(boundary[p.boundary + j / 3]) + j % 3];
    I j = s;
    for (; j % 4; --j) up<1>(F + (j - 1) * (f + 1), f, f - j + 1, Y + j - 1);
    if (j % 8) j -= 4, up<4>(F + j * (f + 1), f, f - j, Y + j);
    for (; j; j -= 8) up<8>(F + (j - 8) * (f + 1), f, f - j + 8, Y + j - 8);
    memcpy(x, Y, s * sizeof(Row));
  }
}
