// Newton steps of a hierarchy towards its targets, to the end, in one call; see hqp/search/newton.py.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "../dynamics/kinematics.hpp"
#include "references.hpp"

namespace hqp {

using Clock = std::chrono::steady_clock;

// Error of an element in its rows: rows of errors, or of bounds whose violation grows at `rate` with it.
struct ErrorRows {
  int start, stop;
  double rate;  // 0 for equalities
  int group;    // its level, -1 where the error counts for nothing
};

struct Pace {  // sizes of steps and when to end; see the constants in hqp/search/newton.py
  double step, least, progress, polish, still;
  std::optional<int> stalled;  // none: never given up
  int last;
};

enum class End { kMet, kNoAnswer, kStill, kStalled, kSpent, kExtraordinary };

class Descent {
 public:
  Descent(const Pace& pace, std::vector<ErrorRows> members, int groups, int nq, int nv)
      : pace_(pace),
        members_(std::move(members)),
        errors_(members_.size()),
        merit_(groups),
        here_(groups),
        mark_(groups),
        best_(groups),
        at_(nq),
        x_(nv),
        q_(nq),
        best_q_(nq),
        best_errors_(members_.size()) {}

  const std::vector<double>& q() const { return best_q_; }
  const std::vector<double>& merit() const { return best_; }
  const std::vector<double>& errors() const { return best_errors_; }
  int taken() const { return taken_; }

  // solve(q): x there, null if there is none; rows, the errors of all rows, lower and upper are then those of q.
  template <typename Solve>
  End run(const double* start, double tolerance, int most, Clock::time_point end, const Solve& solve,
          const Kinematics& robot, const double* rows, const double* lower, const double* upper) {
    constexpr double kNone = std::numeric_limits<double>::infinity();
    std::copy(start, start + q_.size(), q_.begin());
    std::fill(here_.begin(), here_.end(), kNone);
    mark_ = best_ = here_;
    double radius = pace_.step, size = 0.0;
    int since = 0, settled = 0;
    for (taken_ = 0;;) {
      const double* x = solve(q_.data());
      if (!x) return End::kExtraordinary;
      weigh(tolerance, rows, lower, upper);
      if (!(best_ < merit_)) keep();
      const bool met = std::all_of(merit_.begin(), merit_.end(), [](double m) { return m <= 1.0; });
      if (here_ < merit_ && radius > pace_.least) {  // back to where it came from, half the way
        radius *= 0.5;
      } else {
        here_ = merit_;
        at_ = q_;
        std::copy(x, x + x_.size(), x_.begin());
        radius = std::min(2.0 * radius, pace_.step);
        size = 0.0;
        for (const double u : x_) size = std::max(size, std::fabs(u));
        if (met) {
          if (size <= pace_.polish || ++settled > pace_.last) return keep(), End::kMet;
        } else if (size < pace_.still) {
          return End::kStill;
        }
        since = met || advanced() ? 0 : since + 1;
        if (since == 0) mark_ = merit_;
        if (pace_.stalled && since > *pace_.stalled) return End::kStalled;
      }
      if (taken_ == most || Clock::now() > end) return End::kSpent;
      ++taken_;
      radius = std::min(radius, size);
      robot.integrate(at_.data(), x_.data(), radius / std::max(size, 1e-12), q_.data());
    }
  }

 private:
  void weigh(double tolerance, const double* rows, const double* lower, const double* upper) {
    std::fill(merit_.begin(), merit_.end(), 1.0);
    for (std::size_t i = 0; i < members_.size(); ++i) {
      const ErrorRows& t = members_[i];
      double error = 0.0;
      if (t.rate > 0.0) {
        for (int k = t.start; k < t.stop; ++k) error = std::max({error, lower[k], -upper[k]});
        error /= t.rate;
      } else {
        error = std::sqrt(squared(rows + t.start, t.stop - t.start));
      }
      if (!(error >= 0.0)) error = std::numeric_limits<double>::infinity();  // not a number
      errors_[i] = error;
      if (t.group >= 0) merit_[t.group] = std::max(merit_[t.group], error / tolerance);
    }
  }
  void keep() {
    best_ = merit_;
    best_q_ = q_;
    best_errors_ = errors_;
  }
  bool advanced() const {  // true if the first unmet group has decreased, or is met
    for (std::size_t i = 0; i < merit_.size(); ++i)
      if (merit_[i] != mark_[i]) return merit_[i] < pace_.progress * mark_[i] || merit_[i] == 1.0;
    return false;
  }

  Pace pace_;
  std::vector<ErrorRows> members_;
  std::vector<double> errors_, merit_, here_, mark_, best_, at_, x_, q_, best_q_, best_errors_;
  int taken_ = 0;
};

}  // namespace hqp
