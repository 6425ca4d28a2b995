// Warm starts of a solver whose rows come and go: each set of rows that was solved before goes on where it ended.
#pragma once

#include <cstddef>
#include <vector>

#include "carry_over.hpp"

namespace hqp {

class WarmSets {
 public:
  static constexpr std::size_t kMost = 32;  // sets that are kept; others go on where the one before them ended

  // The solver goes on with set `to`: where that ended, or the latest one if it is new.
  template <class Solver>
  void turn(Solver& solver, std::size_t to) {
    if (to == now_) return;
    if (now_ < kMost) {
      CarryOver out = CarryOver::to(states_[now_]);
      solver.keep(out);
    }
    now_ = to;
    if (to >= kMost) return;
    if (states_[to].empty()) return;
    CarryOver in = CarryOver::from(states_[to]);
    solver.keep(in);
  }
  // Takes the memory of all sets that are kept; the solver is new.
  template <class Solver>
  void make_room(Solver& solver) {
    for (WarmState& state : states_) {
      CarryOver room = CarryOver::room(state);
      solver.keep(room);
    }
  }
  void forget() {
    for (WarmState& state : states_) state.clear();
    now_ = kNone;
  }

 private:
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

  std::vector<WarmState> states_ = std::vector<WarmState>(kMost);
  std::size_t now_ = kNone;
};

}  // namespace hqp
