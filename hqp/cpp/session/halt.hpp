// Stop and resume of a session: the caller's from any thread, or its own after a long interval without a usable answer.
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <set>
#include <string>

#include "../common/carry_over.hpp"
#include "tick.hpp"

namespace hqp {

class Halt {
 public:
  // after: ticks without a usable answer after which the session waits for resume(), 0 to resume by itself.
  explicit Halt(std::int64_t after, double dt) : after_(after), seconds_(double(after) * dt) {}

  // Stop, or stay stopped for another reason.
  void stop(const std::string& reason) {
    const std::lock_guard<std::mutex> alone(mutex_);
    why_.store(reasons_.insert(reason.empty() ? "stop" : reason).first->c_str());
  }
  void resume() { why_.store(nullptr); }
  // The reason of the stop, null if the session runs.
  const char* why() const { return why_.load(); }
  static const char* waiting() { return "no answer was usable"; }

  // Take the count of ticks for which the command has been coming to rest.
  void rested(std::int64_t ticks) {
    const char* runs = nullptr;
    if (after_ > 0 && ticks > after_) why_.compare_exchange_strong(runs, waiting());
  }
  Note note(const char* why) const {
    Note found{"stop", Status::kStopped, Cause::kStopped, why};
    if (why == waiting()) found.amount = seconds_;
    return found;
  }
  void keep(CarryOver& state) {  // reasons live as long as the sessions of a batch
    const char* why = why_.load();
    state.take(why);
    if (!state.writes()) why_.store(why);
  }

 private:
  std::int64_t after_;
  double seconds_;
  std::mutex mutex_;
  std::set<std::string> reasons_;
  std::atomic<const char*> why_{nullptr};
};

}  // namespace hqp
