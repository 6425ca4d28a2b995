// One workspace: everything allocated at construction, nothing in solve.
#pragma once

#include "active_set.hpp"
#include "kernel.hpp"
#include "soft_choice.hpp"
#include "violated.hpp"

namespace hqp {
inline namespace HQP_ISA {

class Lexicographic final : public Kernel {
 public:
  Lexicographic(int n, int levels, const int* m, bool metric) : n_(n), choice_(n, sum(levels, m), metric), x_(n) {
    int* sizes = static_cast<int*>(std::malloc(sizeof(int) * (static_cast<std::size_t>(levels) + 3)));
    if (!sizes) throw std::bad_alloc();
    set_.layout(arena_, n, levels, m, sizes, metric);
    arena_.take();
    set_.layout(arena_, n, levels, m, sizes, metric);
    std::free(sizes);
    set_.wire();
  }

  void reset(bool plain) override { set_.forget(plain); }
  void keep(CarryOver& warm) override { set_.keep(warm); }

  void solve(const Problem& problem, const Options& options, Answer& answer) override {
    solved_ = false;
    if (!state_.problem.table.read(problem)) {
      set_.forget(false);
      answer.outcome = Outcome::invalid;
      return;
    }
    set_.solve(options);
    if (set_.judged && state_.outcome == Outcome::optimal) {
      const int free = choice_.unseen(problem, options.softness);
      set_.doubt_rows(choice_.directions(), free);
    }
    solved_ = set_.judged == 0 && state_.outcome <= Outcome::rank_uncertain;
    answer.outcome = state_.outcome;
    answer.iterations = state_.iterations;
    answer.factorisations = state_.problem.factorisations;
    answer.judged = set_.judged;
    std::copy(state_.point.x, state_.point.x + n_, x_.begin());
    if (answer.hard) std::copy(x_.begin(), x_.end(), answer.hard);
    const bool ended = answer.outcome <= Outcome::rank_uncertain;
    const bool chosen = ended && choice_.take(problem, options.softness, x_.data());
    if (chosen && choice_.unclear()) answer.outcome = Outcome::rank_uncertain;
    const double* values = state_.values();
    if (chosen) state_.problem.table.product(x_.data(), state_.point.v), values = state_.point.v;
    state_.point.current = state_.point.current && !chosen;
    report(problem, values, chosen ? allowed() : nullptr, answer);
    if (answer.multipliers) multipliers(problem, answer);
  }

  void choose(const Problem& problem, const Options& options, double* x, bool hard) override {
    choice_.take(problem, options.softness, x, hard);
  }
  const double* unseen(const Problem& problem, const Options& options, int& count) override {
    count = choice_.unseen(problem, options.softness);
    return choice_.directions();
  }
  const double* allowed() override { return choice_.allowed(); }

  bool write_multipliers(const Problem& problem, Answer& answer) override {
    if (solved_) multipliers(problem, answer);
    return solved_;
  }

 private:
  Arena arena_;
  ActiveSet set_;
  SearchState& state_ = set_.state;
  int n_;
  SoftChoice choice_;
  std::vector<double> x_;  // (n,) the answer
  bool solved_ = false;

  static int sum(int levels, const int* m) {
    int total = 0;
    for (int k = 0; k < levels; ++k) total += m[k];
    return total;
  }

  // Slack and activity of every row from (problem, x) alone.  values: of the table's rows at x.  allowed: by how much a
  // row of the constraints may be exceeded, or null.
  void report(const Problem& problem, const double* values, const double* allowed, Answer& answer) {
    const Table& t = state_.problem.table;
    for (int i = 0; i < n_; ++i) answer.x[i] = x_[i];
    int out = 0;
    bool off = false;
    for (int k = 0; k < problem.count; ++k) {
      const Level& level = problem.levels[k];
      const bool constraint = k < problem.constraints;
      const double* value = k >= t.first ? values + t.block[k - t.first].begin : nullptr;
      for (int i = 0; i < level.m; ++i, ++out) {
        const double l = level.lower[i], u = level.upper[i];
        const double a = value ? value[i] : box_value(level, i);
        const double w = a > u ? a - u : a < l ? a - l : 0.0;
        answer.slack[out] = w;
        if (l == u) answer.active[out] = kEquality;
        else if (u < kInfinity && a >= u - kActive * (1.0 + std::fabs(u))) answer.active[out] = kUpper;
        else answer.active[out] = l > -kInfinity && a <= l + kActive * (1.0 + std::fabs(l)) ? kLower : kFree;
        if (constraint && w != 0.0 && !off) off = violated(level, i, w, allowed ? allowed[out] : 0.0, x_.data(), n_);
      }
    }
    answer.unsure = set_.settled && answer.outcome == Outcome::optimal;
    if (!off || answer.outcome > Outcome::rank_uncertain) return;
    answer.unsure = answer.unsure || answer.outcome == Outcome::rank_uncertain;
    answer.outcome = Outcome::constraints_violated;
  }

  double box_value(const Level& level, int i) const {
    const Table& t = state_.problem.table;
    return level.A ? t.single_scale[i] * x_[t.single_index[i]] : level.scale[i] * x_[level.index[i]];
  }

  // lambda_kj of the last working set: the adjoint sweep of level k, and the remaining gradient on the box.
  void multipliers(const Problem& problem, Answer& answer) {
    const Table& t = state_.problem.table;
    Multipliers& a = state_.multipliers;
    const double span = t.span(state_.problem.tableau.x);
    double* out = answer.multipliers;
    int before = 0;
    for (int k = 0; k < problem.count; ++k) {
      const int m = problem.levels[k].m, own = k - t.first;
      for (int i = 0; i < before + m; ++i) out[i] = 0.0;
      if (own >= 0) {
        const double length = a.slack(own, state_.problem.set.W, state_.values(), span);
        if (length > 0.0) {
          a.gradient(own);
          a.sweep_above(own, a.lambda);
          a.refine(own);
          int at = before;
          for (int j = own - 1; j >= 0; --j) {
            const Block& b = t.block[j];
            at -= b.end - b.begin;
            for (int r = b.begin; r < b.end; ++r) out[at + r - b.begin] = a.lambda[r];
          }
          if (t.first) box_multipliers(problem.levels[0], out);
        }
      }
      for (int i = 0; i < m; ++i) out[before + i] = answer.slack[before + i];
      out += before + m;
      before += m;
    }
  }

  static bool meets(double bound, double value) {
    return std::fabs(value - bound) <= kActive * (1.0 + std::fabs(bound));
  }

  // A fixed variable's multiplier goes to the first row that holds it.
  void box_multipliers(const Level& level, double* out) {
    const Table& t = state_.problem.table;
    double* mu = state_.multipliers.mu;
    for (int i = 0; i < level.m; ++i) {
      const int j = static_cast<int>(level.A ? t.single_index[i] : level.index[i]);
      const double s = level.A ? t.single_scale[i] : level.scale[i];
      if (!state_.problem.set.F[j] || mu[j] == 0.0) continue;
      if (!meets(level.lower[i], s * state_.point.x[j]) && !meets(level.upper[i], s * state_.point.x[j])) continue;
      out[i] = mu[j] / s;
      mu[j] = 0.0;
    }
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
