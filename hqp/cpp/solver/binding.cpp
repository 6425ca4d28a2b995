// Python's view of the kernel: a workspace bound once to the arrays of a hierarchy, solved many times.
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/vector.h>

#include "../common/capsule.hpp"
#include "../common/isa.hpp"
#include "batch.hpp"
#include "bound_kernel.hpp"
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

// Names of the fields that solution() sets.
struct Keys {
  nb::str x{"x"}, status{"status"}, detail{"detail"}, multipliers{"multipliers"}, stage_points{"stage_points"},
      numbers{"_numbers"}, parts{"_parts"}, counts{"_counts"}, copy{"copy"};
};

class Workspace final : public hqp::SolveCall {
 public:
  // Seconds for the next solves, none if zero.
  void limit(double seconds) override { kernel_.limit(seconds); }

  Workspace(int n, const std::vector<int>& rows, bool metric, const hqp::Options& options)
      : n_(n), metric_(metric), kernel_(checked(n), checked(rows), metric, options) {}

  // Keep the arrays among the attributes of a Hierarchy, to read them at every solve; false where its shape is another
  // or an array needs a conversion.
  bool take(const nb::object& hierarchy) {
    const Lock lock(busy_);
    return is_bound(hierarchy) || read(hierarchy);
  }

  // x and slacks; marks; and both in one array, the marks as bytes behind the rest.
  nb::ndarray<nb::numpy, double, nb::ndim<1>> values() {
    return {kernel_.numbers().data(), {kernel_.ends()}, nb::find(this)};
  }
  nb::ndarray<nb::numpy, std::int8_t, nb::ndim<1>> active() {
    return {kernel_.marks(), {std::size_t(kernel_.total())}, nb::find(this)};
  }
  nb::ndarray<nb::numpy, double, nb::ndim<1>> numbers() {
    return {kernel_.numbers().data(), {kernel_.numbers().size()}, nb::find(this)};
  }
  nb::ndarray<nb::numpy, double, nb::ndim<1>> multipliers() {
    return {kernel_.multipliers().data(), {std::size_t(kernel_.pairs())}, nb::find(this)};
  }

  // Outcome, iterations, factorisations, judged; the numbers are in values(), active() and multipliers().
  nb::tuple solve() {
    const Lock lock(busy_);
    const hqp::Answer answer = unlocked();
    return nb::make_tuple(static_cast<int>(answer.outcome), answer.iterations, answer.factorisations, answer.judged);
  }
  hqp::Solved run(const double*) override {
    const Lock lock(busy_);
    require_bound();
    return kernel_.run(nullptr);
  }
  // The same for another native module.
  nb::capsule call() { return hqp::capsule_of(this); }

  // What solution() builds: the class, the statuses by outcome, and the slices of each level.
  void report_as(const nb::object& solution, const nb::tuple& statuses, const nb::tuple& slack, const nb::tuple& active,
                 const nb::tuple& multipliers, const nb::str& stopped, const nb::str& unsure) {
    if (!PyType_Check(solution.ptr()) || statuses.size() != kOutcomes)
      refuse("report_as takes a class and one status an outcome");
    solution_ = solution;
    statuses_ = statuses;
    stopped_ = stopped;
    unsure_ = unsure;
    parts_ = nb::make_tuple(slack, active);
    pairs_of_levels_ = multipliers;
    head_ = nb::steal(PySlice_New(nullptr, nb::int_(n_).ptr(), nullptr));
  }

  // Bind what is not bound yet, solve, and build the Solution from copies of the views given, all in one locked call;
  // None if the arrays need a conversion or the numbers are not usable. The fields are set past the frozen class's own
  // initialiser, which would cost as much as the factorisation; slacks, marks and counts are cut out of the copy when
  // they are asked for.
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
    set(made, key_.x, nb::object(numbers[head_]));
    set(made, key_.status, nb::object(statuses_[static_cast<std::size_t>(answer.outcome)]));
    set(made, key_.numbers, numbers);
    set(made, key_.parts, parts_);
    set(made, key_.detail, answer.outcome == hqp::Outcome::not_certified ? stopped_ : answer.unsure ? unsure_ : empty_);
    set(made, key_.multipliers,
        kernel_.options.multipliers ? split(copy(all_multipliers), pairs_of_levels_) : nb::object(nb::none()));
    set(made, key_.stage_points, nb::none());
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - begin;
    set(made, key_.counts, nb::make_tuple(answer.iterations, answer.factorisations, build_seconds, taken.count()));
    return made;
  }

  // Multipliers of the latest answer into multipliers(), false where they are not at hand.
  bool tell() {
    const Lock lock(busy_);
    return bound_ && kernel_.tell();
  }

  void reset(bool plain) {
    const Lock lock(busy_);
    kernel_.reset(plain);
  }
  void turn(const std::vector<bool>& out) {
    const Lock lock(busy_);
    kernel_.turn(out);
  }

  int traverse(visitproc visit, void* arg) {
    Py_VISIT(kept_.ptr());
    Py_VISIT(solution_.ptr());
    Py_VISIT(statuses_.ptr());
    return 0;
  }
  void clear() {
    kept_.reset();
    solution_.reset();
    statuses_.reset();
    bound_ = nullptr;
  }

 private:
  static constexpr int kMost = 10000;
  static constexpr std::size_t kOutcomes = 6;

  hqp::Answer unlocked() {
    require_bound();
    const nb::gil_scoped_release release;
    return kernel_.solve();
  }

  void require_bound() const {
    if (!bound_) refuse("take a problem first");
  }

  static int checked(int n) {
    if (n < 1 || n > kMost) refuse("n must lie in 1.." + std::to_string(kMost) + ", given " + std::to_string(n));
    return n;
  }
  static const std::vector<int>& checked(const std::vector<int>& rows) {
    for (const int m : rows)
      if (m < 0 || m > kMost) refuse("rows of a level must lie in 0.." + std::to_string(kMost));
    return rows;
  }

  bool is_bound(const nb::object& what) const { return what.ptr() == bound_; }

  bool read(const nb::object& hierarchy) {
    bound_ = nullptr;
    hqp::Problem problem;
    if (!reader_.read(hierarchy, n_, kernel_.rows(), metric_, kernel_.levels.data(), problem, kernel_.prices))
      return false;
    kernel_.problem = problem;
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
        throw std::runtime_error("this workspace is solving in another thread; give each thread its own");
    }
    ~Lock() { flag.store(false); }
    std::atomic<bool>& flag;
  };

  int n_;
  bool metric_;
  hqp::BoundKernel kernel_;
  hqp::Reader reader_;
  nb::object kept_, solution_, head_;
  const PyObject* bound_ = nullptr;  // what was bound, alive in `kept_`; null if nothing is
  nb::tuple statuses_, parts_, pairs_of_levels_, none_;
  nb::str stopped_{""}, unsure_{""}, empty_{""};
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
          [](Workspace* self, int n, const nb::list& rows, bool metric, double rank, double multiplier,
             double feasibility, double time_limit, int max_iterations, int exchanges, bool multipliers) {
            std::vector<int> sizes;
            for (nb::handle h : rows) sizes.push_back(nb::cast<int>(h));
            new (self) Workspace(n, sizes, metric,
                                 {rank, multiplier, feasibility, time_limit, max_iterations, exchanges, multipliers});
          },
          "n"_a, "rows"_a, "metric"_a, "rank_tolerance"_a, "multiplier_tolerance"_a, "feasibility_tolerance"_a,
          "time_limit"_a, "max_iterations"_a, "exchanges"_a, "multipliers"_a)
      .def("take", &Workspace::take, "hierarchy"_a)
      .def("solve", &Workspace::solve)
      .def("call", &Workspace::call)
      .def("limit", &Workspace::limit, "seconds"_a)
      .def("report_as", &Workspace::report_as, "solution"_a, "statuses"_a, "slack"_a, "active"_a, "multipliers"_a,
           "stopped"_a, "unsure"_a)
      .def("solution", &Workspace::solution, "hierarchy"_a.none(), "build_seconds"_a, "numbers"_a, "multipliers"_a)
      .def("tell", &Workspace::tell)
      .def("reset", &Workspace::reset, "plain"_a = false)
      .def("turn", &Workspace::turn, "out"_a)
      .def("values", &Workspace::values)
      .def("numbers", &Workspace::numbers)
      .def("active", &Workspace::active)
      .def("multipliers", &Workspace::multipliers);
  hqp::bind_batch(m);
}
