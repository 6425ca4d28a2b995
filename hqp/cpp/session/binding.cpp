// Python's view of a session from a file: numbers in, numbers out.
#include <cstdlib>
#include <string>
#include <tuple>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "plan_file.hpp"
#include "session.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Out = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Told = std::tuple<std::string, int, std::string>;  // element, status, text

class Session {
 public:
  explicit Session(const nb::bytes& file)
      : session_(std::make_shared<const hqp::Plan>(std::string(file.c_str(), file.size()))) {
    for (const std::string& name : session_.names()) references_.push_back(session_.reference(name));
  }

  // command, x, residuals: written; the status, for how many ticks the command has been coming to rest, the notes.
  std::tuple<int, long, std::vector<Told>> step(const Vector& q, const Vector& v, const Out& command, const Out& x,
                                                const Out& residuals) {
    require(q.size() == std::size_t(session_.nq()) && v.size() == std::size_t(session_.nv()), "q or v");
    const hqp::Tick& tick = session_.tick();
    require(command.size() == tick.command().size() && x.size() == tick.x().size() &&
                residuals.size() == tick.residuals().size(),
            "command, x or residuals");
    {
      const nb::gil_scoped_release release;
      session_.step(q.data(), v.data());
    }
    std::copy(tick.command().begin(), tick.command().end(), command.data());
    std::copy(tick.x().begin(), tick.x().end(), x.data());
    std::copy(tick.residuals().begin(), tick.residuals().end(), residuals.data());
    std::vector<Told> notes;
    for (const hqp::Note& note : tick.notes())
      notes.emplace_back(note.element, static_cast<int>(note.status), note.text());
    return {static_cast<int>(tick.status()), static_cast<long>(tick.held()), std::move(notes)};
  }
  std::tuple<std::size_t, std::size_t, std::size_t> sizes() const {
    const hqp::Tick& tick = session_.tick();
    return {tick.command().size(), tick.x().size(), tick.residuals().size()};
  }
  std::vector<std::string> names() const { return session_.names(); }

  // what: 0 value, 1 velocity, 2 acceleration, 3 normal, 4 load, 5 hold value.
  void tell(std::size_t k, int what, const Vector& values) {
    require(k < references_.size() && what >= 0 && what <= 5, "reference");
    hqp::Reference& reference = references_[k];
    if (what == 0) reference.at(values.data(), values.size());
    if (what == 1) reference.velocity(values.data(), values.size());
    if (what == 2) reference.acceleration(values.data(), values.size());
    if (what == 3) require(values.size() == 3, "normal"), reference.normal(values.data());
    if (what == 4) require(values.size() == 1, "load"), reference.load(values(0));
    if (what == 5) reference.hold(values.data(), values.size());
  }
  std::vector<double> held(std::size_t k) const {
    require(k < references_.size(), "reference");
    return references_[k].held();
  }
  void integrate(const Vector& q, const Vector& v, double dt, const Out& out) const {
    const std::size_t nq = std::size_t(session_.nq());
    require(q.size() == nq && out.size() == nq && v.size() == std::size_t(session_.nv()), "q or v");
    session_.integrate(q.data(), v.data(), dt, out.data());
  }
  const hqp::Session& get() const { return session_; }
  void reset() { session_.reset(); }

 private:
  static void require(bool fits, const char* what) {
    if (!fits) throw nb::value_error((std::string(what) + ": wrong shape").c_str());
  }

  hqp::Session session_;
  std::vector<hqp::Reference> references_;
};

}  // namespace

NB_MODULE(_session, module) {
  module.doc() = "Sessions from a file.";
  nb::set_leak_warnings(std::getenv("HQP_LEAK_WARNINGS") != nullptr);  // a script may end anyhow
  nb::exception<hqp::PlanError>(module, "PlanError");
  nb::exception<hqp::ReferenceError>(module, "ReferenceError", PyExc_ValueError);
  nb::class_<Session>(module, "Session")
      .def(nb::init<const nb::bytes&>(), "file"_a)
      .def("step", &Session::step, "q"_a, "v"_a, "command"_a.noconvert(), "x"_a.noconvert(), "residuals"_a.noconvert())
      .def("tell", &Session::tell, "reference"_a, "what"_a, "values"_a)
      .def("held", &Session::held, "reference"_a)
      .def("integrate", &Session::integrate, "q"_a, "v"_a, "dt"_a, "out"_a.noconvert())
      .def("reset", &Session::reset)
      .def_prop_ro("sizes", &Session::sizes)
      .def_prop_ro("names", &Session::names)
      .def_prop_ro("robot", [](const Session& s) { return s.get().robot(); })
      .def_prop_ro("joint_names", [](const Session& s) { return s.get().joint_names(); })
      .def_prop_ro("home", [](const Session& s) { return s.get().home(); })
      .def_prop_ro("nq", [](const Session& s) { return s.get().nq(); })
      .def_prop_ro("nv", [](const Session& s) { return s.get().nv(); })
      .def_prop_ro("dt", [](const Session& s) { return s.get().dt(); });
}
