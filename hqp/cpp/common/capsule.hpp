// Pass native objects from one module to another.
#pragma once

#include <nanobind/nanobind.h>

#include "reactions.hpp"
#include "solve_call.hpp"

namespace hqp {

// Its owner must outlive the holder of the capsule.
inline nanobind::capsule capsule_of(SolveCall* call) { return {call, "hqp.solve_call"}; }
inline nanobind::capsule capsule_of(Reactions* reactions) { return {reactions, "hqp.reactions"}; }
inline nanobind::capsule capsule_of(Limiting* limits) { return {limits, "hqp.limiting"}; }

inline SolveCall* call_of(const nanobind::capsule& capsule) {
  return static_cast<SolveCall*>(PyCapsule_GetPointer(capsule.ptr(), "hqp.solve_call"));
}
inline Reactions* reactions_of(const nanobind::capsule& capsule) {
  return static_cast<Reactions*>(PyCapsule_GetPointer(capsule.ptr(), "hqp.reactions"));
}
inline Limiting* limits_of(const nanobind::capsule& capsule) {
  return static_cast<Limiting*>(PyCapsule_GetPointer(capsule.ptr(), "hqp.limiting"));
}

}  // namespace hqp
