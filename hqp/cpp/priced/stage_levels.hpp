// The stages of a hierarchy with prices (docs/calm.md): which levels the exact answer settles, a stage for each of the
// others, and what each hands down. Everything is allocated once.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "account.hpp"
#include "coordinates.hpp"
#include "settled.hpp"
#include "stage_search.hpp"
#include "stages.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr double kFade = 16.0;                                        // hqp/pace.py, FADE
constexpr double kDearer = 20.0, kLacking = 0.0016, kUnused = 1e-12;  // hqp/pricing.py
constexpr double kSlackMotion = 1e-5;   // slacks of inequality rows count this much as motion
constexpr double kRoundingRow = 2e-15;  // of the longest row: rows no longer have no direction
constexpr double kResting = 1e-4;       // of the largest entry: terms of a row are no smaller, as hqp/pricing.py says

class StageLevels final : public PricedStages {
 public:
  StageLevels(int n, int levels, const int* m, const bool* priced, const Tolerances& tolerances)
      : n_(n),
        asked_(levels),
        level_(sized(levels, m)),
        handed_(levels),
        warm_(levels),
        tolerances_(tolerances),
        at_(n, tolerances.flat),
        ends_(levels),
        paid_(levels),
        accounts_(n),
        settled_(n, level_, total(levels, m), tolerances.met),
        search_(total(levels, m) + levels, n + most(levels, m)) {
    last_ = -1;
    for (int k = 0; k < levels; ++k)
      if (priced[k]) last_ = k;
    const int variables = n + most(levels, m);
    rows_.room(total(levels, m) + levels, padded(variables));
    T_.resize(static_cast<std::size_t>(most(levels, m)) * padded(variables));
    t_.resize(most(levels, m));
    y_.resize(padded(variables));
    a_.resize(n);
    x_.resize(n);
    w_.resize(most(levels, m));
  }

  PricedLevel* levels() override { return level_.data(); }
  Handed* handed() override { return handed_.data(); }
  int iterations() const override { return iterations_; }
  bool ended() const override { return ended_; }
  bool uncertain() const override { return search_.uncertain(); }
  void reset() override {
    for (auto& set : warm_) set.clear();
    settled_.forget();
  }

  void bind(const double* prices, const double* shares, const double* F, const double* f, int r, const double* guard,
            double pace) override {
    pace_ = pace;
    prices_ = prices;
    paid_.assign(prices, prices + level_.size());
    shares_ = shares;
    F_ = F;
    f_ = f;
    r_ = r;
    guard_ = guard != nullptr;
    guard_floor_ = guard ? *guard : 0.0;
  }

  void account(const AccountRows& rows, double* numbers, double* shares, double* worth) override {
    if (last_ < 0) at_.set(F_, f_, r_);
    accounts_.run(level_, handed_, at_, paid_.data(), ends_, rows_, row_of_, rows, numbers, shares, worth);
  }

  int solve(const double* x, int head, double seconds, double* stages, double* last) override {
    search_.limit(seconds);
    iterations_ = 0;
    ended_ = true;
    excess_ = 1.0;
    row_of_.clear();
    unmet_.assign(n_, 0);
    lack_ = 0.0;
    std::copy(prices_, prices_ + level_.size(), paid_.begin());
    for (StageEnd& end : ends_) end.known = false;
    at_.set(F_, f_, r_);
    settled_.begin(at_, prices_, x);
    int first = -1;
    bool met = true;  // all levels so far, so that x keeps to what they leave
    for (int k = 0; k <= last_; ++k) {
      const bool priced = prices_[k] > 0.0;
      const bool settled = met && (!priced || settled_.meets(k));
      if (settled && head > 0 && k == head) return -2;
      if (settled && first < 0) continue;
      if (first < 0) {
        first = k;
        const int levels = static_cast<int>(level_.size());
        std::fill(stages, stages + static_cast<std::size_t>(levels) * n_, std::numeric_limits<double>::quiet_NaN());
        rows_.count = 0;
        rows_.flat = !at_.diagonal();
        find_rounding();
        find_turned();
        set_floor();
        search_.restart();
        for (int l = 0; l < k; ++l) leave(l, x);
      }
      if (settled) {
        leave(k, x);
        continue;
      }
      if (met) at_.motion(x, y_.data());
      if (priced) paid_[k] = cost(k);
      stage(k, paid_[k]);
      at_.point(y_.data(), x_.data());
      if (!ended_ && search_.late()) break;  // the levels below begin where this one does
      if (priced) {
        if (hand_down(k, x_.data())) met = false;
        else settled_.begin_with(k, warm_[k], row_of_);  // the stage ended at the point of least motion
        std::copy(x_.begin(), x_.end(), stages + static_cast<std::size_t>(k) * n_);
      } else {
        hold(k, x_.data());
      }
      if (met && head > 0 && k == head) return -2;
      take(k, priced);
    }
    if (!ended_) {
      std::copy(x_.begin(), x_.end(), last);
      return first;
    }
    if (met) return -1;  // every level hands down its rows as they are
    std::copy(x_.begin(), x_.end(), last);
    for (std::size_t k = last_ + 1; k < level_.size(); ++k) slow(static_cast<int>(k));
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

  const double* row(const PricedLevel& level, int i) {
    if (level.A) return level.A + static_cast<std::size_t>(i) * n_;
    std::fill(a_.begin(), a_.end(), 0.0);
    a_[level.index[i]] = level.scale[i];
    return a_.data();
  }

  // A level that x settles leaves its rows as they are, an exact one its values.
  void leave(int k, const double* x) {
    const bool priced = prices_[k] > 0.0;
    if (priced) hand_down(k, nullptr);
    else hold(k, x);
    take(k, priced);
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
    double square = 0.0, size = 0.0, largest = 0.0;
    for (int j = 0; j < n_; ++j) largest = larger(largest, std::abs(x[j]));
    const double least = kResting * largest;
    for (int i = 0; i < level.m; ++i) {
      const double* a = out.A + static_cast<std::size_t>(i) * n_;
      const double value = dot_any(a, x, n_);
      w_[i] = slack(value, level.lower[i], level.upper[i]);
      square += w_[i] * w_[i];
      double terms = 0.0;
      for (int j = 0; j < n_; ++j) terms += std::abs(a[j]) * (std::abs(x[j]) + least);
      const double bound = std::isfinite(level.lower[i])   ? level.lower[i]
                           : std::isfinite(level.upper[i]) ? level.upper[i]
                                                           : 0.0;
      size = larger(size, terms + std::abs(bound));
    }
    const double norm = std::sqrt(square);
    if (norm <= tolerances_.met * size) return false;
    mark(level);
    lack_ = larger(lack_, norm / prices_[k]);
    excess_ = smaller(excess_, larger(0.0, 1.0 - norm / (kFade * prices_[k] * pace_ * pace_)));
    const double width = shares_[k] * norm / std::sqrt(static_cast<double>(level.m));
    double made = 0.0, base = 0.0;
    for (int i = 0; i < level.m; ++i) {
      const double* a = out.A + static_cast<std::size_t>(i) * n_;
      const double value = dot_any(a, x, n_), u = -w_[i] / norm;
      made += u * (value - dot_any(a, at_.still(), n_));
      base += u * value;
      add_any(guard, a, u, n_);
      if (!level.left_out(i) && (level.lower[i] == level.upper[i] || std::abs(w_[i]) > tolerances_.zero * size)) {
        out.lower[i] = value - width;
        out.upper[i] = value + width;
      }
    }
    if (guard_ && level.m > 1 && made > 0.0)
      out.lower[level.m] = base - smaller(shares_[k] * norm, 0.5 * made + floor_ * shares_[k] * norm);
    else std::fill(guard, guard + n_, 0.0);
    return true;
  }

  double largest(const double* a) const {
    double most = 0.0;
    for (int j = 0; j < n_; ++j) most = larger(most, std::abs(a[j]));
    return most;
  }

  // The coordinates of a level that is not met.
  void mark(const PricedLevel& level) {
    for (int i = 0; i < level.m; ++i) {
      if (level.left_out(i)) continue;
      const double* a = row(level, i);
      const double least = kUnused * largest(a);
      for (int j = 0; j < n_; ++j)
        if (std::abs(a[j]) > least) unmet_[j] = 1;
    }
  }

  // The price of level k in its stage (hqp/pricing.py): more where it has no coordinate but those of unmet levels
  // above.
  double cost(int k) {
    const PricedLevel& level = level_[k];
    if (!(lack_ > 0.0) || f_ != nullptr || !at_.diagonal()) return prices_[k];
    for (int i = 0; i < level.m; ++i) {
      if (level.left_out(i)) continue;
      const double* a = row(level, i);
      const double least = kUnused * largest(a);
      for (int j = 0; j < n_; ++j)
        if (std::abs(a[j]) > least && !unmet_[j]) return prices_[k];
    }
    return prices_[k] / larger(1.0 / kDearer, 1.0 - kLacking * lack_ / (pace_ * pace_));
  }

  // An exact level at its optimum: its slack is unique, so equality rows and violated rows keep their value.
  void hold(int k, const double* x) {
    const PricedLevel& level = level_[k];
    low_.assign(level.lower, level.lower + level.m);
    high_.assign(level.upper, level.upper + level.m);
    for (int i = 0; i < level.m; ++i) {
      if (level.left_out(i)) continue;
      const double value = level.A ? dot_any(row(level, i), x, n_) : level.scale[i] * x[level.index[i]];
      const double w = slack(value, low_[i], high_[i]);
      if (low_[i] == high_[i] || std::abs(w) > tolerances_.met * (1.0 + std::abs(value))) low_[i] = high_[i] = value;
    }
  }

  // Rows no longer than this are rounding: a level of such rows has no stage.
  void find_rounding() {
    double longest = 0.0;
    for (const PricedLevel& level : level_)
      for (int i = 0; i < level.m; ++i) longest = larger(longest, square(level, i));
    rounding_ = kRoundingRow * kRoundingRow * longest;
  }

  double square(const PricedLevel& level, int i) const {
    if (!level.A) return level.scale[i] * level.scale[i];
    const double* a = level.A + static_cast<std::size_t>(i) * n_;
    return dot_any(a, a, n_);
  }

  // The coordinates that a row of a priced level has, or one of a level before it, but for boxes.
  void find_turned() {
    turned_.assign(n_, 0);
    int count = 0;
    for (int k = 0; k <= last_ && count < n_; ++k) {
      const PricedLevel& level = level_[k];
      if (!level.A && !(prices_[k] > 0.0)) continue;
      for (int i = 0; i < level.m && count < n_; ++i) {
        if (level.left_out(i)) continue;
        if (!level.A) {
          count += !turned_[level.index[i]];
          turned_[level.index[i]] = 1;
          continue;
        }
        const double* a = level.A + static_cast<std::size_t>(i) * n_;
        for (int j = 0; j < n_; ++j)
          if (a[j] != 0.0 && !turned_[j]) {
            turned_[j] = 1;
            ++count;
          }
      }
    }
  }

  // |y_i| of the rows of a level k of single coordinates: the least motion that meets row i alone; 0 for inequalities
  // and for rows that turn nothing. rest: what the row is worth at the point of least motion.
  void ask(int k) {
    const PricedLevel& level = level_[k];
    Asked& asked = asked_[k];
    asked.away.assign(level.m, 0.0);
    asked.rest.resize(level.m);
    asked.speed = 0.0;
    if (!handed_[k].lower) return;
    double square = 0.0;
    for (int i = 0; i < level.m; ++i) {
      if (level.lower[i] != level.upper[i] || !turns(level, i)) continue;
      double reach;
      if (level.A) {
        const double* a = level.A + static_cast<std::size_t>(i) * n_;
        at_.row(a, y_.data());
        reach = std::sqrt(dot_any(y_.data(), y_.data(), n_));
        asked.rest[i] = dot_any(a, at_.still(), n_);
      } else {
        const int j = static_cast<int>(level.index[i]);
        reach = std::abs(picked(j, level.scale[i]));
        asked.rest[i] = level.scale[i] * at_.still()[j];
      }
      if (!(reach > 0.0)) continue;
      asked.away[i] = std::abs(level.lower[i] - asked.rest[i]) / reach;
      square += asked.away[i] * asked.away[i];
    }
    asked.speed = std::sqrt(square);
  }

  bool turns(const PricedLevel& level, int i) const {
    if (!level.A) return turned_[level.index[i]];
    const double* a = level.A + static_cast<std::size_t>(i) * n_;
    for (int j = 0; j < n_; ++j)
      if (a[j] != 0.0 && turned_[j]) return true;
    return false;
  }

  // The length of scale e_j' P.
  double picked(int j, double scale) {
    if (at_.diagonal()) return at_.picked(j, scale);
    a_.assign(n_, 0.0);
    a_[j] = scale;
    at_.row(a_.data(), y_.data());
    return std::sqrt(dot_any(y_.data(), y_.data(), n_));
  }

  // phi: a guard turns with the motion of the levels below it, and holds only as far as they are slow.
  void set_floor() {
    double speed = 0.0;
    for (std::size_t k = last_ + 1; k < level_.size(); ++k) {
      ask(static_cast<int>(k));
      speed = larger(speed, asked_[k].speed);
    }
    const double share = speed / pace_;
    floor_ = larger(guard_floor_, smaller(1.0, share * share));
  }

  // Those targets, drawn towards rest: the largest alike, so that the level asks for the pace and what is left above
  // it.
  void slow(int k) {
    const PricedLevel& level = level_[k];
    const Handed& out = handed_[k];
    if (!out.lower) return;
    std::copy(level.lower, level.lower + level.m, out.lower);
    std::copy(level.upper, level.upper + level.m, out.upper);
    const Asked& asked = asked_[k];
    if (!(asked.speed > pace_) || excess_ == 1.0) return;
    const double speed = pace_ + excess_ * (asked.speed - pace_);
    double bound = 0.0;
    for (int count = 0, cut = -1; count != cut;) {
      cut = count;
      double square = 0.0;
      count = 0;
      for (const double size : asked.away) {
        if (size > bound) ++count;
        else square += size * size;
      }
      if (count != cut) bound = std::sqrt(larger(speed * speed - square, 0.0) / count);
    }
    for (int i = 0; i < level.m; ++i)
      if (const double size = asked.away[i]; size > bound)
        out.lower[i] = out.upper[i] = asked.rest[i] + bound / size * (level.lower[i] - asked.rest[i]);
  }

  // The rows that a level leaves join the set of the stages below.
  void take(int k, bool priced) {
    const PricedLevel& level = level_[k];
    const int m = priced ? level.m + 1 : level.m;
    const int first = first_row(k);
    const bool picks = !level.A && !priced && at_.diagonal();
    for (int i = 0; i < m; ++i) {
      if (picks) {
        if (low_[i] == -INFINITY && high_[i] == INFINITY) continue;
        const int j = static_cast<int>(level.index[i]);
        const double shift = level.scale[i] * at_.still()[j];
        if (!rows_.pick(rows_.count, j, at_.picked(j, level.scale[i]), low_[i] - shift, high_[i] - shift)) continue;
        ++rows_.count;
        row_of_.push_back(first + i);
        continue;
      }
      const double* a = priced ? handed_[k].A + static_cast<std::size_t>(i) * n_ : row(level, i);
      const double low = priced ? handed_[k].lower[i] : low_[i], high = priced ? handed_[k].upper[i] : high_[i];
      if (low == -INFINITY && high == INFINITY) continue;
      double* c = rows_.row(rows_.count);
      std::fill(c, c + rows_.ld, 0.0);
      at_.row(a, c);
      const double shift = dot_any(a, at_.still(), n_);
      if (!rows_.close(rows_.count, n_, low - shift, high - shift, std::sqrt(dot_any(a, a, n_)))) continue;
      ++rows_.count;
      row_of_.push_back(first + (i < level.m ? i : 0));  // the guard counts for the first element of its level
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
    double longest = 0.0;
    std::fill(y_.begin() + n_, y_.end(), 0.0);
    std::fill(T_.begin(), T_.end(), 0.0);
    at_.point(y_.data(), x_.data());
    for (int i = 0; i < level.m; ++i) {
      if (level.left_out(i)) continue;
      longest = larger(longest, square(level, i));
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
      const double low = level.lower[i] - shift, high = level.upper[i] - shift;
      if (rows_.close(rows_.count, N + 1, low, high, std::sqrt(square(level, i)))) ++rows_.count;
      ++N;
    }
    bool reached = false;
    if (longest <= rounding_) m = 0;
    if (m) {
      reached = search_.solve(rows_, own, N, T_.data(), t_.data(), m, price, y_.data(), warm_[k], iterations_);
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
  double rounding_ = 0.0;
  double guard_floor_ = 0.0, floor_ = 0.0;  // floor_: of this solve
  std::vector<char> turned_, unmet_;        // (n,) what the pace bounds; what rows of unmet levels have
  double lack_ = 0.0;                       // largest ||w|| / c of those
  double pace_ = INFINITY, excess_ = 1.0;   // excess_: share of what single coordinates ask above it that is left
  struct Asked {                            // by a level of single coordinates after the last price
    std::vector<double> away, rest;
    double speed = 0.0;
  };
  std::vector<Asked> asked_;
  std::vector<PricedLevel> level_;
  std::vector<Handed> handed_;
  std::vector<std::vector<int>> warm_;
  const double *prices_ = nullptr, *shares_ = nullptr, *F_ = nullptr, *f_ = nullptr;
  Tolerances tolerances_;
  Coordinates at_;
  std::vector<StageEnd> ends_;
  std::vector<double> paid_;  // (levels,) the prices in the stages of the latest solve
  std::vector<int> row_of_;
  Accounts accounts_;
  Settled settled_;
  StageSearch search_;
  StageRows rows_;
  std::vector<double> T_, t_, y_, a_, x_, w_, low_, high_;
};

}  // namespace HQP_ISA
}  // namespace hqp
