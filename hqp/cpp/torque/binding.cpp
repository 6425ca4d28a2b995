// Python interface of the steps between rows on the acceleration and the solver at torque level.
#include <cstdlib>
#include <optional>
#include <vector>

#include "../common/capsule.hpp"
#include "../rows/live_plan.hpp"
#include "parts.hpp"

#include <nanobind/stl/optional.h>

namespace {

using namespace binding;
using namespace nb::literals;

// Over the live arrays of a plan, which it keeps alive.
class Parts {
 public:
  explicit Parts(const nb::object& plan) : core_(LivePlan(plan, kept_)) {}
  Parts(const Parts&) = delete;

  int eliminate() { return core_.eliminate(); }
  void write(const Vector& v, const std::optional<Vector>& c) { core_.write(of_all(v), c ? of_all(*c) : nullptr); }
  void force(const std::optional<Vector>& shift) { core_.force(shift ? sized(*shift, core_.motors()) : nullptr); }
  bool hold(const Block& J, const Vector& g, const Written& tau) {
    sized(J, core_.out().size() * core_.coordinates()), sized(tau, core_.motors());
    return core_.hold(J.data(), of_all(g), tau.data());
  }
  nb::ndarray<nb::numpy, std::int8_t, nb::ndim<1>> out() {
    return {core_.out().data(), {core_.out().size()}, nb::find(this)};
  }
  nb::capsule core() { return hqp::capsule_of_part(&core_, "hqp.torque_parts"); }
  nb::capsule reactions() { return hqp::capsule_of(&core_.reactions()); }

 private:
  template <class Array>
  static auto sized(const Array& a, std::size_t size) -> decltype(a.data()) {
    if (a.size() != size) throw nb::value_error("an array has a wrong shape");
    return a.data();
  }
  const double* of_all(const Vector& a) const { return sized(a, core_.coordinates()); }

  std::vector<nb::object> kept_;  // declared before the pointers into it
  hqp::TorqueParts core_;
};

}  // namespace

NB_MODULE(_torque, module) {
  module.doc() = "The constraint forces eliminated, and gravity compensation.";
  nb::set_leak_warnings(std::getenv("HQP_LEAK_WARNINGS") != nullptr);  // a script may end anyhow
  nb::class_<Parts>(module, "Parts")
      .def(nb::init<const nb::object&>(), "plan"_a)
      .def("eliminate", &Parts::eliminate)
      .def("write", &Parts::write, "v"_a, "c"_a.none())
      .def("force", &Parts::force, "shift"_a.none())
      .def("hold", &Parts::hold, "J"_a.noconvert(), "g"_a.noconvert(), "tau"_a.noconvert())
      .def_prop_ro("out", &Parts::out)
      .def("core", &Parts::core)
      .def("reactions", &Parts::reactions);
}
