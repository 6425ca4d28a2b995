// Many problems of one shape on several threads, the interpreter's lock released: a kernel a thread, arrays in and out.
#include <atomic>
#include <memory>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "batch.hpp"
#include "kernel.hpp"
#include "reading.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <class T, int D>
using In = nb::ndarray<const T, nb::ndim<D>, nb::c_contig, nb::device::cpu>;
template <class T, int D>
using Out = nb::ndarray<T, nb::ndim<D>, nb::c_contig, nb::device::cpu>;

class Batch {
 public:
  Batch(int n, const std::vector<int>& rows, bool metric, const hqp::Options& options)
      : n_(n), rows_(rows), metric_(metric), options_(options) {
    if (n < 1 || n > kMost) throw nb::value_error("n must lie in 1..10000");
    for (int m : rows) {
      if (m < 0 || m > kMost) throw nb::value_error("rows of a level must lie in 0..10000");
      total_ += m;
    }
    options_.multipliers = false;
  }

  // Index of the first hierarchy that has another shape or needs a conversion, -1 if there is none. They must live on.
  long read(const nb::list& hierarchies) {
    const std::size_t count = hierarchies.size();
    const double* prices = nullptr;  // the caller has looked at them
    resize(count);
    for (std::size_t i = 0; i < count; ++i)
      if (!reader_.read(hierarchies[i], n_, rows_, metric_, &levels_[i * rows_.size()], problems_[i], prices)) {
        resize(0);
        return static_cast<long>(i);
      }
    return -1;
  }

  // levels: (A or None, index or None, scale or None, lower, upper) each; A (N or 1, m, n), index, scale (m,),
  // lower, upper (N or 1, m).
  void stack(std::size_t count, const nb::list& levels, int constraints) {
    if (levels.size() != rows_.size() || metric_) throw nb::value_error("the levels do not fit the batch");
    resize(count);
    for (std::size_t k = 0; k < rows_.size(); ++k) {
      const auto parts = nb::cast<nb::tuple>(levels[k]);
      const std::size_t m = static_cast<std::size_t>(rows_[k]), n = static_cast<std::size_t>(n_);
      hqp::Level level;
      level.m = rows_[k];
      std::size_t stride_A = 0;
      if (parts[0].is_none()) {
        const auto index = nb::cast<In<std::int64_t, 1>>(parts[1]);
        const auto scale = nb::cast<In<double, 1>>(parts[2]);
        if (index.shape(0) != m || scale.shape(0) != m) throw nb::value_error("a selection has a wrong shape");
        level.index = index.data();
        level.scale = scale.data();
      } else {
        const auto A = nb::cast<In<double, 3>>(parts[0]);
        if (A.shape(1) != m || A.shape(2) != n) throw nb::value_error("A has a wrong shape");
        level.A = A.data();
        stride_A = stride(A.shape(0), count, m * n);
      }
      const auto lower = nb::cast<In<double, 2>>(parts[3]), upper = nb::cast<In<double, 2>>(parts[4]);
      if (lower.shape(1) != m || upper.shape(1) != m) throw nb::value_error("a bound has a wrong shape");
      const std::size_t down = stride(lower.shape(0), count, m), up = stride(upper.shape(0), count, m);
      for (std::size_t i = 0; i < count; ++i) {
        hqp::Level& one = levels_[i * rows_.size() + k] = level;
        if (level.A) one.A = level.A + i * stride_A;
        one.lower = lower.data() + i * down;
        one.upper = upper.data() + i * up;
      }
    }
    for (std::size_t i = 0; i < count; ++i) {
      problems_[i].levels = &levels_[i * rows_.size()];
      problems_[i].count = static_cast<int>(rows_.size());
      problems_[i].constraints = constraints;
    }
  }

  // x (N, n), slack (N, rows), active (N, rows), effort (N, 4): outcome, iterations, factorisations, unsure.
  void solve(int threads, Out<double, 2> x, Out<double, 2> slack, Out<std::int8_t, 2> active,
             Out<std::int32_t, 2> effort) {
    const std::size_t count = problems_.size(), total = static_cast<std::size_t>(total_);
    if (x.shape(0) != count || x.shape(1) != static_cast<std::size_t>(n_) || slack.shape(0) != count ||
        slack.shape(1) != total || active.shape(0) != count || active.shape(1) != total || effort.shape(0) != count ||
        effort.shape(1) != 4)
      throw nb::value_error("an array for the answers has a wrong shape");
    if (threads < 1) throw nb::value_error("threads must be at least one");
    if (busy_.exchange(true)) throw std::runtime_error("this batch is solving in another thread");
    const nb::gil_scoped_release release;
    try {
      const std::size_t workers = std::min<std::size_t>(static_cast<std::size_t>(threads), count ? count : 1);
      while (kernels_.size() < workers)
        kernels_.emplace_back(hqp::make_kernel(n_, static_cast<int>(rows_.size()), rows_.data(), metric_));
      std::atomic<std::size_t> next{0};
      const auto work = [&](hqp::Kernel& kernel) {
        for (std::size_t from; (from = next.fetch_add(kChunk)) < count;)
          for (std::size_t i = from; i < std::min(from + kChunk, count); ++i) {
            hqp::Answer answer;
            answer.x = x.data() + i * static_cast<std::size_t>(n_);
            answer.slack = slack.data() + i * total;
            answer.active = active.data() + i * total;
            kernel.reset(false);
            kernel.solve(problems_[i], options_, answer);
            std::int32_t* told = effort.data() + 4 * i;
            told[0] = static_cast<std::int32_t>(answer.outcome);
            told[1] = answer.iterations;
            told[2] = answer.factorisations;
            told[3] = answer.unsure;
          }
      };
      std::vector<std::thread> others;
      for (std::size_t w = 1; w < workers; ++w) {
        try {
          others.emplace_back(work, std::ref(*kernels_[w]));
        } catch (const std::system_error&) {
          break;  // fewer threads than asked for
        }
      }
      work(*kernels_[0]);
      for (std::thread& thread : others) thread.join();
    } catch (...) {
      busy_.store(false);
      throw;
    }
    busy_.store(false);
  }

 private:
  static constexpr int kMost = 10000;
  static constexpr std::size_t kChunk = 16;
  int n_;
  std::vector<int> rows_;
  bool metric_;
  int total_ = 0;
  hqp::Options options_;
  hqp::Reader reader_;
  std::vector<hqp::Level> levels_;
  std::vector<hqp::Problem> problems_;
  std::vector<std::unique_ptr<hqp::Kernel>> kernels_;
  std::atomic<bool> busy_{false};

  void resize(std::size_t count) {
    if (busy_.load()) throw std::runtime_error("this batch is solving in another thread");
    levels_.assign(count * rows_.size(), hqp::Level());
    problems_.assign(count, hqp::Problem());
  }

  static std::size_t stride(std::size_t given, std::size_t count, std::size_t size) {
    if (given != count && given != 1) throw nb::value_error("stacked arrays disagree on the number of problems");
    return given == 1 ? 0 : size;
  }
};

}  // namespace

namespace hqp {

void bind_batch(nb::module_& m) {
  nb::class_<Batch>(m, "Batch")
      .def(
          "__init__",
          [](Batch* self, int n, const nb::list& rows, bool metric, double rank, double multiplier, double feasibility,
             int max_iterations, int exchanges) {
            std::vector<int> sizes;
            for (nb::handle h : rows) sizes.push_back(nb::cast<int>(h));
            new (self) Batch(n, sizes, metric, {rank, multiplier, feasibility, 0.0, max_iterations, exchanges, false});
          },
          "n"_a, "rows"_a, "metric"_a, "rank_tolerance"_a, "multiplier_tolerance"_a, "feasibility_tolerance"_a,
          "max_iterations"_a, "exchanges"_a)
      .def("read", &Batch::read, "hierarchies"_a)
      .def("stack", &Batch::stack, "count"_a, "levels"_a, "constraints"_a)
      .def("solve", &Batch::solve, "threads"_a, "x"_a, "slack"_a, "active"_a, "effort"_a);
}

}  // namespace hqp
