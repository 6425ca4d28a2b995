// A session over the arrays of a compiled program in Python: it takes References and returns records of ticks.
#pragma once

#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "../common/capsule.hpp"
#include "../rows/live_plan.hpp"
#include "../rows/loop.hpp"
#include "callbacks.hpp"
#include "guarded.hpp"
#include "record.hpp"

namespace binding {

// Parts of a live session: the tree of hqp/loop/document.py with the native parts of its program.
class LiveSource {
 public:
  static constexpr bool kLive = true;
  explicit LiveSource(const nb::object& tree) : tree_(tree) {
    const LivePlan plan = root();
    if (plan.has("callbacks"))
      callbacks_ =
          std::make_unique<Callbacks>(plan.part("callbacks").object(), plan.part("solver").integer("n"), 0, nullptr);
  }
  LivePlan root() const { return {tree_, *kept_}; }
  hqp::Parts parts() const {
    const LivePlan live = root().part("live");
    hqp::Parts found;
    found.kinematics = part<hqp::Kinematics>(live, "kinematics", "hqp.kinematics");
    found.assembly = part<hqp::Assembly>(live, "assembly", "hqp.assembly");
    found.torque = part<hqp::TorqueParts>(live, "torque", "hqp.torque_parts");
    found.solver = part<hqp::LevelSolve>(live, "solver", "hqp.level_solve");
    return found;
  }
  Callbacks* foreign() const { return callbacks_.get(); }
  std::shared_ptr<const void> kept() const { return kept_; }

 private:
  template <class Part>
  static std::shared_ptr<Part> part(const LivePlan& live, const char* field, const char* name) {
    if (!live.has(field)) return nullptr;
    return {hqp::part_of<Part>(live.part(field).object().attr("core")(), name), [](Part*) {}};
  }

  nb::object tree_;
  std::shared_ptr<std::vector<nb::object>> kept_ = std::make_shared<std::vector<nb::object>>();
  std::unique_ptr<Callbacks> callbacks_;
};

// A live session: references in, records out.
class LiveSession {
 public:
  explicit LiveSession(const nb::object& tree) : source_(tree), session_(hqp::Guarded::made(source_)) {
    const hqp::Line& line = session_->line();
    if (source_.foreign()) source_.foreign()->of(line.members(), line.rows());
    for (std::size_t m = 0; m < line.members().size(); ++m)
      index_[nb::str(line.members()[m].name.c_str())] = nb::int_(m);
    next_.resize(line.order() == 1 && line.kinematics() ? std::size_t(line.nq()) : 0);
  }
  LiveSession(const LiveSession&) = delete;

  // Take the references of the next step; return -1, or the index of the first one that does not fit, and discard it.
  int tell(const nb::tuple& references) {
    bool all = false;
    int at = 0;
    for (const nb::handle reference : references) {
      if (!take(reference, all)) return session_->forget(), at;
      ++at;
    }
    if (source_.foreign()) source_.foreign()->ask(all && session_->line().torque());
    return -1;
  }
  // Let Python fill all rows of the next step.
  void ask() {
    if (source_.foreign()) source_.foreign()->ask(true);
  }
  // Take targets by name; return false if one needs conversion.
  bool aim(const nb::dict& targets) {
    PyObject *name = nullptr, *value = nullptr;
    for (Py_ssize_t at = 0; PyDict_Next(targets.ptr(), &at, &name, &value);) {
      const hqp::Member* member = find(name);
      const hqp::Slot* slot =
          member && member->slot >= 0 ? &session_->line().slots()[std::size_t(member->slot)] : nullptr;
      if (!slot || slot->plain == hqp::Plain::kNo || value == Py_None ||
          !number(*member, *slot, 0, value, slot->shape) ||
          !turns(*slot, session_->references().numbers(std::size_t(member->slot), 0)))
        return session_->forget(), false;
    }
    if (source_.foreign()) source_.foreign()->ask(false);
    return true;
  }
  void phase(const std::string& name) { session_->phase(name); }

  // The record of a command that was sent before, see Guarded::begin.
  nb::object begin(const Vector& command, const std::optional<Vector>& q, const std::optional<Vector>& v,
                   const std::optional<Vector>& angles) {
    const hqp::Line& line = session_->line();
    const double* sent = numbers(command, session_->tick().command().size());
    const double *at = numbers(q, std::size_t(line.nq())), *speed = numbers(v, std::size_t(line.nv()));
    session_->begin(sent, at, speed, numbers(angles, std::size_t(line.nv())));
    return record(*session_, next_);
  }
  void stop(const std::string& reason) { session_->halt().stop(reason); }
  void resume() { session_->halt().resume(); }
  std::string stopped() const {
    const char* why = session_->halt().why();
    return why ? why : "";
  }
  const std::vector<double>& start() const { return session_->start(); }

  // A record; a tuple (record, status, ticks held, notes, count of notes not on joint limits) unless the tick is
  // optimal without notes.
  nb::object step(nb::handle q, nb::handle v, nb::handle time, double now, nb::handle angles, nb::handle fault) {
    hqp::Line& line = session_->line();
    const int nq = line.nq(), nv = line.nv();
    const hqp::Doubles at(q, true), speed(v, true), turned(angles.is_none() ? v : angles, true);
    if (!at.data() || !speed.data() || !at.has(&nq, 1) || !speed.has(&nv, 1))
      throw nb::type_error("q and v are vectors of doubles");
    hqp::Guarded::Told told;
    double measured = 0.0;
    if (!time.is_none()) measured = nb::cast<double>(time), told.time = &measured;
    told.now = now;
    if (!angles.is_none()) told.angles = turned.data();
    if (!fault.is_none()) told.fault = (fault_ = nb::cast<std::string>(fault)).c_str();
    const hqp::Tick* tick = nullptr;
    {
      const nb::gil_scoped_release release;
      tick = &session_->step(at.data(), speed.data(), told);
    }
    nb::object made = record(*session_, next_);
    if (tick->status() == hqp::Status::kOptimal && tick->notes().size() == 0 && tick->held() == 0) return made;
    return nb::make_tuple(made, static_cast<int>(tick->status()), tick->held(), notes(*tick), session_->plain_notes());
  }

  // Limit the change of x from `last` in place; return notes.
  nb::list limit(const hqp::RateLimiter& limiter, const Vector& last, const Written& x) {
    nb::list found;
    if (x.size() != last.size()) throw nb::value_error("x: wrong shape");
    session_->outgoing().limit(limiter, sized(last), x.data(), [&](const hqp::Note& note) { found.append(of(note)); });
    return found;
  }
  bool measure(const std::string& name, double load) {
    const hqp::Member* member = find(nb::str(name.c_str()).ptr());
    if (!member || !member->contact) return false;
    session_->contacts().measure(std::size_t(member - session_->line().members().data()), load);
    return true;
  }
  void follow(const LiveSession& other) { session_->follow(*other.session_); }
  // Hold this value until the element is left out.
  void keep_hold(const std::string& name, const Vector& value) {
    const hqp::Member* member = find(nb::str(name.c_str()).ptr());
    if (!member || member->slot < 0 || session_->line().slots()[std::size_t(member->slot)].hold.size() != value.size())
      return;
    session_->references().keep_hold(std::size_t(member->slot), value.data());
  }
  // Hold values by name, flat, of elements whose references have numbers.
  nb::dict holds() const {
    nb::dict found;
    const hqp::Line& line = session_->line();
    for (const hqp::Member& member : line.members()) {
      if (member.slot < 0 || line.slots()[std::size_t(member.slot)].elsewhere) continue;
      const std::vector<double>& hold = line.slots()[std::size_t(member.slot)].hold;
      found[nb::str(member.name.c_str())] = nb::cast(hold);
    }
    return found;
  }
  void aside() { session_->aside(); }
  void alone(const Vector& x) { session_->alone(sized(x)); }
  // Return (x, notes) of a blend that comes to rest.
  nb::tuple rest(const Vector& last, bool good, std::int64_t held, bool fit, int why) {
    const hqp::Tick& tick = session_->rest(sized(last), good, held, fit, static_cast<hqp::Status>(why));
    nb::list x;
    for (const double number : tick.x()) x.append(number);
    return nb::make_tuple(x, notes(tick));
  }
  // Run this call ahead of the solver, None for the solver alone.
  void ahead(const nb::object& call) {
    ahead_ = call;
    session_->line().ahead(call.is_none() ? nullptr : hqp::call_of(nb::cast<nb::capsule>(call)));
  }
  std::string too_large(const Vector& q, const Vector& v, const Vector& angles) {
    return session_->too_large(q.data(), v.data(), angles.data());
  }
  // Count a tick that blends two sessions, which began at that time on the clock of perf_counter [s].
  void count(double begin, bool cut, bool held, bool rejected_state, std::int64_t rejected_references) {
    session_->count({begin, hqp::Guarded::now(), cut, held, rejected_state, rejected_references});
  }
  hqp::Counts counters() const { return session_->counters().counts(); }
  std::int64_t heartbeat() const { return session_->counters().heartbeat(); }
  bool good() const { return session_->good(); }
  std::int64_t held() const { return session_->tick().held(); }
  double deadline() const { return session_->budget().deadline(); }
  double margin() const { return session_->budget().margin(); }

 private:
  const double* sized(const Vector& x) const {
    if (x.size() != std::size_t(session_->line().size())) throw nb::value_error("x: wrong shape");
    return x.data();
  }
  const hqp::Member* find(PyObject* name) const {
    PyObject* found = PyDict_GetItem(index_.ptr(), name);
    return found ? &session_->line().members()[PyLong_AsSize_t(found)] : nullptr;
  }
  bool number(const hqp::Member& member, const hqp::Slot& slot, int what, nb::handle value,
              const std::vector<int>& shape) {
    const std::size_t k = std::size_t(member.slot);
    if (what == 0 && slot.size() == 0) return true;  // Python reads its value
    if (!hqp::Doubles::copy(value, session_->references().numbers(k, what), shape.data(),
                            static_cast<int>(shape.size())))
      return false;
    session_->references().mark(k, what);
    return true;
  }
  static bool turns(const hqp::Slot& slot, const double* value) {  // true if a rotation or pose is valid
    return (slot.plain != hqp::Plain::kRotation || hqp::rotation(value, 3)) &&
           (slot.plain != hqp::Plain::kPose || hqp::pose(value));
  }
  bool take(nb::handle reference, bool& all) {
    const nb::object given = nb::steal(PyObject_GenericGetDict(reference.ptr(), nullptr));  // other fields are None
    if (!given.is_valid()) return PyErr_Clear(), false;
    const nb::handle name = field(given, fields_.name);
    const hqp::Member* member = name.is_valid() ? find(name.ptr()) : nullptr;
    if (!member) return false;
    const std::size_t m = std::size_t(member - session_->line().members().data());
    if (const nb::handle load = field(given, load_); load.is_valid()) {
      if (!member->contact) return false;
      session_->contacts().measure(m, nb::cast<double>(load));
    }
    if (const nb::handle on = field(given, on_); on.is_valid()) {
      if (member->level < 0 && member->row == member->row_end) return false;  // a load
      session_->say(m, nb::cast<bool>(on));
    }
    all = all || field(given, fields_.gravity_normal).is_valid();
    if (member->slot < 0) return true;
    const hqp::Slot& slot = session_->line().slots()[std::size_t(member->slot)];
    session_->references().forget(std::size_t(member->slot));  // an earlier reference of the same element is replaced
    const std::vector<int> rows{slot.rows}, three{3};
    const auto copy = [&](const nb::str& key, int what, const std::vector<int>& shape) {
      const nb::handle value = field(given, key);
      return !value.is_valid() || number(*member, slot, what, value, shape);
    };
    return copy(fields_.value, 0, slot.shape) && copy(fields_.velocity, 1, rows) &&
           copy(fields_.acceleration, 2, rows) && copy(fields_.normal, 3, three);
  }
  // Null if the field is None.
  static nb::handle field(nb::handle given, const nb::str& name) {
    PyObject* found = PyDict_GetItem(given.ptr(), name.ptr());
    return found == Py_None ? nullptr : found;
  }
  static nb::tuple of(const hqp::Note& note) {
    return nb::make_tuple(nb::str(note.element), static_cast<int>(note.status), nb::cast(note.text()));
  }
  static nb::list notes(const hqp::Tick& tick) {
    nb::list found;
    for (const hqp::Note& note : tick.notes()) found.append(of(note));
    return found;
  }

  LiveSource source_;
  std::unique_ptr<hqp::Guarded> session_;
  nb::dict index_;
  hqp::ReferenceFields fields_;
  nb::str load_{"load"}, on_{"on"};
  std::string fault_;
  nb::object ahead_;
  std::vector<double> next_;
};

}  // namespace binding
