// Format and version of readable plans; tests compare them with the Python package.
#pragma once

namespace hqp {

constexpr int kFormat = 1;
constexpr const char* kVersion = "0.3.0";

}  // namespace hqp
