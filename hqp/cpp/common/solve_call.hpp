// A solve that others run, with nothing of Python in between.
#pragma once

#include <cstddef>
#include <cstdint>

namespace hqp {

struct Solved {
  int outcome = 0, iterations = 0, factorisations = 0, judged = 0;
  bool unsure = false;  // a rank was uncertain
  double before = 0.0;  // time of the rows' last steps ahead of the solve [s]
  // x and slacks, marks, and points of stages, where they are not those of the workspace that was bound.
  const double* values = nullptr;
  const std::int8_t* active = nullptr;
  const double* points = nullptr;
  std::size_t point_count = 0;
};

constexpr int kAskPython = -1;  // an outcome: nothing was solved, the same in Python has to do it
constexpr int kOptimal = 0, kUncertain = 1, kViolated = 2, kInvalid = 6;  // numbers of the outcomes of a kernel
constexpr int kNotCertified = 3, kIterationLimit = 4, kTimeLimit = 5;

class SolveCall {
 public:
  virtual ~SolveCall() = default;
  // Without the interpreter's lock; v: velocity of the state. Throws where another thread solves.
  virtual Solved run(const double* v) = 0;
  // Time for the next runs [s], none for 0.
  virtual void limit(double) {}
};

}  // namespace hqp
