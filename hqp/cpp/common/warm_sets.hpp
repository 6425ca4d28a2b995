// Warm starts of a solver whose rows come and go: each set of rows that was solved before goes on where it ended.
#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "carry_over.hpp"

namespace hqp {

class WarmSets {
 public:
  using Out = std::vector<bool>;  // one flag per element whose rows are outside the set

  // Continue the solver with that set.
  template <class Solver>
  void turn(Solver& solver, const Out& out) {
    std::size_t to = 0;
    while (to < known_ && sets_[to] != out) ++to;
    if (to == known_ && to < kMost) {
      grow(known_ + 1);
      sets_[known_++] = out;
    }
    if (to == now_) return;
    if (now_ < kMost) {
      CarryOver last = CarryOver::to(states_[now_]);
      solver.keep(last);
    }
    now_ = to;
    if (to >= kMost || states_[to].empty()) return;
    CarryOver in = CarryOver::from(states_[to]);
    solver.keep(in);
  }
  // Allocate all kept sets of `elements` elements for a new solver.
  template <class Solver>
  void make_room(Solver& solver, std::size_t elements) {
    sets_.assign(kMost, Out(elements));
    grow(kMost);
    for (WarmState& state : states_) {
      CarryOver room = CarryOver::room(state);
      solver.keep(room);
    }
  }
  void forget() {
    for (WarmState& state : states_) state.clear();
    now_ = kNone, known_ = 0;
  }
  // Exchange the known sets with those of another world; the room for further ones stays.
  void exchange(WarmSets& other) {
    const std::size_t count = std::max(known_, other.known_);
    grow(count), other.grow(count);
    std::swap_ranges(states_.begin(), states_.begin() + std::ptrdiff_t(count), other.states_.begin());
    std::swap_ranges(sets_.begin(), sets_.begin() + std::ptrdiff_t(count), other.sets_.begin());
    std::swap(now_, other.now_), std::swap(known_, other.known_);
  }
  std::size_t bytes() const {
    std::size_t sum = 0;
    for (const WarmState& state : states_) sum += state.bytes();
    for (const Out& set : sets_) sum += set.capacity() / 8;
    return sum;
  }

 private:
  static constexpr std::size_t kMost = 32;  // sets that are kept; others go on where the one before them ended
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

  void grow(std::size_t count) {
    if (states_.size() < count) states_.resize(count);
    if (sets_.size() < count) sets_.resize(count);
  }

  std::vector<WarmState> states_;
  std::vector<Out> sets_;  // in the order of their first solves
  std::size_t now_ = kNone, known_ = 0;
};

}  // namespace hqp
