// Many problems of one shape on several threads, the interpreter's lock released: a kernel a thread, and stages where
// levels have a price; arrays in and out.
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

#include "../common/isa.hpp"
#include "../priced/planned.hpp"
#include "../rows/live_plan.hpp"
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
      const auto work = [&](Worker& worker) {
        for (std::size_t from; (from = next.fetch_add(kChunk)) < count;)
          for (std::size_t i = from; i < std::min(from + kChunk, count); ++i) {
            hqp::Answer answer;
            answer.hard = worker.hard.data();
            answer.x = x.data() + i * static_cast<std::size_t>(n_);
            answer.slack = slack.data() + i * total;
            answer.active = active.data() + i * total;
            if (laws_[i].prices) problems_[i].motion = laws_[i].F, problems_[i].motion_rows = laws_[i].r;
            worker.kernel->reset(false);
            worker.kernel->solve(problems_[i], options_, answer);
            if (staged()) follow(worker, i, answer, points.data() + i * rows_.size() * static_cast<std::size_t>(n_));
            std::int32_t* counts = effort.data() + 4 * i;
            counts[0] = static_cast<std::int32_t>(answer.outcome);
            counts[1] = answer.iterations;
            counts[2] = answer.factorisations;
            counts[3] = answer.unsure;
          }
      };
      std::vector<std::thread> others;
      for (std::size_t w = 1; w < workers; ++w) {
        try {
          others.emplace_back(work, std::ref(workers_[w]));
        } catch (const std::system_error&) {
          break;  // fewer threads than requested
        }
      }
      work(workers_[0]);
      for (std::thread& thread : others) thread.join();
    } catch (...) {
      busy_.store(false);
      throw;
    }
    busy_.store(false);
  }

 private:
  struct Worker {
    std::unique_ptr<hqp::Kernel> kernel;
    std::unique_ptr<hqp::PricedStages> stages;
    std::vector<double> last, hard;
  };

  bool staged() const { return std::find(priced_.begin(), priced_.end(), 1) != priced_.end(); }

  Worker made() const {
    const int levels = static_cast<int>(rows_.size());
    Worker worker;
    worker.kernel.reset(hqp::make_kernel(n_, levels, rows_.data(), metric_));
    worker.hard.resize(static_cast<std::size_t>(n_));
    if (!staged()) return worker;
    const std::unique_ptr<bool[]> marks(new bool[priced_.size()]);
    std::copy(priced_.begin(), priced_.end(), marks.get());
    worker.stages.reset(HQP_FOR_MACHINE(make_stages, n_, levels, rows_.data(), marks.get(), tolerances_));
    worker.stages->only_once();
    worker.last.resize(static_cast<std::size_t>(n_));
    return worker;
  }

  // The stages of the levels that an exact answer does not settle; the outcome is unsure if it needs more than an
  // optimum.
  void follow(Worker& worker, std::size_t i, hqp::Answer& answer, double* points) {
    hqp::PricedStages& stages = *worker.stages;
    const hqp::Problem& problem = problems_[i];
    std::fill(points, points + rows_.size() * static_cast<std::size_t>(n_), std::numeric_limits<double>::quiet_NaN());
    if (!laws_[i].prices) return;
    if (answer.outcome != hqp::Outcome::optimal || answer.unsure) {
      answer.unsure = true;
      return;
    }
    for (std::size_t k = 0; k < rows_.size(); ++k) {
      const hqp::Level& level = problem.levels[k];
      stages.levels()[k] = {level.m, level.A, level.index, level.scale, level.lower, level.upper};
    }
    stages.bind(laws_[i], {problem.metric, problem.origin});
    stages.reset();
    if (stages.solve(worker.hard.data(), 0, 0.0, points, worker.last.data()) < 0) return;
    std::copy(worker.last.begin(), worker.last.end(), answer.x);
    if (stages.ended()) {
      int count = 0;
      const double* const unseen = worker.kernel->unseen(problem, options_, count);
      stages.complete(unseen, count, answer.x);
      worker.kernel->choose(problem, options_, answer.x, false);
    }
    answer.unsure = !stages.ended() || stages.uncertain() || stages.doubtful();
    const double* allowed = worker.kernel->allowed();
    answer.unsure =
        stages.describe(answer.x, problem.constraints, allowed, answer.slack, answer.active) || answer.unsure;
    answer.iterations += stages.iterations();
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
  std::vector<Worker> workers_;
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
