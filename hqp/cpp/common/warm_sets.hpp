// Warm starts of a solver whose rows come and go: each set of rows that was solved before goes on where it ended.
#pragma once

#include <cstddef>
#include <vector>

#include "carry_over.hpp"

namespace hqp {

class WarmSets {
 public:
  using Out = std::vector<bool>;  // one flag per element whose rows are outside the set

  // The solver goes on with that set: Continue the solver with that set:
  template <class Solver>
  void turn(Solver& solver, const Out& out) {
    std::size_t to = 0;
    while (to < known_ && sets_[to] != out) ++to;
    if (to == known_ && to < kMost) sets_[known_++] = out;
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
    for (WarmState& state : states_) {
      CarryOver room = CarryOver::room(state);
      solver.keep(room);
    }
  }
  void forget() {
    for (WarmState& state : states_) state.clear();
    now_ = kNone, known_ = 0;
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

  std::vector<WarmState> states_ = std::vector<WarmState>(kMost);
  std::vector<Out> sets_ = std::vector<Out>(kMost);  // in the order of their first solves
  std::size_t now_ = kNone, known_ = 0;
};

}  // namespace hqp
