// Binding of a filter, a part of the module of sessions.
#pragma once

#include <nanobind/nanobind.h>

namespace binding {

namespace nb = nanobind;

void bind_policies(nb::module_& module);

}  // namespace binding
