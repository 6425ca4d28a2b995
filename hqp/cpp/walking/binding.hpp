// Bindings of walks, a part of the module of sessions.
#pragma once

#include <nanobind/nanobind.h>

namespace binding {

namespace nb = nanobind;

void bind_walking(nb::module_& module);

}  // namespace binding
