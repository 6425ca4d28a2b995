// Select the build of a kernel for this machine.
#pragma once

#include <cstdlib>
#include <cstring>

namespace hqp {

// True if the avx2 kernels run: the machine has the instructions, and the environment variable HQP_ISA, read once, is
// not "generic".
static inline bool has_avx2() {
#if defined(HQP_AVX2)
  static const bool found = [] {
    const char* name = std::getenv("HQP_ISA");
    const bool generic = name && std::strcmp(name, "generic") == 0;
    return !generic && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  }();
  return found;
#else
  return false;
#endif
}

}  // namespace hqp

// One of NAME_generic and NAME_avx2, made from the same source.
#if defined(HQP_AVX2)
#define HQP_FOR_MACHINE(name, ...) (hqp::has_avx2() ? hqp::name##_avx2(__VA_ARGS__) : hqp::name##_generic(__VA_ARGS__))
#else
#define HQP_FOR_MACHINE(name, ...) hqp::name##_generic(__VA_ARGS__)
#endif
