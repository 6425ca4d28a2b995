// Which priced levels the exact answer settles (docs/calm.md): where the least motion that meets all levels down to k
// has multipliers u of level k with c_k ||u|| <= 1, level k is met for its price, and its stage need not be solved.
//
// The least motion is min |y|^2 / 2 over equality rows B y = b and inequality rows, of which a working set is held at
// its bounds. Coordinates with one value left (frozen joints) are columns taken out of B. It begins with the set of the
// last tick; rows of the wrong sign leave and violated rows enter, all at once. A set that does not settle in a few
// rounds shows nothing, and the stage decides.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>
#include <vector>

#include "coordinates.hpp"
#include "motion_bound.hpp"
#include "stages.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr double kDepends = 1e-10;  // a row's square below this fraction of itself, off the rows before, is dependent
constexpr double kLeft = 1e-3;      // of a direction, so that a column may be taken out of B
constexpr int kRounds = 8;          // working sets tried for a level

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
        U_(static_cast<std::size_t>(rows) * width_),
        b_(rows),
        z_(rows),
        lambda_(width_),
        column_(width_),
        inverse_(rows),
        held_(rows),
        number_(rows),
        kept_(rows),
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
  // Nothing like this problem follows: what spares a second look is not prepared.
  void only_once() { again_ = false; }

  // x: the exact answer, whose values exact levels keep.
  void begin(const Coordinates& coordinates, const double* prices, const double* x) {
    at_ = &coordinates;
    prices_ = prices;
    exact_ = x;
    bound_.begin(coordinates, prices, x);
    count_ = equalities_ = reached_ = 0;
    consistent_ = independent_ = true;
    taken_out_.clear();
  }

  // The working set of level k a tick later: numbers of rows, + 1, negative at the lower bound.
  void begin_with(int k, const std::vector<int>& set) {
    warm_[k].clear();
    for (const int entry : set)
      if (std::abs(entry) <= first_[k]) warm_[k].push_back(entry);
  }

  // Whether priced level k, the next one down, is met for its price.
  bool meets(int k) {
    if (bound_.shows(k)) return true;
    for (; reached_ < k; ++reached_) enter(reached_);
    const int own = equalities_;
    enter(k);
    reached_ = k + 1;
    const bool met = consistent_ && own_rank_ && least_motion(k) && prices_[k] * multipliers(k, own) <= 1.0;
    if (met && independent_ && again_ && bound_.wants(k)) {
      invert();
      prepare_bound(k, own);
    }
    return met;
  }

 private:
  // Which row of which level.
  std::pair<const PricedLevel&, int> place(int row) const {
    int l = 0;
    while (l + 1 < static_cast<int>(level_.size()) && first_[l + 1] <= row) ++l;
    return {level_[l], row - first_[l]};
  }

  // Rows that level k leaves to those below hold: of an exact level as x meets them, of a priced one its equalities.
  void enter(int k) {
    if (!(prices_[k] > 0.0)) return keep(k);
    const PricedLevel& level = level_[k];
    cut(equalities_);
    own_rank_ = true;
    for (int i = 0; i < level.m && consistent_; ++i) {
      if (level.lower[i] != level.upper[i]) continue;
      consistent_ = append(level, i, level.lower[i], 0);
      own_rank_ = own_rank_ && kept_[count_ - 1];
    }
    independent_ = independent_ && own_rank_;
    equalities_ = count_;
  }

  // The rows of an exact level, which x meets as well as they can be.
  void keep(int k) {
    const PricedLevel& level = level_[k];
    cut(equalities_);
    for (int i = 0; i < level.m && consistent_; ++i) {
      if (level.left_out(i)) continue;
      const double value = at_point(level, i, exact_);
      const bool off = std::abs(slack(value, level.lower[i], level.upper[i])) > met_ * (1.0 + std::abs(value));
      if (level.lower[i] == level.upper[i] || off) {
        if (count_ == 0 && take_out(level, i, value)) continue;
        consistent_ = append(level, i, value, 0);
        independent_ = independent_ && kept_[count_ - 1];
      }
    }
    equalities_ = count_;
  }

  double at_point(const PricedLevel& level, int i, const double* x) const {
    return level.A ? dot_any(level.A + static_cast<std::size_t>(i) * n_, x, n_) : level.scale[i] * x[level.index[i]];
  }

  void cut(int count) { count_ = count; }

  // The coordinate that a row picks, off the rows that follow; false where the row is another, or picks it again.
  bool take_out(const PricedLevel& level, int i, double value) {
    if (level.A || !at_->diagonal()) return false;
    const int j = static_cast<int>(level.index[i]);
    for (const auto& [other, y] : taken_out_)
      if (other == j) return false;
    const double c = at_->picked(j, level.scale[i]);
    if (c == 0.0) return false;
    taken_out_.emplace_back(j, (value - level.scale[i] * at_->still()[j]) / c);
    return true;
  }

  // The working set of level k from that of the last tick; whether it was found.
  bool least_motion(int k) {
    std::vector<int>& set = warm_[k];
    for (int round = 0; round < kRounds; ++round) {
      if (!hold(set)) break;
      solve();
      if (!change(k, set)) return consistent_;
    }
    set.clear();
    return false;
  }

  // The factor of the equality rows and of the set, of which what is held already stays.
  bool hold(const std::vector<int>& set) {
    std::size_t same = 0;
    while (equalities_ + static_cast<int>(same) < count_ && same < set.size() && held_[equalities_ + same] == set[same])
      ++same;
    cut(equalities_ + static_cast<int>(same));
    for (; same < set.size(); ++same) {
      const int row = std::abs(set[same]) - 1;
      const auto [level, i] = place(row);
      const double bound = set[same] > 0 ? level.upper[i] : level.lower[i];
      if (!std::isfinite(bound) || !append(level, i, bound, set[same]) || !kept_[count_ - 1]) return false;
    }
    return true;
  }

  // Rows of the wrong sign leave the set, violated rows of levels down to k enter; whether the set has changed.
  bool change(int k, std::vector<int>& set) {
    double most = 0.0;
    for (int j = 0; j < count_; ++j) most = larger(most, std::abs(lambda_[j]));
    std::size_t left = 0;
    for (std::size_t j = 0; j < set.size(); ++j)
      if ((set[j] > 0 ? 1.0 : -1.0) * lambda_[equalities_ + j] <= 1e-12 * most) set[left++] = set[j];
    bool changed = left < set.size();
    set.resize(left);
    for (int l = 0; l <= k; ++l) {
      const PricedLevel& level = level_[l];
      for (int i = 0; i < level.m; ++i) {
        if (level.lower[i] == level.upper[i] && independent_) continue;  // it is held
        const double value = at_point(level, i, x_.data());
        double w = slack(value, level.lower[i], level.upper[i]);
        if (w == 0.0) continue;
        const double allowed = kHolds * (1.0 + std::abs(value));
        if (std::abs(w) <= allowed) continue;
        if (!(prices_[l] > 0.0)) {  // an exact level may be off as far as x is
          w -= slack(at_point(level, i, exact_), level.lower[i], level.upper[i]);
          if (std::abs(w) <= allowed) continue;
        }
        if (level.lower[i] == level.upper[i]) {  // it depends on others
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

  // One more row of the factor; false where it depends on the others and disagrees with them.
  bool append(const PricedLevel& level, int i, double target, int held) {
    const int c = count_;
    if (c == static_cast<int>(b_.size())) return false;
    const double* a = level.A ? level.A + static_cast<std::size_t>(i) * n_ : a_.data();
    if (!level.A) {
      std::fill(a_.begin(), a_.end(), 0.0);
      a_[level.index[i]] = level.scale[i];
    }
    double* b = &B_[static_cast<std::size_t>(c) * ld_];
    at_->row(a, b);
    b_[c] = target - dot_any(a, at_->still(), n_);
    const int whole = lanes(n_);  // rows are padded with zeros
    const double square = dot_any(b, b, whole);
    for (const auto& [j, y] : taken_out_) {
      b_[c] -= b[j] * y;
      b[j] = 0.0;
    }
    dots_any(b, B_.data(), ld_, c, whole, column_.data());
    double pivot = taken_out_.empty() ? square : dot_any(b, b, whole), z = b_[c];
    for (int j = 0; j < c; ++j) {
      const double f = column_[j] * inverse_[j];
      double* u = &U_[static_cast<std::size_t>(j) * width_];
      const int from = (j + 1) / kLane * kLane;  // whole vectors at the same places, so that stores are forwarded
      add_any(&column_[from], u + from, -f, lanes(c - from));
      u[c] = f;
      pivot -= f * f;
      z -= f * z_[j];
    }
    kept_[c] = pivot > kDepends * square;
    held_[c] = held;
    number_[c] = first_[&level - level_.data()] + i;
    inverse_[c] = kept_[c] ? 1.0 / std::sqrt(pivot) : 0.0;
    z_[c] = z * inverse_[c];
    ++count_;
    return kept_[c] || std::abs(z) <= kHolds * (1.0 + std::abs(b_[c]));
  }

  // lambda_ of B B' lambda = b, zero for rows that depend on others, and x_ = still + P B' lambda.
  void solve() {
    std::fill(y_.begin(), y_.end(), 0.0);
    for (int j = count_ - 1; j >= 0; --j) {
      const double* u = &U_[static_cast<std::size_t>(j) * width_];
      lambda_[j] = (z_[j] - dot_any(u + j + 1, &lambda_[j + 1], count_ - j - 1)) * inverse_[j];
      add_any(y_.data(), &B_[static_cast<std::size_t>(j) * ld_], lambda_[j], lanes(n_));
    }
    for (const auto& [j, y] : taken_out_) y_[j] = y;
    at_->point(y_.data(), x_.data());
  }

  // ||u|| of level k, whose own equality rows begin at `own`: its inequality rows that are held count too.
  double multipliers(int k, int own) const {
    double square = 0.0;
    for (int j = own; j < count_; ++j) {
      const int row = std::abs(held_[j]) - 1;
      if (j < equalities_ || (row >= first_[k] && row < first_[k] + level_[k].m)) square += lambda_[j] * lambda_[j];
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
    for (const auto& [j, y] : taken_out_) out_[j] = 0;
    for (int j = 0; j < n_; ++j) {
      if (!out_[j]) continue;
      std::fill(column_.begin(), column_.begin() + c, 0.0);
      for (int i = 0; i < c; ++i) add_any(column_.data(), inverse_row(i), B_[static_cast<std::size_t>(i) * ld_ + j], c);
      double left = 1.0;
      for (int i = 0; i < c; ++i) left -= column_[i] * B_[static_cast<std::size_t>(i) * ld_ + j];
      if (!(left > kLeft)) return bound_.take(k, whole, INFINITY);
      for (int i = 0; i < c; ++i) add_any(inverse_row(i), column_.data(), column_[i] / left, c);
    }
    bound_.take(k, trace(0, c), trace(own, equalities_));
  }

  // G = (B B')^-1 from W = U^-T, row by row.
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
  std::vector<std::vector<int>> warm_;  // of each level: a row's number + 1, negative at its lower bound
  std::vector<int> first_;
  std::vector<double> B_, U_, b_, z_, lambda_, column_, inverse_;  // B B' = U' U, inverse_ 1 / U_jj
  std::vector<double> W_, G_;                                      // U^-T, (B B')^-1
  std::vector<int> held_, number_;  // how a row is held, as in warm_; which of all rows it is
  std::vector<char> kept_, out_;
  std::vector<double> y_, a_, x_;
  std::vector<std::pair<int, double>> taken_out_;  // coordinates, their values
  MotionBound bound_;
  const Coordinates* at_ = nullptr;
  const double *prices_ = nullptr, *exact_ = nullptr;
  int count_ = 0, equalities_ = 0, reached_ = 0;  // reached_: levels whose rows have entered
  bool consistent_ = true, independent_ = true, own_rank_ = true, again_ = true;
};

}  // namespace HQP_ISA
}  // namespace hqp
