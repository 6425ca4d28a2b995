// Anchors of an unmet level a in a lower level k (docs/calm.md): its rows stay near y_a = A_a x_a, and motion beyond
// x_a costs by the length of those rows' columns,
//   ||v_a||^2 / (2 eta c_a omega_a) + t_a omega_a^2 / 2 sum_j d_aj^2 (F (x - x_a))_j^2,
//   d_aj^2 = ||B_a A_a F^+ e_j||^2 + ||B_a A_a N_a F^+ e_j||^2,
// v_a = A_a x - y_a for equalities, the growth of their slack for inequalities, B_a = diag(1 or |w_ai| / omega_a), N_a
// the projection onto the null space of the equality rows above a.
// The second term only rescales the rows of F: its sum with E is again a motion.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "../solver/tolerances.hpp"
#include "coordinates.hpp"
#include "stages.hpp"

namespace hqp {
inline namespace HQP_ISA {

// A direction that may be rounding of the level's longest row counts only if a step of length 1 + |x| along it can meet
// more than this share of the rows' residual.
constexpr double kMissed = 1e-7;

struct Anchor {
  int level = 0, first = 0;  // its first row among all rows
  double omega = 0.0;        // ||w_a||
  double allowance = 0.0;    // eta c_a omega_a
  double turning = 0.0;      // t_a omega_a^2
  std::vector<char> held;    // (m,) rows that are anchored
  std::vector<double> low;   // (m,) range without cost: y_ai, or from the lower to the upper bound and y_ai
  std::vector<double> high;
  std::vector<double> part;    // (m,) diagonal of B_a
  std::vector<double> share;   // (m, rows of F) part of each row in d_aj^2
  std::vector<double> weight;  // (rows of F,) t_a omega_a^2 d_aj^2
  std::vector<double> from;    // (rows of F,) F x_a
};

// The motion of a hierarchy, F (r, n), or a diagonal if r = 0, or the identity, and the motion of its stages.
class Motions {
 public:
  Motions(int n, double flat)
      : n_(n),
        base_(n, flat),
        here_(n, flat),
        over_(n, kLost, kUncertain, true),
        ld_(padded(n)),
        basis_(static_cast<std::size_t>(n) * ld_),
        flat_(static_cast<std::size_t>(n) * ld_),
        row_(padded(n)),
        step_(padded(n)),
        part_(n) {}

  // Reserve memory for r rows of F (0 for a diagonal) and levels of at most `most` rows.
  void reserve(int r, int most) {
    const int count = r ? r : n_;
    for (auto* part : {&weight_, &mean_}) part->reserve(count);
    stack_.reserve(static_cast<std::size_t>(most + count) * n_);
    target_.reserve(most + count);
    base_.reserve(r), here_.reserve(r), over_.reserve(most + count);
  }

  void set(const double* F, const double* f, int r) {
    F_ = F;
    f_ = f;
    r_ = r;
    base_.set(F, f, r);
    count_ = r ? r : n_;
    held_ = flats_ = 0;
  }

  // Add an equality row of the levels above the anchors.
  void hold(const double* a) {
    base_.row(a, row_.data());
    const int moving = base_.rank();
    if (!base_.diagonal()) scale(row_.data() + moving, n_ - moving, kFreeShare);  // as if they cost like motion
    const double square = dot_any(row_.data(), row_.data(), n_), least = kLost * std::sqrt(square);
    for (int pass = 0; pass < 2 && flats_; ++pass) off(flat_, flats_, moving);
    if (take(flat_, flats_, moving, n_, least)) return;
    off(basis_, held_, 0);
    if (dot_any(row_.data(), row_.data(), n_) < 0.5 * square) off(basis_, held_, 0);  // twice is enough (Kahan)
    take(basis_, held_, 0, moving, least);
  }

  void rounding(double length) {
    rounding_ = length;
    for (Coordinates* at : {&base_, &here_, &over_}) at->rounding(length);
  }

  const Coordinates& base() const { return base_; }
  bool diagonal() const { return r_ == 0; }
  int count() const { return count_; }  // rows of F

  // F_jj of a diagonal F.
  double size(int j) const { return F_ ? F_[j] : 1.0; }
  const double* row(int j) const { return F_ + static_cast<std::size_t>(j) * n_; }
  // (F x)_j.
  double moved(int j, const double* x) const { return r_ ? dot_any(row(j), x, n_) : size(j) * x[j]; }

  // The anchor of a level that ended unmet at x, from its rows, their weights and residuals.
  template <class Row>
  void complete(Anchor& anchor, double turning, const double* x, const Row& row_of) {
    anchor.turning = turning * anchor.omega * anchor.omega;
    anchor.weight.assign(count_, 0.0);
    anchor.from.resize(count_);
    for (int j = 0; j < count_; ++j) anchor.from[j] = moved(j, x);
    anchor.share.assign(anchor.held.size() * count_, 0.0);
    for (std::size_t i = 0; i < anchor.held.size() && anchor.turning > 0.0; ++i) {
      if (!anchor.held[i] || !(anchor.part[i] > 0.0)) continue;
      double* const share = &anchor.share[i * count_];
      base_.row(row_of(static_cast<int>(i)), row_.data());
      add_squares(anchor.part[i] * anchor.part[i], share);
      off(basis_, held_, 0);
      add_squares(anchor.part[i] * anchor.part[i], share);
      add_any(anchor.weight.data(), share, anchor.turning, count_);
    }
  }

  // weight (count,) and mean (count,) of own E plus the anchors' second terms: the sum of
  // weight_j ((F x)_j - mean_j)^2 / 2.
  void weigh(const std::vector<Anchor>& anchors, double own) {
    weight_.assign(count_, own);
    mean_.assign(count_, 0.0);
    if (f_)
      for (int j = 0; j < count_; ++j) mean_[j] = own * f_[j];
    for (const Anchor& anchor : anchors)
      for (int j = 0; j < count_; ++j) {
        weight_[j] += anchor.weight[j];
        mean_[j] += anchor.weight[j] * anchor.from[j];
      }
    for (int j = 0; j < count_; ++j)
      if (weight_[j] > 0.0) mean_[j] /= weight_[j];
  }
  double weight(int j) const { return weight_[j]; }
  double mean(int j) const { return mean_[j]; }

  // Coordinates y in which E plus the anchors' second terms is |y|^2 / 2.
  Coordinates& among(const std::vector<Anchor>& anchors) {
    if (anchors.empty()) return base_;
    weigh(anchors, 1.0);
    if (!r_) return diagonal(nullptr);
    stack_.clear();
    target_.clear();
    push_motion(-1.0);
    here_.set(base_, stack_.data(), target_.data(), r_);
    return here_;
  }

  // Coordinates y in which ||w||^2 / 2 of a level's equality rows plus the anchors' second terms is |y|^2 / 2.
  // x: the start of the stage, see kMissed.
  Coordinates& over(const PricedLevel& level, const std::vector<Anchor>& anchors, const double* x) {
    weigh(anchors, 0.0);
    if (!r_ && !level.A) return diagonal(&level);
    stack_.clear();
    target_.clear();
    double shortest = INFINITY, longest = 0.0;
    for (int i = 0; i < level.m; ++i) {
      if (level.lower[i] != level.upper[i]) continue;
      const double* a = level.A ? level.A + static_cast<std::size_t>(i) * n_
                                : picked(static_cast<int>(level.index[i]), level.scale[i]);
      const double square = dot_any(a, a, n_);
      if (!(square > rounding_ * rounding_)) continue;
      push(a, 1.0, level.lower[i]);
      shortest = smaller(shortest, square);
      longest = larger(longest, square);
    }
    push_motion(shortest < INFINITY ? kLost * kLost * shortest : 0.0);
    if (target_.empty()) push(picked(0, 0.0), 0.0, 0.0);
    const double far = 1.0 + std::sqrt(dot_any(x, x, n_));
    over_.set(stack_.data(), target_.data(), static_cast<int>(target_.size()), far / kMissed,
              kDirection * std::sqrt(longest));
    return over_;
  }

 private:
  // sum[j] += scale (a F^+ e_j)^2 of a row a whose coordinates are row_.
  void add_squares(double scale, double* sum) {
    if (!r_) {
      const Vec4 f = splat(scale);
      int j = 0;
      for (; j + kLane <= n_; j += kLane) {
        const Vec4 a = unaligned(&row_[j]);
        unaligned(sum + j) += f * a * a;
      }
      for (; j < n_; ++j) sum[j] += scale * row_[j] * row_[j];
      return;
    }
    std::fill(row_.begin() + base_.rank(), row_.end(), 0.0);  // F^+ excludes directions without motion
    base_.step(row_.data(), step_.data());
    for (int j = 0; j < r_; ++j) {
      const double part = dot_any(row(j), step_.data(), n_);
      sum[j] += scale * part * part;
    }
  }

  // Project row_ off rows that are orthonormal from entry `from` on.
  void off(const std::vector<double>& rows, int count, int from) {
    dots_any(row_.data() + from, rows.data() + from, ld_, count, lanes(n_) - from, part_.data());
    add_rows(row_.data(), rows.data(), ld_, count, -1.0, part_.data(), 1, lanes(n_));
  }

  // Append row_ up to entry `to` to these rows if more than `least` of it remains from `from` on.
  bool take(std::vector<double>& rows, int& count, int from, int to, double least) {
    const double left = std::sqrt(dot_any(row_.data() + from, row_.data() + from, to - from));
    if (!(left > least)) return false;
    double* at = &rows[static_cast<std::size_t>(count++) * ld_];
    for (int j = 0; j < n_; ++j) at[j] = j < to ? row_[j] / left : 0.0;
    return true;
  }

  // Coordinates of a diagonal F, and of a level whose rows pick one variable each.
  Coordinates& diagonal(const PricedLevel* level) {
    stack_.resize(n_);
    target_.resize(n_);
    for (int j = 0; j < n_; ++j) {
      const double weight = weight_[j] * size(j);
      stack_[j] = weight * size(j);
      target_[j] = weight * mean_[j];
    }
    for (int i = 0; level && i < level->m; ++i) {
      if (level->lower[i] != level->upper[i]) continue;
      stack_[level->index[i]] += level->scale[i] * level->scale[i];
      target_[level->index[i]] += level->scale[i] * level->lower[i];
    }
    const double most = *std::max_element(stack_.begin(), stack_.end());
    for (int j = 0; j < n_; ++j) {
      stack_[j] = stack_[j] > kOnRow * kOnRow * most ? std::sqrt(stack_[j]) : 0.0;
      if (stack_[j] > 0.0) target_[j] /= stack_[j];
    }
    Coordinates& to = level ? over_ : here_;
    to.set(stack_.data(), target_.data(), 0);
    return to;
  }

  // Append rows of F weighted by the anchors; skip squares of at most `least`, lost beside any row.
  void push_motion(double least) {
    for (int j = 0; j < count_; ++j) {
      const double* a = r_ ? row(j) : picked(j, size(j));
      const double root = std::sqrt(weight_[j]);
      if (weight_[j] * dot_any(a, a, n_) > least) push(a, root, root * mean_[j]);
    }
  }

  void push(const double* a, double scale, double target) {
    const std::size_t at = stack_.size();
    stack_.resize(at + n_);
    for (int j = 0; j < n_; ++j) stack_[at + j] = scale * a[j];
    target_.push_back(target);
  }

  const double* picked(int j, double value) {
    std::fill(row_.begin(), row_.end(), 0.0);
    row_[j] = value;
    return row_.data();
  }

  int n_, r_ = 0, count_ = 0;
  double rounding_ = 0.0;
  const double *F_ = nullptr, *f_ = nullptr;
  Coordinates base_, here_, over_;
  int ld_, held_ = 0, flats_ = 0;
  std::vector<double> basis_, flat_;  // held rows in motion coordinates: orthonormal in motion alone, and in directions
                                      // without motion
  std::vector<double> row_, step_, part_, weight_, mean_, stack_, target_;
};

}  // namespace HQP_ISA
}  // namespace hqp
