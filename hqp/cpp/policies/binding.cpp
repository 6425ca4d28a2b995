// Python's view of the filter behind a policy.
#include "binding.hpp"

#include <algorithm>
#include <cstdint>
#include <vector>

#include "../rows/live_plan.hpp"
#include "filter.hpp"

namespace binding {

using namespace nb::literals;

namespace {

class LiveFilter {
 public:
  explicit LiveFilter(const nb::object& tree)
      : filter_(LivePlan(tree, kept_)), model_(LivePlan(tree, kept_).part("model")) {}
  LiveFilter(const LiveFilter&) = delete;

  void begin(const Vector& command, const Vector& q, const Vector& v) {
    if (command.size() != filter_.motors() || q.size() != filter_.nq() || v.size() != filter_.nv())
      throw nb::value_error("command, q or v: wrong shape");
    filter_.begin(model_, command.data(), q.data(), v.data());
  }
  // True if a joint is limited.
  bool end(const Vector& x, bool solved, const Written& command) {
    if (x.size() != filter_.motors() || command.size() != filter_.motors())
      throw nb::value_error("x or command: wrong shape");
    filter_.end(x.data(), solved, command.data());
    const std::vector<std::uint8_t>& limited = filter_.limited();
    return std::find(limited.begin(), limited.end(), 1) != limited.end();
  }
  hqp::Filter& get() { return filter_; }

 private:
  std::vector<nb::object> kept_;  // declared before the pointers into it
  hqp::Filter filter_;
  hqp::InverseDynamics model_;
};

template <class T>
auto view(LiveFilter& owner, const std::vector<T>& numbers) {
  return nb::ndarray<nb::numpy, const T, nb::ndim<1>>(numbers.data(), {numbers.size()}, nb::find(owner));
}

}  // namespace

void bind_policies(nb::module_& module) {
  nb::class_<LiveFilter>(module, "Filter")
      .def(nb::init<const nb::object&>(), "tree"_a)
      .def("begin", &LiveFilter::begin, "command"_a, "q"_a, "v"_a)
      .def("end", &LiveFilter::end, "x"_a, "solved"_a, "command"_a.noconvert())
      .def("reset", [](LiveFilter& f) { f.get().reset(); })
      .def_prop_ro("free", [](LiveFilter& f) { return view(f, f.get().free()); })
      .def_prop_ro("lacking", [](LiveFilter& f) { return view(f, f.get().lacking()); })
      .def_prop_ro("middle", [](LiveFilter& f) { return view(f, f.get().middle()); })
      .def_prop_ro("limited", [](LiveFilter& f) { return view(f, f.get().limited()); });
}

}  // namespace binding
