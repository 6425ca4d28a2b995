// Python's view of what a session lets in and out: bounds, rates, time, late answers, and how it comes to rest.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "../solver/reading.hpp"
#include "budget.hpp"
#include "contact_watch.hpp"
#include "guards.hpp"
#include "late.hpp"
#include "limit_watch.hpp"
#include "rest.hpp"
#include "violations.hpp"

namespace binding {

namespace nb = nanobind;
using namespace nb::literals;

using Numbers = std::vector<double>;
using Names = std::vector<std::string>;
using Told = std::vector<std::tuple<std::string, std::string>>;  // element, text
using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Written = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

template <class Array>
const double* numbers(const Array& x, std::size_t size) {
  if (x.size() != size) throw nb::value_error("a vector has a wrong size");
  return x.data();
}
inline const double* numbers(const std::optional<Vector>& x, std::size_t size) {
  return x ? numbers(*x, size) : nullptr;
}

// See Late; x is written.
inline void late(const nb::object& hierarchy, const Vector& cut, const Vector& last, const Vector& ahead,
                 const std::vector<int>& joints, double most, double violation, const Written& x) {
  const std::size_t n = x.size();
  std::vector<int> rows;
  for (const nb::handle one : hierarchy.attr("levels")) rows.push_back(nb::cast<int>(one.attr("m")));
  std::vector<hqp::Level> levels(rows.size());
  hqp::Reader reader;
  hqp::Problem problem;
  hqp::Law law;
  const double* prices = nullptr;
  const bool metric = !hierarchy.attr("metric").is_none();
  if (!reader.read(hierarchy, static_cast<int>(n), rows, metric, levels.data(), problem, prices) ||
      !reader.read_law(hierarchy, static_cast<int>(n), std::vector<char>(rows.size(), 1), prices, law))
    throw nb::value_error("the hierarchy cannot be read");
  hqp::Late rule(static_cast<int>(n), std::move(levels), problem.constraints, law, violation);
  const double* found =
      rule.choose(numbers(cut, n), numbers(last, n), numbers(ahead, n), joints.data(), joints.size(), most);
  std::copy(found, found + n, x.data());
}

inline void bind_guards(nb::module_& module) {
  nb::class_<hqp::StateBounds>(module, "StateBounds")
      .def(nb::init<Numbers, Numbers, Numbers, double, bool, Names>(), "low"_a, "high"_a, "speed"_a, "distance"_a,
           "floating"_a, "names"_a)
      .def(
          "fault",
          [](const hqp::StateBounds& self, const Vector& angles, const Vector& q, const Vector& v) {
            hqp::Note why;
            const bool held = self.hold(numbers(angles, self.size()), q.data(), numbers(v, self.size()), why);
            return held ? std::string() : why.text();
          },
          "angles"_a, "q"_a, "v"_a);

  nb::class_<hqp::StateAge>(module, "StateAge")
      .def(nb::init<double>(), "most"_a)
      .def(
          "fault",
          [](const hqp::StateAge& self, std::optional<double> time, double now) {
            hqp::Note why;
            return self.hold(time ? &*time : nullptr, now, why) ? std::string() : why.text();
          },
          "time"_a.none(), "now"_a);

  nb::class_<hqp::RateLimiter>(module, "RateLimiter")
      .def(nb::init<Names, Numbers, double>(), "names"_a, "inverse"_a, "dt"_a)
      .def(
          "share",
          [](const hqp::RateLimiter& self, const Vector& last, const Vector& command) {
            hqp::Note why;
            const double share = self.share(
                numbers(last, self.size()), numbers(command, self.size()), [](std::size_t i) { return i; }, why);
            return std::make_tuple(share, share == 1.0 ? std::string() : why.text());
          },
          "last"_a, "command"_a)
      .def_prop_ro("inverse", &hqp::RateLimiter::inverse);

  nb::class_<hqp::ContactWatch> contacts(module, "ContactWatch");
  contacts.def(nb::init<Names, double>(), "names"_a, "dt"_a)
      .def(
          "measure",
          [](hqp::ContactWatch& self, const std::string& name, double load) {
            const Names& names = self.names();
            const auto found = std::find(names.begin(), names.end(), name);
            if (found != names.end()) self.measure(std::size_t(found - names.begin()), load);
            return found != names.end();
          },
          "name"_a, "load"_a)
      .def(
          "judge",
          [](hqp::ContactWatch& self, const nb::frozenset& out) {
            for (std::size_t k = 0; k < self.names().size(); ++k) self.judge(k, out.contains(self.names()[k].c_str()));
          },
          "out"_a)
      .def("lost",
           [](const hqp::ContactWatch& self) {
             Told found;
             self.lost([&](const hqp::Note& note) { found.emplace_back(note.element, note.text()); });
             return found;
           })
      .def_prop_ro("names", &hqp::ContactWatch::names)
      .def_prop_ro("missing", &hqp::ContactWatch::missing);
  contacts.attr("LEAST_LOAD") = hqp::ContactWatch::kLeastLoad;

  nb::class_<hqp::LimitWatch> limits(module, "LimitWatch");
  limits.def(nb::init<hqp::LimitWatch::Parts, Names, double>(), "parts"_a, "names"_a, "dt"_a)
      .def(
          "look",
          [](hqp::LimitWatch& self, const nb::bytearray& record, std::size_t begin, std::int64_t tick) {
            Told found;
            if (record.size() < begin + self.rows()) return found;
            const auto* marks = static_cast<const std::int8_t*>(record.data()) + begin;
            self.look(marks, tick, [&](const hqp::Note& note) { found.emplace_back(note.element, note.text()); });
            return found;
          },
          "record"_a, "begin"_a, "tick"_a)
      .def_static(
          "passed",
          [](double over, const std::string& unit) {
            hqp::Note why;
            return hqp::LimitWatch::passed(over, unit.c_str(), why) ? why.text() : "";
          },
          "over"_a, "unit"_a)
      .def_prop_ro("busy", &hqp::LimitWatch::busy)
      .def_prop_ro("meet", &hqp::LimitWatch::meet);
  limits.attr("SPAN") = hqp::LimitWatch::kSpan;
  limits.attr("OFTEN") = hqp::LimitWatch::kOften;

  module.def(
      "violation",
      [](const Vector& w, const Vector& lower, const Vector& upper, double tolerance, const std::string& limit,
         const nb::callable& row_names) {
        const std::size_t m = w.size();
        const auto off = [&](const Names& names, hqp::Note& why) {
          return hqp::violated(w.data(), numbers(lower, m), numbers(upper, m), m, tolerance, names, why);
        };
        hqp::Note why{"", hqp::Status::kConstraintsViolated, hqp::Cause::kOff, limit.c_str()}, named = why;
        if (!off({}, why)) return std::string();
        const Names names = nb::cast<Names>(row_names());
        off(names, named);
        return named.text();
      },
      "w"_a, "lower"_a, "upper"_a, "tolerance"_a, "limit"_a, "row_names"_a);

  nb::class_<hqp::Budget> budget(module, "Budget");
  budget.def(nb::init<double>(), "deadline"_a)
      .def_prop_ro("deadline", &hqp::Budget::deadline)
      .def_prop_ro("margin", &hqp::Budget::margin)
      .def("begin", &hqp::Budget::begin, "now"_a)
      .def("skip", &hqp::Budget::skip)
      .def("left", &hqp::Budget::left, "spent"_a)
      .def("end", &hqp::Budget::end, "now"_a, "cut"_a);
  budget.attr("LATE") = hqp::Budget::kLate;
  budget.attr("STEP") = hqp::Budget::kStep;
  budget.attr("FIRST") = hqp::Budget::kFirst;
  budget.attr("LONGEST") = hqp::Budget::kLongest;

  nb::class_<hqp::Trend> trend(module, "Trend");
  trend.def(nb::init<std::size_t>(), "n"_a)
      .def("forget", &hqp::Trend::forget)
      .def(
          "take",
          [](hqp::Trend& self, const Vector& x, std::int64_t tick) { self.take(numbers(x, self.size()), tick); }, "x"_a,
          "tick"_a)
      .def(
          "after",
          [](const hqp::Trend& self, const Vector& last, std::int64_t tick, const Written& to) {
            numbers(to, self.size());
            self.after(numbers(last, self.size()), tick, to.data());
          },
          "last"_a, "tick"_a, "to"_a.noconvert());
  trend.attr("LONGEST") = hqp::Trend::kLongest;

  module.def("late", late, "hierarchy"_a, "cut"_a, "last"_a, "ahead"_a, "joints"_a, "most"_a, "violation"_a,
             "x"_a.noconvert());

  nb::class_<hqp::Rest>(module, "Rest")
      .def(
          "begin",
          [](hqp::Rest& self, const std::optional<Vector>& angles, const std::optional<Vector>& v,
             const std::optional<Vector>& holding, const std::optional<Vector>& felt, const Vector& x, bool now) {
            const std::size_t nv = v ? v->size() : 0, n = self.size();
            self.begin({numbers(angles, nv), v ? v->data() : nullptr, numbers(holding, n), numbers(felt, n)},
                       numbers(x, n), now);
          },
          "angles"_a.none(), "v"_a.none(), "holding"_a.none(), "felt"_a.none(), "x"_a, "now"_a)
      .def(
          "next",
          [](hqp::Rest& self, const Written& x) {
            numbers(x, self.size());
            self.next(x.data());
          },
          "x"_a.noconvert());
  nb::class_<hqp::SlowDown, hqp::Rest>(module, "SlowDown")
      .def(nb::init<Numbers, Numbers, std::vector<int>, double, double>(), "low"_a, "high"_a, "joints"_a,
           "deceleration"_a, "dt"_a);
  nb::class_<hqp::Brake, hqp::Rest>(module, "Brake")
      .def(nb::init<std::size_t, std::vector<int>, double, double>(), "nv"_a, "joints"_a, "deceleration"_a, "dt"_a);
  nb::class_<hqp::Hold, hqp::Rest>(module, "Hold")
      .def(nb::init<Numbers, std::vector<int>, double, double>(), "limit"_a, "motors"_a, "damping"_a, "dt"_a);
}

}  // namespace binding
