// Many problems of one shape on several threads, the interpreter's lock released; arrays in and out.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "../priced/level_solve.hpp"
#include "../priced/planned.hpp"
#include "../rows/live_plan.hpp"
#include "batch.hpp"
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
  Batch(int n, const std::vector<int>& rows, bool metric, const hqp::Options& options, const std::vector<char>& priced,
        const hqp::Tolerances& tolerances)
      : n_(n), rows_(rows), metric_(metric), options_(options), priced_(priced), tolerances_(tolerances) {
    if (priced.size() != rows.size()) throw nb::value_error("a level is priced or not");
    if (n < 1 || n > hqp::kLargest) throw nb::value_error("n must lie in 1..10000");
    for (int m : rows) {
      if (m < 0 || m > hqp::kLargest) throw nb::value_error("rows of a level must lie in 0..10000");
      total_ += m;
    }
  }

  // Read the hierarchies; return the index of the first that has another shape or needs a conversion, -1 if there is
  // none. They must live on.
  long read(const nb::list& hierarchies) {
    const std::size_t count = hierarchies.size();
    const double* prices = nullptr;
    resize(count);
    for (std::size_t i = 0; i < count; ++i)
      if (!reader_.read(hierarchies[i], n_, rows_, metric_, &levels_[i * rows_.size()], problems_[i], prices) ||
          !reader_.read_law(hierarchies[i], n_, priced_, prices, laws_[i])) {
        resize(0);
        return static_cast<long>(i);
      }
    return -1;
  }

  // levels: (A or None, index or None, scale or None, lower, upper) each; A (N or 1, m, n), index, scale (m,),
  // lower, upper (N or 1, m).  like: a hierarchy whose law all have.
  void stack(std::size_t count, const nb::list& levels, int constraints, const nb::object& like) {
    if (levels.size() != rows_.size() || metric_) throw nb::value_error("the problem has other levels than the batch");
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
    if (!staged()) return;
    std::vector<hqp::Level> views(rows_.size());
    hqp::Problem read;
    const double* prices = nullptr;
    hqp::Law law;
    if (!reader_.read(like, n_, rows_, metric_, views.data(), read, prices) ||
        !reader_.read_law(like, n_, priced_, prices, law))
      throw nb::value_error("prices, motion or turning have a wrong shape or type");
    laws_.assign(count, law);
  }

  // x (N, n), slack (N, rows), active (N, rows), effort (N, 4): outcome, iterations, factorisations, unsure; points
  // (N, levels, n) of stages, NaN where there was none, (0, levels, n) without prices.
  void solve(int threads, Out<double, 2> x, Out<double, 2> slack, Out<std::int8_t, 2> active,
             Out<std::int32_t, 2> effort, Out<double, 3> points) {
    const std::size_t count = problems_.size(), total = static_cast<std::size_t>(total_);
    if (x.shape(0) != count || x.shape(1) != static_cast<std::size_t>(n_) || slack.shape(0) != count ||
        slack.shape(1) != total || active.shape(0) != count || active.shape(1) != total || effort.shape(0) != count ||
        effort.shape(1) != 4 || points.shape(0) != (staged() ? count : 0) || points.shape(1) != rows_.size() ||
        points.shape(2) != static_cast<std::size_t>(n_))
      throw nb::value_error("an array for the answers has a wrong shape");
    if (threads < 1) throw nb::value_error("threads must be at least one");
    if (busy_.exchange(true)) throw std::runtime_error("this batch is solving in another thread");
    const nb::gil_scoped_release release;
    try {
      const std::size_t workers = std::min<std::size_t>(static_cast<std::size_t>(threads), count ? count : 1);
      while (workers_.size() < workers) workers_.push_back(made());
      std::atomic<std::size_t> next{0};
      const auto work = [&](hqp::LevelSolve& worker) {
        const std::size_t n = static_cast<std::size_t>(n_);
        for (std::size_t from; (from = next.fetch_add(kChunk)) < count;)
          for (std::size_t i = from; i < std::min(from + kChunk, count); ++i)
            solve_one(worker, i, x.data() + i * n, slack.data() + i * total, active.data() + i * total,
                      effort.data() + 4 * i, points.data() + i * rows_.size() * n);
      };
      std::vector<std::thread> others;
      for (std::size_t w = 1; w < workers; ++w) {
        try {
          others.emplace_back(work, std::ref(*workers_[w]));
        } catch (const std::system_error&) {
          break;  // fewer threads than requested
        }
      }
      work(*workers_[0]);
      for (std::thread& thread : others) thread.join();
    } catch (...) {
      busy_.store(false);
      throw;
    }
    busy_.store(false);
  }

 private:
  bool staged() const { return std::find(priced_.begin(), priced_.end(), 1) != priced_.end(); }

  std::unique_ptr<hqp::LevelSolve> made() const {
    auto worker = std::make_unique<hqp::LevelSolve>(n_, rows_, metric_, options_, priced_, tolerances_);
    if (staged()) worker->stages().only_once();
    return worker;
  }

  // Solve problem i cold; the outcome is unsure if it needs more than an optimum.
  void solve_one(hqp::LevelSolve& worker, std::size_t i, double* x, double* slack, std::int8_t* active,
                 std::int32_t* effort, double* points) {
    hqp::BoundKernel& exact = worker.exact();
    exact.levels.assign(problems_[i].levels, problems_[i].levels + rows_.size());
    exact.problem = problems_[i];
    exact.problem.levels = exact.levels.data();
    if (staged()) worker.bind(laws_[i]);
    worker.reset();
    const hqp::Solved found = worker.run(nullptr);
    const double* const values = found.values ? found.values : exact.numbers().data();
    const std::int8_t* const marks = found.active ? found.active : exact.marks();
    std::copy(values, values + n_, x);
    std::copy(values + n_, values + n_ + total_, slack);
    std::copy(marks, marks + total_, active);
    const bool unsure = found.unsure || (found.points && worker.stages().uncertain());
    const int counts[] = {found.outcome, found.iterations, found.factorisations, unsure};
    std::copy(counts, counts + 4, effort);
    const std::size_t all = staged() ? rows_.size() * static_cast<std::size_t>(n_) : 0;
    if (found.points) std::copy(found.points, found.points + all, points);
    else std::fill(points, points + all, std::numeric_limits<double>::quiet_NaN());
  }

  static constexpr std::size_t kChunk = 16;
  int n_;
  std::vector<int> rows_;
  bool metric_;
  int total_ = 0;
  hqp::Options options_;
  hqp::Reader reader_;
  std::vector<hqp::Level> levels_;
  std::vector<hqp::Problem> problems_;
  std::vector<char> priced_;  // (levels,)
  hqp::Tolerances tolerances_;
  std::vector<hqp::Law> laws_;
  std::vector<std::unique_ptr<hqp::LevelSolve>> workers_;
  std::atomic<bool> busy_{false};

  void resize(std::size_t count) {
    if (busy_.load()) throw std::runtime_error("this batch is solving in another thread");
    levels_.assign(count * rows_.size(), hqp::Level());
    problems_.assign(count, hqp::Problem());
    laws_.assign(count, hqp::Law());
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
          [](Batch* self, int n, const std::vector<int>& rows, bool metric, const nb::dict& options,
             const std::vector<bool>& priced, const nb::dict& tolerances) {
            std::vector<nb::object> kept;
            new (self) Batch(n, rows, metric, hqp::options_of(binding::LivePlan(options, kept)),
                             {priced.begin(), priced.end()}, hqp::tolerances_of(binding::LivePlan(tolerances, kept)));
          },
          "n"_a, "rows"_a, "metric"_a, "options"_a, "priced"_a, "tolerances"_a)
      .def("read", &Batch::read, "hierarchies"_a)
      .def("stack", &Batch::stack, "count"_a, "levels"_a, "constraints"_a, "like"_a.none())
      .def("solve", &Batch::solve, "threads"_a, "x"_a, "slack"_a, "active"_a, "effort"_a, "points"_a);
}

}  // namespace hqp
