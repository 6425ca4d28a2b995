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

  // All rows, but for those of elements that are left out; why the dynamics fail, null where they do not.
  virtual const char* fill(const std::vector<bool>& left_out) = 0;
  virtual void write() = 0;
  virtual Fault fault(std::size_t member) = 0;
  // Elements that are to be out, less those that have to stay; why these have to, null where all may go.
  virtual const char* supported(std::vector<bool>& out, std::vector<bool>& stay) = 0;
  // These elements are out from now on.
  virtual void go_without(const std::vector<bool>& out) = 0;
  virtual Answered solve() = 0;
  virtual Answered judge(const Solved& found) = 0;
  virtual void limit(double seconds) = 0;
  // A state as a robot comes to rest from it; last: the last good one, instead of the tick's.
  virtual RestFrom start(bool last) = 0;
};

}  // namespace hqp
