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
#include <nanobind/stl/optional.h>

#include "../common/capsule.hpp"
#include "../rows/live_plan.hpp"
#include "../rows/loop.hpp"
#include "callbacks.hpp"
#include "guarded.hpp"
#include "record.hpp"
#include "transition.hpp"

namespace binding {

// Numbers of a vector of that size, null for None.
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

// A state from Python.  time: its time, or None; now: time of the tick [s]; angles: joints of q if native
// kinematics do not know all, or None; fault: reason why the state is not valid, or None.
class GivenState {
 public:
  GivenState(const hqp::Line& line, nb::handle q, nb::handle v, nb::handle time, double now, nb::handle angles,
             nb::handle fault)
      : q_(q, true), v_(v, true), angles_(angles.is_none() ? v : angles, true) {
    const int nq = line.nq(), nv = line.nv();
    if (!q_.data() || !v_.data() || !q_.has(&nq, 1) || !v_.has(&nv, 1))
      throw nb::type_error("q and v are vectors of doubles");
    if (!time.is_none()) measured_ = nb::cast<double>(time), facts.time = &measured_;
    facts.now = now;
    if (!angles.is_none()) facts.angles = angles_.data();
    if (!fault.is_none()) facts.fault = (fault_ = nb::cast<std::string>(fault)).c_str();
  }
  const double* q() const { return q_.data(); }
  const double* v() const { return v_.data(); }

  hqp::StateFacts facts;

 private:
  hqp::Doubles q_, v_, angles_;
  double measured_ = 0.0;
  std::string fault_;
};

// A live session: references in, records out.
class LiveSession {
 public:
  explicit LiveSession(const nb::object& tree) : source_(tree), session_(hqp::made<hqp::Guarded>(source_)) {
    const hqp::Line& line = session_->line();
    if (source_.foreign()) source_.foreign()->of(line.members(), line.rows());
    for (std::size_t m = 0; m < line.members().size(); ++m)
      index_[nb::str(line.members()[m].name.c_str())] = nb::int_(m);
    next_.resize(line.order() == 1 && line.kinematics() ? std::size_t(line.nq()) : 0);
  }
  LiveSession(const LiveSession&) = delete;

  // Take the references of the next step; return -1, or the index of the first one that does not fit, and discard it.
  int take_references(const nb::tuple& references) {
    bool all = false;
    int at = 0;
    for (const nb::handle reference : references) {
      if (!take(reference, all)) return session_->inputs().forget(), at;
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
          !turns(*slot, session_->inputs().references().numbers(std::size_t(member->slot), 0)))
        return session_->inputs().forget(), false;
    }
    if (source_.foreign()) source_.foreign()->ask(false);
    return true;
  }
  void phase(const std::string& name) { session_->inputs().phase(name); }

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
  const std::vector<double>& start() const { return session_->latest().start; }

  // A record; a tuple (record, status, ticks held, notes, count of notes not on joint limits) unless the tick is
  // optimal without notes.
  nb::object step(nb::handle q, nb::handle v, nb::handle time, double now, nb::handle angles, nb::handle fault) {
    const GivenState given(session_->line(), q, v, time, now, angles, fault);
    {
      const nb::gil_scoped_release release;
      session_->step(given.q(), given.v(), given.facts);
    }
    return outcome();
  }
  // Record or tuple for the latest tick.
  nb::object outcome() {
    const hqp::Tick& tick = session_->tick();
    nb::object made = record(*session_, next_);
    if (tick.status() == hqp::Status::kOptimal && tick.notes().size() == 0 && tick.held() == 0) return made;
    return nb::make_tuple(made, static_cast<int>(tick.status()), tick.held(), notes(tick.notes()),
                          session_->plain_notes());
  }
  void follow(const LiveSession& other) { session_->follow(*other.session_, other.session_->latest().x.data()); }
  // Hold this value until the element is left out.
  void keep_hold(const std::string& name, const Vector& value) {
    const hqp::Member* member = find(nb::str(name.c_str()).ptr());
    if (!member || member->slot < 0 || session_->line().slots()[std::size_t(member->slot)].hold.size() != value.size())
      return;
    session_->inputs().references().keep_hold(std::size_t(member->slot), value.data());
  }
  // Hold values by name, flat, of elements that have one so far.
  nb::dict holds() const {
    nb::dict found;
    const hqp::Line& line = session_->line();
    for (const hqp::Member& member : line.members()) {
      if (member.slot < 0 || line.slots()[std::size_t(member.slot)].elsewhere) continue;
      if (const std::vector<double>* hold = session_->inputs().references().held(member.name))
        found[nb::str(member.name.c_str())] = nb::cast(*hold);
    }
    return found;
  }
  std::string too_large(const Vector& q, const Vector& v, const Vector& angles) {
    return session_->too_large(q.data(), v.data(), angles.data());
  }
  // Acceleration of each coordinate under these torques, by the dynamics of the latest tick.
  void acceleration(const Vector& torques, const Written& found) const {
    const hqp::TorqueParts* parts = session_->line().torque();
    if (!parts || torques.size() != parts->motors() || found.size() != parts->coordinates())
      throw nb::value_error("the torques or accelerations of a line at torque level: wrong shape");
    for (std::size_t i = 0; i < found.size(); ++i) found.data()[i] = parts->acceleration(i, torques.data());
  }
  void weigh(double heavier) { session_->line().assembly().weigh(heavier); }
  hqp::Counts counters() const { return session_->timing().counters().counts(); }
  std::int64_t heartbeat() const { return session_->timing().counters().heartbeat(); }
  bool good() const { return session_->latest().good; }
  std::int64_t held() const { return session_->tick().held(); }
  double deadline() const { return session_->timing().budget().deadline(); }
  double margin() const { return session_->timing().budget().margin(); }
  hqp::Guarded& get() { return *session_; }

  template <class Some>
  static nb::list notes(const Some& given) {
    nb::list found;
    for (const hqp::Note& note : given)
      found.append(nb::make_tuple(nb::str(note.element), static_cast<int>(note.status), nb::cast(note.text())));
    return found;
  }

 private:
  const hqp::Member* find(PyObject* name) const {
    PyObject* found = PyDict_GetItem(index_.ptr(), name);
    return found ? &session_->line().members()[PyLong_AsSize_t(found)] : nullptr;
  }
  bool number(const hqp::Member& member, const hqp::Slot& slot, int what, nb::handle value,
              const std::vector<int>& shape) {
    const std::size_t k = std::size_t(member.slot);
    if (what == 0 && slot.size() == 0) return true;  // Python reads its value
    if (!hqp::Doubles::copy(value, session_->inputs().references().numbers(k, what), shape.data(),
                            static_cast<int>(shape.size())))
      return false;
    session_->inputs().references().mark(k, what);
    session_->inputs().name(std::size_t(&member - session_->line().members().data()));
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
    session_->inputs().name(m);
    if (const nb::handle load = field(given, load_); load.is_valid()) {
      if (!member->contact) return false;
      session_->inputs().contacts().measure(m, nb::cast<double>(load));
    }
    if (const nb::handle on = field(given, on_); on.is_valid()) {
      if (member->level < 0 && member->row == member->row_end) return false;  // a load
      session_->inputs().say(m, nb::cast<bool>(on));
    }
    all = all || field(given, fields_.gravity_normal).is_valid();
    if (member->slot < 0) return true;
    const hqp::Slot& slot = session_->line().slots()[std::size_t(member->slot)];
    session_->inputs().references().forget(
        std::size_t(member->slot));  // an earlier reference of the same element is replaced
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
  LiveSource source_;
  std::unique_ptr<hqp::Guarded> session_;
  nb::dict index_;
  hqp::ReferenceFields fields_;
  nb::str load_{"load"}, on_{"on"};
  std::vector<double> next_;
};

// A transition between live sessions; `owner` (hqp/loop/transition.py) hears of each tick of a stack.
class LiveTransition final : public hqp::Transition::Hooks {
 public:
  // sessions: one for each stack on the way; the owner keeps them and the transition that is under way to the first.
  LiveTransition(const nb::list& sessions, const nb::object& way, double ticks, LiveTransition* under_way,
                 nb::handle owner)
      : owner_(owner), way_(LivePlan(way, kept_)) {
    std::vector<hqp::Guarded*> stacks;
    for (const nb::handle one : sessions) {
      sessions_.push_back(nb::cast<LiveSession*>(one));
      stacks.push_back(&sessions_.back()->get());
    }
    transition_ = std::make_unique<hqp::Transition>(std::move(stacks), way_, ticks,
                                                    under_way ? under_way->transition_.get() : nullptr, *this);
  }
  LiveTransition(const LiveTransition&) = delete;

  void measure(const std::string& name, double load) { transition_->measure(name, load); }
  void step(nb::handle q, nb::handle v, nb::handle time, double now, nb::handle angles, nb::handle fault) {
    const GivenState given(sessions_[0]->get().line(), q, v, time, now, angles, fault);
    const nb::gil_scoped_release release;
    transition_->step(given.q(), given.v(), given.facts);
  }
  void begin() { transition_->begin_sent(); }
  void end() { transition_->end(); }
  void pass_on(LiveSession& other) const { transition_->pass_on(other.get()); }
  int depth() const { return transition_->depth(); }
  double progress() const { return transition_->progress(); }

 private:
  void begins(std::size_t first, std::size_t second, bool arriving) override {
    const nb::gil_scoped_acquire held;
    owner_.attr("begins")(first, second, arriving);
  }
  void before(std::size_t k) override {
    const nb::gil_scoped_acquire held;
    owner_.attr("before")(k);
  }
  void after(std::size_t k) override {
    const nb::gil_scoped_acquire held;
    owner_.attr("after")(k, sessions_[k]->outcome());
  }
  void sent() override {
    const nb::gil_scoped_acquire held;
    const hqp::Transition::Sent& sent = transition_->sent();
    const hqp::Tick& tick = transition_->tick();
    owner_.attr("sent")(nb::make_tuple(sent.first, sent.second), sent.stack,
                        nb::bytes(tick.x().data(), tick.x().size() * sizeof(double)), static_cast<int>(tick.status()),
                        LiveSession::notes(sent.waits), LiveSession::notes(sent.limited), tick.held(), sent.done);
  }

  std::vector<nb::object> kept_;
  nb::handle owner_;  // it owns this object
  hqp::Way way_;
  std::vector<LiveSession*> sessions_;
  std::unique_ptr<hqp::Transition> transition_;
};

}  // namespace binding
