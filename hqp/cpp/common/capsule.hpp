// Pass native objects from one module to another.
#pragma once

#include <nanobind/nanobind.h>

#include "reactions.hpp"
#include "solve_call.hpp"

namespace hqp {

// Its owner must outlive the holder of the capsule.
inline nanobind::capsule capsule_of(SolveCall* call) { return {call, "hqp.solve_call"}; }
inline nanobind::capsule capsule_of(Reactions* reactions) { return {reactions, "hqp.reactions"}; }

// A part that another module goes on with as its own.
template <class Part>
nanobind::capsule capsule_of_part(Part* part, const char* name) {
  return {part, name};
}
template <class Part>
Part* part_of(const nanobind::handle& capsule, const char* name) {
  void* found = PyCapsule_GetPointer(capsule.ptr(), name);
  if (!found) nanobind::raise_python_error();
  return static_cast<Part*>(found);
}

inline SolveCall* call_of(const nanobind::capsule& capsule) {
  return static_cast<SolveCall*>(PyCapsule_GetPointer(capsule.ptr(), "hqp.solve_call"));
}
inline Reactions* reactions_of(const nanobind::capsule& capsule) {
  return static_cast<Reactions*>(PyCapsule_GetPointer(capsule.ptr(), "hqp.reactions"));
}

}  // namespace hqp
