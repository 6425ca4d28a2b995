// Parts of a tick written in Python: rows of a user's own, a solver that is a plug-in, kinematics of other joints.
#pragma once

#include <cstddef>
#include <vector>

#include "../common/solve_call.hpp"
#include "outgoing.hpp"

namespace hqp {

class Foreign {
 public:
  // Problem of an element, null if none is known.  leave: true if the element is left out of the tick.
  struct Fault {
    const char* text = nullptr;
    Status status = Status::kInvalidElement;
    bool leave = true;
  };

  virtual ~Foreign() = default;

  bool fills = false;   // all rows, by fill()
  bool writes = false;  // rows of some elements, by write() between those of native operations and the laws
  bool judges = false;  // answers of a native solver that are no optimum
  bool failed = false;  // an element has a fault since fill() or write()

  // Fill all rows except those of left out elements; return the reason if the dynamics fail, else null.
  virtual const char* fill(const std::vector<bool>& left_out) = 0;
  virtual void write() = 0;
  virtual Fault fault(std::size_t member) = 0;
  // Move the elements that must stay from `out` to `stay`; return the reason, or null if all may leave.
  virtual const char* supported(std::vector<bool>& out, std::vector<bool>& stay) = 0;
  // Leave these elements out from now on.
  virtual void go_without(const std::vector<bool>& out) = 0;
  virtual Answered solve() = 0;
  virtual Answered judge(const Solved& found) = 0;
  virtual void limit(double seconds) = 0;
  // A state as a robot comes to rest from it; last: the last good one, instead of the tick's.
  virtual RestFrom start(bool last) = 0;
};

}  // namespace hqp
