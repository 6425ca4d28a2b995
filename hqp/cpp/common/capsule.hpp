// A solve of one native module that another one runs.
#pragma once

#include <nanobind/nanobind.h>

#include "solve_call.hpp"

namespace hqp {

// Its owner has to outlive what is given the capsule.
inline nanobind::capsule capsule_of(SolveCall* call) { return {call, "hqp.solve_call"}; }

inline SolveCall* call_of(const nanobind::capsule& capsule) {
  return static_cast<SolveCall*>(PyCapsule_GetPointer(capsule.ptr(), "hqp.solve_call"));
}

}  // namespace hqp
