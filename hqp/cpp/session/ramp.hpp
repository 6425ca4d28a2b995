// Progress of a transition from one stack to the next, and the blend of two answers at that point:
//
//   x = x_a + h (x_b - x_a),    h = 3 s^2 - 2 s^3 from 0 to 1
//
// Both answers lie in the convex set of optima of every level that the two stacks share from the top, so x does: levels
// above a change are as they were, exactly.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "easing.hpp"

namespace hqp {

inline double smooth(double s) { return s * s * (3.0 - 2.0 * s); }
// s with smooth(s) = h.
inline double inverse(double h) { return 0.5 - std::sin(std::asin(1.0 - 2.0 * std::min(std::max(h, 0.0), 1.0)) / 3.0); }

class Ramp {
 public:
  static constexpr double kStill = 1e-9;  // share of the largest change below which a command is the same in both
  // After this many times its duration a transition continues at 1 / kPatience of its pace, regardless of commands,
  // so that it ends.
  static constexpr double kPatience = 10.0;
  static constexpr double kNearly = 1.0 - 1e-6;  // largest progress of a pair while its command is limited

  // ticks: least number for all pairs.  caps: largest change of each motor's command in a tick, the unit of changes
  // here.  motors: their indices in x.
  Ramp(double ticks, std::vector<double> caps, std::vector<int> motors)
      : ticks_(ticks), left_(kPatience * ticks), caps_(std::move(caps)), motors_(std::move(motors)) {}

  const std::vector<double>& caps() const { return caps_; }

  // Spans of the pairs: 0 for one that takes a single tick, else 1.
  void take(std::vector<double> spans) {
    spans_ = std::move(spans);
    total_ = 0.0;
    for (const double span : spans_) total_ += span;
    pace_ = total_ / ticks_;
  }

  std::size_t at() const { return at_; }  // pair
  bool arriving() const { return at_ + 1 == spans_.size(); }
  bool done() const { return arriving() && s_ >= 1.0; }
  double most() const { return most_; }  // largest change of a command in this tick, in caps
  double progress() const {              // 0 at the start, 1 at the end of all pairs
    double before = 0.0;
    for (std::size_t k = 0; k < at_; ++k) before += spans_[k];
    return (before + spans_[at_] * smooth(s_)) / total_;
  }
  // h of this tick, unless a command would change too fast.  wait: no further than before.
  double target(bool wait) const { return smooth(wait ? s_ : std::min(1.0, s_ + (spans_[at_] > 0.0 ? pace_ : 1.0))); }

  // Write x on the line from a to b: at h, or nearer to a so that no command changes by more than its cap, if that is
  // possible: see Segment::fastest.  felt: the change follows a measured touch-down or lift-off, and the cap is added
  // to the change of the answers themselves.  follows: a jerk limiter follows the blend, which keeps its pace.  Return
  // true if a command changes by more than most().
  bool blend(const double* a, const double* b, const double* last, double h, const Easing* ease, bool felt,
             bool follows, double* x, std::size_t n) {
    const auto weight_at = [&](double at) { return ease ? ease->weight(at) : at; };
    double weight = weight_at(h), s = inverse(h);
    if (s > s_) left_ -= 1.0;
    const Segment line{a, b, last, caps_, motors_};
    double reach = line.change(weight).size;
    most_ = 1.0;
    if (reach > 1.0 && felt) most_ += line.change(weight_at(smooth(s_))).size;
    if (reach > most_ && !follows) {
      const double least = weight_at(smooth(std::min(s, s_ + (left_ < 0.0 ? pace_ / kPatience : 0.0))));
      weight = std::max(least, line.fastest(weight, most_));
      s = inverse(ease ? ease->share(weight) : weight);
      reach = line.change(weight).size;
    }
    for (std::size_t i = 0; i < n; ++i) x[i] = a[i] + weight * (b[i] - a[i]);
    s_ = h >= 1.0 && weight >= 1.0 ? 1.0 : std::max(s_, s);
    return !follows && reach > most_ + kStill;
  }
  // Another command than the blend was sent: the pair does not end there.
  void limited() { s_ = std::min(s_, kNearly); }
  // Begin the next pair if this one is done; return true if so.
  bool advance() {
    if (!(s_ >= 1.0) || arriving()) return false;
    ++at_, s_ = 0.0;
    return true;
  }

  template <class State>
  void keep(State& state) {
    state.take(at_), state.take(s_), state.take(left_);
  }

 private:
  // Commands a + weight (b - a), and their changes from the last ones.
  struct Segment {
    const double *a, *b, *last;
    const std::vector<double>& caps;
    const std::vector<int>& motors;

    struct Change {
      double size;  // in caps
      bool grows;   // with the weight
    };
    // Largest change of a command.
    Change change(double weight) const {
      Change largest{0.0, false};
      for (std::size_t k = 0; k < motors.size(); ++k) {
        const int i = motors[k];
        const double slope = b[i] - a[i], change = a[i] + weight * slope - last[i], size = std::fabs(change) / caps[k];
        if (!(size <= largest.size)) largest = {size, (change > 0.0) == (slope > 0.0)};
      }
      return largest;
    }
    // The largest weight up to the given one with changes of at most `most`, or beyond it by at most twice the least
    // excess: a continuous function of the commands, which goes on if none of them is near the last one.
    double fastest(double weight, double most) const {
      double low = 0.0, high = weight;  // around the weight of the least change, of a convex function
      for (int k = 0; k < std::numeric_limits<double>::digits; ++k) {
        const double middle = 0.5 * (low + high);
        (change(middle).grows ? high : low) = middle;
      }
      const double least = low, level = most + 2.0 * std::max(0.0, change(least).size - most);
      for (std::size_t k = 0; k < motors.size(); ++k) {
        const int i = motors[k];
        const double slope = b[i] - a[i], size = std::fabs(slope) / caps[k];
        if (size > kStill) weight = std::min(weight, level / size - (a[i] - last[i]) / slope);
      }
      return std::max(weight, least);
    }
  };

  double ticks_, left_, most_ = 1.0;
  std::vector<double> caps_;
  std::vector<int> motors_;
  std::vector<double> spans_;
  double total_ = 1.0, pace_ = 1.0, s_ = 0.0;
  std::size_t at_ = 0;
};

}  // namespace hqp
