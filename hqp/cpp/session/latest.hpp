// State and command of a tick, and the last valid ones.
#pragma once

#include <algorithm>
#include <vector>

#include "../common/carry_over.hpp"
#include "line.hpp"

namespace hqp {

// Facts about a state besides q and v.
struct StateFacts {
  const double* time = nullptr;    // [s], null if unknown
  double now = 0.0;                // time of the tick [s]
  const double* angles = nullptr;  // joints of q, if the line has no kinematics
  const char* fault = nullptr;     // reason why the state is invalid, null if unknown
};

struct Latest {
  explicit Latest(const Line& line)
      : q(std::size_t(line.nq())),
        v(std::size_t(line.nv())),
        valid_q(q.size()),
        valid_v(v.size()),
        x(std::size_t(line.size())),
        start(x.size()),
        velocity(line.order() == 1) {}

  std::vector<double> q, v;              // state of the tick, q normalised
  std::vector<double> valid_q, valid_v;  // last valid state
  std::vector<double> x;                 // last sent
  std::vector<double> start;             // x from which the rates of the first tick start
  bool velocity;                         // true at velocity level
  bool good = false;                     // x was sent
  bool placed = false;                   // valid_q and valid_v are known
  bool timed = false;                    // an answer was usable before

  // Velocity at the centre of the limits' windows.
  const double* around() const { return velocity && good ? x.data() : v.data(); }

  void take(const double* state, const double* rates) {
    std::copy(state, state + q.size(), q.begin());
    std::copy(rates, rates + v.size(), v.begin());
  }
  // Keep the state of the tick as the last valid one; rates: its velocity.
  void keep_valid(const double* rates) {
    std::copy(q.begin(), q.end(), valid_q.begin());
    std::copy(rates, rates + v.size(), valid_v.begin());
    placed = true;
  }
  // Start from a command, by its indices in x; rates: velocity of the robot, null if unknown.
  void begin(const double* command, const std::vector<int>& picks, const double* rates) {
    std::fill(x.begin(), x.end(), 0.0);
    if (rates && velocity) std::copy(rates, rates + v.size(), x.begin());
    for (std::size_t i = 0; i < picks.size(); ++i) x[std::size_t(picks[i])] = command[i];
    start = x, good = true;
  }
  // Send x: the command is part of it.
  void send(const std::vector<double>& sent, const std::vector<int>& picks, std::vector<double>& command) {
    std::copy(sent.begin(), sent.end(), x.begin());
    for (std::size_t i = 0; i < picks.size(); ++i) command[i] = x[std::size_t(picks[i])];
  }
  // Continue from another session, after it sent that x.
  void follow(const Latest& other, const double* sent) {
    std::copy(sent, sent + x.size(), x.begin());
    good = other.good, valid_q = other.valid_q, valid_v = other.valid_v;
    placed = other.placed, timed = other.timed;
  }
  void keep(CarryOver& state) {
    state.take(good), state.take(placed);
    state.take(x.data(), x.size());
    if (placed) state.take(valid_q.data(), valid_q.size()), state.take(valid_v.data(), valid_v.size());
  }
};

}  // namespace hqp
