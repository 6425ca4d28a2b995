// The stages of a hierarchy with prices (docs/calm.md): which levels the exact answer settles, a stage for each of the
// others, and what each hands down. Everything is allocated once.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "account.hpp"
#include "anchors.hpp"
#include "choice.hpp"
#include "settled.hpp"
#include "stage_search.hpp"
#include "stages.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr double kSlackMotion = 1e-5;   // slacks of inequality rows count this much as motion
constexpr double kRoundingRow = 2e-15;  // of the longest row: rows no longer have no direction
constexpr double kFlatPull = 1e-10;     // of the level's gradient: what directions without motion, or slacks, may pull
constexpr int kFlatRounds = 100;

class StageLevels final : public PricedStages {
 public:
  StageLevels(int n, int levels, const int* m, const bool* priced, const Tolerances& tolerances)
      : n_(n),
        level_(sized(levels, m)),
        warm_(levels),
        end_at_(levels),
        first_(levels),
        tolerances_(tolerances),
        motions_(n, tolerances.flat),
        ends_(levels),
        accounts_(n, level_),
        settled_(n, level_, total(levels, m), tolerances.met),
        variables_(n + total(levels, m) + most(levels, m)),
        search_(total(levels, m) + most(levels, m) + 2 * variables_, n, variables_, most(levels, m),
                tolerances.accurate, tolerances.rounded, deadline_),
        rows_(n, total(levels, m) + most(levels, m) + 2 * variables_, total(levels, m), padded(variables_)),
        choice_(n, total(levels, m), tolerances.activity, tolerances.violation, deadline_) {
    last_ = -1;
    int rows = 0;
    for (int k = 0; k < levels; ++k) {
      if (priced[k]) last_ = k;
      first_[k] = rows;
      rows += m[k];
    }
    T_.resize(static_cast<std::size_t>(most(levels, m)) * padded(variables_));
    t_.resize(most(levels, m));
    sizes_.resize(most(levels, m));
    y_.resize(padded(variables_));
    a_.resize(padded(n));
    x_.resize(n);
    extent_.resize(n);
    w_.resize(most(levels, m));
    low_.resize(rows);
    high_.resize(rows);
    lengths_.resize(rows + 1);
    anchors_.reserve(levels);
    spare_.resize(levels);
    for (Anchor& anchor : spare_) {
      anchor.held.reserve(most(levels, m));
      for (auto* part : {&anchor.low, &anchor.high, &anchor.part}) part->reserve(most(levels, m));
    }
    for (auto& set : warm_) set.reserve(rows);
    for (auto& x : end_at_) x.reserve(n);
    for (StageEnd& end : ends_) {
      end.rows.reserve(rows);
      end.lambda.reserve(rows);
      end.firm.reserve(rows);
    }
  }

  PricedLevel* levels() override { return level_.data(); }
  int iterations() const override { return iterations_; }
  bool ended() const override { return ended_; }
  bool uncertain() const override { return uncertain_; }
  bool undecided() const override { return undecided_; }
  bool doubtful() const override { return undecided_ || inexact_; }
  bool unpriced_met(const double* x) override {
    if (!measure()) return false;
    int last = static_cast<int>(level_.size());
    while (last > 0 && !(law_.prices[last - 1] > 0.0)) --last;
    for (int k = 0; k < last; ++k) {
      if (!(law_.prices[k] > 0.0) && !met(k, x)) return false;
    }
    return true;
  }
  void reset() override {
    for (auto& set : warm_) set.clear();
    for (auto& x : end_at_) x.clear();
    settled_.forget();
  }

  void only_once() override { settled_.only_once(); }

  void keep(CarryOver& warm) override {
    for (auto& set : warm_) warm.list(set);
    for (auto& x : end_at_) warm.list(x);
    settled_.keep(warm);
  }

  void bind(const Law& law, const Completion& completion) override {
    law_ = law;
    completion_ = completion;
    motions_.reserve(law.r, static_cast<int>(w_.size()));
    for (Anchor& anchor : spare_) {
      for (auto* part : {&anchor.weight, &anchor.from}) part->reserve(law.r ? law.r : n_);
      anchor.share.reserve(w_.size() * static_cast<std::size_t>(law.r ? law.r : n_));
    }
  }

  void account(const AccountRows& rows, double* numbers, double* shares, double* worth) override {
    if (last_ < 0) motions_.set(law_.F, law_.f, law_.r);
    accounts_.run(motions_, law_.prices, ends_, anchors_, rows, numbers, shares, worth);
  }

  int solve(const double* x, int head, double seconds, double* stages, double* last) override {
    begin(seconds);
    if (x) settled_.begin(motions_.base(), law_.prices, x);
    int first = -1;
    for (int k = x ? 0 : head; k < static_cast<int>(level_.size()); ++k) {
      const bool priced = law_.prices[k] > 0.0;
      const bool met = anchors_.empty();  // all levels so far, so that x keeps to what they leave
      if (met && k > last_) break;
      const bool asked = head > 0 && k == head;  // not met a tick ago: its stage tells whether it is by now
      const bool settled = met && (!priced || (!asked && settled_.meets(k)));
      if (settled && asked) return -2;
      if (settled && first < 0) continue;
      if (first < 0) {
        first = k;
        std::fill(stages, stages + level_.size() * n_, std::numeric_limits<double>::quiet_NaN());
        if (!find_rounding()) return -2;
        for (int l = 0; l < k; ++l) leave(l, x);
      }
      if (settled) {
        leave(k, x);
        continue;
      }
      if (met && x) std::copy(x, x + n_, x_.begin());
      if ((priced || asks(k)) && !stage(k, x || !met)) return -2;
      if (!x && met && !all_settled(k)) return -2;
      if (!ended_ && deadline_.passed()) break;  // the levels below begin where this one does
      leave(k, x_.data());
      if (priced) {
        anchor(k, x_.data());
        if (!anchored(k) && met) settled_.begin_with(k, warm_[k]);  // it ended at the point of least motion
        std::copy(x_.begin(), x_.end(), stages + static_cast<std::size_t>(k) * n_);
      }
      if (anchors_.empty() && asked) return -2;
    }
    if (anchors_.empty() && ended_) return -1;  // every level hands down its rows as they are
    finish();
    // a value that was taken far from the answer has the rounding of there
    const double here = 1.0 + std::sqrt(dot_any(x_.data(), x_.data(), n_));
    undecided_ = undecided_ || tolerances_.met * taken_at_ > tolerances_.accurate * here;
    std::copy(x_.begin(), x_.end(), last);
    return first;
  }

  bool describe(const double* x, int constraints, const double* allowed, double* slacks, std::int8_t* marks) override {
    bool violated = false;
    for (std::size_t k = 0; k < level_.size(); ++k) {
      const PricedLevel& level = level_[k];
      for (int i = 0; i < level.m; ++i, ++slacks, ++marks) {
        const double low = level.lower[i], high = level.upper[i], value = product(level, i, x);
        *slacks = slack(value, low, high);
        const bool at_upper = value >= high - tolerances_.activity * (1.0 + std::abs(high));
        const bool at_lower = value <= low + tolerances_.activity * (1.0 + std::abs(low));
        *marks = low == high ? 2 : at_upper ? 1 : at_lower ? -1 : 0;
        if (static_cast<int>(k) < constraints && *slacks != 0.0)
          violated =
              violated || std::abs(*slacks) > tolerances_.violation * (1.0 + std::abs(*slacks > 0.0 ? high : low)) +
                                                  (allowed ? allowed[first_[k] + i] : 0.0);
      }
    }
    return violated;
  }

 private:
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
    deadline_.start(seconds);
    motions_.set(law_.F, law_.f, law_.r);
    motions_.rounding(0.0);
    iterations_ = 0;
    ended_ = true;
    uncertain_ = undecided_ = inexact_ = false;
    for (; !anchors_.empty(); anchors_.pop_back()) spare_.push_back(std::move(anchors_.back()));
    open_ = false;
    taken_at_ = 0.0;
    framed_ = 0;
    for (StageEnd& end : ends_) end.known = false;
  }

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

  const Anchor* anchored(int k) const {
    return !anchors_.empty() && anchors_.back().level == k ? &anchors_.back() : nullptr;
  }

  // Whether any row of level k is more than free; a level that asks nothing leaves x where it is.
  bool asks(int k) const {
    for (int i = 0; i < level_[k].m; ++i)
      if (!level_[k].left_out(i)) return true;
    return false;
  }

  // Whether the levels above k, of which x_ keeps to all rows, are met for their prices.
  bool all_settled(int k) {
    settled_.begin(motions_.base(), law_.prices, x_.data());
    for (int l = 0; l < k; ++l)
      if (law_.prices[l] > 0.0 && !settled_.meets(l)) return false;
    return true;
  }

  // The rows that level k leaves at x: as they are, or its values where it has no price.
  void leave(int k, const double* x) {
    const PricedLevel& level = level_[k];
    double *low = &low_[first_[k]], *high = &high_[first_[k]];
    std::copy(level.lower, level.lower + level.m, low);
    std::copy(level.upper, level.upper + level.m, high);
    if (law_.prices[k] > 0.0 || !x) return;
    rest_at(x);
    for (int i = 0; i < level.m; ++i) {  // its slack is unique: rows that are missed keep their value
      if (level.left_out(i)) continue;
      const double value = product(level, i, x), w = slack(value, low[i], high[i]);
      if (low[i] == high[i] || anchors_.empty()) {
        if (w == 0.0 || std::abs(w) <= tolerances_.met * size(level, i)) continue;
        low[i] = high[i] = value;
        taken_at_ = larger(taken_at_, std::sqrt(dot_any(x, x, n_)));
      } else {  // below anchors it may still be lessened
        low[i] = std::min(low[i], value);
        high[i] = std::max(high[i], value);
      }
    }
  }

  // What each entry of x counts for.
  void rest_at(const double* x) {
    double largest = 1.0;
    for (int j = 0; j < n_; ++j) largest = larger(largest, std::abs(x[j]));
    for (int j = 0; j < n_; ++j) extent_[j] = std::abs(x[j]) + tolerances_.resting * largest;
  }

  // What the rounding of row i is relative to there: its terms and its bound.
  double size(const PricedLevel& level, int i) const {
    const double terms = level.A ? absolute_dot(level.A + static_cast<std::size_t>(i) * n_, extent_.data(), n_)
                                 : std::abs(level.scale[i]) * extent_[level.index[i]];
    const double low = level.lower[i], high = level.upper[i];
    return terms + std::abs(std::isfinite(low) ? low : std::isfinite(high) ? high : 0.0);
  }

  // Whether w of level k at x, which goes into w_, is rounding of rows of unit length.
  bool met(int k, const double* x) {
    const PricedLevel& level = level_[k];
    rest_at(x);
    const double* const length = &lengths_[first_[k]];
    const double longest = level.m ? *std::max_element(length, length + level.m) : 0.0;
    double off = 0.0, size = 0.0;
    for (int i = 0; i < level.m; ++i) {
      const double unit = length[i] > 0.0 ? length[i] : longest > 0.0 ? longest : 1.0;
      w_[i] = slack(product(level, i, x), level.lower[i], level.upper[i]);
      off += w_[i] / unit * (w_[i] / unit);
      size = larger(size, this->size(level, i) / unit);
    }
    return std::sqrt(off) <= tolerances_.met * size;
  }

  // The anchor of level k where it is not met at x, the end of its stage.
  void anchor(int k, const double* x) {
    const PricedLevel& level = level_[k];
    if (met(k, x)) return;
    const double norm = std::sqrt(dot_any(w_.data(), w_.data(), level.m));
    anchors_.push_back(std::move(spare_.back()));
    spare_.pop_back();
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
    for (; framed_ < k; ++framed_) {
      if (std::any_of(anchors_.begin(), anchors_.end(), [&](const Anchor& a) { return a.level == framed_; })) continue;
      for (int i = 0; i < level_[framed_].m; ++i)
        if (low_[first_[framed_] + i] == high_[first_[framed_] + i]) motions_.hold(row(level_[framed_], i));
    }
    motions_.complete(anchor, law_.turning ? law_.turning[k] : 0.0, x, [&](int i) { return row(level, i); });
  }

  // Lengths of all rows; whether these are numbers, and no bounds crossed.
  bool measure() {
    double sum = 0.0;
    bool apart = true;
    for (std::size_t k = 0; k < level_.size(); ++k) {
      const PricedLevel& level = level_[k];
      for (int i = 0; i < level.m; ++i) {
        const double *a = level.A + static_cast<std::size_t>(i) * n_, low = level.lower[i], high = level.upper[i];
        sum += lengths_[first_[k] + i] = level.A ? std::sqrt(dot_any(a, a, n_)) : std::abs(level.scale[i]);
        apart = apart && low <= high && low < INFINITY && high > -INFINITY;
      }
    }
    return apart && sum < INFINITY;
  }

  // Rows no longer than this are rounding: a level of such rows has no stage.  As measure().
  bool find_rounding() {
    const bool usable = measure();
    rounding_ = kRoundingRow * *std::max_element(lengths_.begin(), lengths_.end());
    rows_.rounding(rounding_);
    motions_.rounding(rounding_);
    return usable;
  }

  // Row i of a level, between these bounds.
  StageRow bounded(int k, int i, double low, double high) const {
    const PricedLevel& level = level_[k];
    StageRow to;
    if (level.A) to.a = level.A + static_cast<std::size_t>(i) * n_;
    else to.only = static_cast<int>(level.index[i]), to.scale = level.scale[i];
    to.lower = low, to.upper = high;
    to.number = first_[k] + i;
    to.size = lengths_[to.number];
    return to;
  }

  // The rows that levels above k leave.  Those of an anchor move by bands, coordinates of their own of which y^2 / 2 is
  // what they cost.  The number of coordinates.
  int gather(int k) {
    int N = n_;
    std::size_t next = 0;
    for (int l = 0; l < k; ++l) {
      const Anchor* anchor = next < anchors_.size() && anchors_[next].level == l ? &anchors_[next++] : nullptr;
      const double root = anchor ? std::sqrt(anchor->give) : 0.0;
      for (int i = 0; i < level_[l].m; ++i) {
        if (!anchor || !anchor->held[i]) {
          rows_.add(bounded(l, i, low_[first_[l] + i], high_[first_[l] + i]));
          continue;
        }
        StageRow to = bounded(l, i, anchor->low[i], anchor->high[i]);
        to.band = N;
        to.share = -root;
        y_[N] = slack(product(level_[l], i, x_.data()), to.lower, to.upper) / root;
        N += rows_.add(to);
      }
    }
    return N;
  }

  // Level k over what the levels above leave, from x_ to its optimum.  started: whether x_ keeps to that; false where
  // it may not, and the face of the last tick does not give the optimum.
  bool stage(int k, bool started) {
    const PricedLevel& level = level_[k];
    const bool priced = law_.prices[k] > 0.0;
    Coordinates& at = priced ? motions_.among(anchors_) : motions_.over(level, anchors_, x_.data());
    rows_.begin(at, n_);
    int N = gather(k);
    const int own = rows_.count(), ld = padded(variables_);
    at.motion(x_.data(), y_.data());
    Aim aim{T_.data(), t_.data(), sizes_.data(), ld, 0, priced ? law_.prices[k] : 1.0};
    double longest = priced ? 0.0 : INFINITY;
    for (int i = 0; i < level.m; ++i) {
      const bool equal = level.lower[i] == level.upper[i];
      if (level.left_out(i) || (equal && !priced)) continue;
      const double* a = row(level, i);
      double* T = &T_[static_cast<std::size_t>(aim.m) * ld];
      if (priced) {
        longest = larger(longest, sizes_[aim.m] = lengths_[first_[k] + i]);
        std::fill(T, T + ld, 0.0);
        t_[aim.m++] = 0.0;
        if (equal) {
          at.row(a, T);
          continue;
        }
      }
      // lower <= a x - s <= upper with a slack s = unit y[N] that the level keeps small
      const double unit = priced ? 1.0 / kSlackMotion : 1.0;
      StageRow to = bounded(k, i, level.lower[i], level.upper[i]);
      y_[N] = slack(product(level, i, x_.data()), to.lower, to.upper) / unit;
      to.band = N;
      to.share = -unit;
      rows_.grade(N, 1.0 / unit);
      if (priced) T[N] = unit;
      N += rows_.add(to);
    }
    if (longest <= rounding_) return started;
    while (N % kLane) y_[N++] = 0.0;  // coordinates that no row sees: whole vectors
    const auto search = [&](bool from_y) {
      for (int i = 0, row = 0; priced && i < level.m; ++i) {
        if (level.left_out(i)) continue;
        if (level.lower[i] == level.upper[i]) t_[row] = level.lower[i] - dot_any(this->row(level, i), at.still(), n_);
        ++row;
      }
      return search_.solve(rows_, N, aim, y_.data(), warm_[k], iterations_, end_at_[k], from_y);
    };
    bool reached = search(started);
    if (!reached && !started) return false;
    int rounds = 0;  // directions without motion, and slacks, count from where they ended, until that is nothing
    for (; reached && rounds <= kFlatRounds; ++rounds) {
      const bool flat = flat_counts(k, at, aim.price), slack = priced && slacks_count(own, aim.price);
      if (!flat && !slack) break;
      if (flat) at.count_flat_from(y_.data());
      if (slack) count_slacks_from(k, own);
      reached = search(true);
    }
    ended_ = ended_ && reached;
    uncertain_ = uncertain_ || search_.uncertain();
    undecided_ = undecided_ || (!priced && search_.uncertain());
    inexact_ = inexact_ || rounds > kFlatRounds || search_.strays(y_.data());
    note(k, own, reached);
    at.point(y_.data(), x_.data());
    if (reached) end_at_[k].clear();
    else end_at_[k] = x_;
    seen_by_ = &at;
    open_ = leaves(at);
    return true;
  }

  // Whether what directions without motion count pulls, at y_, by more than rounding of a row's own gradient.
  bool flat_counts(int k, const Coordinates& at, double price) {
    const double pull = price * at.flat_pull(y_.data());
    if (pull == 0.0) return false;
    double shortest = INFINITY, far = 1.0;
    for (int i = 0; i < level_[k].m; ++i) {
      const double own = lengths_[first_[k] + i];
      if (!level_[k].left_out(i) && own > rounding_) shortest = smaller(shortest, own * own);
    }
    if (law_.prices[k] > 0.0) return pull > kFlatPull * std::sqrt(shortest);
    at.point(y_.data(), x_.data());
    for (int j = 0; j < n_; ++j) far = larger(far, std::abs(x_[j]));
    return pull > kFlatPull * kUncertain * shortest * far;  // so that w is known in directions as short as these
  }

  // Whether what slacks count, of the rows of the stage from `own` on, pulls by more than rounding of their own.
  bool slacks_count(int own, double price) const {
    double most = 0.0;
    for (int i = own; i < rows_.count(); ++i) most = larger(most, std::fabs(y_[rows_[i].band]));
    return price * kSlackMotion * most > kFlatPull;
  }

  // They count from where y_ has them, which goes on.
  void count_slacks_from(int k, int own) {
    const PricedLevel& level = level_[k];
    for (int i = 0, row = 0, at = own; i < level.m; ++i) {
      if (level.left_out(i)) continue;
      if (level.lower[i] != level.upper[i]) {
        double& y = y_[rows_[at].band];
        t_[row] += rows_[at].share * y;
        rows_.count_from(at++, y);
        y = 0.0;
      }
      ++row;
    }
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
      end.rows.push_back(rows_[i].number);
      end.lambda.push_back(search_.multipliers()[q]);
      end.firm.push_back(rows_[i].equal());
    }
  }

  // The answer, where the last level leaves a choice: hard and anchored rows stay as they are.
  void finish() {
    if (!ended_ || !open_) return;
    choice_.begin(seen_by_->basis(false, choice_.basis()), x_.data());
    std::size_t next = 0;
    for (int l = 0; l < static_cast<int>(level_.size()); ++l) {
      const Anchor* anchor = next < anchors_.size() && anchors_[next].level == l ? &anchors_[next++] : nullptr;
      for (int i = 0; i < level_[l].m; ++i) {
        const bool held = anchor && anchor->held[i];
        choice_.add(row(level_[l], i), held ? anchor->low[i] : low_[first_[l] + i],
                    held ? anchor->high[i] : high_[first_[l] + i]);
      }
    }
    ++iterations_;
    if (!choice_.take(completion_.metric, completion_.origin, x_.data())) inexact_ = true;
  }

  // Whether the equalities of the latest search leave a direction that its coordinates do not see.
  bool leaves(const Coordinates& at) const {
    for (int j = 0; j < n_; ++j)
      if (!at.moves(j) && !search_.determines(j)) return true;
    return false;
  }

  int n_, last_ = -1, iterations_ = 0;
  int framed_ = 0;  // levels whose equality rows anchors have seen
  bool ended_ = true, uncertain_ = false, undecided_ = false, inexact_ = false;
  const Coordinates* seen_by_ = nullptr;  // of the latest stage
  bool open_ = false;                     // whether it left a choice
  double rounding_ = 0.0;
  double taken_at_ = 0.0;  // |x| where a level without a price that was missed left its values
  std::vector<PricedLevel> level_;
  std::vector<std::vector<int>> warm_;
  std::vector<std::vector<double>> end_at_;  // where each level's latest stage was cut, empty where it was not
  std::vector<int> first_;                   // each level's first row among all
  Law law_;
  Completion completion_;
  Tolerances tolerances_;
  Motions motions_;
  std::vector<Anchor> anchors_, spare_;  // those of this solve, and room for others
  std::vector<StageEnd> ends_;
  Accounts accounts_;
  Settled settled_;
  int variables_;  // of a stage
  Deadline deadline_;
  StageSearch search_;
  StageRows rows_;
  Choice choice_;
  std::vector<double> T_, t_, sizes_, y_, a_, x_, extent_, w_, low_, high_, lengths_;
};

}  // namespace HQP_ISA
}  // namespace hqp
