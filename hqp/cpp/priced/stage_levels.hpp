// The stages of a hierarchy with prices (docs/calm.md): which levels the exact answer settles, a stage for each of the
// others, and what each hands down. Everything is allocated once.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "account.hpp"
#include "coordinates.hpp"
#include "stage_search.hpp"
#include "stages.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr double kMet = 1e-10;         // ||w|| below this fraction of a level's terms is zero
constexpr double kZero = 1e-12;        // a row's slack below this fraction of its level's terms is zero
constexpr double kSettled = 1e-9;      // rows hold at a level's point of least motion, relative to 1 + |value|
constexpr double kSlackMotion = 1e-5;  // slacks of inequality rows count this much as motion

class StageLevels final : public PricedStages {
 public:
  StageLevels(int n, int levels, const int* m, const bool* priced)
      : n_(n),
        level_(levels),
        handed_(levels),
        priced_(priced, priced + levels),
        warm_(levels),
        at_(n),
        ends_(levels),
        accounts_(n),
        search_(total(levels, m) + levels, n + most(levels, m)) {
    last_ = -1;
    for (int k = 0; k < levels; ++k) {
      level_[k].m = m[k];
      if (priced[k]) last_ = k;
    }
    const int variables = n + most(levels, m);
    rows_.room(total(levels, m) + levels, padded(variables));
    T_.resize(static_cast<std::size_t>(most(levels, m)) * padded(variables));
    t_.resize(most(levels, m));
    y_.resize(padded(variables));
    a_.resize(n);
    x_.resize(n);
    w_.resize(most(levels, m));
    gram_.resize(static_cast<std::size_t>(total(levels, m)) * (total(levels, m) + 1));
    B_.resize(static_cast<std::size_t>(total(levels, m)) * padded(n));
    b_.resize(total(levels, m));
    z_.resize(total(levels, m));
    lambda_.resize(total(levels, m));
    kept_.resize(total(levels, m));
    side_.resize(total(levels, m));
  }

  PricedLevel* levels() override { return level_.data(); }
  Handed* handed() override { return handed_.data(); }
  int iterations() const override { return iterations_; }
  bool ended() const override { return ended_; }
  void reset() override {
    for (auto& set : warm_) set.clear();
  }

  void bind(const double* prices, const double* shares, const double* F, const double* f, int r,
            const double* guard) override {
    prices_ = prices;
    shares_ = shares;
    F_ = F;
    f_ = f;
    r_ = r;
    guard_ = guard != nullptr;
    guard_floor_ = guard ? *guard : 0.0;
  }

  void account(const AccountRows& rows, double* numbers, double* shares, double* worth) override {
    if (last_ < 0) at_.set(F_, f_, r_);
    accounts_.run(level_, handed_, at_, prices_, ends_, rows_.C.data(), rows_.ld, row_of_, rows, numbers, shares,
                  worth);
  }

  int solve(const double* x, double* stages, double* last) override {
    iterations_ = 0;
    ended_ = true;
    row_of_.clear();
    for (StageEnd& end : ends_) end.known = false;
    at_.set(F_, f_, r_);
    const int first = first_unsettled(x);
    if (first < 0) return first;
    const int levels = static_cast<int>(level_.size());
    std::fill(stages, stages + static_cast<std::size_t>(levels) * n_, std::numeric_limits<double>::quiet_NaN());
    rows_.count = 0;
    for (int k = 0; k < first; ++k) {
      if (prices_[k] > 0.0) hand_down(k, nullptr);
      else hold(k, x);
      take(k, prices_[k] > 0.0);
    }
    at_.motion(x, y_.data());
    bool met = true;
    for (int k = first; k <= last_; ++k) {
      const bool priced = prices_[k] > 0.0;
      stage(k, priced ? prices_[k] : 0.0);
      at_.point(y_.data(), x_.data());
      if (priced) {
        if (hand_down(k, x_.data())) met = false;
        std::copy(x_.begin(), x_.end(), stages + static_cast<std::size_t>(k) * n_);
      } else {
        hold(k, x_.data());
      }
      take(k, priced);
    }
    if (met && ended_) return -1;  // every level hands down its rows as they are
    std::copy(x_.begin(), x_.end(), last);
    return first;
  }

  bool describe(const double* x, int constraints, double activity, double violation, double* slacks,
                std::int8_t* marks) override {
    bool violated = false;
    for (std::size_t k = 0; k < level_.size(); ++k) {
      const PricedLevel& level = level_[k];
      for (int i = 0; i < level.m; ++i, ++slacks, ++marks) {
        const double low = level.lower[i], high = level.upper[i];
        const double value =
            level.A ? dot_any(level.A + static_cast<std::size_t>(i) * n_, x, n_) : level.scale[i] * x[level.index[i]];
        *slacks = slack(value, low, high);
        const bool at_upper = value >= high - activity * (1.0 + std::abs(high));
        const bool at_lower = value <= low + activity * (1.0 + std::abs(low));
        *marks = low == high ? 2 : at_upper ? 1 : at_lower ? -1 : 0;
        if (static_cast<int>(k) < constraints && *slacks != 0.0)
          violated = violated || std::abs(*slacks) > violation * (1.0 + std::abs(*slacks > 0.0 ? high : low));
      }
    }
    return violated;
  }

 private:
  static int total(int levels, const int* m) {
    int sum = 0;
    for (int k = 0; k < levels; ++k) sum += m[k];
    return sum;
  }
  static int most(int levels, const int* m) {
    int found = 1;
    for (int k = 0; k < levels; ++k) found = std::max(found, m[k]);
    return found;
  }

  const double* row(const PricedLevel& level, int i) {
    if (level.A) return level.A + static_cast<std::size_t>(i) * n_;
    std::fill(a_.begin(), a_.end(), 0.0);
    a_[level.index[i]] = level.scale[i];
    return a_.data();
  }

  static double slack(double value, double lower, double upper) {
    return value > upper ? value - upper : value < lower ? value - lower : 0.0;
  }

  static bool left_out(const PricedLevel& level, int i) {
    return level.lower[i] == -INFINITY && level.upper[i] == INFINITY;
  }

  // The first priced level whose point of least motion does not show that x settles it: rows of the levels down to it
  // held as equalities, and inequality rows that this point would violate held at their bound, if their multipliers
  // have the right sign. A Cholesky factor of the rows' Gram matrix grows with the levels.
  int first_unsettled(const double* x) {
    count_ = 0;
    for (int k = 0; k <= last_; ++k) {
      const PricedLevel& level = level_[k];
      const int start = count_;
      const bool priced = prices_[k] > 0.0;
      for (int i = 0; i < level.m; ++i) {
        if (left_out(level, i)) continue;
        const bool equal = level.lower[i] == level.upper[i];
        const double* a = row(level, i);
        double target = level.lower[i];
        if (!priced) {  // an exact level keeps the values that it has at x
          const double value = dot_any(a, x, n_);
          const bool off = std::abs(slack(value, level.lower[i], level.upper[i])) > kMet * (1.0 + std::abs(value));
          if (!equal && !off) continue;
          target = value;
        } else if (!equal) {
          continue;
        }
        if (!factor(a, target, 0) || (priced && !kept_[count_ - 1])) return next_priced(k);
      }
      if (priced && !settled(k, x, start)) return k;
    }
    return -1;
  }

  // Whether level k, whose own equality rows begin at `start`, is met for its price at the point of least motion.
  bool settled(int k, const double* x, int start) {
    const int end = count_, ld = padded(n_), width = static_cast<int>(b_.size()) + 1;
    for (int round = 0; round < 5; ++round) {
      for (int j = count_ - 1; j >= 0; --j) {
        double s = z_[j];
        for (int i = j + 1; i < count_; ++i) s -= gram_[static_cast<std::size_t>(i) * width + j] * lambda_[i];
        lambda_[j] = kept_[j] ? s / gram_[static_cast<std::size_t>(j) * width + j] : 0.0;
      }
      const double length = std::sqrt(dot_any(&lambda_[start], &lambda_[start], end - start));
      if (!(prices_[k] * length <= 1.0)) return false;
      std::fill(y_.begin(), y_.end(), 0.0);
      for (int j = 0; j < count_; ++j) add_any(y_.data(), &B_[static_cast<std::size_t>(j) * ld], lambda_[j], n_);
      at_.point(y_.data(), x_.data());
      const int before = count_;
      for (int l = 0; l <= k; ++l)
        if (!hold_violated(l, x, prices_[l] > 0.0)) return false;
      if (count_ > before) continue;
      for (int j = 0; j < count_; ++j)
        if (side_[j] * lambda_[j] > 0.0) return false;
      return true;
    }
    return false;
  }

  // One more row of the factor; false where it depends on the others and disagrees with them.
  bool factor(const double* a, double target, int side) {
    const int ld = padded(n_), width = static_cast<int>(b_.size()) + 1, i = count_;
    if (i == static_cast<int>(b_.size())) return false;
    double* b = &B_[static_cast<std::size_t>(i) * ld];
    at_.row(a, b);
    b_[i] = target - dot_any(a, at_.still(), n_);
    double* g = &gram_[static_cast<std::size_t>(i) * width];
    const double square = dot_any(b, b, n_);
    double pivot = square, z = b_[i];
    for (int j = 0; j < i; ++j) {
      const double* h = &gram_[static_cast<std::size_t>(j) * width];
      g[j] = kept_[j] ? (dot_any(b, &B_[static_cast<std::size_t>(j) * ld], n_) - dot_any(g, h, j)) / h[j] : 0.0;
      pivot -= g[j] * g[j];
      z -= g[j] * z_[j];
    }
    kept_[i] = pivot > 1e-10 * square;
    side_[i] = side;
    g[i] = kept_[i] ? std::sqrt(pivot) : 1.0;
    z_[i] = kept_[i] ? z / g[i] : 0.0;
    ++count_;
    return kept_[i] || std::abs(z) <= kSettled * (1.0 + std::abs(b_[i]));
  }

  int next_priced(int k) const {
    while (!(prices_[k] > 0.0)) ++k;
    return k;
  }

  // Inequality rows that x_ violates, an exact level's beyond what x does, are held at their bound from now on; false
  // where an equality row is off, or the bound cannot be reached.
  bool hold_violated(int l, const double* x, bool priced) {
    const PricedLevel& level = level_[l];
    for (int i = 0; i < level.m; ++i) {
      if (left_out(level, i)) continue;
      const bool single = !level.A;
      const double* a = single ? nullptr : level.A + static_cast<std::size_t>(i) * n_;
      const double value = single ? level.scale[i] * x_[level.index[i]] : dot_any(a, x_.data(), n_);
      double w = slack(value, level.lower[i], level.upper[i]);
      if (w == 0.0) continue;
      if (!priced) {
        const double there = single ? level.scale[i] * x[level.index[i]] : dot_any(a, x, n_);
        w -= slack(there, level.lower[i], level.upper[i]);
      }
      if (std::abs(w) <= kSettled * (1.0 + std::abs(value))) continue;
      if (level.lower[i] == level.upper[i]) return false;
      if (!factor(row(level, i), w > 0.0 ? level.upper[i] : level.lower[i], w > 0.0 ? 1 : -1) || !kept_[count_ - 1])
        return false;
    }
    return true;
  }

  // What level k leaves at x, written into handed_ (priced) or low_/high_ (exact); x null: its rows as they are.
  // Returns whether the level is not met.
  bool hand_down(int k, const double* x) {
    const PricedLevel& level = level_[k];
    const Handed& out = handed_[k];
    for (int i = 0; i < level.m; ++i) {
      const double* a = row(level, i);
      std::copy(a, a + n_, out.A + static_cast<std::size_t>(i) * n_);
    }
    std::copy(level.lower, level.lower + level.m, out.lower);
    std::copy(level.upper, level.upper + level.m, out.upper);
    double* guard = out.A + static_cast<std::size_t>(level.m) * n_;
    std::fill(guard, guard + n_, 0.0);
    out.lower[level.m] = -INFINITY;
    out.upper[level.m] = INFINITY;
    if (!x) return false;
    double square = 0.0, size = 0.0;
    for (int i = 0; i < level.m; ++i) {
      const double* a = out.A + static_cast<std::size_t>(i) * n_;
      const double value = dot_any(a, x, n_);
      w_[i] = slack(value, level.lower[i], level.upper[i]);
      square += w_[i] * w_[i];
      double terms = 0.0;
      for (int j = 0; j < n_; ++j) terms += std::abs(a[j] * x[j]);
      const double bound = std::isfinite(level.lower[i])   ? level.lower[i]
                           : std::isfinite(level.upper[i]) ? level.upper[i]
                                                           : 0.0;
      size = larger(size, terms + std::abs(bound));
    }
    const double norm = std::sqrt(square);
    if (norm <= kMet * size) return false;
    const double width = shares_[k] * norm / std::sqrt(static_cast<double>(level.m));
    double made = 0.0, base = 0.0;
    for (int i = 0; i < level.m; ++i) {
      const double* a = out.A + static_cast<std::size_t>(i) * n_;
      const double value = dot_any(a, x, n_), u = -w_[i] / norm;
      made += u * (value - dot_any(a, at_.still(), n_));
      base += u * value;
      add_any(guard, a, u, n_);
      if (!left_out(level, i) && (level.lower[i] == level.upper[i] || std::abs(w_[i]) > kZero * size)) {
        out.lower[i] = value - width;
        out.upper[i] = value + width;
      }
    }
    if (guard_ && level.m > 1 && made > 0.0)
      out.lower[level.m] = base - smaller(shares_[k] * norm, 0.5 * made + guard_floor_ * shares_[k] * norm);
    else std::fill(guard, guard + n_, 0.0);
    return true;
  }

  // An exact level at its optimum: its slack is unique, so equality rows and violated rows keep their value.
  void hold(int k, const double* x) {
    const PricedLevel& level = level_[k];
    low_.assign(level.lower, level.lower + level.m);
    high_.assign(level.upper, level.upper + level.m);
    for (int i = 0; i < level.m; ++i) {
      if (left_out(level, i)) continue;
      const double value = dot_any(row(level, i), x, n_), w = slack(value, low_[i], high_[i]);
      if (low_[i] == high_[i] || std::abs(w) > kMet * (1.0 + std::abs(value))) low_[i] = high_[i] = value;
    }
  }

  // The rows that a level leaves join the set of the stages below.
  void take(int k, bool priced) {
    const PricedLevel& level = level_[k];
    const int m = priced ? level.m + 1 : level.m;
    for (int i = 0; i < m; ++i) {
      const double* a = priced ? handed_[k].A + static_cast<std::size_t>(i) * n_ : row(level, i);
      const double low = priced ? handed_[k].lower[i] : low_[i], high = priced ? handed_[k].upper[i] : high_[i];
      if (low == -INFINITY && high == INFINITY) continue;
      double* c = rows_.row(rows_.count);
      std::fill(c, c + rows_.ld, 0.0);
      at_.row(a, c);
      const double shift = dot_any(a, at_.still(), n_);
      if (!rows_.close(rows_.count, n_, low - shift, high - shift)) continue;
      ++rows_.count;
      row_of_.push_back(first_row(k) + (i < level.m ? i : 0));  // the guard counts for the first element of its level
    }
  }

  int first_row(int k) const {
    int first = 0;
    for (int j = 0; j < k; ++j) first += level_[j].m;
    return first;
  }

  // Level k over what the levels above leave, from y_ to its optimum.
  void stage(int k, double price) {
    const PricedLevel& level = level_[k];
    const int own = rows_.count, ld = rows_.ld;
    int N = n_, m = 0;
    std::fill(y_.begin() + n_, y_.end(), 0.0);
    std::fill(T_.begin(), T_.end(), 0.0);
    at_.point(y_.data(), x_.data());
    for (int i = 0; i < level.m; ++i) {
      if (left_out(level, i)) continue;
      const double* a = row(level, i);
      const double shift = dot_any(a, at_.still(), n_);
      double* T = &T_[static_cast<std::size_t>(m) * ld];
      if (level.lower[i] == level.upper[i]) {
        at_.row(a, T);
        t_[m++] = level.lower[i] - shift;
        continue;
      }
      // lower <= a y - s <= upper with a slack s = y[N] / kSlackMotion that the level keeps small
      double* c = rows_.row(rows_.count);
      std::fill(c, c + ld, 0.0);
      at_.row(a, c);
      c[N] = -1.0 / kSlackMotion;
      T[N] = 1.0 / kSlackMotion;
      t_[m++] = 0.0;
      y_[N] = kSlackMotion * slack(dot_any(a, x_.data(), n_), level.lower[i], level.upper[i]);
      if (rows_.close(rows_.count, N + 1, level.lower[i] - shift, level.upper[i] - shift)) ++rows_.count;
      ++N;
    }
    bool reached = false;
    if (m) {
      reached = search_.solve(rows_, N, T_.data(), t_.data(), m, price, y_.data(), warm_[k], iterations_);
      ended_ = ended_ && reached;
    }
    rows_.count = own;
    if (!m) return;
    StageEnd& end = ends_[k];
    end.known = reached;
    end.rows.assign(search_.held().begin(), search_.held().end());
    end.lambda.assign(search_.multipliers().begin(), search_.multipliers().begin() + end.rows.size());
  }

  int n_, last_ = -1, r_ = 0, iterations_ = 0;
  bool guard_ = true, ended_ = true;
  double guard_floor_ = 0.0;
  std::vector<PricedLevel> level_;
  std::vector<Handed> handed_;
  std::vector<bool> priced_;
  std::vector<std::vector<int>> warm_;
  const double *prices_ = nullptr, *shares_ = nullptr, *F_ = nullptr, *f_ = nullptr;
  Coordinates at_;
  std::vector<StageEnd> ends_;
  std::vector<int> row_of_;
  Accounts accounts_;
  StageSearch search_;
  StageRows rows_;
  std::vector<double> T_, t_, y_, a_, x_, w_, low_, high_, gram_, B_, b_, z_, lambda_;
  std::vector<char> kept_;
  std::vector<int> side_;
  int count_ = 0;
};

}  // namespace HQP_ISA
}  // namespace hqp
