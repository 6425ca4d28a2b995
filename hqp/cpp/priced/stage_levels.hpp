// The order of the stages of a hierarchy with prices (docs/calm.md): the exact answer settles the first levels; each
// other one has a stage and hands its rows down. Everything is allocated once.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "../solver/violated.hpp"
#include "account.hpp"
#include "choice.hpp"
#include "hand_down.hpp"
#include "level_stage.hpp"
#include "priced_rows.hpp"
#include "settled.hpp"
#include "stages.hpp"

namespace hqp {
inline namespace HQP_ISA {

class StageLevels final : public PricedStages {
 public:
  StageLevels(int n, int levels, const int* m, const bool* priced, const Tolerances& tolerances)
      : n_(n),
        tolerances_(tolerances),
        levels_(n, levels, m, tolerances),
        motions_(n, tolerances.flat),
        above_(levels_, motions_, n),
        accounts_(n, levels_.all()),
        settled_(n, levels_.all(), levels_.total(), tolerances.met),
        stage_(levels_, above_, motions_, n, tolerances, deadline_),
        choice_(n, levels_.total()),
        x_(n) {
    for (int k = 0; k < levels; ++k)
      if (priced[k]) last_ = k;
  }

  PricedLevel* levels() override { return levels_.all().data(); }
  int iterations() const override { return stage_.iterations() + completed_; }
  bool ended() const override { return stage_.ended(); }
  bool uncertain() const override { return stage_.uncertain(); }
  bool undecided() const override { return far_ || stage_.undecided(); }
  bool doubtful() const override { return undecided() || inexact_ || stage_.inexact(); }
  bool unpriced_met(const double* x) override {
    if (!levels_.measure()) return false;
    int last = levels_.count();
    while (last > 0 && !(law_.prices[last - 1] > 0.0)) --last;
    for (int k = 0; k < last; ++k)
      if (!(law_.prices[k] > 0.0) && !levels_.met(k, x)) return false;
    return true;
  }
  void reset() override { stage_.reset(), settled_.forget(); }
  void only_once() override { settled_.only_once(); }
  void keep(CarryOver& warm) override { stage_.keep(warm), settled_.keep(warm); }

  void bind(const Law& law, const Completion& completion) override {
    law_ = law;
    completion_ = completion;
    motions_.reserve(law.r, levels_.most());
    above_.bind(law);
  }

  void account(const AccountRows& rows, double* numbers, double* shares, double* worth) override {
    if (last_ < 0) motions_.set(law_.F, law_.f, law_.r);
    accounts_.run(motions_, law_.prices, stage_.ends(), above_.anchors(), rows, numbers, shares, worth);
  }

  int solve(const double* x, int prefix, double seconds, double* stages, double* last) override {
    begin(seconds);
    if (x) settled_.begin(motions_.base(), law_.prices, x);
    int first = -1;
    bool kept = true;  // no level without a price has had a stage
    for (int k = x ? 0 : prefix; k < levels_.count(); ++k) {
      const bool priced = law_.prices[k] > 0.0;
      const bool met = kept && above_.anchors().empty();  // all levels so far: x keeps to the rows that they leave
      if (met && k > last_) break;
      const bool unmet = prefix > 0 && k == prefix;  // unmet a tick ago: its stage decides
      const bool settled = met && (priced ? !unmet && settled_.meets(k) : first < 0 || !x || levels_.met(k, x));
      if (settled && unmet) return -2;
      if (settled && first < 0) continue;
      if (first < 0) {
        first = k;
        std::fill(stages, stages + levels_.count() * n_, std::numeric_limits<double>::quiet_NaN());
        const bool usable = levels_.measure();
        motions_.rounding(stage_.find_rounding());
        if (!usable) return -2;
        int l = 0;  // a level without a price that x does not meet has a stage of its own
        for (; l < k && (!x || law_.prices[l] > 0.0 || levels_.met(l, x)); ++l) above_.leave(l, x);
        if (l < k) {
          k = l - 1;
          continue;
        }
      }
      if (settled) {
        above_.leave(k, x);
        continue;
      }
      if (met && x) std::copy(x, x + n_, x_.begin());
      const bool asks = priced || levels_.bounded(k);
      if ((asks || k + 1 == levels_.count()) && !stage_.solve(k, law_.prices[k], x || !met, x_)) return -2;
      if (!x && met && !all_settled(k)) return -2;
      if (!stage_.ended() && deadline_.passed()) break;  // the levels below begin where this one does
      above_.leave(k, x_.data());
      if (priced) above_.anchor(k, x_.data());
      if (asks) std::copy(x_.begin(), x_.end(), stages + static_cast<std::size_t>(k) * n_);
      if (above_.anchors().empty() && unmet) return -2;
      kept = kept && priced;
    }
    if (above_.anchors().empty() && stage_.ended()) return -1;  // every level hands down its rows as they are
    look_from(x_.data());
    std::copy(x_.begin(), x_.end(), last);
    return first;
  }

  void complete(const double* unseen, int count, double* x) override {
    if (!stage_.left()) return;
    Basis& basis = choice_.basis();
    basis.count = stage_.left()->basis(false, basis.at(0));
    for (int j = 0; j < count; ++j) basis.hold(unseen + static_cast<std::ptrdiff_t>(j) * n_, kDirection);
    if (!basis.count) return;
    choice_.begin(x);
    for (const bool equal : {true, false})
      above_.each(levels_.count(), [&](int l, int i, double low, double high, const Anchor*) {
        if ((low == high) != equal) return;
        if (equal) choice_.hold(levels_.row(l, i));
        else choice_.add(levels_.row(l, i), low, high);
      });
    ++completed_;
    inexact_ = choice_.unclear() || (basis.count && !choice_.take(completion_.metric, completion_.origin, x));
    look_from(x);
  }

  bool describe(const double* x, int constraints, const double* allowed, double* slacks, std::int8_t* marks) override {
    bool off = false;
    for (int k = 0; k < levels_.count(); ++k) {
      const PricedLevel& level = levels_[k];
      for (int i = 0; i < level.m; ++i, ++slacks, ++marks) {
        const double low = level.lower[i], high = level.upper[i], value = levels_.value(k, i, x);
        *slacks = slack(value, low, high);
        const bool at_upper = value >= high - tolerances_.activity * (1.0 + std::abs(high));
        const bool at_lower = value <= low + tolerances_.activity * (1.0 + std::abs(low));
        *marks = low == high ? 2 : at_upper ? 1 : at_lower ? -1 : 0;
        if (k < constraints && *slacks != 0.0 && !off)
          off = violated(level, i, *slacks, allowed ? allowed[levels_.first(k) + i] : 0.0, x, n_);
      }
    }
    return off;
  }

 private:
  void begin(double seconds) {
    deadline_.start(seconds);
    motions_.set(law_.F, law_.f, law_.r);
    motions_.rounding(0.0);
    above_.begin(), stage_.begin();
    inexact_ = far_ = false, completed_ = 0;
  }

  // Return true if the levels above k, of which x_ keeps to all rows, are met for their prices.
  bool all_settled(int k) {
    settled_.begin(motions_.base(), law_.prices, x_.data());
    for (int l = 0; l < k; ++l)
      if (law_.prices[l] > 0.0 && !settled_.meets(l)) return false;
    return true;
  }

  // Values that were taken far from the answer x (n) have the rounding of that place.
  void look_from(const double* x) {
    far_ = tolerances_.met * above_.taken_at() > tolerances_.accurate * (1.0 + std::sqrt(dot_any(x, x, n_)));
  }

  int n_, last_ = -1;  // last_: the last level that may have a price
  int completed_ = 0;  // iterations of the completion
  bool inexact_ = false;
  bool far_ = false;  // an unmet level left its values too far from the answer
  Law law_;
  Completion completion_;
  Tolerances tolerances_;
  PricedRows levels_;
  Motions motions_;
  HandDown above_;
  Accounts accounts_;
  Settled settled_;
  Deadline deadline_;
  LevelStage stage_;
  Choice choice_;
  std::vector<double> x_;
};

}  // namespace HQP_ISA
}  // namespace hqp
