// Bindings of single parts of a tick, for tests: watch of joint limits, time budget, answers that were cut.
#pragma once

#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "../solver/reading.hpp"
#include "budget.hpp"
#include "limit_watch.hpp"
#include "live.hpp"
#include "outgoing.hpp"

namespace binding {

using namespace nb::literals;

using Names = std::vector<std::string>;
using Notes = std::vector<std::tuple<std::string, int, std::string>>;  // element, status, text

inline auto teller(Notes& notes) {
  return
      [&notes](const hqp::Note& note) { notes.emplace_back(note.element, static_cast<int>(note.status), note.text()); };
}

// Commands in place of answers to a hierarchy, whose arrays are live, that the deadline has cut.
class CutAnswers {
 public:
  CutAnswers(nb::object hierarchy, const std::vector<int>& motors, double most, double violation, Names sentences,
             double dt)
      : hierarchy_(std::move(hierarchy)),
        outgoing_(read(motors, most, violation, std::move(sentences))),
        rest_(std::size_t(outgoing_.size()), motors, 1.0, dt),
        contacts_({}, dt),
        slack_(outgoing_.rows()) {}

  // Write the command in place of a cut answer into x.
  Notes instead(const Vector& cut, const Vector& last, std::int64_t tick, const Written& x) {
    Notes notes;
    const auto start = [] { return hqp::RestFrom{}; };
    if (!outgoing_.take({hqp::Status::kTimeLimit, of(cut), slack_.data(), nullptr}, {of(last), true, tick}, rest_,
                        start, contacts_, nullptr, nullptr, nullptr, nullptr, of(x), teller(notes)))
      throw nb::value_error("the answer is not usable");
    return notes;
  }
  void solved(const Vector& x, std::int64_t tick) { outgoing_.trend().take(of(x), tick); }
  // Come to rest in one tick.
  void rest(const Vector& last, std::int64_t tick, const Written& x) {
    Notes notes;
    outgoing_.rest(
        rest_, [] { return hqp::RestFrom{}; }, true, 1, hqp::Status::kOptimal, {of(last), true, tick}, nullptr, of(x),
        teller(notes));
  }

 private:
  const double* of(const Vector& x) const { return numbers(x, std::size_t(outgoing_.size())); }
  double* of(const Written& x) const { return numbers(x, std::size_t(outgoing_.size())); }
  hqp::Outgoing read(const std::vector<int>& motors, double most, double violation, Names sentences) const {
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
    return {
        n,         std::move(levels),   problem.constraints, law, {}, motors, std::vector<double>(motors.size(), most),
        violation, std::move(sentences)};
  }

  nb::object hierarchy_;  // keeps its arrays
  hqp::Outgoing outgoing_;
  hqp::Brake rest_;
  hqp::ContactWatch contacts_;
  std::vector<double> slack_;
};

inline void bind_parts(nb::module_& module) {
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

  nb::class_<CutAnswers> cut(module, "CutAnswers");
  cut.def(nb::init<nb::object, const std::vector<int>&, double, double, Names, double>(), "hierarchy"_a, "motors"_a,
          "most"_a, "violation"_a, "sentences"_a, "dt"_a)
      .def("instead", &CutAnswers::instead, "cut"_a, "last"_a, "tick"_a, "x"_a.noconvert())
      .def("solved", &CutAnswers::solved, "x"_a, "tick"_a)
      .def("rest", &CutAnswers::rest, "last"_a, "tick"_a, "x"_a.noconvert());
  cut.attr("LONGEST") = hqp::Trend::kLongest;
}

}  // namespace binding
