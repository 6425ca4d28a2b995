// State of a solver, or of rows, between ticks: written into bytes, or read back in the same order; large parts are
// moved instead.
#pragma once

#include <cstddef>
#include <cstring>
#include <memory>
#include <utility>
#include <vector>

namespace hqp {

// Large part of it.
class WarmPart {
 public:
  virtual ~WarmPart() = default;
  virtual void forget() = 0;                              // as new
  virtual void trim() = 0;                                // release memory of unknown state
  virtual std::shared_ptr<WarmPart> another() const = 0;  // a new one, with all memory that it may need
  virtual std::size_t bytes() const = 0;
};

// All of it, while others are solved; nothing at first. With room, it takes no memory any more.
struct WarmState {
  std::vector<char> small;
  std::vector<std::shared_ptr<WarmPart>> parts;
  bool room = false;

  bool empty() const { return small.empty(); }
  void clear() {
    small.clear();
    if (!room) parts.clear();
    for (const auto& part : parts) part->forget();
  }
  std::size_t bytes() const {
    std::size_t sum = sizeof(*this) + small.capacity();
    for (const auto& part : parts) sum += sizeof(part) + (part ? part->bytes() : 0);
    return sum;
  }
};

template <class T>
std::size_t bytes_of(const std::vector<T>& values) {
  return values.capacity() * sizeof(T);
}

class CarryOver {
 public:
  static CarryOver to(WarmState& state) { return {state, true}; }
  static CarryOver from(WarmState& state) { return {state, false}; }
  // State without its large parts: a large part stays in place, and is new after reading.
  static CarryOver to_first(WarmState& state) { return {state, true, true}; }
  static CarryOver from_first(WarmState& state) { return {state, false, true}; }
  // Reserve memory for all of it.
  static CarryOver room(WarmState& state) {
    state.room = true;
    CarryOver found{state, true};
    found.measures_ = true;
    return found;
  }

  template <class T>
  void take(T* values, std::size_t count) {
    const std::size_t size = count * sizeof(T);
    if (size == 0) return;
    std::vector<char>& bytes = state_.small;
    if (measures_) {
      bytes.reserve(at_ + size);
    } else if (writes_) {
      if (bytes.size() < at_ + size) bytes.resize(at_ + size);
      std::memcpy(bytes.data() + at_, values, size);
    } else {
      std::memcpy(values, bytes.data() + at_, size);
    }
    at_ += size;
  }
  template <class T>
  void take(T& value) {
    take(&value, 1);
  }
  template <class T>
  void list(std::vector<T>& values) {  // list with a varying length
    std::size_t size = values.size();
    take(size);
    if (!writes_) values.resize(size);
    take(values.data(), measures_ ? values.capacity() : size);
  }
  // Move a large part, null if unknown, between states: to another state, and back from it.
  template <class T>
  void part(std::shared_ptr<T>& mine) {
    if (first_) {
      if (mine && !writes_) mine->forget();
      return;
    }
    const std::size_t k = part_++;
    if (writes_ && !state_.room && mine) mine->trim();
    if (state_.parts.size() <= k) state_.parts.resize(k + 1);
    if (measures_) {
      state_.parts[k] = mine->another();
      return;
    }
    std::shared_ptr<WarmPart> theirs = std::move(state_.parts[k]);
    state_.parts[k] = std::move(mine);
    mine = std::static_pointer_cast<T>(std::move(theirs));
  }
  bool writes() const { return writes_; }

 private:
  CarryOver(WarmState& state, bool writes, bool first = false) : state_(state), writes_(writes), first_(first) {}

  WarmState& state_;
  bool writes_, first_, measures_ = false;
  std::size_t at_ = 0, part_ = 0;
};

}  // namespace hqp
