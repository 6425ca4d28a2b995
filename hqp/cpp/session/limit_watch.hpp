// Joint limits by the marks of their rows: rates of alternation, and limits outside the window.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "../common/carry_over.hpp"
#include "tick.hpp"

namespace hqp {

// Counts alternations of each limit: active on one side, then on the other. The rate of a row is
// sum exp(-age / kSpan) / kSpan over its alternations, in the mean their number a second.
class LimitWatch {
 public:
  using Parts = std::vector<std::pair<std::size_t, std::size_t>>;  // first and last of some rows

  static constexpr double kSpan = 0.2;  // alternations are counted over this time, in the mean [s]
  // Alternations a second above which a joint is restless: about four within kSpan, more than any reference causes.
  static constexpr double kOften = 20.0;
  static constexpr double kOver = 1e-6;  // a limit passed by less is rounding [rad, m]

  // parts: rows of limits, with a name each.
  LimitWatch(Parts parts, std::vector<std::string> names, double dt)
      : parts_(std::move(parts)),
        names_(std::move(names)),
        dt_(dt),
        last_(names_.size(), kNone),
        marks_(names_.size()),
        side_(names_.size(), 0),
        rate_(names_.size(), 0.0) {}

  std::size_t size() const { return names_.size(); }
  std::size_t rows() const {  // count up to the last one that it reads
    std::size_t last = 0;
    for (const auto& part : parts_) last = std::max(last, part.second);
    return last;
  }
  // True if the bounds of a joint meet: its limits are outside the window of its reachable rates.
  bool meet() const { return meet_; }

  // Take the marks of all rows in a tick of that number; note the limits that alternate.
  template <class Report>
  void look(const std::int8_t* marks, std::int64_t tick, const Report& report) {
    tick_ = tick;
    auto to = marks_.begin();
    for (const auto& [first, last] : parts_) to = std::copy(marks + first, marks + last, to);
    if (marks_ != last_) turn();
    if (!busy_) return;
    const double peak = peak_ * faded();
    busy_ = peak > 0.1 * kOften || meet_;
    if (!(peak > kOften)) return;
    fade();
    for (std::size_t i = 0; i < rate_.size(); ++i)
      if (rate_[i] > kOften) report(Note{names_[i].c_str(), Status::kOptimal, Cause::kRestless, "", rate_[i]});
  }
  // Return true if a joint comes to rest that far beyond its position limit: it cannot brake harder.
  static bool passed(double over, const char* unit, Note& why) {
    why.cause = Cause::kOverrun, why.where = unit, why.amount = over;
    return over > kOver;
  }
  // Return true if a joint is outside [low, high] by more than rounding; slack: violation of its row.
  static bool outside(double by, double low, double high, double slack, const char* unit, Note& why) {
    why.cause = std::fabs(slack) > kOver ? Cause::kOutside : Cause::kReturns, why.where = unit;
    why.amount = by, why.allowed = low, why.most = high;
    return by > kOver;
  }
  void keep(CarryOver& state) {
    state.take(last_.data(), last_.size()), state.take(side_.data(), side_.size());
    state.take(rate_.data(), rate_.size());
    state.take(tick_), state.take(seen_), state.take(peak_), state.take(busy_), state.take(meet_);
  }

 private:
  static constexpr std::int8_t kNone = -128, kEquality = 2;

  void turn() {
    last_ = marks_;
    meet_ = std::find(marks_.begin(), marks_.end(), kEquality) != marks_.end();
    bool turned = false;
    for (std::size_t i = 0; i < marks_.size(); ++i) {
      if (marks_[i] * side_[i] == -1) {
        if (!turned) fade();
        rate_[i] += 1.0 / kSpan;
        turned = true;
      }
      if (marks_[i] == 1 || marks_[i] == -1) side_[i] = marks_[i];
    }
    if (turned) peak_ = *std::max_element(rate_.begin(), rate_.end());
    busy_ = busy_ || turned || meet_;
  }
  double faded() const { return std::exp(-double(tick_ - seen_) * dt_ / kSpan); }
  void fade() {
    const double factor = faded();
    for (double& rate : rate_) rate *= factor;
    peak_ *= factor;
    seen_ = tick_;
  }

  Parts parts_;
  std::vector<std::string> names_;
  double dt_;
  std::vector<std::int8_t> last_, marks_, side_;
  std::vector<double> rate_;
  std::int64_t tick_ = 0, seen_ = 0;
  double peak_ = 0.0;
  bool busy_ = false, meet_ = false;
};

}  // namespace hqp
