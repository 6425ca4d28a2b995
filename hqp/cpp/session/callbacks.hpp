// Rows, solvers and kinematics written in Python, called from a native tick.
#pragma once

#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "../rows/live_plan.hpp"
#include "../rows/loop.hpp"
#include "foreign.hpp"
#include "line.hpp"

namespace binding {

namespace nb = nanobind;

// Calls the methods of an object of hqp/loop/callbacks.py.
class Callbacks final : public hqp::Foreign {
 public:
  Callbacks(nb::object self, int n, std::size_t rows, const std::vector<hqp::Member>* members)
      : self_(std::move(self)), x_(std::size_t(n)), slack_(rows), marks_(rows), members_(members) {
    always_ = fills = nb::cast<bool>(self_.attr("fills"));
    writes = nb::cast<bool>(self_.attr("writes"));
    judges = nb::cast<bool>(self_.attr("judges"));
  }
  // all: true if Python must fill all rows of this tick.
  void ask(bool all) { fills = always_ || all; }
  void of(const std::vector<hqp::Member>& members, std::size_t rows) {
    members_ = &members, slack_.resize(rows), marks_.resize(rows);
  }

  const char* fill(const std::vector<bool>& left_out) override {
    const nb::gil_scoped_acquire held;
    const nb::object why = self_.attr("fill")(names(left_out));
    take_faults();
    return why.is_none() ? nullptr : (why_ = nb::cast<std::string>(why)).c_str();
  }
  void write() override {
    const nb::gil_scoped_acquire held;
    self_.attr("write")();
    take_faults();
  }
  Fault fault(std::size_t m) override {
    if (!failed) return {};
    const nb::gil_scoped_acquire held;
    const nb::object found = self_.attr("faults").attr("get")((*members_)[m].name);
    if (found.is_none()) return {};
    const auto [status, text, leave] = nb::cast<std::tuple<int, std::string, bool>>(found);
    if (texts_.size() <= m) texts_.resize(members_->size());
    texts_[m] = text;
    return {texts_[m].c_str(), static_cast<hqp::Status>(status), leave};
  }
  const char* supported(std::vector<bool>& out, std::vector<bool>& stay) override {
    const nb::gil_scoped_acquire held;
    const nb::object found = self_.attr("supported")(names(out));
    if (found.is_none()) return nullptr;
    const auto [rest, stays, why] =
        nb::cast<std::tuple<std::vector<std::string>, std::vector<std::string>, std::string>>(found);
    mark(out, rest), mark(stay, stays);
    return (why_ = why).c_str();
  }
  void go_without(const std::vector<bool>& out) override {
    const nb::gil_scoped_acquire held;
    self_.attr("go_without")(names(out));
  }
  hqp::Answered solve() override {
    const nb::gil_scoped_acquire held;
    return answered(self_.attr("solve")());
  }
  hqp::Answered judge(const hqp::Solved& found) override {
    const nb::gil_scoped_acquire held;
    return answered(
        self_.attr("judge")(nb::make_tuple(found.outcome, found.iterations, found.factorisations, bool(found.judged))));
  }
  void limit(double seconds) override {
    const nb::gil_scoped_acquire held;
    self_.attr("limit")(seconds);
  }
  hqp::RestFrom start(bool last) override {
    const nb::gil_scoped_acquire held;
    const nb::object found = self_.attr("start")(last);
    if (found.is_none()) return {};
    const nb::tuple parts = nb::cast<nb::tuple>(found);
    const double* at[4] = {};
    for (std::size_t i = 0; i < 4; ++i) {
      if (nb::object(parts[i]).is_none()) continue;
      from_[i] = nb::cast<Numbers>(parts[i]);
      at[i] = from_[i].data();
    }
    return {at[0], at[1], at[2], at[3]};
  }

 private:
  nb::list names(const std::vector<bool>& which) const {
    nb::list found;
    for (std::size_t m = 0; m < which.size(); ++m)
      if (which[m]) found.append(nb::str((*members_)[m].name.c_str()));
    return found;
  }
  void mark(std::vector<bool>& which, const std::vector<std::string>& names) const {
    which.assign(members_->size(), false);
    for (std::size_t m = 0; m < which.size(); ++m)
      which[m] = std::find(names.begin(), names.end(), (*members_)[m].name) != names.end();
  }
  void take_faults() { failed = nb::len(nb::object(self_.attr("faults"))) > 0; }
  // (status, x, slacks and marks of all levels, detail, points of stages or None, iterations, factorisations)
  hqp::Answered answered(const nb::object& parts) {
    const nb::tuple p = nb::cast<nb::tuple>(parts);
    detail_ = nb::cast<std::string>(p[4]);
    copy(p[1], x_.data(), x_.size());
    copy(p[2], slack_.data(), slack_.size());
    const auto marks = nb::cast<Marks>(p[3]);
    if (marks.size() != marks_.size()) throw nb::value_error("a solver gave the marks of other rows");
    std::copy(marks.data(), marks.data() + marks.size(), marks_.begin());
    hqp::Answered found{static_cast<hqp::Status>(nb::cast<int>(p[0])), x_.data(), slack_.data(), marks_.data()};
    found.detail = detail_.c_str();
    if (!nb::object(p[5]).is_none()) {
      points_ = nb::cast<Numbers>(p[5]);
      found.points = points_.data(), found.point_count = points_.size();
    }
    found.iterations = nb::cast<int>(p[6]), found.factorisations = nb::cast<int>(p[7]);
    return found;
  }
  static void copy(nb::handle from, double* to, std::size_t size) {
    const int shape[] = {static_cast<int>(size)};
    if (size && !hqp::Doubles::copy(from, to, shape, 1))
      throw nb::value_error("a solver gave a vector of another size");
  }

  nb::object self_;
  bool always_ = false;
  std::vector<double> x_, slack_, points_;
  std::vector<std::int8_t> marks_;
  Numbers from_[4];
  std::string why_, detail_;
  std::vector<std::string> texts_;
  const std::vector<hqp::Member>* members_;
};

}  // namespace binding
