// Solves the problems of a file cold and warm through the kernel's headers alone: for sanitizers, and with
// COUNT_ALLOCATIONS for the number of allocations during solve.
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "lexicographic.hpp"

static long allocations = 0;
static bool counting = false;

#ifdef COUNT_ALLOCATIONS
extern "C" void* __libc_malloc(std::size_t);
extern "C" void* __libc_calloc(std::size_t, std::size_t);
extern "C" void* __libc_realloc(void*, std::size_t);
extern "C" void* __libc_memalign(std::size_t, std::size_t);
extern "C" void* malloc(std::size_t size) {
  allocations += counting;
  return __libc_malloc(size);
}
extern "C" void* calloc(std::size_t count, std::size_t size) {
  allocations += counting;
  return __libc_calloc(count, size);
}
extern "C" void* realloc(void* p, std::size_t size) {
  allocations += counting;
  return __libc_realloc(p, size);
}
extern "C" void* aligned_alloc(std::size_t to, std::size_t size) {
  allocations += counting;
  return __libc_memalign(to, size);
}
extern "C" int posix_memalign(void** p, std::size_t to, std::size_t size) {
  allocations += counting;
  *p = __libc_memalign(to, size);
  return *p ? 0 : 12;
}
#endif

template <class T>
static std::vector<T> take(std::FILE* file, std::size_t count) {
  std::vector<T> values(count);
  if (count && std::fread(values.data(), sizeof(T), count, file) != count) std::exit(3);
  return values;
}

int main(int argc, char** argv) {
  long solves = 0;
  double total = 0.0;
  for (int argument = 1; argument < argc; ++argument) {
    std::FILE* file = std::fopen(argv[argument], "rb");
    if (!file) return 2;
    const int count = take<int>(file, 1)[0];
    for (int q = 0; q < count; ++q) {
      const auto size = take<int>(file, 2);
      const int n = size[0];
      std::vector<std::vector<double>> numbers;
      std::vector<std::vector<std::int64_t>> indices;
      std::vector<hqp::Level> levels(size[1]);
      std::vector<int> rows;
      int total_rows = 0, pairs = 0;
      numbers.reserve(4 * levels.size());
      indices.reserve(levels.size());
      for (hqp::Level& level : levels) {
        const auto head = take<int>(file, 2);
        level.m = head[0];
        if (head[1]) {
          indices.push_back(take<std::int64_t>(file, level.m));
          level.index = indices.back().data();
          numbers.push_back(take<double>(file, level.m));
          level.scale = numbers.back().data();
        } else {
          numbers.push_back(take<double>(file, static_cast<std::size_t>(level.m) * n));
          level.A = numbers.back().data();
        }
        numbers.push_back(take<double>(file, level.m));
        level.lower = numbers.back().data();
        numbers.push_back(take<double>(file, level.m));
        level.upper = numbers.back().data();
        rows.push_back(level.m);
        total_rows += level.m;
        pairs += total_rows;
      }
      hqp::Lexicographic workspace(n, size[1], rows.data(), false);
      std::vector<double> x(n), slack(total_rows + 1), lambda(pairs + 1);
      std::vector<std::int8_t> active(total_rows + 1);
      hqp::Problem problem;
      problem.levels = levels.data();
      problem.count = size[1];
      hqp::Options options{1e-9, 1e-11, 1e-11};
      hqp::Answer answer;
      answer.x = x.data();
      answer.slack = slack.data();
      answer.active = active.data();
      answer.multipliers = lambda.data();
      counting = true;
      for (int warm = 0; warm < 2; ++warm, ++solves) {
        workspace.solve(problem, options, answer);
        if (static_cast<int>(answer.outcome) > 2) {
          std::fprintf(stderr, "%s %d not solved\n", argv[argument], q);
          return 1;
        }
      }
      counting = false;
      for (double value : x) total += value;
    }
    std::fclose(file);
  }
  std::printf("solves %ld allocations %ld sum %.6g\n", solves, allocations, total);
  return 0;
}
