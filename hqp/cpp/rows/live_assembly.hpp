// The rows of a stack over NumPy arrays, and a tick of them: references in, a record out.
#pragma once

#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <nanobind/stl/optional.h>

#include "../common/capsule.hpp"
#include "assembly.hpp"
#include "live_kinematics.hpp"
#include "live_plan.hpp"
#include "loop.hpp"

namespace binding {

class Assembly {
 public:
  using Parts = std::vector<std::tuple<int, int>>;  // first and last of some rows

  Assembly(const Columns& twists, const nb::object& bodies, int nq, double dt, int order, const nb::object& reference)
      : rows_(hqp::bodies(plan(bodies), static_cast<int>(twists.shape(1))), keep(twists), nq, dt, order),
        loop_(reference) {}
  Assembly(const Assembly&) = delete;

  // Parts of a plan, see planned.hpp.
  void add(const nb::object& operation) {
    const LivePlan p = plan(operation);
    try {
      rows_.add(p.part("plan"), hqp::target(p, size()));
    } catch (const hqp::UnknownPlan& error) {
      throw nb::type_error(error.what());
    }
  }
  void laws(const nb::object& p) { rows_.laws(hqp::laws(plan(p), rows_.order(), size())); }
  // A law of the element with these rows, and its number; later on it goes over to one of them, see LawChange.
  std::size_t law(int start, int stop, const nb::object& p) {
    require(start, stop);
    return rows_.demands().add(hqp::rows_law(plan(p), start, stop));
  }
  void aim(int start, int stop, std::size_t number, bool at_once) { rows_.demands().aim(start, stop, number, at_once); }
  void go_on() { rows_.demands().go_on(rows_.dt()); }
  void out(const std::string& name, int start, int stop, bool out) {
    require(start, stop);
    rows_.out(name, start, stop, out);
  }
  void dynamics(const nb::object& p) { hqp::add_dynamics(rows_, plan(p)); }
  void load(const nb::object& p) { hqp::add_load(rows_, plan(p)); }
  void slot(const nb::object& p) { loop_.add(plan(p).text("name"), hqp::slot(plan(p), rows_.operations())); }

  // Native kinematics, which writes placements and twists before the rows of a tick.
  void move(const nb::object& robot) {
    kept_.push_back(robot);
    kinematics_ = &nb::cast<LiveKinematics&>(robot).get();
  }
  void run(const Vector& q, const Vector& v, const Vector& measured) {
    if (kinematics_) kinematics_->update(q.data());
    rows_.operate(q.data(), v.data(), measured.data());
  }
  void demand(const Vector& v) { rows_.demand(v.data()); }
  void limit(const Vector& v, const nb::capsule& reactions) { rows_.limit(v.data(), *hqp::reactions_of(reactions)); }
  nb::capsule core() { return hqp::capsule_of_part(&rows_, "hqp.assembly"); }

  // call: solve call of a workspace bound to the arrays of the laws; values: its x and slack.  largest: largest regular
  // demand.
  void answers(const nb::capsule& call, const Vector& values, double largest) {
    rows_.largest(largest);
    call_ = hqp::call_of(call);
    called_ = call;
    values_ = keep(values);
  }

  // Rows that are written between those of native operations and the laws: their place in J and, for inequalities, in
  // the bounds (first, last).
  void written(const Parts& rows, const Parts& bounds) { rows_.written(pairs(rows), pairs(bounds)); }

  // Solve many configurations at rest under one set of references: x, or null for irregular data and failed solves;
  // rows alone.
  bool take(const nb::tuple& references) { return loop_.take(references, true); }
  bool write(const double* q, const double* v) {
    rows_.begin();
    rows_.operate(q, v, v);
    rows_.demand(v);
    return rows_.small();
  }
  const double* answer() {
    const nb::gil_scoped_release release;
    const hqp::Solved found = call_->run(nullptr);
    return found.outcome > hqp::kViolated ? nullptr : found.values ? found.values : values_;
  }
  const hqp::Demands& demands() const { return rows_.demands(); }
  int size() const { return rows_.size(); }

 private:
  void require(int start, int stop) const {
    if (start < 0 || start > stop || stop > rows_.demands().size())
      throw nb::value_error("an element lies outside the rows");
  }
  template <typename Array>
  auto keep(const Array& array) -> decltype(array.data()) {
    kept_.push_back(nb::cast(array));
    return array.data();
  }
  LivePlan plan(const nb::object& object) { return {object, kept_}; }
  static hqp::Assembly::Parts pairs(const Parts& parts) {
    hqp::Assembly::Parts found;
    for (const auto& [first, last] : parts) found.emplace_back(first, last);
    return found;
  }

  std::vector<nb::object> kept_;  // declared before the pointers into it
  hqp::Assembly rows_;
  hqp::Kinematics* kinematics_ = nullptr;
  hqp::Loop loop_;
  nb::object called_;  // keeps call_ alive
  hqp::SolveCall* call_ = nullptr;
  const double* values_ = nullptr;
};

}  // namespace binding
