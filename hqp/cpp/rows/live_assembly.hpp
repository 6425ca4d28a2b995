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

  // Placements and twists are written by this, ahead of the rows of a tick.
  void move(const nb::object& robot) {
    kept_.push_back(robot);
    kinematics_ = &nb::cast<LiveKinematics&>(robot).get();
  }
  void run(const Vector& q, const Vector& v) {
    if (kinematics_) kinematics_->update(q.data());
    rows_.operate(q.data(), v.data());
  }
  void demand(const Vector& v) { rows_.demand(v.data()); }
  void limit(const Vector& v, const nb::capsule& reactions) { rows_.limit(v.data(), *hqp::reactions_of(reactions)); }
  nb::capsule limits() { return hqp::capsule_of(&rows_); }

  // The hold value of an element, None for one that is not there.
  void hold(const std::string& name, const std::optional<Vector>& value) {
    hqp::Slot* slot = loop_.find(name);
    if (!slot) throw nb::key_error(name.c_str());
    slot->hold.clear();
    if (!value || !slot->target || slot->size() == 0) return;
    if (value->size() != std::size_t(slot->size()))
      throw nb::value_error(("the hold value of " + name + " has another size than in its plan").c_str());
    slot->hold.assign(value->data(), value->data() + slot->size());
  }
  // The next step begins from hold values for every reference, fresh ones for those of these elements that are
  // measured.
  void renew(const std::vector<std::string>& names) {
    settle_ = true;
    for (const std::string& name : names)
      if (hqp::Slot* slot = loop_.find(name)) renewed_.push_back(slot);
  }
  Numbers overrun(const std::string& name, const Vector& q, const Vector& v) {
    Numbers over;
    if (const hqp::Slot* slot = loop_.find(name)) rows_.overrun(slot->operation, q.data(), v.data(), over);
    return over;
  }
  // Update immediately, if no step follows.
  void look(const Vector& q, const Vector& v) {
    if (kinematics_) kinematics_->update(q.data());
    rows_.take_holds(q.data(), v.data(), renewed_);
  }
  void held(const std::string& name, const Written& value) {
    const hqp::Slot* slot = loop_.find(name);
    if (!slot || slot->hold.size() != value.size()) throw nb::key_error(name.c_str());
    std::copy(slot->hold.begin(), slot->hold.end(), value.data());
  }
  // solve: solve of a workspace bound to the arrays of the laws, (outcome, ...) with 0 for an optimum; call: the native
  // solve, if there is one. values: x and slack, active: marks, both its own. command: entries of x that form the
  // command. largest: a demand beyond it is out of the ordinary.
  void answers(const nb::object& solve, const std::optional<nb::capsule>& call, const Vector& values,
               const Marks& active, Ints command, double largest) {
    solve_ = solve;
    call_ = call ? hqp::call_of(*call) : nullptr;
    values_ = keep(values), active_ = keep(active);
    value_count_ = values.size(), active_count_ = active.size();
    sent_.assign(values.data(), values.data() + std::min(values.size(), static_cast<std::size_t>(size())));
    marks_.assign(active_count_, 0);
    command_ = std::move(command);
    rows_.largest(largest);
  }

  // Rows that are written between those of native operations and the laws: their place in J and, for inequalities, in
  // the bounds (first, last).
  void written(const Parts& rows, const Parts& bounds) { rows_.written(pairs(rows), pairs(bounds)); }

  // References, rows, laws and solver: a record [command, x, slack, begin, seconds for rows and solve, solve's counts,
  // marks, points of stages where there were any, q and v of a tick of arrays and, at velocity level, where q comes to,
  // 1 where marks are others than in the record before + 2 for stages]; the result of solve if it is not an optimum;
  // None where a reference, a row or a demand is out of the ordinary. v None for the x of the record before, at
  // velocity level; write: Python's rows, whether all are there.
  nb::object step(nb::handle q, nb::handle v, const nb::tuple& references, bool fresh, nb::handle write) {
    const hqp::Doubles at(q, true), speed(v.is_none() ? q : v, true);
    if (!at.data() || !speed.data()) throw nb::type_error("q and v are vectors of doubles");
    const double* velocity = v.is_none() ? sent_.data() : speed.data();
    begin_ = hqp::Clock::now();
    if (fresh) std::fill(marks_.begin(), marks_.end(), kNoMark);
    if (kinematics_) kinematics_->update(at.data());
    rows_.take_holds(at.data(), velocity, renewed_);
    if (!loop_.take(references, fresh || std::exchange(settle_, false))) return nb::none();
    rows_.operate(at.data(), velocity);
    if (!write.is_none() && !nb::cast<bool>(write())) return nb::none();
    rows_.demand(velocity);
    return rows_.usable() ? answered(velocity) : nb::none();
  }

  // A step of arrays alone, q (nq,) and v (nv,), or null for rest, where all is native: see hqp::Loop::aim. None as
  // well where the squares of a state sum up to `largest` or more, or its quaternions are off length one by `rounding`.
  // before: at velocity level the x around which limits stand, null for that of the record before.
  nb::object tick(nb::handle q, nb::handle v, const nb::dict& targets, bool fresh, nb::handle before, double largest,
                  double rounding) {
    const hqp::Doubles at(q, true), speed(v.is_none() ? q : v, true), sent(before.is_none() ? q : before, true);
    const int nq = kinematics_ ? kinematics_->size() : 0, nv = size();
    if (!kinematics_ || !at.data() || !speed.data() || !sent.data()) return nb::none();
    if (!at.has(&nq, 1) || (!v.is_none() && !speed.has(&nv, 1)) || (v.is_none() && rows_.order() == 2))
      return nb::none();
    const double square = hqp::squared(at.data(), nq) + (v.is_none() ? 0.0 : hqp::squared(speed.data(), nv));
    if (!(square < largest) || !kinematics_->unit(at.data(), rounding)) return nb::none();
    begin_ = hqp::Clock::now();
    if (!loop_.aim(targets, fresh)) return nb::none();
    kinematics_->update(at.data());
    const double* velocity = rows_.order() == 2 ? speed.data() : before.is_none() ? sent_.data() : sent.data();
    if (v.is_none()) state_.assign(state_.size(), 0.0);
    rows_.operate(at.data(), velocity);
    rows_.demand(velocity);
    return rows_.usable() ? answered(velocity, at.data(), v.is_none() ? nullptr : speed.data()) : nb::none();
  }

  // Solve without Python's objects, for many configurations at rest under equal references: x, null for an
  // extraordinary or unsolved tick; rows alone.
  bool take(const nb::tuple& references) { return loop_.take(references, true); }
  bool write(const double* q, const double* v) {
    rows_.operate(q, v);
    rows_.demand(v);
    return rows_.small();
  }
  const double* answer() {
    const hqp::Solved found = solved(nullptr);
    return found.outcome > hqp::kViolated ? nullptr : found.values ? found.values : values_;
  }
  const hqp::Demands& demands() const { return rows_.demands(); }
  int size() const { return rows_.size(); }

 private:
  static constexpr std::int8_t kNoMark = -128;

  void require(int start, int stop) const {
    if (start < 0 || start > stop || stop > rows_.demands().size())
      throw nb::value_error("an element lies outside the rows");
  }
  nb::object answered(const double* v, const double* q = nullptr, const double* rate = nullptr) {
    const auto begun = hqp::Clock::now();
    const hqp::Solved found = solved(v);
    if (found.outcome == hqp::kInvalid) return nb::none();
    if (found.outcome != hqp::kOptimal)
      return nb::make_tuple(found.outcome, found.iterations, found.factorisations, found.judged);
    return record(found, hqp::seconds(begin_, begun) + found.before,
                  hqp::seconds(begun, hqp::Clock::now()) - found.before, q, rate);
  }
  hqp::Solved solved(const double* v) {
    hqp::Solved found{hqp::kAskPython};
    if (call_) {
      const nb::gil_scoped_release release;
      found = call_->run(v);
    }
    if (found.outcome != hqp::kAskPython) return found;
    const nb::tuple told = nb::cast<nb::tuple>(solve_());
    return {nb::cast<int>(told[0]), nb::cast<int>(told[1]), nb::cast<int>(told[2]), nb::cast<int>(told[3]),
            found.before};
  }

  nb::object record(const hqp::Solved& found, double filling, double solving, const double* q, const double* rate) {
    const std::size_t numbers = command_.size() + value_count_ + 5, points = sizeof(double) * found.point_count;
    const std::size_t nq = q ? kinematics_->size() : 0, nv = q ? size() : 0, moved = rows_.order() == 1 ? nq : 0;
    const double* values = found.values ? found.values : values_;
    const std::int8_t* active = found.active ? found.active : active_;
    const nb::object made = nb::steal(PyByteArray_FromStringAndSize(
        nullptr, static_cast<Py_ssize_t>(sizeof(double) * (numbers + nq + nv + moved) + active_count_ + points + 1)));
    if (!made.is_valid()) nb::raise_python_error();
    double* out = reinterpret_cast<double*>(PyByteArray_AsString(made.ptr()));
    for (const int i : command_) *out++ = values[i];
    out = std::copy(values, values + value_count_, out);
    std::copy(values, values + sent_.size(), sent_.begin());
    for (const double number :
         {hqp::seconds({}, begin_), filling, solving, double(found.iterations), double(found.factorisations)})
      *out++ = number;
    std::int8_t* marks = reinterpret_cast<std::int8_t*>(out);
    std::copy(active, active + active_count_, marks);
    if (points) std::memcpy(marks + active_count_, found.points, points);
    std::int8_t* end = marks + active_count_ + points;
    if (q) {
      state_.resize(nq + nv + moved);
      std::copy(q, q + nq, state_.begin());
      if (rate) std::copy(rate, rate + nv, state_.begin() + nq);
      if (moved) kinematics_->integrate(q, values, rows_.dt(), state_.data() + nq + nv);
      std::memcpy(end, state_.data(), sizeof(double) * state_.size());
      end += sizeof(double) * state_.size();
    }
    *end = (points ? 2 : 0) + !std::equal(active, active + active_count_, marks_.begin());
    std::copy(active, active + active_count_, marks_.begin());
    return made;
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
  std::vector<hqp::Slot*> renewed_;
  bool settle_ = false;
  nb::object solve_;
  hqp::SolveCall* call_ = nullptr;
  std::vector<double> sent_;        // x of the latest record
  std::vector<std::int8_t> marks_;  // and its marks
  std::vector<double> state_;       // q, v and, at velocity level, where q comes to
  const double* values_ = nullptr;
  const std::int8_t* active_ = nullptr;
  std::size_t value_count_ = 0, active_count_ = 0;
  Ints command_;
  hqp::Clock::time_point begin_;
};

}  // namespace binding
