// A session over the arrays of a program in Python: its parts are the program's own, references and ticks are Python's
// objects.
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
#include "guarded.hpp"

namespace binding {

// What of a tick is written in Python, by the methods of an object of hqp/loop/callbacks.py.
class Callbacks final : public hqp::Foreign {
 public:
  Callbacks(nb::object self, int n, std::size_t rows, const std::vector<hqp::Member>* members)
      : self_(std::move(self)), x_(std::size_t(n)), slack_(rows), marks_(rows), members_(members) {
    always_ = fills = nb::cast<bool>(self_.attr("fills"));
    writes = nb::cast<bool>(self_.attr("writes"));
    judges = nb::cast<bool>(self_.attr("judges"));
  }
  // Whether this tick has what only fill() knows.
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
  hqp::Answered answered(const nb::object& told) {
    const nb::tuple p = nb::cast<nb::tuple>(told);
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

// What a live session is made of: the tree of hqp/loop/document.py, with the parts of its program.
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

// The tick of a live session: references in, a record out.
class LiveSession {
 public:
  explicit LiveSession(const nb::object& tree) : source_(tree), session_(hqp::Guarded::made(source_)) {
    const hqp::Line& line = session_->line();
    if (source_.foreign()) source_.foreign()->of(line.members(), line.rows());
    for (std::size_t m = 0; m < line.members().size(); ++m)
      index_[nb::str(line.members()[m].name.c_str())] = nb::int_(m);
    moved_.resize(line.order() == 1 && line.kinematics() ? std::size_t(line.nq()) : 0);
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
  // All rows of the next step are filled in Python.
  void ask() {
    if (source_.foreign()) source_.foreign()->ask(true);
  }
  // The same of targets alone, by name, that are taken as they are; false for one that is not.
  bool aim(const nb::dict& targets) {
    PyObject *name = nullptr, *value = nullptr;
    for (Py_ssize_t at = 0; PyDict_Next(targets.ptr(), &at, &name, &value);) {
      const hqp::Member* member = find(name);
      const hqp::Slot* slot =
          member && member->slot >= 0 ? &session_->line().slots()[std::size_t(member->slot)] : nullptr;
      if (!slot || slot->plain == hqp::Plain::kNo || value == Py_None ||
          !number(*member, *slot, 0, value, slot->shape) ||
          !turns(*slot, session_->numbers(std::size_t(member->slot), 0)))
        return session_->forget(), false;
    }
    if (source_.foreign()) source_.foreign()->ask(false);
    return true;
  }
  void phase(const std::string& name) { session_->phase(name); }

  // A record: [command, x, the solver's x, slacks, begin, seconds for rows and for the solver, iterations,
  // factorisations, its status, q, v and, at velocity level, where q comes to], points of stages, marks, 1 for an
  // answer of the solver + 2 for stages; with (status, ticks held, notes, how many of them are not on limits of joints)
  // where there is more to say than that it is optimal.
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
    nb::object made = record(*tick);
    if (tick->status() == hqp::Status::kOptimal && tick->notes().size() == 0 && tick->held() == 0) return made;
    return nb::make_tuple(made, static_cast<int>(tick->status()), tick->held(), notes(*tick), session_->plain_notes());
  }

  // Notes on x where it goes no further from `last` than a limiter allows: it is changed.
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
  // Held from now on until the element is left out.
  void keep_hold(const std::string& name, const Vector& value) {
    const hqp::Member* member = find(nb::str(name.c_str()).ptr());
    if (!member || member->slot < 0 || session_->line().slots()[std::size_t(member->slot)].hold.size() != value.size())
      return;
    session_->keep_hold(std::size_t(member->slot), value.data());
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
  // (x, notes) of a tick of a blend that comes to rest.
  nb::tuple rest(const Vector& last, bool good, std::int64_t held, bool fit, int why) {
    const hqp::Tick& tick = session_->rest(sized(last), good, held, fit, static_cast<hqp::Status>(why));
    nb::list x;
    for (const double number : tick.x()) x.append(number);
    return nb::make_tuple(x, notes(tick));
  }
  // A call that runs ahead of the solver, and it, as its own; None for the solver alone.
  void ahead(const nb::object& call) {
    ahead_ = call;
    session_->line().ahead(call.is_none() ? nullptr : hqp::call_of(nb::cast<nb::capsule>(call)));
  }
  std::string too_large(const Vector& q, const Vector& v, const Vector& angles) {
    return session_->too_large(q.data(), v.data(), angles.data());
  }
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
    if (what == 0 && slot.size() == 0) return true;  // its value is Python's to read
    if (!hqp::Doubles::copy(value, session_->numbers(k, what), shape.data(), static_cast<int>(shape.size())))
      return false;
    session_->told(k, what);
    return true;
  }
  static bool turns(const hqp::Slot& slot, const double* value) {  // whether what has to be a rotation is one
    return (slot.plain != hqp::Plain::kRotation || hqp::rotation(value, 3)) &&
           (slot.plain != hqp::Plain::kPose || hqp::pose(value));
  }
  bool take(nb::handle reference, bool& all) {
    const nb::object given = nb::steal(PyObject_GenericGetDict(reference.ptr(), nullptr));  // the rest is None
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
    session_->forget(std::size_t(member->slot));  // an earlier reference of the same element is replaced
    const std::vector<int> rows{slot.rows}, three{3};
    const auto copy = [&](const nb::str& key, int what, const std::vector<int>& shape) {
      const nb::handle value = field(given, key);
      return !value.is_valid() || number(*member, slot, what, value, shape);
    };
    return copy(fields_.value, 0, slot.shape) && copy(fields_.velocity, 1, rows) &&
           copy(fields_.acceleration, 2, rows) && copy(fields_.normal, 3, three);
  }
  // Null for None, too.
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

  nb::object record(const hqp::Tick& tick) {
    hqp::Line& line = session_->line();
    const hqp::Answered* answer = session_->answered();
    const std::size_t n = std::size_t(line.size()), rows = line.rows(), points = answer ? answer->point_count : 0;
    const std::size_t numbers =
        tick.command().size() + 2 * n + rows + 6 + session_->q().size() + session_->v().size() + moved_.size() + points;
    const nb::object made =
        nb::steal(PyByteArray_FromStringAndSize(nullptr, static_cast<Py_ssize_t>(sizeof(double) * numbers + rows + 1)));
    if (!made.is_valid()) nb::raise_python_error();
    double* out = reinterpret_cast<double*>(PyByteArray_AsString(made.ptr()));
    out = std::copy(tick.command().begin(), tick.command().end(), out);
    out = std::copy(tick.x().begin(), tick.x().end(), out);
    if (answer) {
      out = std::copy(answer->x, answer->x + n, out);
      out = std::copy(answer->slack, answer->slack + rows, out);
    } else {
      std::fill(out, out + n + rows, 0.0);
      out += n + rows;
    }
    for (const double number :
         {session_->begun(), session_->filling(), session_->solving(), answer ? double(answer->iterations) : 0.0,
          answer ? double(answer->factorisations) : 0.0, answer ? double(static_cast<int>(answer->status)) : 0.0})
      *out++ = number;
    out = std::copy(session_->q().begin(), session_->q().end(), out);
    out = std::copy(session_->v().begin(), session_->v().end(), out);
    if (!moved_.empty()) {
      line.kinematics()->integrate(session_->q().data(), tick.x().data(), line.dt(), moved_.data());
      out = std::copy(moved_.begin(), moved_.end(), out);
    }
    if (points) out = std::copy(answer->points, answer->points + points, out);
    std::int8_t* marks = reinterpret_cast<std::int8_t*>(out);
    if (answer) std::copy(answer->marks, answer->marks + rows, marks);
    else std::fill(marks, marks + rows, std::int8_t(0));
    marks[rows] = static_cast<std::int8_t>((answer ? 1 : 0) + (points ? 2 : 0));
    return made;
  }

  LiveSource source_;
  std::unique_ptr<hqp::Guarded> session_;
  nb::dict index_;
  hqp::ReferenceFields fields_;
  nb::str load_{"load"}, on_{"on"};
  std::string fault_;
  nb::object ahead_;
  std::vector<double> moved_;
};

}  // namespace binding
