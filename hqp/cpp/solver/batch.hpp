// The class behind hqp.solve_many.
#pragma once

#include <nanobind/nanobind.h>

namespace hqp {

void bind_batch(nanobind::module_& m);

}  // namespace hqp
