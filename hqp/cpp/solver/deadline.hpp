// Deadline of a search.
#pragma once

#include <ctime>
#include <ratio>

namespace hqp {
inline namespace HQP_ISA {

static inline double now() {
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec) / std::nano::den;
}

// A check takes 25 ns: every loop with iterations longer than 10 us checks, so that none ends much later.
class Deadline {
 public:
  // seconds: from now, none for 0.
  void start(double seconds) {
    looked_ = now();
    end_ = seconds > 0.0 ? looked_ + seconds : 0.0;
    missed_ = false;
  }

  // Return true if the deadline has passed.
  bool passed() {
    if (!missed_ && end_ > 0.0) missed_ = now() > end_;
    return missed_;
  }

  // Turns of another kind follow.
  void turn() {
    if (end_ > 0.0) looked_ = now();
  }

  // Return true if this many more turns of the duration since the last call would pass it.
  bool too_near(double turns) {
    if (missed_ || end_ == 0.0) return missed_;
    const double time = now(), lap = time - looked_;
    looked_ = time;
    return missed_ = time + turns * lap > end_;
  }

 private:
  double end_ = 0.0, looked_ = 0.0;
  bool missed_ = false;
};

}  // namespace HQP_ISA
}  // namespace hqp
