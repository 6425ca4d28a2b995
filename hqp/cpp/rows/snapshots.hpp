// Live arrays copied into a ring, one snapshot a tick, past the caches: nobody reads them in the loop.
#pragma once

#include <cstdint>
#include <cstring>
#include <tuple>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

namespace binding {

namespace nb = nanobind;

class Snapshots {
 public:
  using Bytes = nb::ndarray<const std::uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
  using Ring = nb::ndarray<std::uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

  // parts: bytes with their offsets in a snapshot; size: bytes of a snapshot.
  Snapshots(const std::vector<std::tuple<Bytes, std::size_t>>& parts, const Ring& ring, std::size_t size)
      : ring_(ring), to_(ring.data()), size_(size), count_(size ? ring.size() / size : 0) {
    for (const auto& [bytes, begin] : parts) {
      if (begin + bytes.size() > size) throw nb::value_error("a part ends behind its snapshot");
      parts_.push_back({bytes.data(), bytes.size(), begin});
      kept_.push_back(bytes);
    }
  }

  void take(std::size_t i) {
    if (i >= count_) throw nb::index_error("no such snapshot");
    for (const Part& part : parts_) copy(to_ + i * size_ + part.begin, part.from, part.size);
#if defined(__SSE2__)
    _mm_sfence();
#endif
  }

 private:
  struct Part {
    const std::uint8_t* from;
    std::size_t size, begin;
  };

  static void copy(std::uint8_t* to, const std::uint8_t* from, std::size_t size) {
    std::size_t i = 0;
#if defined(__SSE2__)
    if (reinterpret_cast<std::uintptr_t>(to) % 16 == 0)
      for (; i + 64 <= size; i += 64) {
        __m128i lines[4];
        for (int k = 0; k < 4; ++k) lines[k] = _mm_loadu_si128(reinterpret_cast<const __m128i*>(from + i) + k);
        for (int k = 0; k < 4; ++k) _mm_stream_si128(reinterpret_cast<__m128i*>(to + i) + k, lines[k]);
      }
#endif
    std::memcpy(to + i, from + i, size - i);
  }

  Ring ring_;
  std::uint8_t* to_;
  std::size_t size_, count_;
  std::vector<Part> parts_;
  std::vector<Bytes> kept_;
};

}  // namespace binding
