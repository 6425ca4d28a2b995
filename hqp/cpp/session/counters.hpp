// Counters of a session since it was made, and its heartbeat: the thread that steps writes them, any thread reads them.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>

namespace hqp {

// Counters at one time.
struct Counts {
  std::int64_t ticks = 0;                // ended ticks; the heartbeat
  std::int64_t late = 0;                 // ticks that took longer than the period dt
  std::int64_t cut = 0;                  // ticks whose search the deadline or the iteration limit stopped
  std::int64_t held = 0;                 // ticks whose command was coming to rest
  std::int64_t rejected_states = 0;      // ticks whose state was not valid
  std::int64_t rejected_references = 0;  // references that were not valid
  double longest_gap = 0.0;              // longest time from the begin of a tick to that of the next [s]
  double worst_time = 0.0;               // longest tick, from its begin to its end [s]

  // Add the ticks of another session.
  void add(const Counts& other) {
    ticks += other.ticks, late += other.late, cut += other.cut, held += other.held;
    rejected_states += other.rejected_states, rejected_references += other.rejected_references;
    longest_gap = std::max(longest_gap, other.longest_gap);
    worst_time = std::max(worst_time, other.worst_time);
  }
};

class Counters {
 public:
  // Facts about one tick; times on a monotonic clock [s].
  struct Ended {
    double begin, end;
    bool cut, held, rejected_state;
    std::int64_t rejected_references;
  };

  void take(const Ended& tick, double dt) {
    const double spent = tick.end - tick.begin;
    if (running_) raise(longest_gap_, tick.begin - begin_);
    raise(worst_time_, spent);
    add(late_, spent > dt), add(cut_, tick.cut), add(held_, tick.held), add(rejected_states_, tick.rejected_state);
    add(rejected_references_, tick.rejected_references);
    begin_ = tick.begin, running_ = true;
    ticks_.store(ticks_.load(std::memory_order_relaxed) + 1, std::memory_order_release);  // last: the tick has ended
  }
  // The next tick begins another run: the time before it is no gap.
  void pause() { running_ = false; }

  std::int64_t heartbeat() const { return ticks_.load(std::memory_order_acquire); }
  Counts counts() const {
    const auto of = [](const auto& number) { return number.load(std::memory_order_relaxed); };
    const std::int64_t ticks = heartbeat();  // first: the others are at least those of that tick
    return {ticks,
            of(late_),
            of(cut_),
            of(held_),
            of(rejected_states_),
            of(rejected_references_),
            of(longest_gap_),
            of(worst_time_)};
  }

 private:
  template <class Number>
  static void add(std::atomic<std::int64_t>& to, Number number) {  // one thread writes
    to.store(to.load(std::memory_order_relaxed) + std::int64_t(number), std::memory_order_relaxed);
  }
  static void raise(std::atomic<double>& to, double number) {
    if (number > to.load(std::memory_order_relaxed)) to.store(number, std::memory_order_relaxed);
  }

  std::atomic<std::int64_t> ticks_{0}, late_{0}, cut_{0}, held_{0}, rejected_states_{0}, rejected_references_{0};
  std::atomic<double> longest_gap_{0.0}, worst_time_{0.0};
  double begin_ = 0.0;
  bool running_ = false;
};

}  // namespace hqp
