// Times of a tick, the time of its solver, and the counters of the session.
#pragma once

#include <chrono>
#include <cstdint>
#include <limits>
#include <memory>

#include "budget.hpp"
#include "counters.hpp"
#include "tick.hpp"

namespace hqp {

class Timing {
 public:
  explicit Timing(double deadline) : deadline_(deadline), budget_(deadline) {}

  static double now() { return seconds(Clock::now().time_since_epoch()); }
  // Times of the tick: its begin on the clock of now(), then those of rows and solver [s].
  double begun() const { return seconds(begin_.time_since_epoch()); }
  double filling() const { return seconds(filled_ - begin_); }
  double solving() const { return seconds(solved_ - filled_); }

  void begin() { begin_ = filled_ = solved_ = Clock::now(); }
  void filled() { filled_ = Clock::now(); }
  void solved() { solved_ = Clock::now(); }

  const Budget& budget() const { return budget_; }
  bool limited() const { return budget_.limited(); }
  void begin_budget() {
    if (fresh_ && limited()) budget_.begin(thread_time());
    else budget_.skip();
  }
  // Time for the solver [s]; counts: false before the first answer, whose rows take long.
  double left(bool counts) const { return budget_.left(counts ? seconds(Clock::now() - begin_) : 0.0); }
  // End a tick with an answer of that status.
  void answered(Status status) {
    if (limited() && status != Status::kOptimal) budget_.end(thread_time(), status == Status::kTimeLimit);
    fresh_ = status != Status::kOptimal;
  }
  void unanswered() { fresh_ = true; }

  void without_deadline() { deadline_ = std::numeric_limits<double>::infinity(), budget_ = Budget(deadline_); }
  // Share the period with another session.
  void halve() { budget_ = Budget(0.5 * budget_.deadline()); }
  void whole() {
    if (budget_.deadline() != deadline_) budget_ = Budget(deadline_);
  }

  const Counters& counters() const { return *counters_; }
  void count(const Counters::Ended& tick, double dt) { counters_->take(tick, dt); }
  void pause() { counters_->pause(); }
  void share_counters(const Timing& other) { counters_ = other.counters_; }
  void follow(const Timing& other) { budget_ = other.budget_; }

 private:
  using Clock = std::chrono::steady_clock;
  static double seconds(Clock::duration time) { return std::chrono::duration<double>(time).count(); }

  double deadline_;  // [s], of the plan
  Budget budget_;
  bool fresh_ = true;  // the last tick had no optimal answer
  Clock::time_point begin_, filled_, solved_;
  std::shared_ptr<Counters> counters_ = std::make_shared<Counters>();  // shared by sessions that follow each other
};

}  // namespace hqp
