// Bindings of rate limits, watches, the time budget and the outgoing command, for transitions and tests.
#pragma once

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
#include "limit_watch.hpp"
#include "outgoing.hpp"

namespace binding {

namespace nb = nanobind;
using namespace nb::literals;

using Numbers = std::vector<double>;
using Names = std::vector<std::string>;
using Notes = std::vector<std::tuple<std::string, int, std::string>>;  // element, status, text
using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Written = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

template <class Array>
auto numbers(const Array& x, std::size_t size) {
  if (x.size() != size)
    throw nb::value_error(
        ("a vector has size " + std::to_string(x.size()) + ", needed " + std::to_string(size)).c_str());
  return x.data();
}
inline const double* numbers(const std::optional<Vector>& x, std::size_t size) {
  return x ? numbers(*x, size) : nullptr;
}
inline auto teller(Notes& notes) {
  return
      [&notes](const hqp::Note& note) { notes.emplace_back(note.element, static_cast<int>(note.status), note.text()); };
}

// The outgoing command of a hierarchy whose arrays are live.
class Outgoing {
 public:
  using Part = std::tuple<std::string, int, int, int, Names>;                             // see hqp::Outgoing::Part
  using From = std::tuple<Vector, Vector, std::optional<Vector>, std::optional<Vector>>;  // see hqp::RestFrom
  using Answer = std::tuple<int, Vector, Vector, std::string>;                            // see hqp::Answered
  using Before = std::tuple<Vector, bool, std::int64_t>;                                  // see hqp::Before

  Outgoing(nb::object hierarchy, const std::vector<Part>& parts, std::vector<int> motors, double most, double violation,
           Names sentences)
      : hierarchy_(std::move(hierarchy)),
        outgoing_(read(parts, std::move(motors), most, violation, std::move(sentences))) {}

  std::pair<bool, Notes> take(const Answer& answer, const Before& before, hqp::Rest& rest, const nb::callable& start,
                              const hqp::ContactWatch& contacts, const hqp::RateLimiter* limiter, const Written& x) {
    const auto& [status, found, slack, detail] = answer;
    const double* w = status ? numbers(slack, outgoing_.rows()) : nullptr;
    Start from{rest, start};
    Notes notes;
    const bool usable =
        outgoing_.take({static_cast<hqp::Status>(status), of(found), w, nullptr, detail.c_str()}, of(before), rest,
                       from, contacts, nullptr, nullptr, limiter, of(x), teller(notes));
    return {usable, std::move(notes)};
  }
  Notes rest(hqp::Rest& rest, const nb::callable& start, bool fit, std::int64_t held, int why, const Before& before,
             const hqp::RateLimiter* limiter, const Written& x) {
    Start from{rest, start};
    Notes notes;
    outgoing_.rest(rest, from, fit, held, static_cast<hqp::Status>(why), of(before), limiter, of(x), teller(notes));
    return notes;
  }
  void solved(const Vector& x, std::int64_t tick) { outgoing_.trend().take(of(x), tick); }

 private:
  // State at the begin of braking, with its arrays.
  struct Start {
    const hqp::Rest& rest;
    const nb::callable& told;
    std::optional<From> kept = std::nullopt;

    hqp::RestFrom operator()() {
      if (!(kept = nb::cast<std::optional<From>>(told()))) return {};
      const auto& [angles, v, holding, felt] = *kept;
      return {numbers(angles, v.size()), v.data(), numbers(holding, rest.size()), numbers(felt, rest.size())};
    }
  };
  const double* of(const Vector& x) const { return numbers(x, std::size_t(outgoing_.size())); }
  double* of(const Written& x) const { return numbers(x, std::size_t(outgoing_.size())); }
  hqp::Before of(const Before& told) const {
    const auto& [x, good, tick] = told;
    return {of(x), good, tick};
  }
  hqp::Outgoing read(const std::vector<Part>& parts, std::vector<int> motors, double most, double violation,
                     Names sentences) const {
    const int n = nb::cast<int>(hierarchy_.attr("n"));
    std::vector<int> rows;
    for (const nb::handle one : hierarchy_.attr("levels")) rows.push_back(nb::cast<int>(one.attr("m")));
    std::vector<hqp::Level> levels(rows.size());
    hqp::Reader reader;
    hqp::Problem problem;
    hqp::Law law;
    const double* prices = nullptr;
    if (!reader.read(hierarchy_, n, rows, !hierarchy_.attr("metric").is_none(), levels.data(), problem, prices) ||
        !reader.read_law(hierarchy_, n, std::vector<char>(rows.size(), 1), prices, law))
      throw nb::value_error("the hierarchy's arrays do not have the shapes or types that its levels need");
    std::vector<hqp::Outgoing::Part> found;
    for (const auto& [name, level, first, last, names] : parts) {
      if (level < 0 || level >= problem.count || first < 0 || last < first || last > rows[std::size_t(level)])
        throw nb::value_error("a part names a level or rows outside the hierarchy");
      found.push_back({name, level, first, last, names});
    }
    return {n,    std::move(levels), problem.constraints, law, std::move(found), std::move(motors),
            most, violation,         std::move(sentences)};
  }

  nb::object hierarchy_;  // keeps its arrays
  hqp::Outgoing outgoing_;
};

inline void bind_guards(nb::module_& module) {
  nb::class_<hqp::RateLimiter>(module, "RateLimiter")
      .def(nb::init<Names, Numbers, double, std::string>(), "joints"_a, "inverse"_a, "dt"_a, "name"_a)
      .def_prop_ro("inverse", &hqp::RateLimiter::inverse);

  nb::class_<hqp::ContactWatch> contacts(module, "ContactWatch");
  contacts.def(nb::init<Names, double>(), "names"_a, "dt"_a);
  contacts.attr("LEAST_LOAD") = hqp::ContactWatch::kLeastLoad;

  nb::class_<hqp::LimitWatch> limits(module, "LimitWatch");
  limits.def(nb::init<hqp::LimitWatch::Parts, Names, double>(), "parts"_a, "names"_a, "dt"_a)
      .def(
          "look",
          [](hqp::LimitWatch& self, const nb::bytearray& record, std::size_t begin, std::int64_t tick) {
            Notes found;
            if (record.size() < begin + self.rows()) return found;
            const auto* marks = static_cast<const std::int8_t*>(record.data()) + begin;
            self.look(marks, tick, teller(found));
            return found;
          },
          "record"_a, "begin"_a, "tick"_a);
  limits.attr("SPAN") = hqp::LimitWatch::kSpan;
  limits.attr("OFTEN") = hqp::LimitWatch::kOften;

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

  nb::class_<Outgoing> outgoing(module, "Outgoing");
  outgoing
      .def(nb::init<nb::object, const std::vector<Outgoing::Part>&, std::vector<int>, double, double, Names>(),
           "hierarchy"_a, "parts"_a, "motors"_a, "most"_a, "violation"_a, "sentences"_a)
      .def("take", &Outgoing::take, "answer"_a, "before"_a, "rest"_a, "start"_a, "contacts"_a, "limiter"_a.none(),
           "x"_a.noconvert())
      .def("rest", &Outgoing::rest, "rest"_a, "start"_a, "fit"_a, "held"_a, "why"_a, "before"_a, "limiter"_a.none(),
           "x"_a.noconvert())
      .def("solved", &Outgoing::solved, "x"_a, "tick"_a);
  outgoing.attr("LONGEST") = hqp::Trend::kLongest;

  nb::class_<hqp::Rest>(module, "Rest");
  nb::class_<hqp::Brake, hqp::Rest>(module, "Brake")
      .def(nb::init<std::size_t, std::vector<int>, double, double>(), "nv"_a, "joints"_a, "deceleration"_a, "dt"_a);
}

}  // namespace binding
