// Each part of the kernel alone, on random numbers: checks its defining properties instead of a stored answer.
#include <cstdio>
#include <random>
#include <vector>

#include "../priced/row_space.hpp"
#include "../priced/secular.hpp"
#include "../priced/stage_search.hpp"
#include "lexicographic.hpp"

using namespace hqp;

static int failures = 0;
static long looks = 0;  // at the clock, which goes on by a nanosecond each

extern "C" int clock_gettime(clockid_t, timespec* t) {
  *t = {0, ++looks};
  return 0;
}

static std::mt19937 engine(7);

static double random_number() { return std::normal_distribution<double>()(engine); }

static void small(const char* what, double value, double bound = 1e-12) {
  if (std::fabs(value) <= bound) return;
  std::printf("%s: %.3g > %.3g\n", what, value, bound);
  ++failures;
}

static std::vector<double> random_vector(std::size_t size) {
  std::vector<double> v(size);
  for (double& x : v) x = random_number();
  return v;
}

template <class T>
struct Placed : T {  // a part that lives in an arena
  Arena arena;
  template <class... Sizes>
  explicit Placed(Sizes... sizes) {
    T::layout(arena, sizes...);
    arena.take();
    T::layout(arena, sizes...);
  }
};

static void null_space(int n, int m) {
  Placed<NullSpace> space(n);
  const auto A = random_vector(m * n);
  for (int i = 0; i < m; ++i) {
    std::vector<double> y(A.begin() + i * n, A.begin() + (i + 1) * n);
    space.project(y.data());
    space.add(y.data(), space.length(y.data()));
  }
  for (int j = m; j < n; ++j)
    for (int k = m; k <= j; ++k) {
      std::vector<double> a(n), b(n);
      a[j] = b[k] = 1.0;
      space.lift(a.data());
      space.lift(b.data());
      small("null space: orthonormal", dot_any(a.data(), b.data(), n) - (j == k));
      for (int i = 0; i < m && k == j; ++i) small("null space: leaves a row", dot_any(a.data(), &A[i * n], n));
    }
  for (int other = 0; other < 3; ++other) {  // the last row, then others in its place
    const auto row = random_vector(n);
    auto whole = row, tail = row, next = random_vector(n);
    space.project(whole.data());
    space.project_tail(tail.data());
    for (int j = space.rank; j < n; ++j) small("null space: tail of a row", tail[j] - whole[j]);
    --space.rank;
    space.project(next.data());
    space.add(next.data(), space.length(next.data()));
  }
}

// Rows with given singular values: find them, with and without a gap, and drop the least.
static void row_factor(const std::vector<double>& sigma) {
  const int n = 9, m = static_cast<int>(sigma.size());
  Placed<NullSpace> left(m), right(n), space(n);  // random orthogonal U and V
  for (auto* q : {static_cast<NullSpace*>(&left), static_cast<NullSpace*>(&right)})
    for (int i = 0; i < q->n; ++i) {
      std::vector<double> y = random_vector(q->n);
      q->project(y.data());
      q->add(y.data(), q->length(y.data()));
    }
  std::vector<double> rows(m * n);
  for (int k = 0; k < m; ++k) {
    std::vector<double> u(m), v(n);
    u[k] = v[k] = 1.0;
    left.lift(u.data());
    right.lift(v.data());
    for (int a = 0; a < m; ++a) add_any(&rows[a * n], v.data(), sigma[k] * u[a], n);
  }
  Placed<RowFactor> factor(n, m);
  Deadline none;
  none.start(0.0);
  factor.start(m, n);
  for (int a = 0; a < m; ++a) factor.set(a, &rows[a * n]);
  factor.reduce(space, n);
  small("row factor: rank", factor.rank - m, 0);
  factor.find_singular_values(none);
  int shortest = 0;
  for (int j = 1; j < m; ++j)
    if (factor.singular_value(j) < factor.singular_value(shortest)) shortest = j;
  small("row factor: least singular value", factor.singular_value(shortest) / sigma[m - 1] - 1.0, 1e-4);
  factor.drop(shortest, space, 0);
  space.rank = 0;
  factor.renew(m);
  for (int a = 0; a < m; ++a) factor.set(a, &rows[a * n]);
  factor.reduce(space, m - 1);
  std::vector<double> v(n);
  v[m - 1] = 1.0;
  right.lift(v.data());
  space.project(v.data());
  small("row factor: the direction dropped is free", space.length(v.data()) - 1.0, 1e-6);
}

static void nonnegative_least_squares() {
  const int n = 6, k = 10;
  for (int trial = 0; trial < 200; ++trial) {
    Placed<NonnegativeLeastSquares> part(n, k);
    auto C = random_vector(k * n), t = random_vector(n);
    for (int i = 0; i < n; ++i) C[3 * n + i] = C[2 * n + i] = i < 2 ? C[i] : 0.0;  // dependent columns, one twice
    part.count = k;
    for (int a = 0; a < k; ++a) {
      part.column[a] = &C[a * n];
      part.sign[a] = a % 2 ? -1.0 : 1.0;
    }
    const double length = part.solve(t.data(), n);
    std::vector<double> rest = t;
    for (int a = 0; a < k; ++a) add_any(rest.data(), &C[a * n], -part.mu[a] * part.sign[a], n);
    small("nnls: length of the rest", length - std::sqrt(dot_any(rest.data(), rest.data(), n)), 1e-10);
    for (int a = 0; a < k; ++a) {
      const double pull = part.sign[a] * dot_any(&C[a * n], rest.data(), n);
      small("nnls: multiplier below zero", smaller(part.mu[a], 0.0), 0.0);
      small("nnls: a column still pulls", larger(pull, 0.0), 1e-9);
      if (part.mu[a] > 0.0) small("nnls: slack and multiplier", pull, 1e-9);
    }
  }
}

// n variables, two dense levels of equalities, and the least norm.
struct Two {
  static constexpr int n = 8, m = 3;
  const int sizes[2] = {m, m};
  int blocks[5];
  Arena arena;
  ActiveSet set;
  Table& table = set.state.problem.table;
  Tableau& tableau = set.state.problem.tableau;
  Levels& levels = set.state.problem.levels;
  Updates& updates = set.state.problem.updates;
  std::vector<double> A = random_vector(2 * m * n), b = random_vector(2 * m);
  Level level[2];
  std::vector<std::int8_t> F = std::vector<std::int8_t>(n, kFree);

  Two() {
    set.layout(arena, n, 2, sizes, blocks, false);
    arena.take();
    set.layout(arena, n, 2, sizes, blocks, false);
    set.wire();
    for (int k = 0; k < 2; ++k) {
      level[k].A = &A[k * m * n];
      level[k].lower = level[k].upper = &b[k * m];
      level[k].m = m;
    }
    read_with(&b[0]);
    levels.choose_bias();
    tableau.recording = true;
  }

  // Level 0 as ranges from b to `upper`.
  void read_with(const double* upper) {
    level[0].upper = upper;
    Problem problem;
    problem.levels = level;
    problem.count = 2;
    if (!table.read(problem)) ++failures;
  }
  const double* factorise() {
    levels.factorise(table.kind, F.data());
    return tableau.x;
  }
};

static void factorisation() {
  for (int trial = 0; trial < 100; ++trial) {
    Two two;
    const double* x = two.factorise();
    Placed<NullSpace> space(Two::n);
    for (int r = 0; r < 2 * Two::m; ++r) {
      const double* a = &two.A[r * Two::n];
      small("tableau: a row", dot_any(a, x, Two::n) - two.b[r], 1e-9);
      std::vector<double> y(a, a + Two::n);
      space.project(y.data());
      space.add(y.data(), space.length(y.data()));
    }
    std::vector<double> y(x, x + Two::n);
    space.project(y.data());
    small("tableau: not the shortest", space.length(y.data()), 1e-9);
  }
}

// Fix a variable before level 1 by an update, or first of all by a factorisation: both give one point.
static void updates() {
  int updated = 0;
  for (int trial = 0; trial < 100; ++trial) {
    Two two;
    two.factorise();
    const double value = 0.3;
    if (!two.updates.rewind(1) || !two.updates.hold(0, value)) continue;
    ++updated;
    two.updates.resume(two.table.kind);
    const std::vector<double> x(two.tableau.x, two.tableau.x + Two::n);
    two.table.hi[0] = value;
    two.F[0] = kUpper;
    const double* fresh = two.factorise();
    for (int i = 0; i < Two::n; ++i) small("tableau: updated and fresh", x[i] - fresh[i], 1e-8);
  }
  if (updated < 90) small("tableau: updates refused", 100 - updated, 10);
}

// Rows at, inside and beyond their bounds: rows beyond enter the working set, rows well inside leave, rows at a bound
// stay.
static void working_set() {
  const int n = 3;
  Two two;
  std::vector<double> upper(two.b.begin(), two.b.begin() + Two::m);
  for (double& u : upper) u += 0.5;
  two.read_with(upper.data());
  WorkingSet& set = two.set.state.problem.set;
  set.start(two.table, false);
  for (int r = 0; r < 2 * n; ++r) small("working set: cold", set.W[r] - (r < n ? kFree : kEquality), 0);
  const auto empty = set.hash(two.table);
  std::vector<double> v(two.table.rows);
  for (int r = 0; r < n; ++r) v[r] = upper[r] + (r - 1);  // inside, at the bound, beyond
  v[0] = 0.5 * (two.b[0] + upper[0]);
  set.W[0] = set.W[1] = kUpper;
  set.changes.start();
  set.sort(two.table, v.data(), 1.0);
  const std::int8_t sides[] = {kFree, kUpper, kUpper};
  for (int r = 0; r < n; ++r) small("working set: side", set.W[r] - sides[r], 0);
  if (set.changes.known) small("working set: sorted without notice", 1.0);
  if (set.hash(two.table) == empty) small("working set: two of one hash", 1.0);
  upper[1] = upper[2] = kInfinity;
  two.read_with(upper.data());
  set.start(two.table, true);
  for (int r = 1; r < n; ++r) small("working set: at a bound that is gone", set.W[r], 0);
}

// Step from a point of the box: x stays inside, the level above does not rise, and the blocking row is at its bound.
static void step() {
  int blocked = 0;
  for (int trial = 0; trial < 100; ++trial) {
    Two two;
    EqualityProblem& problem = two.set.state.problem;
    Point& point = two.set.state.point;
    for (int i = 0; i < Two::n; ++i) {
      two.table.lo[i] = -0.2;
      two.table.hi[i] = 0.2;
    }
    two.table.boxed = true;
    Step step(problem, point);
    Arena arena;
    step.layout(arena, Two::n, two.table.rows);
    arena.take();
    step.layout(arena, Two::n, two.table.rows);
    problem.set.start(two.table, false);
    problem.solve();
    for (int i = 0; i < Two::n; ++i) point.x[i] = 0.0;
    two.table.product(point.x, point.v);
    const double before = two.table.outside(0, point.v);
    const bool whole = step.advance();
    small("step: the top level rises", larger(two.table.outside(0, point.v) - before, 0.0));
    bool inside = true;
    for (int i = 0; i < Two::n; ++i) {
      if (!whole) small("step: out of the box", larger(std::fabs(point.x[i]) - 0.2, 0.0), 0);
      inside = inside && std::fabs(problem.tableau.x[i]) <= 0.2;
      if (step.length < 1.0) small("step: not straight", point.x[i] - step.length * problem.tableau.x[i]);
      if (problem.set.F[i]) small("step: held off its bound", std::fabs(point.x[i]) - 0.2, 0);
      blocked += problem.set.F[i] != kFree;
    }
    if (whole != inside) small("step: blocked by nothing, or by something unseen", 1.0);
  }
  if (blocked < 50) small("step: nothing blocks", 50 - blocked, 0);
}

// Ranges above equalities: solve level by level from zero; only the point of the active set passes the certificate.
static void level_search() {
  for (int trial = 0; trial < 100; ++trial) {
    Two two;
    std::vector<double> upper(two.b.begin(), two.b.begin() + Two::m);
    for (double& u : upper) u += 0.5;
    two.read_with(upper.data());
    two.set.solve(Options{kSeen, kMet, kMet});
    Placed<Conditions> at(Two::n, two.table.rows, Two::n, two.table.blocks);
    at.wire(&two.table);
    Judge judge(at);
    LevelSearch search(at, judge);
    Arena arena;
    search.layout(arena, Two::n, two.table.rows);
    arena.take();
    search.layout(arena, Two::n, two.table.rows);
    std::vector<double> x(Two::n);
    if (!search.search(x.data())) small("level search: not found", 1.0);
    small("level search: points", search.solves, 30);
    const double* optimum = two.set.state.point.x;
    for (int i = 0; i < Two::n; ++i) small("level search: another point", at.x[i] - optimum[i], 1e-8);
    x.assign(optimum, optimum + Two::n);
    if (!judge.judge(x.data())) small("judge: refuses the optimum", judge.gap);
    x[trial % Two::n] += 1e-3;
    if (judge.judge(x.data())) small("judge: passes another point", 1.0);
  }
}

// Rows of lengths 1 to 1e-8, two parallel and one zero: the residual is orthogonal to every row up to rounding. The
// gradient along a further column, of the unsorted rows, is B' rhs.
static void row_sorted_least_squares() {
  const int m = 9, f = 6;
  for (int trial = 0; trial < 100; ++trial) {
    Placed<RowSortedLeastSquares> part(f + 1, m);
    auto A = random_vector(m * f), rhs = random_vector(m), further = random_vector(m);
    for (int j = 0; j < f; ++j) A[5 * f + j] = A[4 * f + j];
    for (int j = 0; j < f; ++j) A[2 * f + j] = 0.0;
    double along = 0.0;
    for (int i = 0; i < m; ++i) {
      const double length = std::pow(10.0, -i);
      rhs[i] *= length;
      part.set(i, &A[i * f], f, length, rhs[i], &further[i], 1);
      for (int j = 0; j < f; ++j) A[i * f + j] *= length;
      along += length * further[i] * rhs[i];
    }
    const double reach = part.solve(m, f, 0.0, 1);
    double y[f], more, left;
    part.gradient(m, f, 1, 1.0, 0.0, 0.0, 0.0, y, &more);
    small("row-sorted least squares: along a further column", more - along, 1e-13);
    for (int j = 0; j < f; ++j) {
      for (int i = 0; i < m; ++i) y[j] -= A[i * f + j] * rhs[i];
      small("row-sorted least squares: along a column", y[j], 1e-13);
    }
    part.gradient(m, f, 1, 1.0, kInfinity, 0.0, 0.0, y, &left);  // every met row counts as rounding
    for (int i = 0; i < m; ++i) left -= std::pow(10.0, -i) * further[i] * (rhs[i] - dot_any(&A[i * f], part.z, f));
    small("row-sorted least squares: along a further column, what is left", left, 1e-13);
    std::vector<double> gradient(f);
    double taken = 0.0;
    for (int i = 0; i < m; ++i) {
      const double w = dot_any(&A[i * f], part.z, f) - rhs[i];
      taken += rhs[i] * rhs[i] - w * w;
      add_any(gradient.data(), &A[i * f], w, f);
    }
    for (int j = 0; j < f; ++j) small("row-sorted least squares: gradient", gradient[j], 1e-13);
    small("row-sorted least squares: what is taken away", reach * reach - taken);
  }
}

static void level_along_step() {
  for (int trial = 0; trial < 200; ++trial) {
    const int m = 7;
    auto lower = random_vector(m), upper = random_vector(m), v = random_vector(m), change = random_vector(m);
    for (int r = 0; r < m; ++r) upper[r] = lower[r] + std::fabs(upper[r]);
    Table table;
    table.lower = lower.data();
    table.upper = upper.data();
    Block level{};
    level.end = m;
    const LevelAlongStep along{table, level, v.data(), change.data()};
    const auto value = [&](double alpha) {
      double square = 0.0;
      for (int r = 0; r < m; ++r) square += std::pow(table.beyond(r, v[r] + alpha * change[r]), 2);
      return square;
    };
    const double alpha = 2.0, best = value(along.lowest(alpha, 1e-12));
    for (int i = 0; i <= 100; ++i)
      small("level along step: lower elsewhere", larger(best - value(alpha * i / 100), 0.0));
  }
}

// The first `picks` of the rows pick one coordinate each.  free: divisors of the last coordinates.
static void row_space(int picks, double free) {
  const int n = 7, ld = padded(n), m = 4;
  RowSpace space(n, ld, 1e-11);
  std::vector<double> grade(n, 1.0);
  for (int j = n - 2; j < n; ++j) grade[j] = free;
  std::vector<std::vector<double>> W;
  for (int i = 0; i < m; ++i) {
    auto row = random_vector(ld);
    const int only = i < picks ? (2 * i + 1) % n : -1;
    if (only >= 0) {
      std::fill(row.begin(), row.end(), 0.0);
      row[only] = i % 2 ? -1.0 : 1.0;
    }
    const double size = std::sqrt(dot_any(row.data(), row.data(), n));
    for (int j = 0; j < n; ++j) row[j] /= grade[j];
    auto begun = row;  // already rotated by the first two rows
    const int turned = i == 3 ? 2 : 0;
    space.turn(begun.data(), n, 0, turned);
    const bool added = only >= 0 ? space.picks() && space.pick(only, row[only])
                                 : space.add(begun.data(), n, grade.data(), size, 0.0, turned);
    if (!added) ++failures;
    if (only >= 0 && space.pick(only, row[only])) small("row space: a coordinate picked twice", 1.0);
    W.push_back(row);
  }
  if (space.add(W[1].data(), n, grade.data(), 1.0, 0.0)) small("row space: a dependent row added", 1.0);
  auto together = random_vector(5 * ld), alone = together;
  space.turn(together.data(), ld, 5, ld, 1, m);
  for (int i = 0; i < 5; ++i) {
    space.turn(&alone[i * ld], ld, 1, m);
    for (int j = 0; j < ld; ++j) small("row space: rows turned together", together[i * ld + j] - alone[i * ld + j]);
  }
  const auto b = random_vector(m), mu = random_vector(m);
  std::vector<double> y(ld), g(ld), part(m), lambda(m);
  space.meet(b.data(), part.data());
  space.join(y.data(), part.data());
  space.turn_back(y.data(), n);
  for (int i = 0; i < m; ++i) {
    small("row space: W y = b", dot_any(W[i].data(), y.data(), n) - b[i]);
    add_any(g.data(), W[i].data(), mu[i], n);
  }
  space.turn(g.data(), n);
  space.split(g.data(), part.data());
  space.multipliers(part.data(), lambda.data());
  for (int i = 0; i < m; ++i) small("row space: multipliers", lambda[i] - mu[i], 1e-11);
  space.turn(y.data(), n);
  space.split(y.data(), part.data());
  for (int j = 0; j < n; ++j) small("row space: not the shortest", y[j]);
}

// At the minimum of ||M z - e|| + c/2 |z|^2: M'u + c z = 0 with u = w / ||w||, or |u| <= 1 where w = 0.
static void secular_equation() {
  int met = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const bool many = trial % 2;  // many rows: Cholesky factors, if the level is far from met
    const int n = many ? 14 : 6, ld = padded(n), m = many ? 9 : 3;
    auto M = random_vector(m * ld), e = random_vector(m);
    const auto rows = M;
    const auto target = e;
    const double price = std::pow(10.0, trial % 5 - 3);
    Secular part;
    part.solve(M.data(), ld, n, e.data(), m, price);
    std::vector<double> z(ld), u(m), w(m);
    for (int i = 0; i < m; ++i) add_any(z.data(), &M[i * ld], part.weight(i), n);
    part.direction(price, u.data());
    double length = 0.0, norm = 0.0;
    for (int i = 0; i < m; ++i) {
      w[i] = dot_any(&rows[i * ld], z.data(), n) - target[i];
      length += u[i] * u[i];
      norm += w[i] * w[i];
    }
    length = std::sqrt(length);
    norm = std::sqrt(norm);
    met += part.met();
    if (part.met()) {
      small("secular: not met", norm, 1e-9);
      small("secular: |u| > 1", larger(length - 1.0, 0.0));
    } else {
      for (int i = 0; i < m; ++i) small("secular: u = w / |w|", u[i] - w[i] / norm, 1e-6);
    }
    for (int j = 0; j < n; ++j) {
      double g = price * z[j];
      for (int i = 0; i < m; ++i) g += rows[i * ld + j] * u[i];
      small("secular: gradient", g, 1e-9);
    }
  }
  if (met < 20 || met > 180) small("secular: one kind of case alone", met, 0);
}

// Distance of rows in motion coordinates from other rows, for every width of the last columns.
static void rows_apart() {
  for (int n = 1; n < 20; ++n) {
    const int m = 3;
    Coordinates at(n, 1e-7);
    auto E = random_vector(n);
    for (double& e : E) e = 1.0 + std::fabs(e);
    at.set(E.data(), nullptr, 0);
    const auto A = random_vector(m * n), B = random_vector(m * n);
    double sum = 0.0;
    for (int i = 0; i < m * n; ++i) sum += (A[i] / E[i % n] - B[i]) * (A[i] / E[i % n] - B[i]);
    small("coordinates: rows apart", at.apart(A.data(), B.data(), m) - sum, 1e-12 * sum);
  }
}

// Start at a vertex of nearly dependent rows, some missed by rounding: no row leaves, and the value does not rise. A
// search that is cut again and again goes on where it ended.
static void stage_search() {
  for (int trial = 0; trial < 300; ++trial) {
    const int n = 6, pairs = 4, m = 4, count = 2 * pairs + 2 * n, ld = padded(n);
    const double price = 0.01;
    Coordinates at(n, 1e-7);
    at.set(nullptr, nullptr, 0);
    StageRows rows(n, count, count, ld);
    rows.begin(at, n);
    std::vector<double> y(ld), T(static_cast<std::size_t>(m) * ld), t(m), size(m), C(2 * pairs * n);
    for (int j = 0; j < n; ++j) y[j] = larger(-1.0, smaller(1.0, 0.3 * random_number()));
    StageRow row;
    row.number = 0;
    for (int i = 0; i < 2 * pairs; ++i, ++row.number) {
      double* c = &C[i * n];
      for (int j = 0; j < n; ++j) c[j] = i % 2 ? c[j - n] + 1e-9 * random_number() : random_number();
      const double length = row.size = std::sqrt(dot_any(c, c, n));
      row.a = c, row.lower = -INFINITY, row.upper = dot_any(c, y.data(), n) + 3e-10 * random_number() * length;
      rows.add(row);
    }
    row.a = nullptr, row.size = 1.0;
    for (int j = 0; j < n; ++j) {
      row.only = j, row.lower = -1.0, row.upper = 1.0;
      rows.add(row), ++row.number;
      row.lower = y[j] - 0.01 * std::fabs(random_number()), row.upper = INFINITY;
      rows.add(row), ++row.number;
    }
    for (int i = 0; i < m; ++i) {
      for (int j = 0; j < n; ++j) T[i * ld + j] = random_number();
      t[i] = 10.0 * random_number();
      size[i] = std::sqrt(dot_any(&T[i * ld], &T[i * ld], n));
    }
    const auto worth = [&] {
      double square = 0.0, moved = 0.0;
      for (int i = 0; i < m; ++i) {
        const double w = dot_any(&T[i * ld], y.data(), n) - t[i];
        square += w * w;
      }
      for (int j = 0; j < n; ++j) moved += y[j] * y[j];
      return std::sqrt(square) + 0.5 * price * moved;
    };
    const double before = worth();
    const std::vector<double> start = y;
    Deadline deadline;
    StageSearch search(count, n, n, count + n, 1e-8, 1e-11, deadline);
    std::vector<int> working;
    int iterations = 0;
    const Aim aim{T.data(), t.data(), size.data(), ld, m, price};
    small("stage: not reached", !search.solve(rows, n, aim, y.data(), working, iterations));
    small("stage: value rises", larger(worth() - before, 0.0), 1e-6);
    for (int i = 0; i < count; ++i) {
      const double value = rows[i].value(y.data(), y.data(), n);
      small("stage: row left", larger(larger(rows[i].lower - value, value - rows[i].upper), 0.0) / rows[i].size, 2e-9);
    }
    const double least = worth();
    std::vector<double> near;  // ends of searches that are cut after a few looks at the clock
    working.clear();
    int cuts = 0;
    for (bool reached = false; !reached && cuts < 100; ++cuts) {
      y = start;
      deadline.start(20e-9);
      reached = search.solve(rows, n, aim, y.data(), working, iterations, near);
      near.assign(y.begin(), y.begin() + n);
    }
    small("stage: cut again and again", cuts == 100);
    small("stage: value after cuts", worth() - least, 1e-6);
  }
}

int main() {
  null_space(9, 5);
  null_space(24, 20);
  row_factor({1.0, 0.7, 0.3, 1e-8, 3e-11});
  row_factor({1.0, 1e-2, 1e-4, 5e-7, 1e-8, 2e-10});
  nonnegative_least_squares();
  factorisation();
  updates();
  working_set();
  step();
  level_search();
  row_sorted_least_squares();
  level_along_step();
  for (int picks : {0, 2, 4})
    for (double free : {1.0, 1e-7}) row_space(picks, free);
  secular_equation();
  stage_search();
  rows_apart();
  std::printf("%d failures\n", failures);
  return failures != 0;
}
