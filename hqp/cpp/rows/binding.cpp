// Python's view of the row operations, and of descents on them.
#include <cstdlib>

#include "descents.hpp"
#include "live_assembly.hpp"
#include "snapshots.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using namespace binding;

// (q'q + v'v, whether quaternions and (cos, sin) pairs in q have length one up to rounding), None for other shapes.
class Measure {
 public:
  Measure(std::vector<std::tuple<int, int>> units, double rounding, int nq, int nv)
      : units_(std::move(units)), rounding_(rounding), nq_(nq), nv_(nv) {}
  std::optional<std::tuple<double, bool>> operator()(nb::handle position, nb::handle velocity) const {
    const hqp::Doubles q(position, true), v(velocity, true);
    if (!q.data() || !v.data() || !q.has(&nq_, 1) || !v.has(&nv_, 1)) return {};
    bool unit = true;
    for (const auto& [start, stop] : units_)
      unit = unit && std::fabs(hqp::squared(q.data() + start, stop - start) - 1.0) < rounding_;
    return std::tuple(hqp::squared(q.data(), nq_) + hqp::squared(v.data(), nv_), unit);
  }

 private:
  std::vector<std::tuple<int, int>> units_;
  double rounding_;
  int nq_, nv_;
};

}  // namespace

NB_MODULE(_assembly, module) {
  module.doc() = "Rows of the common tasks, written by one call a tick.";
  nb::set_leak_warnings(std::getenv("HQP_LEAK_WARNINGS") != nullptr);  // a script may end anyhow
  nb::class_<Measure>(module, "Measure")
      .def(nb::init<std::vector<std::tuple<int, int>>, double, int, int>(), "units"_a, "rounding"_a, "nq"_a, "nv"_a)
      .def("__call__", &Measure::operator(), "q"_a, "v"_a);
  module.def(
      "is_rotation",
      [](nb::handle R, double tolerance) {
        const hqp::Doubles a(R);
        const int shape[] = {3, 3};
        return a.data() && a.has(shape, 2) && hqp::rotation(a.data(), 3, tolerance);
      },
      "R"_a, "tolerance"_a);
  module.def(
      "is_pose",
      [](nb::handle T, double tolerance) {
        const hqp::Doubles a(T);
        const int shape[] = {4, 4};
        return a.data() && a.has(shape, 2) && hqp::pose(a.data(), tolerance);
      },
      "T"_a, "tolerance"_a);
  nb::class_<Assembly>(module, "Assembly")
      .def(nb::init<const Columns&, const nb::object&, int, double, int, const nb::object&>(), "twists"_a.noconvert(),
           "bodies"_a, "nq"_a, "dt"_a, "order"_a, "reference"_a)
      .def("add", &Assembly::add, "operation"_a)
      .def("laws", &Assembly::laws, "laws"_a)
      .def("law", &Assembly::law, "start"_a, "stop"_a, "law"_a)
      .def("aim", &Assembly::aim, "start"_a, "stop"_a, "number"_a, "at_once"_a)
      .def("go_on", &Assembly::go_on)
      .def("out", &Assembly::out, "name"_a, "start"_a, "stop"_a, "out"_a)
      .def("slot", &Assembly::slot, "slot"_a)
      .def("dynamics", &Assembly::dynamics, "terms"_a)
      .def("load", &Assembly::load, "load"_a)
      .def("answers", &Assembly::answers, "call"_a, "values"_a.noconvert(), "largest"_a)
      .def("move", &Assembly::move, "robot"_a)
      .def("written", &Assembly::written, "rows"_a, "bounds"_a)
      .def("run", &Assembly::run, "q"_a, "v"_a, "measured"_a)
      .def("demand", &Assembly::demand, "v"_a)
      .def("limit", &Assembly::limit, "v"_a, "reactions"_a)
      .def("core", &Assembly::core);
  nb::class_<Snapshots>(module, "Snapshots")
      .def(nb::init<const std::vector<std::tuple<Snapshots::Bytes, std::size_t>>&, const Snapshots::Ring&,
                    std::size_t>(),
           "parts"_a, "ring"_a, "size"_a)
      .def("take", &Snapshots::take, "i"_a);
  nb::class_<hqp::Pace>(module, "Pace")
      .def(nb::init<double, double, double, double, double, std::optional<int>, int>(), "step"_a, "least"_a,
           "progress"_a, "polish"_a, "still"_a, "stalled"_a.none(), "last"_a);
  nb::class_<LiveKinematics>(module, "Kinematics")
      .def(nb::init<const WrittenColumns&, const nb::object&, const nb::object&>(), "twists"_a.noconvert(), "joints"_a,
           "frames"_a)
      .def_prop_ro("size", [](LiveKinematics& k) { return k.get().size(); })
      .def("core", &LiveKinematics::core)
      .def("update", &LiveKinematics::update, "q"_a)
      .def("integrate", &LiveKinematics::integrate, "q"_a, "x"_a, "h"_a, "out"_a.noconvert());
  nb::class_<Descents>(module, "Descents")
      .def(nb::init<Assembly&, LiveKinematics&, const Members&, int, int, const hqp::Pace&>(), "assembly"_a, "robot"_a,
           "members"_a, "groups"_a, "nq"_a, "pace"_a, nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>())
      .def("aim", &Descents::aim, "references"_a)
      .def("run", &Descents::run, "q"_a.noconvert(), "merit"_a.noconvert(), "errors"_a.noconvert(), "tolerance"_a,
           "most"_a, "seconds"_a);
}
