// Repeat the loops of record_filter.py in C++: equal bits, no allocation in a step.  filter FILE.hqp ...
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include <filtering.hpp>

#include "counted.hpp"

namespace {

bool repeat(const std::string& path) {
  hqp::FilterSession filter(hqp::read(path));
  std::ifstream file(path.substr(0, path.rfind('.')) + ".ticks", std::ios::binary);
  const std::size_t nq = std::size_t(filter.nq()), nv = std::size_t(filter.nv()), n = filter.joint_names().size();
  std::vector<double> numbers(nq + nv + 2 * n), times;
  long taken = 0, other = 0, limited = 0;
  std::int32_t size;
  while (file.read(reinterpret_cast<char*>(&size), sizeof size)) {
    if (size != std::int32_t(numbers.size())) return false;
    file.read(reinterpret_cast<char*>(numbers.data()), std::streamsize(numbers.size() * sizeof(double)));
    const double *q = numbers.data(), *v = q + nq, *policy = v + nv, *sent = policy + n;
    const auto begin = std::chrono::steady_clock::now();
    taken += allocations_of([&] { filter.step(q, v, policy); });
    times.push_back(std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begin).count());
    other += std::memcmp(filter.command().data(), sent, n * sizeof(double)) != 0;
    limited += std::count(filter.limited().begin(), filter.limited().end(), 1) > 0;
  }
  std::sort(times.begin(), times.end());
  std::printf("%s: %zu ticks, %ld with other bits, %ld limited, %ld allocations; p50 %.0f us\n", path.c_str(),
              times.size(), other, limited, taken, times.empty() ? 0.0 : times[times.size() / 2]);
  return !times.empty() && other == 0 && taken == 0 && limited > 0;
}

}  // namespace

int main(int argc, char** argv) {
  bool good = argc > 1;
  for (int k = 1; k < argc; ++k) good = repeat(argv[k]) && good;
  return good ? 0 : 1;
}
