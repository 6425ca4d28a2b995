// A robot's loop in C++: the problems that record.py wrote are solved again by the kernel, warm from tick to tick, and
// compared with the answers Python got.  replay FILE [tolerance]
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <vector>

#include <lexicographic.hpp>

template <class T>
static std::vector<T> read(std::FILE* file, std::size_t count) {
  std::vector<T> values(count);
  if (count && std::fread(values.data(), sizeof(T), count, file) != count) {
    std::fprintf(stderr, "the file ends too early\n");
    std::exit(2);
  }
  return values;
}

int main(int argc, char** argv) {
  if (argc < 2) return 2;
  const double tolerance = argc > 2 ? std::atof(argv[2]) : 1e-12;
  std::FILE* file = std::fopen(argv[1], "rb");
  if (!file) return 2;

  const int ticks = read<int>(file, 1)[0];
  std::unique_ptr<hqp::Lexicographic> workspace;  // made once: solve() allocates nothing
  double worst = 0.0, seconds = 0.0;
  for (int tick = 0; tick < ticks; ++tick) {
    const auto size = read<int>(file, 2);
    const int n = size[0], count = size[1];
    std::vector<hqp::Level> levels(count);
    std::vector<std::vector<double>> numbers;  // data of the levels
    std::vector<std::vector<std::int64_t>> indices;
    std::vector<int> rows;
    int total = 0, pairs = 0;
    for (hqp::Level& level : levels) {
      const auto head = read<int>(file, 2);  // rows, and whether each picks one variable
      level.m = head[0];
      if (head[1]) {
        indices.push_back(read<std::int64_t>(file, level.m));
        level.index = indices.back().data();
        numbers.push_back(read<double>(file, level.m));
        level.scale = numbers.back().data();
      } else {
        numbers.push_back(read<double>(file, static_cast<std::size_t>(level.m) * n));
        level.A = numbers.back().data();
      }
      numbers.push_back(read<double>(file, level.m));
      level.lower = numbers.back().data();
      numbers.push_back(read<double>(file, level.m));
      level.upper = numbers.back().data();
      rows.push_back(level.m);
      total += level.m;
      pairs += total;
    }
    const auto expected = read<double>(file, n);

    if (!workspace) workspace = std::make_unique<hqp::Lexicographic>(n, count, rows.data(), false);
    std::vector<double> x(n), slack(total + 1), multipliers(pairs + 1);
    std::vector<std::int8_t> active(total + 1);
    hqp::Problem problem;
    problem.levels = levels.data();
    problem.count = count;
    hqp::Answer answer;
    answer.x = x.data();
    answer.slack = slack.data();
    answer.active = active.data();
    answer.multipliers = multipliers.data();
    const auto start = std::chrono::steady_clock::now();
    workspace->solve(problem, hqp::Options{}, answer);
    seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();

    for (int i = 0; i < n; ++i)
      worst = std::fmax(worst, std::fabs(x[i] - expected[i]) / (1.0 + std::fabs(expected[i])));
  }
  std::fclose(file);
  std::printf("%d ticks, largest difference %.2g, %.1f us a solve\n", ticks, worst, 1e6 * seconds / ticks);
  return worst <= tolerance ? 0 : 1;
}
