// Allocations that this thread makes while it counts them.
#pragma once

#include <cstddef>

namespace {
thread_local bool counting = false;
thread_local long allocations = 0;
}  // namespace

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__)
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
void* malloc(std::size_t size) { return allocations += counting, __libc_malloc(size); }
void* calloc(std::size_t count, std::size_t size) { return allocations += counting, __libc_calloc(count, size); }
void* realloc(void* old, std::size_t size) { return allocations += counting, __libc_realloc(old, size); }
void* aligned_alloc(std::size_t align, std::size_t size) {
  return allocations += counting, __libc_memalign(align, size);
}
}
#endif

template <class Do>
long allocations_of(const Do& run) {
  allocations = 0, counting = true;
  run();
  counting = false;
  return allocations;
}
