// Limits the jerk of velocity commands: the command follows the solver's answer with bounded changes of acceleration.
//
// With u_t the last command, a_t its change in that tick over dt, u* the answer, j_i, a_i the limits of motor i, and
// |x| = max_i |x_i| / j_i:
//
//   d       = u* 2 / (1 + sqrt(1 + 4 s)) - u_t,   s = max(K^2 |u*|, K max_i |u*_i| / a_i)
//   b       = d / (dt / 2 + sqrt(dt^2 / 4 + |d|)),   |b_i| <= a_i              acceleration that the jerk can end
//   a_{t+1} = a_t + (b - a_t) min(1, dt / |b - a_t|),   u_{t+1} = u_t + dt a_{t+1}
//
// Near a goal at distance x the answer is u* = -K x. With the speed of the first line a joint slows down by at most
// a / 2 and 0.15 j, so that the acceleration can follow: one joint does not pass its goal, at any K, j and distance. K
// is the largest gain of the tasks, or the rate at which answers turned against the motion in the last kSpan, if that
// is larger:
//
//   K_t = (sum -(u*_t - u*_{t-1}) . u_{t-1}) / (sum dt u . u),   u in units of j
//
// All motors share each scalar: commands stay linear combinations of the answers, so that contacts at rest hold.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "../common/carry_over.hpp"
#include "errors.hpp"
#include "tick.hpp"

namespace hqp {

// Limits of the motors: inverse of the jerk [s^3/rad, s^3/m], 0 for none, largest change in a tick [rad/s, m/s],
// position limits [rad, m] and speed limits [rad/s, m/s], infinite for none.
struct JerkLimits {
  std::vector<std::string> names;
  std::vector<double> inverse, change, low, high, speed;
  std::vector<std::string> elements;  // elements of the stack that declare these limits
  double rate = 0.0;                  // largest gain of the tasks [1/s]
};

class JerkLimiter {
 public:
  static constexpr double kSpan = 0.5;       // answers of this time count for K_t [s]
  static constexpr double kRounding = 1e-6;  // share of 1 + |bound|

  // coordinates: indices of the motors in the angles; places: their indices in x (n).
  JerkLimiter(JerkLimits limits, std::vector<int> coordinates, std::vector<int> places, std::size_t n, double dt)
      : limits_(std::move(limits)),
        coordinates_(std::move(coordinates)),
        places_(std::move(places)),
        dt_(dt),
        last_(n, std::numeric_limits<double>::quiet_NaN()),
        change_(n),
        answer_(n),
        before_(n),
        up_(places_.size()),
        down_(places_.size()) {
    const std::size_t m = limits_.names.size();
    for (const std::vector<double>* one :
         {&limits_.inverse, &limits_.change, &limits_.low, &limits_.high, &limits_.speed})
      if (one->size() != m || places_.size() != m || coordinates_.size() != m)
        throw PlanError("jerk limits: " + std::to_string(one->size()) + " numbers for " + std::to_string(m) +
                        " motors: export the plan anew");
  }

  // Write the next command into x, from an answer in x and the command that was sent last.  changes: a change of each
  // motor in a tick; accelerations fall to `most` of these.
  void approach(const double* last, const double* changes, double most, double* x) {
    const std::size_t n = last_.size();
    std::copy(x, x + n, answer_.begin());
    const bool follows = std::equal(last_.begin(), last_.end(), last);
    if (!follows) std::fill(change_.begin(), change_.end(), 0.0), turned_ = moved_ = 0.0;
    if (follows) watch(last);
    std::copy(answer_.begin(), answer_.end(), before_.begin());
    const double rate = std::max(limits_.rate, moved_ > 0.0 ? turned_ / moved_ : 0.0);
    const double slows = std::max(rate * rate * size(answer_.data()), rate * dt_ * ticks(answer_.data()));
    const double share = 2.0 / (1.0 + std::sqrt(1.0 + 4.0 * slows));
    for (std::size_t i = 0; i < n; ++i) x[i] = share * answer_[i] - last[i];  // d
    double gain = dt_ / (0.5 * dt_ + std::sqrt(0.25 * dt_ * dt_ + size(x)));  // dt b = gain d
    for (std::size_t i = 0; i < places_.size(); ++i) {
      const double bound = std::min(limits_.change[i], most * changes[i]), wanted = gain * std::fabs(x[places_[i]]);
      if (wanted > bound) gain *= bound / wanted;
    }
    for (std::size_t i = 0; i < n; ++i) x[i] = gain * x[i] - change_[i];
    const double jerk = size(x) / (dt_ * dt_), allowed = jerk > 1.0 ? 1.0 / jerk : 1.0;
    for (std::size_t i = 0; i < n; ++i) x[i] = last[i] + change_[i] + allowed * x[i];
    given_ = 0.0, why_ = "";
  }

  // Take a row or limit whose bounds x exceeds more than the answer: its value at x and at the answer.
  void keep_within(double at, double there, double lower, double upper, const char* name) {
    const double over = std::max(at - upper, lower - at), own = std::max(there - upper, lower - there);
    if (!(over > kRounding * (1.0 + std::min(std::fabs(lower), std::fabs(upper)))) || own >= over) return;
    const double share = own > 0.0 ? 1.0 : over / (over - own);
    if (share > given_) given_ = share, why_ = name;
  }
  // Take position and speed limits in the same way: within its acceleration a joint can still stop in time.
  void keep_within_limits(const double* angles, const double* x) {
    for (std::size_t i = 0; i < places_.size(); ++i) {
      const double at = angles ? angles[coordinates_[i]] : 0.0;
      const bool held = limits_.inverse[i] > 0.0;
      up_[i] = !held ? INFINITY : angles ? stops(limits_.high[i] - at, i) : limits_.speed[i];
      down_[i] = !held ? INFINITY : angles ? stops(at - limits_.low[i], i) : limits_.speed[i];
      const std::size_t k = std::size_t(places_[i]);
      keep_within(x[k], answer_[k], -down_[i], up_[i], limits_.names[i].c_str());
    }
  }
  // Move x towards the answer by as much as these limits need and accelerations allow, then joints alone that are still
  // too fast; return true, and why, if the jerk is larger by that.
  bool give_way(const double* last, double* x, Note& why) {
    if (given_ == 0.0) return false;
    double most = given_;
    for (std::size_t i = 0; i < places_.size(); ++i) {
      const std::size_t k = std::size_t(places_[i]);
      const double way = answer_[k] - x[k], end = last[k] + std::copysign(limits_.change[i], way);
      if (std::fabs(x[k] + most * way - last[k]) > limits_.change[i] && way != 0.0)
        most = std::min(most, std::max(0.0, (end - x[k]) / way));
    }
    for (std::size_t k = 0; k < last_.size(); ++k) x[k] += most * (answer_[k] - x[k]);
    for (std::size_t i = 0; i < places_.size(); ++i) {
      const std::size_t k = std::size_t(places_[i]);
      const double within = std::min(std::max(x[k], -down_[i]), up_[i]), change = limits_.change[i];
      if (within != x[k]) x[k] = std::min(std::max(within, last[k] - change), last[k] + change);
    }
    std::size_t worst = 0;
    double jerk = 0.0;
    for (std::size_t i = 0; i < places_.size(); ++i) {
      const std::size_t k = std::size_t(places_[i]);
      const double own = std::fabs(x[k] - last[k] - change_[k]) * limits_.inverse[i];
      if (own > jerk) jerk = own, worst = i;
    }
    jerk /= dt_ * dt_;
    if (!(jerk > 1.0 + 1e-6)) return false;
    why = {"jerk", Status::kOptimal, Cause::kJerk, why_};
    why.rows[0].name = limits_.names[worst].c_str();
    why.amount = jerk / limits_.inverse[worst], why.allowed = 1.0 / limits_.inverse[worst];
    return true;
  }
  // Take the command that was sent.  A change that limits enforced is not continued.
  void sent(const double* last, const double* x) {
    for (std::size_t i = 0; i < last_.size(); ++i) change_[i] = given_ > 0.0 ? 0.0 : x[i] - last[i], last_[i] = x[i];
  }

  const std::vector<double>& answer() const { return answer_; }
  bool declared_by(const std::string& element) const {
    return std::find(limits_.elements.begin(), limits_.elements.end(), element) != limits_.elements.end();
  }
  // Continue from the limiter of another stack.
  void follow(const JerkLimiter& other) {
    last_ = other.last_, change_ = other.change_, before_ = other.before_;
    turned_ = other.turned_, moved_ = other.moved_;
  }
  void keep(CarryOver& state) {
    for (std::vector<double>* one : {&last_, &change_, &before_}) state.take(one->data(), one->size());
    state.take(turned_), state.take(moved_);
  }

 private:
  // max_i |x_i| / j_i [s^2 of a speed]
  double size(const double* x) const {
    double most = 0.0;
    for (std::size_t i = 0; i < places_.size(); ++i)
      most = std::max(most, std::fabs(x[places_[i]]) * limits_.inverse[i]);
    return most;
  }
  // Ticks in which the acceleration limits reach that speed.
  double ticks(const double* x) const {
    double most = 0.0;
    for (std::size_t i = 0; i < places_.size(); ++i)
      most = std::max(most, std::fabs(x[places_[i]]) / limits_.change[i]);
    return most;
  }
  void watch(const double* last) {
    const double stays = std::exp(-dt_ / kSpan);
    turned_ *= stays, moved_ *= stays;
    for (std::size_t i = 0; i < places_.size(); ++i) {
      const std::size_t k = std::size_t(places_[i]);
      const double scale = limits_.inverse[i] * limits_.inverse[i], u = last[k];
      turned_ -= scale * u * (answer_[k] - before_[k]), moved_ += scale * u * u * dt_;
    }
  }
  // Largest speed towards a position limit: v^2 / (2 a) + dt v = way.
  double stops(double way, std::size_t i) const {
    if (!(way < std::numeric_limits<double>::infinity())) return limits_.speed[i];
    const double off = std::max(way, 0.0), braking = limits_.change[i] / dt_;
    return std::min(limits_.speed[i], 2.0 * off / (std::sqrt(dt_ * dt_ + 2.0 * off / braking) + dt_));
  }

  JerkLimits limits_;
  std::vector<int> coordinates_, places_;
  double dt_;
  std::vector<double> last_, change_;    // the command sent last and its change in that tick
  std::vector<double> answer_, before_;  // the answer of this tick and of the last one
  std::vector<double> up_, down_;        // speeds of the motors from which they can stop at their limits
  double turned_ = 0.0, moved_ = 0.0;    // sums of K_t
  double given_ = 0.0;                   // share of the way to the answer that limits need
  const char* why_ = "";
};

}  // namespace hqp
