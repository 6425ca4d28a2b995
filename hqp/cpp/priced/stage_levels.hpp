// The stages of a hierarchy with prices (docs/calm.md): which levels the exact answer settles, a stage for each of the
// others, and what each hands down. Everything is allocated once.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <vector>

#include "account.hpp"
#include "anchors.hpp"
#include "remainder.hpp"
#include "settled.hpp"
#include "stage_search.hpp"
#include "stages.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr double kSlackMotion = 1e-5;   // slacks of inequality rows count this much as motion
constexpr double kRoundingRow = 2e-15;  // of the longest row: rows no longer have no direction
constexpr double kResting = 1e-4;       // of the largest entry: terms of a row are no smaller, as hqp/pricing.py says

class StageLevels final : public PricedStages {
 public:
  StageLevels(int n, int levels, const int* m, const bool* priced, const Tolerances& tolerances)
      : n_(n),
        level_(sized(levels, m)),
        above_(levels),
        remaining_(levels + 1),
        warm_(levels),
        first_(levels),
        tolerances_(tolerances),
        motions_(n, tolerances.flat),
        ends_(levels),
        accounts_(n, level_),
        settled_(n, level_, total(levels, m), tolerances.met),
        remainder_(n, level_, priced),
        search_(total(levels, m), n + total(levels, m) + most(levels, m)) {
    last_ = -1;
    int rows = 0;
    for (int k = 0; k < levels; ++k) {
      if (priced[k]) last_ = k;
      first_[k] = rows;
      rows += m[k];
    }
    const int variables = n + rows + most(levels, m);
    rows_.room(rows, padded(variables));
    T_.resize(static_cast<std::size_t>(most(levels, m)) * padded(variables));
    t_.resize(most(levels, m));
    y_.resize(padded(variables));
    a_.resize(n);
    x_.resize(n);
    w_.resize(most(levels, m));
    low_.resize(rows);
    high_.resize(rows);
    anchors_.reserve(levels);
  }

  PricedLevel* levels() override { return level_.data(); }
  Room* above() override { return above_.data(); }
  Remaining* remaining() override { return remaining_.data(); }
  int iterations() const override { return iterations_; }
  bool ended() const override { return ended_; }
  bool uncertain() const override { return uncertain_; }
  bool doubtful() const override { return doubtful_; }
  void reset() override {
    for (auto& set : warm_) set.clear();
    settled_.forget();
  }

  void bind(const Law& law, const Completion& completion) override {
    law_ = law;
    completion_ = completion;
  }

  void account(const AccountRows& rows, double* numbers, double* shares, double* worth) override {
    if (last_ < 0) motions_.set(law_.F, law_.f, law_.r);
    accounts_.run(motions_, law_.prices, ends_, anchors_, rows, numbers, shares, worth);
  }

  int solve(const double* x, int head, double seconds, double* stages, double* last) override {
    begin(seconds);
    settled_.begin(motions_.base(), law_.prices, x);
    int first = -1;
    for (int k = 0; k < static_cast<int>(level_.size()); ++k) {
      const bool priced = law_.prices[k] > 0.0;
      const bool met = anchors_.empty();  // all levels so far, so that x keeps to what they leave
      if (met && k > last_) break;
      const bool settled = met && (!priced || settled_.meets(k));
      if (settled && head > 0 && k == head) return -2;
      if (settled && first < 0) continue;
      if (first < 0) {
        first = k;
        std::fill(stages, stages + level_.size() * n_, std::numeric_limits<double>::quiet_NaN());
        rows_.flat = !motions_.diagonal();
        find_rounding();
        for (int l = 0; l < k; ++l) leave(l, x);
      }
      if (settled) {
        leave(k, x);
        continue;
      }
      if (met) std::copy(x, x + n_, x_.begin());
      if (priced) stage(k);
      else if (asks(k)) remainder(k);
      if (!ended_ && late()) break;  // the levels below begin where this one does
      leave(k, x_.data());
      if (priced) {
        anchor(k, x_.data());
        if (!anchored(k) && met) settled_.begin_with(k, warm_[k], row_of_);  // it ended at the point of least motion
        std::copy(x_.begin(), x_.end(), stages + static_cast<std::size_t>(k) * n_);
      }
      if (anchors_.empty() && head > 0 && k == head) return -2;
    }
    uncertain_ = uncertain_ || search_.uncertain();
    if (anchors_.empty() && ended_) return -1;  // every level hands down its rows as they are
    finish();
    std::copy(x_.begin(), x_.end(), last);
    return first;
  }

  bool describe(const double* x, int constraints, double activity, double violation, double* slacks,
                std::int8_t* marks) override {
    bool violated = false;
    for (std::size_t k = 0; k < level_.size(); ++k) {
      const PricedLevel& level = level_[k];
      for (int i = 0; i < level.m; ++i, ++slacks, ++marks) {
        const double low = level.lower[i], high = level.upper[i], value = product(level, i, x);
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
  using Clock = std::chrono::steady_clock;

  static std::vector<PricedLevel> sized(int levels, const int* m) {
    std::vector<PricedLevel> all(levels);
    for (int k = 0; k < levels; ++k) all[k].m = m[k];
    return all;
  }
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

  void begin(double seconds) {
    limited_ = seconds > 0.0 && std::isfinite(seconds);
    if (limited_)
      end_ = Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
    search_.limit(seconds);
    search_.restart();
    motions_.set(law_.F, law_.f, law_.r);
    iterations_ = 0;
    ended_ = true;
    uncertain_ = doubtful_ = false;
    anchors_.clear();
    forget_rows();
    for (StageEnd& end : ends_) end.known = false;
  }

  double left() const {
    return limited_ ? larger(std::chrono::duration<double>(end_ - Clock::now()).count(), 1e-6) : 0.0;
  }
  bool late() const { return limited_ && Clock::now() > end_; }

  const double* row(const PricedLevel& level, int i) {
    if (level.A) return level.A + static_cast<std::size_t>(i) * n_;
    std::fill(a_.begin(), a_.end(), 0.0);
    a_[level.index[i]] = level.scale[i];
    return a_.data();
  }

  double product(const PricedLevel& level, int i, const double* x) const {
    if (!level.A) return level.scale[i] * x[level.index[i]];
    return dot_any(level.A + static_cast<std::size_t>(i) * n_, x, n_);
  }

  double square(const PricedLevel& level, int i) const {
    if (!level.A) return level.scale[i] * level.scale[i];
    const double* a = level.A + static_cast<std::size_t>(i) * n_;
    return dot_any(a, a, n_);
  }

  const Anchor* anchored(int k) const {
    return !anchors_.empty() && anchors_.back().level == k ? &anchors_.back() : nullptr;
  }

  // Whether any row of level k is more than free; a level that asks nothing leaves x where it is.
  bool asks(int k) const {
    for (int i = 0; i < level_[k].m; ++i)
      if (!level_[k].left_out(i)) return true;
    return false;
  }

  // The rows that level k leaves at x: as they are, or its values where it has no price.
  void leave(int k, const double* x) {
    const PricedLevel& level = level_[k];
    double *low = &low_[first_[k]], *high = &high_[first_[k]];
    std::copy(level.lower, level.lower + level.m, low);
    std::copy(level.upper, level.upper + level.m, high);
    if (law_.prices[k] > 0.0) return;
    for (int i = 0; i < level.m; ++i) {  // its slack is unique: equality rows and violated rows keep their value
      if (level.left_out(i)) continue;
      const double value = product(level, i, x), w = slack(value, low[i], high[i]);
      if (low[i] == high[i] || (anchors_.empty() && std::abs(w) > tolerances_.met * (1.0 + std::abs(value)))) {
        low[i] = high[i] = value;
      } else if (!anchors_.empty()) {  // below them it may still be lessened
        low[i] = std::min(low[i], value);
        high[i] = std::max(high[i], value);
      }
    }
  }

  // The anchor of level k where it is not met at x, the end of its stage.
  void anchor(int k, const double* x) {
    const PricedLevel& level = level_[k];
    double square = 0.0, size = 0.0, largest = 0.0;
    for (int j = 0; j < n_; ++j) largest = larger(largest, std::abs(x[j]));
    const double least = kResting * largest;
    for (int i = 0; i < level.m; ++i) {
      const double* a = row(level, i);
      double value = 0.0, terms = 0.0;
      for (int j = 0; j < n_; ++j) {
        value += a[j] * x[j];
        terms += std::abs(a[j]) * (std::abs(x[j]) + least);
      }
      w_[i] = slack(value, level.lower[i], level.upper[i]);
      square += w_[i] * w_[i];
      const double bound = std::isfinite(level.lower[i])   ? level.lower[i]
                           : std::isfinite(level.upper[i]) ? level.upper[i]
                                                           : 0.0;
      size = larger(size, terms + std::abs(bound));
    }
    const double norm = std::sqrt(square);
    if (norm <= tolerances_.met * size) return;
    anchors_.emplace_back();
    Anchor& anchor = anchors_.back();
    anchor.level = k;
    anchor.first = first_[k];
    anchor.omega = norm;
    anchor.give = law_.eta * law_.prices[k] * norm;
    anchor.held.resize(level.m);
    anchor.low.resize(level.m);
    anchor.high.resize(level.m);
    anchor.part.resize(level.m);
    for (int i = 0; i < level.m; ++i) {
      const bool equal = level.lower[i] == level.upper[i];
      const double y = product(level, i, x);
      anchor.held[i] = !level.left_out(i);
      anchor.low[i] = equal || y < level.lower[i] ? y : level.lower[i];
      anchor.high[i] = equal || y > level.upper[i] ? y : level.upper[i];
      anchor.part[i] = equal ? 1.0 : std::abs(w_[i]) / norm;
    }
    motions_.complete(anchor, law_.turning ? law_.turning[k] : 0.0, x, [&](int i) { return row(level, i); });
    forget_rows();
  }

  // Rows no longer than this are rounding: a level of such rows has no stage.
  void find_rounding() {
    double longest = 0.0;
    for (const PricedLevel& level : level_)
      for (int i = 0; i < level.m; ++i) longest = larger(longest, square(level, i));
    rounding_ = kRoundingRow * kRoundingRow * longest;
  }

  void forget_rows() {
    rows_.count = gathered_ = bands_ = 0;
    row_of_.clear();
  }

  // The rows that levels above k leave, in motion coordinates.  Those of an anchor move by bands, variables of their
  // own: c_k y^2 / 2 is what they cost.
  void gather(int k, const Coordinates& at) {
    if (!anchors_.empty()) {  // other coordinates than those of the stage before
      forget_rows();
      uncertain_ = uncertain_ || search_.uncertain();
      search_.restart();
    }
    std::size_t next = 0;
    for (; gathered_ < k; ++gathered_) {
      const Anchor* anchor = nullptr;
      if (next < anchors_.size() && anchors_[next].level == gathered_) anchor = &anchors_[next++];
      const PricedLevel& level = level_[gathered_];
      const double root = anchor ? std::sqrt(anchor->give) : 0.0;
      for (int i = 0; i < level.m; ++i) {
        const int row_number = first_[gathered_] + i;
        double low = low_[row_number], high = high_[row_number];
        if (low == -INFINITY && high == INFINITY) continue;
        const bool held = anchor && anchor->held[i];
        if (!level.A && !held && at.diagonal()) {
          const int j = static_cast<int>(level.index[i]);
          const double shift = level.scale[i] * at.still()[j];
          if (!rows_.pick(rows_.count, j, at.picked(j, level.scale[i]), low - shift, high - shift)) continue;
        } else {
          const double *a = row(level, i), shift = dot_any(a, at.still(), n_);
          double* c = rows_.row(rows_.count);
          std::fill(c, c + rows_.ld, 0.0);
          at.row(a, c);
          if (held) {
            c[n_ + bands_] = -root;
            low = anchor->low[i];
            high = anchor->high[i];
            y_[n_ + bands_] = slack(dot_any(a, x_.data(), n_), low, high) / root;
            ++bands_;
          }
          if (!rows_.close(rows_.count, n_ + bands_, low - shift, high - shift, std::sqrt(dot_any(a, a, n_)))) continue;
        }
        ++rows_.count;
        row_of_.push_back(row_number);
      }
    }
  }

  // Level k over what the levels above leave, from x_ to its optimum.
  void stage(int k) {
    const PricedLevel& level = level_[k];
    const double price = law_.prices[k];
    const Coordinates& at = motions_.among(anchors_);
    gather(k, at);
    at.motion(x_.data(), y_.data());
    const int own = rows_.count, ld = rows_.ld;
    int N = n_ + bands_, m = 0;
    double longest = 0.0;
    std::fill(y_.begin() + N, y_.end(), 0.0);
    std::fill(T_.begin(), T_.end(), 0.0);
    for (int i = 0; i < level.m; ++i) {
      if (level.left_out(i)) continue;
      longest = larger(longest, square(level, i));
      const double* a = row(level, i);
      const double shift = dot_any(a, at.still(), n_);
      double* T = &T_[static_cast<std::size_t>(m) * ld];
      if (level.lower[i] == level.upper[i]) {
        at.row(a, T);
        t_[m++] = level.lower[i] - shift;
        continue;
      }
      // lower <= a y - s <= upper with a slack s = y[N] / kSlackMotion that the level keeps small
      double* c = rows_.row(rows_.count);
      std::fill(c, c + ld, 0.0);
      at.row(a, c);
      c[N] = -1.0 / kSlackMotion;
      T[N] = 1.0 / kSlackMotion;
      t_[m++] = 0.0;
      y_[N] = kSlackMotion * slack(dot_any(a, x_.data(), n_), level.lower[i], level.upper[i]);
      const double low = level.lower[i] - shift, high = level.upper[i] - shift;
      if (rows_.close(rows_.count, N + 1, low, high, std::sqrt(square(level, i)))) ++rows_.count;
      ++N;
    }
    if (longest <= rounding_) m = 0;
    if (m) {
      const bool reached =
          search_.solve(rows_, own, N, T_.data(), t_.data(), m, price, y_.data(), warm_[k], iterations_);
      ended_ = ended_ && reached;
      note(k, own, reached);
      at.point(y_.data(), x_.data());
    }
    rows_.count = own;
  }

  // How the stage of level k ended.
  void note(int k, int own, bool reached) {
    StageEnd& end = ends_[k];
    end.known = reached;
    end.rows.clear();
    end.lambda.clear();
    end.firm.clear();
    for (std::size_t q = 0; q < search_.held().size(); ++q) {
      const int i = search_.held()[q];
      if (i >= own) continue;
      end.rows.push_back(row_of_[i]);
      end.lambda.push_back(search_.multipliers()[q] / rows_.length[i]);
      end.firm.push_back(rows_.equal[i]);
    }
  }

  // Level k, which has no price, below an unmet one.
  void remainder(int k) {
    const Remaining& rest = remaining_[k];
    remainder_.write(k, anchors_, low_.data(), high_.data(), motions_, above_.data(), rest, completion_);
    const int outcome = rest.solve->run(left());
    doubtful_ = doubtful_ || outcome == kUncertainRank;
    if (outcome == 0 || outcome == kUncertainRank) remainder_.point(rest.z, x_.data());
    else ended_ = false;
  }

  // Which of the answers, where the last level has a price and motion leaves a choice.
  void finish() {
    const Remaining& rest = remaining_.back();
    if (!ended_ || !rest.solve || motions_.base().rank() == n_) return;
    remainder_.finish(anchors_, low_.data(), high_.data(), motions_, x_.data(), above_.data(), rest, completion_);
    if (rest.solve->run(left()) == 0) remainder_.point(rest.z, x_.data());
    else doubtful_ = true;
  }

  static constexpr int kUncertainRank = 1;  // an outcome of the kernel, hqp/cpp/solver/problem.hpp

  int n_, last_ = -1, iterations_ = 0;
  int gathered_ = 0, bands_ = 0;  // levels whose rows are gathered, and variables of anchored rows
  bool ended_ = true, uncertain_ = false, doubtful_ = false, limited_ = false;
  double rounding_ = 0.0;
  Clock::time_point end_;
  std::vector<PricedLevel> level_;
  std::vector<Room> above_;
  std::vector<Remaining> remaining_;
  std::vector<std::vector<int>> warm_;
  std::vector<int> first_;  // each level's first row among all
  Law law_;
  Completion completion_;
  Tolerances tolerances_;
  Motions motions_;
  std::vector<Anchor> anchors_;
  std::vector<StageEnd> ends_;
  std::vector<int> row_of_;
  Accounts accounts_;
  Settled settled_;
  Remainder remainder_;
  StageSearch search_;
  StageRows rows_;
  std::vector<double> T_, t_, y_, a_, x_, w_, low_, high_;
};

}  // namespace HQP_ISA
}  // namespace hqp
