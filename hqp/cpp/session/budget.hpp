// Time for the solver of a tick: the deadline less a margin for the rest of the tick.
#pragma once

#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>

namespace hqp {

// Margin before the deadline for the solver's last iteration, the command and the notes.
//
// It follows the quantile 1 - LATE of the lateness of cut ticks, by stochastic approximation: m + s (1 - LATE) after a
// late tick, m - s LATE after another one. Only CPU time counts: other work on the machine is no fault of the margin.
class Budget {
 public:
  static constexpr double kLate = 1e-3;    // share of the ticks at the deadline that may end after it
  static constexpr double kStep = 40e-6;   // growth of the margin after a late tick [s]
  static constexpr double kFirst = 0.25;   // first margin, as a share of the deadline
  static constexpr double kLongest = 0.5;  // largest margin, as a share of the deadline

  explicit Budget(double deadline) : deadline_(deadline), margin_(kFirst * deadline) {}

  double deadline() const { return deadline_; }
  double margin() const { return margin_; }
  bool limited() const { return deadline_ < std::numeric_limits<double>::infinity(); }
  // A tick begins that may be cut; times of the thread [s].
  void begin(double now) { begun_ = now, measured_ = true; }
  // The tick that ends next was not measured from its begin.
  void skip() { measured_ = false; }
  // Time for the solver [s], after so much of the tick.
  double left(double spent) const { return std::max(deadline_ - margin_ - spent, 1e-6); }
  // The tick ends; cut: its solver was stopped.
  void end(double now, bool cut) {
    if (!measured_) return;
    const bool late = now - begun_ > deadline_;
    measured_ = false;
    if (late) margin_ = std::min(margin_ + kStep * (1.0 - kLate), kLongest * deadline_);
    else if (cut) margin_ = std::max(margin_ - kStep * kLate, 0.0);
  }

 private:
  double deadline_, margin_, begun_ = 0.0;
  bool measured_ = false;
};

// CPU time of this thread [s].
inline double thread_time() {
#ifdef CLOCK_THREAD_CPUTIME_ID
  std::timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
#else
  return double(std::clock()) / CLOCKS_PER_SEC;
#endif
}

}  // namespace hqp
