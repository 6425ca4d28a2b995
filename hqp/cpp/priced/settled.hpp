// Priced levels that the exact answer settles (docs/calm.md): if the least motion that meets all levels down to k has
// multipliers u of level k with c_k ||u|| <= 1, level k is met for its price and needs no stage.
//
// The least motion is min |y|^2 / 2 over equality rows B y = b and inequality rows with a working set at its
// bounds. Coordinates with one value left (frozen joints), and those in the set, are columns taken out of B. It begins
// with the set of the last tick; rows of the wrong sign leave and violated rows enter, all at once. If the set still
// changes after a few rounds, the stage decides.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>
#include <vector>

#include "coordinates.hpp"
#include "motion_bound.hpp"
#include "priced_rows.hpp"
#include "stages.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr int kRounds = 8;  // working sets tried for a level

class Settled {
 public:
  Settled(int n, const std::vector<PricedLevel>& levels, int rows, double met)
      : n_(n),
        met_(met),
        ld_(padded(n)),
        width_(padded(rows + 1)),
        level_(levels),
        warm_(levels.size()),
        first_(levels.size()),
        B_(static_cast<std::size_t>(rows) * ld_),
        C_(static_cast<std::size_t>(rows) * ld_),
        U_(static_cast<std::size_t>(rows) * width_),
        b_(rows),
        square_(rows),
        z_(rows),
        lambda_(width_),
        column_(width_),
        inverse_(rows),
        number_(rows),
        kept_(rows),
        side_(n),
        free_(ld_, 1.0),
        fixed_(ld_),
        picked_(n),
        frozen_pull_(n),
        y_(ld_),
        a_(n),
        x_(n),
        bound_(n, levels) {
    int before = 0;
    for (std::size_t k = 0; k < levels.size(); ++k) {
      first_[k] = before;
      before += levels[k].m;
    }
    for (auto& set : warm_) set.reserve(rows);
    pull_.reserve(rows);
    for (auto* table : {&W_, &G_}) table->reserve(static_cast<std::size_t>(n) * n);
    taken_out_.reserve(n);
    out_.reserve(n);
  }

  void keep(CarryOver& warm) {
    for (auto& set : warm_) warm.list(set);
    bound_.keep(warm);
  }
  void forget() {
    for (auto& set : warm_) set.clear();
    bound_.forget();
  }
  // Skip preparations for the next problem: nothing alike follows.
  void only_once() { again_ = false; }

  // x: the exact answer; exact levels keep its values.
  void begin(const Coordinates& coordinates, const double* prices, const double* x) {
    at_ = &coordinates;
    prices_ = prices;
    exact_ = x;
    bound_.begin(coordinates, prices, x);
    count_ = equalities_ = factored_ = reached_ = 0;
    frozen_ = 0;
    put_back(0);
  }

  // Return true if priced level k, the next one down, is met for its price.
  bool meets(int k) {
    if (bound_.shows(k)) return true;
    count_ = equalities_;
    for (; reached_ < k; ++reached_) enter(reached_);
    const int own = equalities_;
    const std::size_t frozen = frozen_;
    enter(k);
    reached_ = k + 1;
    if (!least_motion(k) || !kept(own) || !(prices_[k] * multipliers(k, own, frozen) <= 1.0)) return false;
    if (again_ && frozen == frozen_ && kept(0) && bound_.wants(k)) {
      invert();
      prepare_bound(k, own);
    }
    return true;
  }

 private:
  // The level of a row, and the row's index there.
  std::pair<const PricedLevel&, int> place(int row) const {
    int l = 0;
    while (l + 1 < static_cast<int>(level_.size()) && first_[l + 1] <= row) ++l;
    return {level_[l], row - first_[l]};
  }

  // Enter the rows of level k as constraints of the lower ones: for an exact level at the values of x, for a priced one
  // its equalities.
  void enter(int k) {
    put_back(frozen_);  // columns of the last level's set stand behind frozen ones
    const PricedLevel& level = level_[k];
    const bool priced = prices_[k] > 0.0;
    for (int i = 0; i < level.m; ++i) {
      const bool equal = level.lower[i] == level.upper[i];
      if (level.left_out(i) || (priced && !equal)) continue;
      const double value = priced ? level.lower[i] : row_value(level, i, exact_, n_);
      if (!equal && std::abs(slack(value, level.lower[i], level.upper[i])) <= met_ * (1.0 + std::abs(value))) continue;
      if (count_ == 0 && picks(level, i) && take_out(level, i, value)) ++frozen_;
      else append(level, i, value);
    }
    equalities_ = count_;
  }

  // Return true if all equality rows from `from` on are independent.
  bool kept(int from) const {
    return std::find(kept_.begin() + from, kept_.begin() + equalities_, 0) == kept_.begin() + equalities_;
  }

  bool picks(const PricedLevel& level, int i) const {
    return !level.A && at_->diagonal() && at_->picked(static_cast<int>(level.index[i]), level.scale[i]) != 0.0;
  }
  // Fix the coordinate that a row picks at this value and take it out of all rows; false if it is fixed already.
  bool take_out(const PricedLevel& level, int i, double value) {
    const int j = static_cast<int>(level.index[i]);
    if (free_[j] == 0.0) return false;
    free_[j] = 0.0;
    picked_[j] = at_->picked(j, level.scale[i]);
    fixed_[j] = (value - level.scale[i] * at_->still()[j]) / picked_[j];
    taken_out_.push_back(j);
    factored_ = 0;
    return true;
  }
  // Put back all coordinates but the first ones.
  void put_back(std::size_t first) {
    for (; taken_out_.size() > first; taken_out_.pop_back()) {
      free_[taken_out_.back()] = 1.0;
      fixed_[taken_out_.back()] = 0.0;
      factored_ = 0;
    }
  }

  // Find the working set of level k from that of the last tick; return true on success.
  bool least_motion(int k) {
    std::vector<int>& set = warm_[k];
    for (int round = 0; round < kRounds; ++round) {
      if (!hold(set)) break;
      solve(set);
      if (!change(k, set)) return consistent_;
    }
    set.clear();
    return false;
  }

  double bound_of(int entry) const {
    const auto [level, i] = place(std::abs(entry) - 1);
    return entry > 0 ? level.upper[i] : level.lower[i];
  }

  // Factor the equality rows and the set, whose coordinates are out; false if that fails.
  bool hold(const std::vector<int>& set) {
    std::size_t out = frozen_;
    for (const int entry : set) {
      const auto [level, i] = place(std::abs(entry) - 1);
      if (!std::isfinite(bound_of(entry))) return false;
      if (!picks(level, i)) continue;
      const int j = static_cast<int>(level.index[i]);
      if (out == taken_out_.size() || taken_out_[out] != j || side_[j] != entry) {
        put_back(out);
        if (!take_out(level, i, bound_of(entry))) return false;
        side_[j] = entry;
      }
      ++out;
    }
    put_back(out);
    count_ = equalities_;
    if (factored_ == 0) consistent_ = true;
    for (; factored_ < equalities_; ++factored_) factor(factored_);
    for (const int entry : set) {
      const auto [level, i] = place(std::abs(entry) - 1);
      if (picks(level, i)) continue;
      if (count_ == static_cast<int>(b_.size())) return false;
      append(level, i, bound_of(entry));
      factor(count_ - 1);
      if (!kept_[count_ - 1]) return false;
    }
    return consistent_;
  }

  // Rows of the wrong sign leave the set, violated rows of levels down to k enter; return true if the set has changed.
  bool change(int k, std::vector<int>& set) {
    double most = 0.0;
    for (int j = 0; j < equalities_; ++j) most = larger(most, std::abs(lambda_[j]));
    for (const double pull : pull_) most = larger(most, std::abs(pull));
    std::size_t left = 0;
    for (std::size_t j = 0; j < set.size(); ++j)
      if ((set[j] > 0 ? 1.0 : -1.0) * pull_[j] <= kNoRate * most) set[left++] = set[j];
    bool changed = left < set.size();
    set.resize(left);
    for (int l = 0; l <= k; ++l) {
      const PricedLevel& level = level_[l];
      for (int i = 0; i < level.m; ++i) {
        const double value = row_value(level, i, x_.data(), n_);
        double w = slack(value, level.lower[i], level.upper[i]);
        if (w == 0.0) continue;
        const double allowed = kActive * (1.0 + std::abs(value));
        if (std::abs(w) <= allowed) continue;
        if (!(prices_[l] > 0.0)) {  // an exact level may be off as far as x is
          w -= slack(row_value(level, i, exact_, n_), level.lower[i], level.upper[i]);
          if (std::abs(w) <= allowed) continue;
        }
        if (level.lower[i] == level.upper[i]) {  // a dependent row, or one so nearly that its multiplier is rounding
          consistent_ = false;
          return false;
        }
        const int row = first_[l] + i + 1;
        set.push_back(w > 0.0 ? row : -row);
        changed = true;
      }
    }
    return changed;
  }

  // One more row.
  void append(const PricedLevel& level, int i, double target) {
    const int c = count_++;
    const double* a = coefficients(level, i, n_, a_);
    double* b = &B_[static_cast<std::size_t>(c) * ld_];
    at_->row(a, b);
    b_[c] = target - dot_any(a, at_->still(), n_);
    square_[c] = dot_any(b, b, lanes(n_));  // rows are padded with zeros
    number_[c] = first_[&level - level_.data()] + i;
  }

  // Compute row c of the factor without the columns that are out; a dependent row must agree with the others.
  void factor(int c) {
    const int whole = lanes(n_);
    const double* b = &B_[static_cast<std::size_t>(c) * ld_];
    double* free = &C_[static_cast<std::size_t>(c) * ld_];
    Vec4 own = splat(0.0), off = own;
    for (int j = 0; j < whole; j += kLane) {
      const Vec4 a = unaligned(b + j), left = unaligned(free + j) = a * unaligned(&free_[j]);
      own += left * left;
      off += a * unaligned(&fixed_[j]);
    }
    dots_any(free, C_.data(), ld_, c, whole, column_.data());
    const double target = b_[c] - sum(off);
    double pivot = sum(own), z = target;
    for (int j = 0; j < c; ++j) {
      const double f = column_[j] * inverse_[j];
      double* u = &U_[static_cast<std::size_t>(j) * width_];
      const int from = (j + 1) / kLane * kLane;  // whole vectors at the same places, so that stores are forwarded
      add_any(&column_[from], u + from, -f, lanes(c - from));
      u[c] = f;
      pivot -= f * f;
      z -= f * z_[j];
    }
    kept_[c] = pivot > kDirection * square_[c];
    inverse_[c] = kept_[c] ? 1.0 / std::sqrt(pivot) : 0.0;
    z_[c] = z * inverse_[c];
    consistent_ = consistent_ && (kept_[c] || std::abs(z) <= kActive * (1.0 + std::abs(target)));
  }

  // lambda_ of C C' lambda = b, zero for rows that depend on others, pull_ of the set, and x_ = still + P y.
  void solve(const std::vector<int>& set) {
    std::fill(y_.begin(), y_.end(), 0.0);
    for (int j = count_ - 1; j >= 0; --j) {
      const double* u = &U_[static_cast<std::size_t>(j) * width_];
      lambda_[j] = (z_[j] - dot_any(u + j + 1, &lambda_[j + 1], count_ - j - 1)) * inverse_[j];
      add_any(y_.data(), &B_[static_cast<std::size_t>(j) * ld_], lambda_[j], lanes(n_));
    }
    pull_.clear();
    int next = equalities_;
    for (const int entry : set) {
      const auto [level, i] = place(std::abs(entry) - 1);
      const int j = level.A ? 0 : static_cast<int>(level.index[i]);
      pull_.push_back(picks(level, i) ? (fixed_[j] - y_[j]) / picked_[j] : lambda_[next++]);
    }
    for (std::size_t f = 0; f < frozen_; ++f) {
      const int j = taken_out_[f];
      frozen_pull_[f] = (fixed_[j] - y_[j]) / picked_[j];
    }
    for (const int j : taken_out_) y_[j] = fixed_[j];
    at_->point(y_.data(), x_.data());
  }

  // ||u|| of level k, whose own equality rows begin at `own` and frozen columns at `frozen`: its inequality rows that
  // are held count too.
  double multipliers(int k, int own, std::size_t frozen) const {
    double square = 0.0;
    for (int j = own; j < equalities_; ++j) square += lambda_[j] * lambda_[j];
    for (std::size_t f = frozen; f < frozen_; ++f) square += frozen_pull_[f] * frozen_pull_[f];
    for (std::size_t j = 0; j < pull_.size(); ++j) {
      const int row = std::abs(warm_[k][j]) - 1;
      if (row >= first_[k] && row < first_[k] + level_[k].m) square += pull_[j] * pull_[j];
    }
    return std::sqrt(square);
  }

  // The inverse G for the bound of level k, whose own rows begin at `own`. Coordinates near a bound are not
  // to move: their columns are taken out of B (Sherman and Morrison), but for those that a row has alone.
  void prepare_bound(int k, int own) {
    const int c = count_;
    const double whole = trace(0, c);
    out_ = bound_.near(k);
    for (int i = 0; i < c; ++i)
      if (const auto [level, row] = place(number_[i]); !level.A) out_[level.index[row]] = 0;
    for (const int j : taken_out_) out_[j] = 0;
    for (int j = 0; j < n_; ++j) {
      if (!out_[j]) continue;
      std::fill(column_.begin(), column_.begin() + c, 0.0);
      for (int i = 0; i < c; ++i) add_any(column_.data(), inverse_row(i), B_[static_cast<std::size_t>(i) * ld_ + j], c);
      double left = 1.0;
      for (int i = 0; i < c; ++i) left -= column_[i] * B_[static_cast<std::size_t>(i) * ld_ + j];
      if (!(left > kRests)) return bound_.take(k, whole, INFINITY);
      for (int i = 0; i < c; ++i) add_any(inverse_row(i), column_.data(), column_[i] / left, c);
    }
    bound_.take(k, trace(0, c), trace(own, equalities_));
  }

  // G = (C C')^-1 from W = U^-T, row by row.
  void invert() {
    const int c = count_;
    W_.assign(static_cast<std::size_t>(c) * c, 0.0);
    G_.assign(static_cast<std::size_t>(c) * c, 0.0);
    for (int i = 0; i < c; ++i) {
      double* w = &W_[static_cast<std::size_t>(i) * c];
      w[i] = 1.0;
      for (int j = 0; j < i; ++j)
        add_any(w, &W_[static_cast<std::size_t>(j) * c], -U_[static_cast<std::size_t>(j) * width_ + i], j + 1);
      scale(w, i + 1, inverse_[i]);
      for (int j = 0; j <= i; ++j) add_any(inverse_row(j), w, w[j], i + 1);
    }
  }

  double* inverse_row(int i) { return &G_[static_cast<std::size_t>(i) * count_]; }

  // The root of the trace of G over rows [from, to): the length of those columns of B's inverse.
  double trace(int from, int to) const {
    double sum = 0.0;
    for (int i = from; i < to; ++i) sum += G_[static_cast<std::size_t>(i) * (count_ + 1)];
    return std::sqrt(sum);
  }

  int n_;
  double met_;
  int ld_, width_;
  const std::vector<PricedLevel>& level_;
  std::vector<std::vector<int>> warm_;  // set of each level: a row's number + 1, negative at its lower bound
  std::vector<int> first_;
  // C: B off the columns that are out; C C' = U' U, inverse_ 1 / U_jj; square_ |B_j|^2; pull_ multipliers of the set.
  std::vector<double> B_, C_, U_, b_, square_, z_, lambda_, column_, inverse_, pull_;
  std::vector<double> W_, G_;  // U^-T, (C C')^-1
  std::vector<int> number_;    // number of a row among all
  std::vector<char> kept_, out_;
  std::vector<int> taken_out_, side_;         // coordinates; each one's entry in the set, as in warm_
  std::vector<double> free_, fixed_;          // 1 of coordinates that are in, 0 of others; their values, 0 of those
  std::vector<double> picked_, frozen_pull_;  // scale of the row that took a column out; multipliers of frozen ones
  std::vector<double> y_, a_, x_;
  MotionBound bound_;
  const Coordinates* at_ = nullptr;
  const double *prices_ = nullptr, *exact_ = nullptr;
  int count_ = 0, equalities_ = 0, factored_ = 0;  // numbers of rows; factored_: equality rows
  int reached_ = 0;                                // levels whose rows have entered
  std::size_t frozen_ = 0;                         // coordinates that are out for good
  bool consistent_ = true, again_ = true;
};

}  // namespace HQP_ISA
}  // namespace hqp
