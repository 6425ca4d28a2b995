// Python's view of the stages: bound once to the arrays of a hierarchy and of what its levels hand down.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <memory>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <tuple>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "../common/capsule.hpp"
#include "../common/isa.hpp"
#include "staged_solve.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Matrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Index = nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Owners = nb::ndarray<const std::int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Out = nb::ndarray<double, nb::c_contig, nb::device::cpu>;

[[noreturn]] void refuse(const char* text) { throw nb::value_error(text); }

template <class Array>
auto checked(nb::handle h, std::size_t m) {
  const auto a = nb::cast<Array>(h);
  if (a.shape(0) != m) refuse("an array has a wrong shape");
  return a.data();
}

// One thread at a time: the second is refused.
class Turn {
 public:
  explicit Turn(std::atomic<bool>& busy) : busy_(busy) {
    if (busy.exchange(true)) throw std::runtime_error("these stages are being solved in another thread");
  }
  ~Turn() { busy_.store(false); }
  Turn(const Turn&) = delete;
  Turn& operator=(const Turn&) = delete;

 private:
  std::atomic<bool>& busy_;
};

class Stages final : public hqp::SolveCall {
 public:
  Stages(int n, const std::vector<int>& rows, const std::vector<int>& priced, double met, double flat, double accurate,
         double resting, double rounded, double activity, double violation)
      : n_(n),
        rows_(rows),
        core_(n, rows, made(n, rows, priced, {met, flat, accurate, resting, rounded, activity, violation})) {}
  // levels: (A or None, index or None, scale or None, lower, upper).  prices, turning: one a level.  metric, origin:
  // None for none.  The caller keeps the arrays alive, and so does this object.
  void bind(const nb::list& levels, const Vector& prices, const nb::object& turning, double eta, const nb::object& F,
            const nb::object& f, const nb::object& metric, const nb::object& origin) {
    if (levels.size() != rows_.size() || prices.shape(0) != rows_.size()) refuse("one entry a level");
    if (!(eta > 0.0)) refuse("eta: positive");
    for (std::size_t k = 0; k < rows_.size(); ++k) {
      const auto parts = nb::cast<nb::tuple>(levels[k]);
      hqp::PricedLevel& level = stages().levels()[k];
      const std::size_t m = static_cast<std::size_t>(rows_[k]);
      if (!parts[0].is_none()) {
        const auto A = nb::cast<Matrix>(parts[0]);
        if (A.shape(0) != m || A.shape(1) != std::size_t(n_)) refuse("A has a wrong shape");
        level.A = A.data();
      } else {
        level.A = nullptr;
        level.index = checked<Index>(parts[1], m);
        level.scale = checked<Vector>(parts[2], m);
        for (std::size_t i = 0; i < m; ++i)
          if (level.index[i] < 0 || level.index[i] >= n_) refuse("a position beyond n");
      }
      level.lower = checked<Vector>(parts[3], m);
      level.upper = checked<Vector>(parts[4], m);
    }
    hqp::Law law;
    law.prices = prices.data();
    law.turning = turning.is_none() ? nullptr : checked<Vector>(turning, rows_.size());
    law.eta = eta;
    if (!F.is_none()) {
      const auto any = nb::cast<nb::ndarray<const double, nb::c_contig, nb::device::cpu>>(F);
      if (any.ndim() == 0 || any.ndim() > 2 || any.shape(any.ndim() - 1) != std::size_t(n_)) refuse("F: wrong shape");
      law.F = any.data();
      law.r = any.ndim() == 2 ? static_cast<int>(any.shape(0)) : 0;
    }
    if (!f.is_none()) law.f = checked<Vector>(f, static_cast<std::size_t>(law.r ? law.r : n_));
    hqp::Completion completion;
    if (!metric.is_none()) {
      const auto M = nb::cast<Matrix>(metric);
      if (M.shape(0) != std::size_t(n_) || M.shape(1) != std::size_t(n_)) refuse("metric: wrong shape");
      completion.metric = M.data();
    }
    if (!origin.is_none()) completion.origin = checked<Vector>(origin, std::size_t(n_));
    core_.bind(law, completion);
    kept_ = nb::make_tuple(levels, prices, turning, F, f, metric, origin);
    bound_ = true;
    heads_.clear();
  }

  // The first level that x does not settle, -1 for none; otherwise stages (levels, n) and last (n) are written.
  // head: x is the exact answer of the levels above this one only, 0 for all; -2 where level `head` is met.
  // seconds: for the stages, 0 for no limit.
  int solve(const Vector& x, const Out& stages, const Out& last, int head, double seconds) {
    if (!bound_) refuse("bind() comes first");
    if (x.shape(0) != std::size_t(n_) || last.size() != std::size_t(n_) || stages.size() != rows_.size() * n_)
      refuse("x, stages or last has a wrong shape");
    if (head < 0 || std::size_t(head) >= rows_.size()) refuse("head: not a level");
    const Turn turn(busy_);
    const double* from = x.data();
    double *to = stages.data(), *end = last.data();
    const nb::gil_scoped_release release;
    return core_.start(from, head, seconds, to, end);
  }

  // solve() of all levels straight after the exact solve whose capsule is given, as one call for another native module.
  nb::capsule after(const nb::capsule& exact, const Vector& x, const Out& stages, const Out& last) {
    if (x.shape(0) != std::size_t(n_) || last.size() != std::size_t(n_) || stages.size() != rows_.size() * n_)
      refuse("x, stages or last has a wrong shape");
    core_.after(hqp::call_of(exact), x.data(), stages.data(), last.data());
    chained_ = nb::make_tuple(exact, x, stages, last);
    return hqp::capsule_of(this);
  }
  // The solve of the levels above one that may be the first that is not settled, and the x that it writes.
  void above(int head, const nb::capsule& solve, const Vector& x) {
    if (head < 1 || std::size_t(head) >= rows_.size() || x.shape(0) != std::size_t(n_)) refuse("head: not a level");
    core_.above(head, hqp::call_of(solve), x.data());
    heads_.append(nb::make_tuple(solve, x));
  }
  // run() answers itself where the stages reach their optima and no row of the first levels is violated; the rest as
  // for describe().
  void answers(int constraints) { core_.answers(constraints); }
  hqp::Solved run(const double* v) override {
    const Turn turn(busy_);
    return core_.run(v);
  }
  // Time for run() [s], none for 0.
  void limit(double seconds) override { core_.limit(seconds); }
  // Of the latest run(): whether it settled all levels, whether it answered itself; the level above which it solved
  // exactly, 0 for all; the time since it began [s].
  std::tuple<bool, bool, int, double> latest() const {
    return {core_.settled(), core_.answered(), core_.used(), core_.elapsed()};
  }

  // The latest answer is none of the stages': they were not asked.
  void unasked() { core_.unasked(); }
  // The level above which all are settled, for the next solve; 0 for none known.
  int head() const { return core_.head(); }
  void begin_at(int head) {
    if (head < 0 || std::size_t(head) >= rows_.size()) refuse("head: not a level");
    core_.begin_at(head);
  }

  // What account() reads beside the rows: stages, which solve wrote, the element of each row, and how close to rest an
  // inequality holds that binds in a stage alone.
  void accounts(const Out& stages, const Owners& owner, int elements, double near) {
    const std::size_t rows = total();
    if (owner.shape(0) != rows || elements < 1 || stages.size() != rows_.size() * n_)
      refuse("stages or owner has a wrong shape");
    for (std::size_t i = 0; i < rows; ++i)
      if (owner(i) < 0 || owner(i) >= elements) refuse("a row of no element");
    points_ = stages.data();
    owner_.assign(owner.data(), owner.data() + rows);
    elements_ = elements;
    near_ = near;
    read_ = nb::make_tuple(stages, owner);
  }

  // What holds every level back, of the latest solve, for the slacks of all rows, the answer and the multipliers of
  // the first exact levels, into one vector: numbers (elements, 4), shares (levels, elements + 1), worth (levels).
  void account(const Vector& w, const Vector& x, const std::optional<Vector>& lambda, const Out& out) {
    if (!bound_ || !elements_) refuse("bind() and accounts() come first");
    const std::size_t E = static_cast<std::size_t>(elements_), levels = rows_.size();
    if (w.shape(0) != owner_.size() || x.shape(0) != std::size_t(n_) || out.size() != 4 * E + levels * (E + 2))
      refuse("an array has a wrong shape");
    const Turn turn(busy_);
    double* to = out.data();
    const std::size_t told = lambda ? lambda->shape(0) : 0;
    stages().account(
        {points_, w.data(), owner_.data(), elements_, told ? lambda->data() : nullptr, told, x.data(), near_}, to,
        to + 4 * E, to + 4 * E + levels * (E + 1));
  }

  // slack (rows) and marks (rows) of x, as in Solution; whether a row of the first levels is violated.
  bool describe(const Vector& x, int constraints, const Out& slack,
                const nb::ndarray<std::int8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>& marks) {
    if (!bound_) refuse("bind() comes first");
    if (x.shape(0) != std::size_t(n_) || slack.size() != total() || marks.shape(0) != total())
      refuse("x, slack or marks has a wrong shape");
    return stages().describe(x.data(), constraints, slack.data(), marks.data());
  }

  // Steps of the latest stages, whether all reached their optima, whether directions were uncertain, whether the answer
  // depends on such, and whether that or an end is in doubt.
  std::tuple<int, bool, bool, bool, bool> effort() {
    hqp::PricedStages& latest = core_.stages();
    return {latest.iterations(), latest.ended(), latest.uncertain(), latest.undecided(), latest.doubtful()};
  }
  void reset() { core_.reset(); }
  void turn(const std::vector<bool>& out) { core_.turn(out); }

 private:
  static std::unique_ptr<hqp::PricedStages> made(int n, const std::vector<int>& rows, const std::vector<int>& priced,
                                                 const hqp::Tolerances& tolerances) {
    if (n < 1 || rows.size() != priced.size()) refuse("a level is priced or not");
    std::unique_ptr<bool[]> marks(new bool[priced.size()]);
    for (std::size_t k = 0; k < priced.size(); ++k) marks[k] = priced[k] != 0;
    const int levels = static_cast<int>(rows.size());
    return std::unique_ptr<hqp::PricedStages>(
        HQP_FOR_MACHINE(make_stages, n, levels, rows.data(), marks.get(), tolerances));
  }

  std::size_t total() const { return core_.total(); }
  hqp::PricedStages& stages() { return core_.stages(); }

  int n_;
  std::vector<int> rows_;
  hqp::StagedSolve core_;
  nb::object kept_, read_, chained_;
  nb::list heads_;
  const double* points_ = nullptr;
  std::vector<std::int32_t> owner_;
  int elements_ = 0;
  double near_ = 0.0;
  bool bound_ = false;
  std::atomic<bool> busy_{false};
};

}  // namespace

NB_MODULE(_priced, m) {
  m.doc() = "Native stages of levels with a price.";
  nb::class_<Stages>(m, "Stages")
      .def(nb::init<int, const std::vector<int>&, const std::vector<int>&, double, double, double, double, double,
                    double, double>(),
           "n"_a, "rows"_a, "priced"_a, "met"_a, "flat"_a, "accurate"_a, "resting"_a, "rounded"_a, "activity"_a,
           "violation"_a)
      .def("bind", &Stages::bind, "levels"_a, "prices"_a, "turning"_a.none(), "eta"_a, "F"_a.none(), "f"_a.none(),
           "metric"_a.none(), "origin"_a.none())
      .def("solve", &Stages::solve, "x"_a, "stages"_a, "last"_a, "head"_a = 0, "seconds"_a = 0.0)
      .def("after", &Stages::after, "exact"_a, "x"_a, "stages"_a, "last"_a)
      .def("above", &Stages::above, "head"_a, "solve"_a, "x"_a)
      .def("answers", &Stages::answers, "constraints"_a)
      .def_prop_rw("head", &Stages::head, &Stages::begin_at)
      .def("limit", &Stages::limit, "seconds"_a)
      .def("latest", &Stages::latest)
      .def("unasked", &Stages::unasked)
      .def("accounts", &Stages::accounts, "stages"_a, "owner"_a, "elements"_a, "near"_a)
      .def("account", &Stages::account, "w"_a, "x"_a, "multipliers"_a.none(), "out"_a)
      .def("describe", &Stages::describe, "x"_a, "constraints"_a, "slack"_a, "marks"_a)
      .def("effort", &Stages::effort)
      .def("reset", &Stages::reset)
      .def("turn", &Stages::turn, "out"_a);
}
