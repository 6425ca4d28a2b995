// Repeat the loops of record.py in C++: equal numbers, no allocation in a step, and times of steps.
// replay TOLERANCE [--rounds N] FILE.hqp ...; tolerance 0 for equal bits; each round begins with a reset.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

#include <session.hpp>

#include "counted.hpp"

namespace {

template <class T>
std::vector<T> read(std::istream& file, std::size_t count) {
  std::vector<T> values(count);
  if (!file.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(count * sizeof(T)))) {
    std::fprintf(stderr, "the recording ends too early\n");
    std::exit(2);
  }
  return values;
}

bool replay(const std::string& plan, double tolerance, int rounds) {
  hqp::Session session = hqp::load(plan);
  std::vector<hqp::Reference> references;
  for (const std::string& name : session.names()) references.push_back(session.reference(name));
  std::ifstream file(plan.substr(0, plan.rfind('.')) + ".ticks", std::ios::binary);
  const std::vector<std::int32_t> head = read<std::int32_t>(file, 4);
  const std::size_t nq = std::size_t(head[1]), nv = std::size_t(head[2]), n = std::size_t(head[3]);
  const std::streamoff first = file.tellg();
  const long ticks = long(head[0]) * rounds;
  std::vector<double> times;
  times.reserve(std::size_t(ticks));
  double worst = 0.0;
  long taken = 0, other = 0, statuses = 0;
  for (long i = 0; i < ticks; ++i) {
    if (i % head[0] == 0) session.reset(), file.seekg(first);
    const std::vector<std::int32_t> told = read<std::int32_t>(file, 2);
    for (int k = 0; k < told[0]; ++k) {
      const std::vector<std::int32_t> what = read<std::int32_t>(file, 3);
      std::vector<double> values = read<double>(file, std::size_t(what[2]));
      hqp::Reference& reference = references[std::size_t(what[0])];
      if (what[1] == 0) reference.at(values.data(), what[2]);
      if (what[1] == 1) reference.velocity(values.data(), values.size());
      if (what[1] == 2) reference.acceleration(values.data(), values.size());
      if (what[1] == 5) reference.hold(values.data(), values.size());
      if (what[1] == 6) reference.on(values[0] != 0.0);
      if (what[1] == 7) session.phase(std::to_string(int(values[0])));
    }
    std::vector<double> numbers = read<double>(file, nq + nv + n);
    const auto begin = std::chrono::steady_clock::now();
    const long made = allocations_of([&] { session.step(numbers.data(), numbers.data() + nq); });
    times.push_back(std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begin).count());
    const hqp::Tick& tick = session.tick();
    taken += made;
    statuses += static_cast<int>(tick.status()) != told[1];
    double most = 0.0;
    for (std::size_t j = 0; j < n; ++j) {
      const double off = std::fabs(tick.x()[j] - numbers[nq + nv + j]) / (1.0 + std::fabs(numbers[nq + nv + j]));
      most = off > most || std::isnan(off) ? off : most;
    }
    other += !(most <= tolerance);
    worst = most > worst || std::isnan(most) ? most : worst;
  }
  std::sort(times.begin(), times.end());
  const auto at = [&](double share) { return times[std::size_t(share * double(times.size() - 1))]; };
  const std::string name = plan.substr(plan.rfind('/') + 1);
  std::printf("| %s | %ld | %ld | %.1e | %ld | %ld | %.1f | %.1f | %.1f | %.1f | %.1f |\n", name.c_str(), ticks, other,
              worst, statuses, taken, at(0.5), at(0.9), at(0.99), at(0.999), times.back());
  const hqp::Counts counted = session.counters();
  if (counted.ticks != ticks || session.heartbeat() != ticks) {
    std::printf("%s: %lld ticks counted\n", name.c_str(), static_cast<long long>(counted.ticks));
    return false;
  }
  return other == 0 && statuses == 0 && taken == 0;
}

}  // namespace

int main(int argc, char** argv) {
  const bool told = argc > 3 && std::string(argv[2]) == "--rounds";
  const int first = told ? 4 : 2, rounds = told ? std::atoi(argv[3]) : 1;
  if (argc <= first || rounds < 1) return 2;
  std::printf(
      "| plan | ticks | other numbers | by up to | other statuses | allocations | p50 [us] | p90 | p99 | p99.9 | max "
      "|\n"
      "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n");
  bool good = true;
  for (int k = first; k < argc; ++k) good = replay(argv[k], std::atof(argv[1]), rounds) && good;
  return good ? 0 : 1;
}
