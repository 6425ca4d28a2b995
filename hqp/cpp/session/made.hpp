// Making of sessions from plans.
#pragma once

#include <exception>
#include <memory>
#include <string>

#include "errors.hpp"

namespace hqp {

// A session or its stacks from a plan; throws PlanError if the plan is inconsistent.
template <class Made, class From>
std::unique_ptr<Made> made(const From& from) {
  try {
    return std::make_unique<Made>(from);
  } catch (const PlanError&) {
    throw;
  } catch (const std::exception& error) {  // a part rejects its numbers, or memory is exhausted
    throw PlanError(std::string("cannot make a session of the plan: ") + error.what());
  }
}

}  // namespace hqp
