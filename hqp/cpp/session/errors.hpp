// Errors outside the loop: invalid plan files, and names and sizes that do not fit a plan.
#pragma once

#include <stdexcept>

namespace hqp {

struct PlanError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct ReferenceError : std::invalid_argument {
  using std::invalid_argument::invalid_argument;
};

}  // namespace hqp
