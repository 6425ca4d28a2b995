// Python's view of the kernel and the stages: a workspace bound once to the arrays of a hierarchy, solved many times.
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "../common/capsule.hpp"
#include "../common/isa.hpp"
#include "../priced/level_solve.hpp"
#include "../priced/planned.hpp"
#include "../rows/live_plan.hpp"
#include "batch.hpp"
#include "kernel.hpp"
#include "reading.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace hqp {

Kernel* make_kernel(int n, int levels, const int* m, bool metric) {
  return HQP_FOR_MACHINE(make, n, levels, m, metric);
}

}  // namespace hqp

namespace {

[[noreturn]] void refuse(const std::string& text) { throw nb::value_error(text.c_str()); }

using binding::Vector;
using binding::Written;
using WrittenMarks = nb::ndarray<std::int8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Slots = nb::ndarray<const std::int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// Names of the fields that solution() sets.
struct Keys {
  nb::str x{"x"}, status{"status"}, detail{"detail"}, multipliers{"multipliers"}, stage_points{"stage_points"},
      numbers{"_numbers"}, parts{"_parts"}, counts{"_counts"}, copy{"copy"};
};

class Workspace final : public hqp::SolveCall {
 public:
  Workspace(int n, const std::vector<int>& rows, bool metric, const hqp::Options& options,
            const std::vector<char>& priced, const hqp::Tolerances& tolerances)
      : n_(n),
        metric_(metric),
        priced_(checked(priced, rows)),
        core_(checked(n), checked(rows), metric, options, priced, tolerances) {}

  // Keep the arrays among the attributes of a Hierarchy, to read them at every solve; false where its shape is another
  // or an array needs a conversion.
  bool take(const nb::object& hierarchy) {
    const Lock lock(busy_);
    return is_bound(hierarchy) || read(hierarchy);
  }

  // x and slacks; marks; and both in one array, the marks as bytes behind the rest.
  nb::ndarray<nb::numpy, double, nb::ndim<1>> values() {
    return {exact().numbers().data(), {exact().ends()}, nb::find(this)};
  }
  nb::ndarray<nb::numpy, std::int8_t, nb::ndim<1>> active() {
    return {exact().marks(), {std::size_t(exact().total())}, nb::find(this)};
  }
  nb::ndarray<nb::numpy, double, nb::ndim<1>> numbers() {
    return {exact().numbers().data(), {exact().numbers().size()}, nb::find(this)};
  }
  nb::ndarray<nb::numpy, double, nb::ndim<1>> multipliers() {
    return {exact().multipliers().data(), {std::size_t(exact().pairs())}, nb::find(this)};
  }
  // Results of the latest stages: their points (levels, n), and the answer.
  nb::ndarray<nb::numpy, double, nb::ndim<2>> points() {
    return {core_.points().data(), {priced_.size(), std::size_t(n_)}, nb::find(this)};
  }
  nb::ndarray<nb::numpy, double, nb::ndim<1>> end() {
    return {core_.end().data(), {core_.end().size()}, nb::find(this)};
  }

  // Outcome, iterations, factorisations, judged; the numbers are in values() and active(), or those of the stages.
  nb::tuple solve() {
    const Lock lock(busy_);
    require_bound();
    hqp::Solved found;
    {
      const nb::gil_scoped_release release;
      found = core_.solve();
    }
    return counts(found);
  }
  hqp::Solved run(const double* v) override {
    const Lock lock(busy_);
    require_bound();
    return core_.run(v);
  }
  // Seconds for the next solves, none if zero; limits the exact kernel, and all else.
  void limit(double seconds) override { core_.limit(seconds); }
  void limit_exact(double seconds) { exact().limit(seconds); }
  void limit_stages(double seconds) { core_.limit_stages(seconds); }
  // Return the capsule for another native module.
  nb::capsule call() { return hqp::capsule_of(this); }
  nb::capsule core() { return hqp::capsule_of_part(&core_, "hqp.level_solve"); }

  // Set the arguments of solution(): the class, the statuses by outcome, and the slices of each level.
  void report_as(const nb::object& solution, const nb::tuple& statuses, const nb::tuple& slack, const nb::tuple& active,
                 const nb::tuple& multipliers, const nb::str& stopped, const nb::str& unsure) {
    if (!PyType_Check(solution.ptr()) || statuses.size() != static_cast<std::size_t>(hqp::Outcome::invalid))
      refuse("report_as takes a class and one status an outcome");
    solution_ = solution;
    statuses_ = statuses;
    stopped_ = stopped;
    unsure_ = unsure;
    parts_ = nb::make_tuple(slack, active);
    pairs_of_levels_ = multipliers;
    leading_ = nb::steal(PySlice_New(nullptr, nb::int_(n_).ptr(), nullptr));
  }

  // Bind new arrays, solve, and build the Solution from copies of the views given, all in one locked call; None if the
  // arrays need a conversion or the numbers are not usable. The fields are set past the frozen class's own initialiser,
  // which would cost as much as the factorisation; slacks, marks and counts are cut out of the copy on first access.
  nb::object solution(const nb::object& hierarchy, double build_seconds, const nb::object& all_numbers,
                      const nb::object& all_multipliers) {
    if (!solution_.is_valid()) refuse("call report_as first");
    const Lock lock(busy_);
    auto begin = std::chrono::steady_clock::now();
    if (!is_bound(hierarchy)) {
      if (!read(hierarchy)) return nb::none();
      const auto end = std::chrono::steady_clock::now();
      build_seconds += std::chrono::duration<double>(end - begin).count();
      begin = end;
    }
    const hqp::Answer answer = unlocked();
    if (answer.outcome == hqp::Outcome::invalid) return nb::none();
    const nb::object numbers = copy(all_numbers);
    const nb::object made = fresh(solution_);
    set(made, key_.x, nb::object(numbers[leading_]));
    set(made, key_.status, nb::object(statuses_[static_cast<std::size_t>(answer.outcome)]));
    set(made, key_.numbers, numbers);
    set(made, key_.parts, parts_);
    set(made, key_.detail, answer.outcome == hqp::Outcome::not_certified ? stopped_ : answer.unsure ? unsure_ : empty_);
    set(made, key_.multipliers,
        exact().options.multipliers ? split(copy(all_multipliers), pairs_of_levels_) : nb::object(nb::none()));
    set(made, key_.stage_points, nb::none());
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - begin;
    set(made, key_.counts, nb::make_tuple(answer.iterations, answer.factorisations, build_seconds, taken.count()));
    return made;
  }

  // Bind the hierarchy, and its prices if it has some.
  bool price(const nb::object& hierarchy) {
    const Lock lock(busy_);
    hqp::Law law;
    if (!read(hierarchy) || !reader_.read_law(hierarchy, n_, priced_, exact().prices, law)) return false;
    exact().prices = nullptr;
    priced_by_ = hierarchy;
    core_.bind(law);
    return true;
  }
  // The parts of solve() where stages go on from an exact answer that Python has judged, see LevelSolve.
  nb::object begin() {
    const Lock lock(busy_);
    hqp::Solved found;
    {
      const nb::gil_scoped_release release;
      if (!core_.begin(found)) found.outcome = hqp::kAskPython;
    }
    return found.outcome == hqp::kAskPython ? nb::none() : nb::object(counts(found));
  }
  bool follow(const Vector& x) {
    const Lock lock(busy_);
    const double* from = sized(x, n_);
    const nb::gil_scoped_release release;
    return core_.follow_from(from) >= 0;
  }
  bool unpriced_met(const Vector& x) { return stages().unpriced_met(sized(x, n_)); }
  int prefix() const { return core_.prefix(); }
  double elapsed() const { return core_.elapsed(); }
  void without_multipliers() { core_.without_multipliers(); }

  // Steps of the latest stages, whether all reached their optima, whether directions were uncertain, whether the answer
  // depends on such, and whether that or an end is in doubt.
  nb::tuple effort() {
    hqp::PricedStages& latest = stages();
    return nb::make_tuple(latest.iterations(), latest.ended(), latest.uncertain(), latest.undecided(),
                          latest.doubtful());
  }
  // slack (rows) and marks (rows) of x, as in Solution; return true if a constraint is violated.
  bool describe(const Vector& x, const Written& slack, const WrittenMarks& marks) {
    const std::size_t total = std::size_t(exact().total());
    stages();
    return core_.describe(sized(x, n_), sized(slack, total), sized(marks, total));
  }

  // Multipliers of the latest answer, live: rows above each level, then its own; empty for stages without exact
  // multipliers, None if they are not available.
  nb::object exact_multipliers() {
    const Lock lock(busy_);
    hqp::BoundKernel* const teller = bound_ ? core_.teller() : nullptr;
    if (!teller && !core_.staged()) return nb::none();
    const std::size_t count = teller ? std::size_t(teller->pairs()) : 0;
    double* const numbers = (teller ? teller : &exact())->multipliers().data();
    return nb::cast(nb::ndarray<nb::numpy, double, nb::ndim<1>>(numbers, {count}, nb::find(this)));
  }
  // Set the inputs of account() beside the rows: the element of each, and how close to rest an inequality holds that
  // binds in a stage alone.  False where the rows have to be converted.
  bool accounts(const nb::object& hierarchy, const Slots& owner, int elements, double near) {
    const Lock lock(busy_);
    sized(owner, std::size_t(exact().total()));
    for (std::size_t i = 0; i < owner.size(); ++i)
      if (owner(i) < 0 || owner(i) >= elements) refuse("a row belongs to no element");
    if (!core_.bound()) {
      if (!is_bound(hierarchy) && !read(hierarchy)) return false;
      core_.bind({});
    }
    owner_.assign(owner.data(), owner.data() + owner.size());
    elements_ = elements;
    near_ = near;
    return true;
  }
  // Write the shares of every level, of the latest solve, for the slacks of all rows, the solution and the multipliers
  // of the first exact levels, into one vector: numbers (elements, 4), shares (levels, elements + 1), worth (levels).
  void account(const Vector& w, const Vector& x, const Vector& multipliers, const Written& out) {
    const Lock lock(busy_);
    if (elements_ < 0) refuse("accounts() comes first");
    const std::size_t E = static_cast<std::size_t>(elements_), levels = priced_.size();
    double* const to = sized(out, 4 * E + levels * (E + 2));
    stages().account({core_.points().data(), sized(w, owner_.size()), owner_.data(), elements_,
                      multipliers.size() ? multipliers.data() : nullptr, multipliers.size(), sized(x, n_), near_},
                     to, to + 4 * E, to + 4 * E + levels * (E + 1));
  }

  void reset(bool plain) {
    const Lock lock(busy_);
    plain ? exact().reset(true) : core_.reset();
  }
  void turn(const std::vector<bool>& out) {
    const Lock lock(busy_);
    core_.turn(out);
  }

  int traverse(visitproc visit, void* arg) {
    Py_VISIT(kept_.ptr());
    Py_VISIT(priced_by_.ptr());
    Py_VISIT(solution_.ptr());
    Py_VISIT(statuses_.ptr());
    return 0;
  }
  void clear() {
    kept_.reset();
    priced_by_.reset();
    solution_.reset();
    statuses_.reset();
    bound_ = nullptr;
  }

 private:
  hqp::Answer unlocked() {
    require_bound();
    const nb::gil_scoped_release release;
    return core_.solve_exact();
  }
  static nb::tuple counts(const hqp::Solved& found) {
    return nb::make_tuple(found.outcome, found.iterations, found.factorisations, found.judged);
  }
  template <class Array>
  static auto sized(const Array& a, std::size_t size) -> decltype(a.data()) {
    if (a.size() != size) refuse("an array has a wrong shape");
    return a.data();
  }
  hqp::BoundKernel& exact() { return core_.exact(); }

  hqp::PricedStages& stages() {
    if (!core_.bound()) refuse("price a problem first");
    return core_.stages();
  }

  void require_bound() const {
    if (!bound_) refuse("take a problem first");
  }

  static int checked(int n) {
    if (n < 1 || n > hqp::kLargest)
      refuse("n must lie in 1.." + std::to_string(hqp::kLargest) + ", given " + std::to_string(n));
    return n;
  }
  static const std::vector<int>& checked(const std::vector<int>& rows) {
    for (const int m : rows)
      if (m < 0 || m > hqp::kLargest) refuse("rows of a level must lie in 0.." + std::to_string(hqp::kLargest));
    return rows;
  }

  static const std::vector<char>& checked(const std::vector<char>& priced, const std::vector<int>& rows) {
    if (priced.size() != rows.size()) refuse("a level is priced or not");
    return priced;
  }

  bool is_bound(const nb::object& what) const { return what.ptr() == bound_; }

  bool read(const nb::object& hierarchy) {
    bound_ = nullptr;
    hqp::Problem problem;
    if (!reader_.read(hierarchy, n_, exact().rows(), metric_, exact().levels.data(), problem, exact().prices))
      return false;
    exact().problem = problem;
    kept_ = hierarchy;
    bound_ = hierarchy.ptr();
    return true;
  }

  nb::object fresh(const nb::object& type) const {
    static const auto make = reinterpret_cast<newfunc>(PyType_GetSlot(&PyBaseObject_Type, Py_tp_new));
    PyObject* made = make(reinterpret_cast<PyTypeObject*>(type.ptr()), none_.ptr(), nullptr);
    if (!made) nb::raise_python_error();
    return nb::steal(made);
  }

  static void set(const nb::object& made, const nb::str& name, const nb::object& value) {
    if (PyObject_GenericSetAttr(made.ptr(), name.ptr(), value.ptr())) nb::raise_python_error();
  }

  nb::object copy(const nb::object& array) const {
    PyObject* made = PyObject_CallMethodObjArgs(array.ptr(), key_.copy.ptr(), nullptr);
    if (!made) nb::raise_python_error();
    return nb::steal(made);
  }

  static nb::object split(const nb::object& values, const nb::tuple& parts) {
    const std::size_t count = parts.size();
    const nb::object all = nb::steal(PyTuple_New(static_cast<Py_ssize_t>(count)));
    for (std::size_t k = 0; k < count; ++k) {
      PyObject* piece = PyObject_GetItem(values.ptr(), nb::object(parts[k]).ptr());
      if (!piece) nb::raise_python_error();
      PyTuple_SetItem(all.ptr(), static_cast<Py_ssize_t>(k), piece);
    }
    return all;
  }

  struct Lock {
    explicit Lock(std::atomic<bool>& flag) : flag(flag) {
      if (flag.exchange(true))
        throw std::runtime_error("another thread is solving with this workspace: use one workspace per thread");
    }
    ~Lock() { flag.store(false); }
    std::atomic<bool>& flag;
  };

  int n_;
  bool metric_;
  std::vector<char> priced_;
  hqp::LevelSolve core_;
  hqp::Reader reader_;
  nb::object kept_, priced_by_, solution_, leading_;
  const PyObject* bound_ = nullptr;  // the bound hierarchy, alive in `kept_`; null if nothing is
  nb::tuple statuses_, parts_, pairs_of_levels_, none_;
  nb::str stopped_{""}, unsure_{""}, empty_{""};
  std::vector<std::int32_t> owner_;  // one per row
  int elements_ = -1;
  double near_ = 0.0;
  Keys key_;
  std::atomic<bool> busy_{false};
};

int traverse(PyObject* self, visitproc visit, void* arg) {
#if PY_VERSION_HEX >= 0x03090000
  Py_VISIT(Py_TYPE(self));
#endif
  if (!nb::inst_ready(self)) return 0;
  return nb::inst_ptr<Workspace>(self)->traverse(visit, arg);
}

int clear(PyObject* self) {
  if (nb::inst_ready(self)) nb::inst_ptr<Workspace>(self)->clear();
  return 0;
}

PyType_Slot slots[] = {
    {Py_tp_traverse, reinterpret_cast<void*>(traverse)}, {Py_tp_clear, reinterpret_cast<void*>(clear)}, {0, nullptr}};

}  // namespace

NB_MODULE(_lexicographic, m) {
  m.doc() = "Native kernel of the lexicographic solver.";
  nb::set_leak_warnings(std::getenv("HQP_LEAK_WARNINGS") != nullptr);  // a script may end anyhow
  m.attr("instruction_set") = hqp::has_avx2() ? "avx2" : "generic";
  nb::class_<Workspace>(m, "Workspace", nb::type_slots(slots))
      .def(
          "__init__",
          [](Workspace* self, int n, const std::vector<int>& rows, bool metric, const nb::dict& options,
             bool multipliers, const std::vector<bool>& priced, const nb::dict& tolerances) {
            std::vector<nb::object> kept;
            hqp::Options given = hqp::options_of(binding::LivePlan(options, kept));
            given.multipliers = multipliers;
            new (self) Workspace(n, rows, metric, given, {priced.begin(), priced.end()},
                                 hqp::tolerances_of(binding::LivePlan(tolerances, kept)));
          },
          "n"_a, "rows"_a, "metric"_a, "options"_a, "multipliers"_a, "priced"_a, "tolerances"_a)
      .def("take", &Workspace::take, "hierarchy"_a)
      .def("solve", &Workspace::solve)
      .def("call", &Workspace::call)
      .def("core", &Workspace::core)
      .def("limit", &Workspace::limit_exact, "seconds"_a)
      .def("limit_stages", &Workspace::limit_stages, "seconds"_a)
      .def("price", &Workspace::price, "hierarchy"_a)
      .def("begin", &Workspace::begin)
      .def("follow", &Workspace::follow, "x"_a)
      .def("unpriced_met", &Workspace::unpriced_met, "x"_a)
      .def_prop_ro("prefix", &Workspace::prefix)
      .def("elapsed", &Workspace::elapsed)
      .def("without_multipliers", &Workspace::without_multipliers)
      .def("effort", &Workspace::effort)
      .def("describe", &Workspace::describe, "x"_a, "slack"_a, "marks"_a)
      .def("accounts", &Workspace::accounts, "hierarchy"_a, "owner"_a, "elements"_a, "near"_a)
      .def("account", &Workspace::account, "w"_a, "x"_a, "multipliers"_a, "out"_a)
      .def("points", &Workspace::points)
      .def("end", &Workspace::end)
      .def("report_as", &Workspace::report_as, "solution"_a, "statuses"_a, "slack"_a, "active"_a, "multipliers"_a,
           "stopped"_a, "unsure"_a)
      .def("solution", &Workspace::solution, "hierarchy"_a.none(), "build_seconds"_a, "numbers"_a, "multipliers"_a)
      .def("exact_multipliers", &Workspace::exact_multipliers)
      .def("reset", &Workspace::reset, "plain"_a = false)
      .def("turn", &Workspace::turn, "out"_a)
      .def("values", &Workspace::values)
      .def("numbers", &Workspace::numbers)
      .def("active", &Workspace::active)
      .def("multipliers", &Workspace::multipliers);
  hqp::bind_batch(m);
}
