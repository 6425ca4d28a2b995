// Rows that finished levels hand down to the levels below: as they are, at their values, or anchored.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "anchors.hpp"
#include "priced_rows.hpp"

namespace hqp {
inline namespace HQP_ISA {

class HandDown {
 public:
  HandDown(PricedRows& levels, Motions& motions, int n) : n_(n), levels_(levels), motions_(motions) {
    low_.resize(levels.total());
    high_.resize(levels.total());
    open_.resize(levels.total());
    anchors_.reserve(levels.count());
    spare_.resize(levels.count());
    for (Anchor& anchor : spare_) {
      anchor.held.reserve(levels.most());
      for (auto* part : {&anchor.low, &anchor.high, &anchor.part}) part->reserve(levels.most());
    }
  }

  void bind(const Law& law) {
    law_ = law;
    const int count = law.r ? law.r : n_;
    for (Anchor& anchor : spare_) {
      for (auto* part : {&anchor.weight, &anchor.from}) part->reserve(count);
      anchor.share.reserve(static_cast<std::size_t>(levels_.most()) * count);
    }
  }
  void begin() {
    for (; !anchors_.empty(); anchors_.pop_back()) spare_.push_back(std::move(anchors_.back()));
    taken_at_ = 0.0;
    framed_ = 0;
    std::fill(open_.begin(), open_.end(), 0.0);
  }

  const std::vector<Anchor>& anchors() const { return anchors_; }
  // |x| at which an unmet level without a price left its values, 0 without one.
  double taken_at() const { return taken_at_; }

  // Error of the value of each row that a level keeps: a slack of at most kViolated may be rounding, since a stage may
  // have ended before.  Ten times that are real slacks of feet that take load.
  const std::vector<double>& open() const { return open_; }

  // Leave the rows of level k at x: a level without a price keeps its values.
  void leave(int k, const double* x) {
    const PricedLevel& level = levels_[k];
    double *low = &low_[levels_.first(k)], *high = &high_[levels_.first(k)];
    std::copy(level.lower, level.lower + level.m, low);
    std::copy(level.upper, level.upper + level.m, high);
    if (law_.prices[k] > 0.0 || !x) return;
    levels_.rest_at(x);
    for (int i = 0; i < level.m; ++i) {  // its slack is unique: unmet rows keep their value
      if (level.left_out(i)) continue;
      const double value = levels_.value(k, i, x), w = slack(value, low[i], high[i]);
      if (low[i] == high[i] || anchors_.empty()) {
        if (levels_.is_met(k, i, w)) continue;
        low[i] = high[i] = value;
        open_[levels_.first(k) + i] = levels_.is_met(k, i, w, kViolated) ? w : 0.0;
        taken_at_ = larger(taken_at_, std::sqrt(dot_any(x, x, n_)));
      } else {  // below anchors the slack may still shrink
        low[i] = std::min(low[i], value);
        high[i] = std::max(high[i], value);
      }
    }
  }

  // Anchor the rows of level k at x, the end of its stage, unless it is met there.
  void anchor(int k, const double* x) {
    if (levels_.met(k, x)) return;
    const PricedLevel& level = levels_[k];
    const double* const w = levels_.w();
    const double norm = std::sqrt(dot_any(w, w, level.m));
    anchors_.push_back(std::move(spare_.back()));
    spare_.pop_back();
    Anchor& anchor = anchors_.back();
    anchor.level = k;
    anchor.first = levels_.first(k);
    anchor.omega = norm;
    anchor.allowance = law_.eta * law_.prices[k] * norm;
    anchor.held.resize(level.m);
    anchor.low.resize(level.m);
    anchor.high.resize(level.m);
    anchor.part.resize(level.m);
    for (int i = 0; i < level.m; ++i) {
      const bool equal = level.lower[i] == level.upper[i];
      const double y = levels_.value(k, i, x);
      anchor.held[i] = !level.left_out(i);
      anchor.low[i] = equal || y < level.lower[i] ? y : level.lower[i];
      anchor.high[i] = equal || y > level.upper[i] ? y : level.upper[i];
      anchor.part[i] = equal ? 1.0 : std::abs(w[i]) / norm;
    }
    for (; framed_ < k; ++framed_) {
      if (std::any_of(anchors_.begin(), anchors_.end(), [&](const Anchor& a) { return a.level == framed_; })) continue;
      for (int i = 0, at = levels_.first(framed_); i < levels_[framed_].m; ++i, ++at)
        if (low_[at] == high_[at]) motions_.hold(levels_.row(framed_, i));
    }
    motions_.complete(anchor, law_.turning ? law_.turning[k] : 0.0, x, [&](int i) { return levels_.row(k, i); });
  }

  // Call run(l, i, low, high, anchor) for the rows of levels above k, with the bounds that they leave; anchor: null for
  // a row without one.
  template <class Run>
  void each(int k, const Run& run) const {
    std::size_t next = 0;
    for (int l = 0; l < k; ++l) {
      const Anchor* anchor = next < anchors_.size() && anchors_[next].level == l ? &anchors_[next++] : nullptr;
      for (int i = 0, at = levels_.first(l); i < levels_[l].m; ++i, ++at) {
        if (anchor && anchor->held[i]) run(l, i, anchor->low[i], anchor->high[i], anchor);
        else run(l, i, low_[at], high_[at], nullptr);
      }
    }
  }

 private:
  int n_;
  PricedRows& levels_;
  Motions& motions_;
  Law law_;
  std::vector<Anchor> anchors_, spare_;  // anchors of this solve, and room for others
  std::vector<double> low_, high_, open_;
  double taken_at_ = 0.0;
  int framed_ = 0;  // levels whose equality rows anchors have seen
};

}  // namespace HQP_ISA
}  // namespace hqp
