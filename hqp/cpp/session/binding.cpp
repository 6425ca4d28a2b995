// Python's view of a session from a file: numbers in, numbers out.
#include <cstdlib>
#include <string>
#include <tuple>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "../policies/binding.hpp"
#include "../policies/filters.hpp"
#include "../walking/binding.hpp"
#include "../walking/walkers.hpp"
#include "batch.hpp"
#include "live.hpp"
#include "node.hpp"
#include "parts_alone.hpp"
#include "session.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Out = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using hqp::NoteRecord;

// As hqp.loop.counters.Counters lists them.
nb::tuple counters_of(const hqp::Counts& c) {
  return nb::make_tuple(c.ticks, c.late, c.cut, c.held, c.rejected_states, c.rejected_references, c.longest_gap,
                        c.worst_time);
}

std::string text(const nb::bytes& given) { return {given.c_str(), given.size()}; }

class Session {
 public:
  explicit Session(const nb::bytes& file, const nb::bytes& key)
      : session_(std::make_shared<const hqp::Plan>(text(file), text(key))) {
    for (const std::string& name : session_.names()) references_.push_back(session_.reference(name));
  }

  // command, x, residuals: written; the status, for how many ticks the command has been coming to rest, the notes, and
  // the number of levels.
  std::tuple<int, long, std::vector<NoteRecord>, std::size_t> step(const Vector& q, const Vector& v, const Out& command,
                                                                   const Out& x, const Out& residuals,
                                                                   std::optional<double> time, double now) {
    require(q.size() == std::size_t(session_.nq()) && v.size() == std::size_t(session_.nv()), "q or v");
    const auto [motors, variables, levels] = sizes();
    require(command.size() == motors && x.size() == variables && residuals.size() == levels, "command, x or residuals");
    {
      const nb::gil_scoped_release release;
      if (time) session_.step(q.data(), v.data(), *time, now);
      else session_.step(q.data(), v.data());
    }
    const hqp::Tick& tick = session_.tick();
    std::copy(tick.command().begin(), tick.command().end(), command.data());
    std::copy(tick.x().begin(), tick.x().end(), x.data());
    std::copy(tick.residuals().begin(), tick.residuals().end(), residuals.data());
    return {static_cast<int>(tick.status()), static_cast<long>(tick.held()), hqp::records(tick),
            tick.residuals().size()};
  }
  std::tuple<std::size_t, std::size_t, std::size_t> sizes() const {
    const hqp::Tick& tick = session_.tick();
    return {tick.command().size(), tick.x().size(), session_.levels()};
  }
  void begin(const Vector& command, const std::optional<Vector>& q, const std::optional<Vector>& v) {
    require(command.size() == session_.tick().command().size(), "command");
    require(!q || q->size() == std::size_t(session_.nq()), "q");
    require(!v || v->size() == std::size_t(session_.nv()), "v");
    session_.begin(command.data(), q ? q->data() : nullptr, v ? v->data() : nullptr);
  }
  void change(const std::string& stack, double over) { session_.change(stack, over); }
  std::vector<std::string> names() const { return session_.names(); }

  // what: 0 value, 1 velocity, 2 acceleration, 3 normal, 4 load, 5 hold value.
  void set_reference(std::size_t k, int what, const Vector& values) {
    require(k < references_.size() && what >= 0 && what <= 5, "reference");
    hqp::Reference& reference = references_[k];
    if (what == 0) reference.at(values.data(), values.size());
    if (what == 1) reference.velocity(values.data(), values.size());
    if (what == 2) reference.acceleration(values.data(), values.size());
    if (what == 3) require(values.size() == 3, "normal"), reference.normal(values.data());
    if (what == 4) require(values.size() == 1, "load"), reference.load(values(0));
    if (what == 5) reference.hold(values.data(), values.size());
  }
  void say(std::size_t k, bool in) {
    require(k < references_.size(), "reference");
    references_[k].on(in);
  }
  void phase(const std::string& name) { session_.phase(name); }
  std::vector<double> held(std::size_t k) const {
    require(k < references_.size(), "reference");
    return references_[k].held();
  }
  void integrate(const Vector& q, const Vector& v, double dt, const Out& out) const {
    const std::size_t nq = std::size_t(session_.nq());
    require(q.size() == nq && out.size() == nq && v.size() == std::size_t(session_.nv()), "q or v");
    session_.integrate(q.data(), v.data(), dt, out.data());
  }
  void stop(const std::string& reason) { session_.stop(reason); }
  void resume() { session_.resume(); }
  const hqp::Session& get() const { return session_; }
  void reset() { session_.reset(); }

 private:
  static void require(bool fits, const char* what) {
    if (!fits) throw nb::value_error((std::string(what) + ": wrong shape").c_str());
  }

  hqp::Session session_;
  std::vector<hqp::Reference> references_;
};

using Table = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using OutTable = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Statuses = nb::ndarray<std::int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// Worlds over threads: sessions alone, with walkers or with filters.
template <class Many>
class WorldsOf {
 public:
  WorldsOf(const nb::bytes& file, std::size_t count, std::size_t threads, const nb::bytes& key)
      : many_(std::make_shared<const hqp::Plan>(text(file), text(key)), count, threads) {}
  WorldsOf(const WorldsOf&) = delete;

  void reset(std::size_t i) { many_.reset(checked(i)); }
  // Lengths of command and x, and number of levels.
  std::tuple<std::size_t, std::size_t, std::size_t> sizes() {
    const hqp::Stacks& session = many_.batch().session();
    return {session.tick().command().size(), session.tick().x().size(), session.levels()};
  }
  std::tuple<int, int> state() {
    const hqp::Line& line = many_.batch().session().current().line();
    return {line.nq(), line.nv()};
  }
  std::size_t count() { return many_.batch().count(); }
  std::size_t threads() { return many_.batch().threads(); }
  nb::tuple counters() { return counters_of(many_.batch().counters()); }

 protected:
  std::size_t checked(std::size_t i) {
    if (i >= count())
      throw nb::index_error(("world " + std::to_string(i) + ", allowed 0 to " + std::to_string(count() - 1)).c_str());
    return i;
  }
  template <class Table>
  bool fits(const Table& table, std::size_t width) {
    return table.shape(0) == count() && table.shape(1) == width;
  }
  // Throw unless each array has a row for each world.
  void require(const Table& q, const Table& v, const OutTable& commands, const Statuses& status,
               const OutTable& residuals, const OutTable& x, bool others = true) {
    const auto [motors, variables, levels] = sizes();
    const auto [nq, nv] = state();
    if (!fits(q, std::size_t(nq)) || !fits(v, std::size_t(nv)) || !fits(commands, motors) || !fits(residuals, levels) ||
        !fits(x, variables) || status.shape(0) != count() || !others)
      throw nb::value_error("an array has the wrong number of worlds or columns");
  }

  Many many_;
};

class Worlds : public WorldsOf<hqp::Batch> {
 public:
  using WorldsOf::WorldsOf;

  // Notes of the worlds, if they are wanted.
  std::vector<std::vector<NoteRecord>> step(const Table& q, const Table& v,
                                            const std::vector<std::tuple<std::string, int, Table>>& targets,
                                            const OutTable& commands, const Statuses& status, const OutTable& residuals,
                                            const OutTable& x, bool noted) {
    require(q, v, commands, status, residuals, x);
    const hqp::Stacks& session = many_.session();
    std::vector<hqp::BatchTarget> converted;
    for (const auto& [name, what, values] : targets) {
      const std::size_t element = session.element(name), size = session.width(element, what);
      if (!fits(values, size))
        throw hqp::ReferenceError(name + ": targets must have shape (" + std::to_string(count()) + ", " +
                                  std::to_string(size) + "), given (" + std::to_string(values.shape(0)) + ", " +
                                  std::to_string(values.shape(1)) + ")");
      converted.push_back({element, what, values.data(), size});
    }
    std::vector<std::vector<NoteRecord>> notes(noted ? count() : 0);
    const nb::gil_scoped_release release;
    many_.step(q.data(), v.data(), converted, commands.data(), status.data(), residuals.data(), x.data(),
               noted ? notes.data() : nullptr);
    return notes;
  }
  void begin(std::size_t i, const Vector& command, const std::optional<Vector>& q, const std::optional<Vector>& v) {
    const auto [nq, nv] = state();
    if (command.size() != std::get<0>(sizes()) || (q && q->size() != std::size_t(nq)) ||
        (v && v->size() != std::size_t(nv)))
      throw nb::value_error("command, q or v: wrong shape");
    many_.change(checked(i), [&](hqp::Stacks& session) {
      session.begin(command.data(), q ? q->data() : nullptr, v ? v->data() : nullptr);
    });
  }
  void change(std::size_t i, const std::string& stack, double over) {
    many_.change(checked(i), [&](hqp::Stacks& session) { session.change(stack, over); });
  }
  void stop(std::size_t i, const std::string& reason) { many_.stop(checked(i), reason); }
  void resume(std::size_t i) { many_.resume(checked(i)); }
  // q + dt v of all worlds, out may be q.
  void integrate(const Table& q, const Table& v, double dt, const OutTable& out) {
    const hqp::Line& line = many_.session().current().line();
    const std::size_t nq = std::size_t(line.nq()), nv = std::size_t(line.nv());
    if (!fits(q, nq) || !fits(v, nv) || !fits(out, nq))
      throw nb::value_error("an array has the wrong number of worlds or columns");
    for (std::size_t i = 0; i < count(); ++i)
      line.kinematics()->integrate(q.data() + i * nq, v.data() + i * nv, dt, out.data() + i * nq);
  }
  const char* kind() {
    const hqp::Line& line = many_.session().current().line();
    return line.torque() ? "torque" : line.order() == 1 ? "velocity" : "acceleration";
  }
  std::size_t bytes() const { return many_.bytes(); }
};

class WalkingWorlds : public WorldsOf<hqp::Walkers> {
 public:
  using WorldsOf::WorldsOf;
  using Place = std::tuple<int, double, double, double, double>;  // side, x, y, z, yaw

  void step(const Table& q, const Table& v, const std::optional<Table>& loads, const OutTable& commands,
            const Statuses& status, const OutTable& residuals, const OutTable& x) {
    require(q, v, commands, status, residuals, x, !loads || fits(*loads, 2));
    const nb::gil_scoped_release release;
    many_.step(q.data(), v.data(), loads ? loads->data() : nullptr, commands.data(),
               {status.data(), residuals.data(), x.data()});
  }
  void go(std::size_t i, double forward, double left, double turn) { many_.go(checked(i), {forward, left, turn}); }
  void follow(std::size_t i, const std::vector<Place>& wanted) {
    std::vector<hqp::Foothold> found;
    for (const auto& [side, x, y, z, yaw] : wanted) found.push_back({side, x, y, z, yaw});
    many_.follow(checked(i), found);
  }
  void stop(std::size_t i) { many_.stop(checked(i)); }
  void halt(std::size_t i, const std::string& reason) { many_.halt(checked(i), reason); }
  void resume(std::size_t i) { many_.resume(checked(i)); }
  std::vector<std::string> why(std::size_t i) { return many_.walker(checked(i)).why(); }
  std::vector<int> phases() {
    std::vector<int> found;
    for (std::size_t i = 0; i < count(); ++i) found.push_back(int(many_.walker(i).state().phase));
    return found;
  }
  std::vector<std::string> supports() {
    std::vector<std::string> found;
    for (std::size_t i = 0; i < count(); ++i) found.emplace_back(many_.walker(i).support());
    return found;
  }
  std::vector<std::tuple<double, double, double>> velocities() {
    std::vector<std::tuple<double, double, double>> found;
    for (std::size_t i = 0; i < count(); ++i) {
      const hqp::Command& command = many_.walker(i).state().command;
      found.emplace_back(command.forward, command.left, command.turn);
    }
    return found;
  }
};

class FilteredWorlds : public WorldsOf<hqp::Filters> {
 public:
  using WorldsOf::WorldsOf;

  void step(const Table& q, const Table& v, const Table& policy, const OutTable& commands, const Statuses& status,
            const OutTable& residuals, const OutTable& x) {
    require(q, v, commands, status, residuals, x, fits(policy, std::get<0>(sizes())));
    const nb::gil_scoped_release release;
    many_.step(q.data(), v.data(), policy.data(), commands.data(), {status.data(), residuals.data(), x.data()});
  }
  void stop(std::size_t i, const std::string& reason) { many_.batch().stop(checked(i), reason); }
  void resume(std::size_t i) { many_.batch().resume(checked(i)); }
};

}  // namespace

NB_MODULE(_session, module) {
  module.doc() = "Sessions from a file, and the checks of states and commands of every session.";
  nb::set_leak_warnings(std::getenv("HQP_LEAK_WARNINGS") != nullptr);  // a script may end anyhow
  nb::exception<hqp::PlanError>(module, "PlanError");
  nb::exception<hqp::ReferenceError>(module, "ReferenceError", PyExc_ValueError);
  binding::bind_parts(module);
  binding::bind_walking(module);
  binding::bind_policies(module);
  nb::class_<binding::LiveSession>(module, "Live")
      .def(nb::init<const nb::object&>(), "tree"_a)
      .def("take_references", &binding::LiveSession::take_references, "references"_a)
      .def("ask", &binding::LiveSession::ask)
      .def("aim", &binding::LiveSession::aim, "targets"_a)
      .def("phase", &binding::LiveSession::phase, "name"_a)
      .def("stop", &binding::LiveSession::stop, "reason"_a)
      .def("resume", &binding::LiveSession::resume)
      .def_prop_ro("stopped", &binding::LiveSession::stopped)
      .def("begin", &binding::LiveSession::begin, "command"_a, "q"_a.none(), "v"_a.none(), "angles"_a.none())
      .def("step", &binding::LiveSession::step, "q"_a, "v"_a, "time"_a.none(), "now"_a, "angles"_a.none(),
           "fault"_a.none())
      .def("follow", &binding::LiveSession::follow, "other"_a)
      .def("keep_hold", &binding::LiveSession::keep_hold, "name"_a, "value"_a)
      .def("holds", &binding::LiveSession::holds)
      .def("too_large", &binding::LiveSession::too_large, "q"_a, "v"_a, "angles"_a)
      .def("acceleration", &binding::LiveSession::acceleration, "torques"_a, "found"_a)
      .def("weigh", &binding::LiveSession::weigh, "heavier"_a)
      .def_prop_ro("counters", [](const binding::LiveSession& s) { return counters_of(s.counters()); })
      .def_prop_ro("heartbeat", &binding::LiveSession::heartbeat)
      .def_prop_ro("good", &binding::LiveSession::good)
      .def_prop_ro("start", &binding::LiveSession::start)
      .def_prop_ro("held", &binding::LiveSession::held)
      .def_prop_ro("deadline", &binding::LiveSession::deadline)
      .def_prop_ro("margin", &binding::LiveSession::margin);
  nb::class_<binding::LiveTransition> transition(module, "Transition");
  transition
      .def(nb::init<const nb::list&, const nb::object&, double, binding::LiveTransition*, nb::handle>(), "sessions"_a,
           "way"_a, "ticks"_a, "under_way"_a.none(), "owner"_a)
      .def("measure", &binding::LiveTransition::measure, "name"_a, "load"_a)
      .def("step", &binding::LiveTransition::step, "q"_a, "v"_a, "time"_a.none(), "now"_a, "angles"_a.none(),
           "fault"_a.none())
      .def("begin", &binding::LiveTransition::begin)
      .def("end", &binding::LiveTransition::end)
      .def("pass_on", &binding::LiveTransition::pass_on, "session"_a)
      .def_prop_ro("depth", &binding::LiveTransition::depth)
      .def_prop_ro("progress", &binding::LiveTransition::progress);
  transition.attr("DEEPEST") = hqp::Transition::kDeepest;
  nb::class_<Worlds>(module, "Batch")
      .def(nb::init<const nb::bytes&, std::size_t, std::size_t, const nb::bytes&>(), "file"_a, "count"_a, "threads"_a,
           "key"_a)
      .def("step", &Worlds::step, "q"_a, "v"_a, "targets"_a, "commands"_a.noconvert(), "status"_a.noconvert(),
           "residuals"_a.noconvert(), "x"_a.noconvert(), "noted"_a)
      .def("reset", &Worlds::reset, "world"_a)
      .def("change", &Worlds::change, "world"_a, "stack"_a, "over"_a)
      .def("stop", &Worlds::stop, "world"_a, "reason"_a)
      .def("resume", &Worlds::resume, "world"_a)
      .def("begin", &Worlds::begin, "world"_a, "command"_a, "q"_a.none(), "v"_a.none())
      .def("integrate", &Worlds::integrate, "q"_a, "v"_a, "dt"_a, "out"_a.noconvert())
      .def_prop_ro("counters", &Worlds::counters)
      .def_prop_ro("kind", &Worlds::kind)
      .def_prop_ro("sizes", &Worlds::sizes)
      .def_prop_ro("state", &Worlds::state)
      .def_prop_ro("threads", &Worlds::threads)
      .def_prop_ro("bytes", &Worlds::bytes);
  nb::class_<WalkingWorlds>(module, "Walkers")
      .def(nb::init<const nb::bytes&, std::size_t, std::size_t, const nb::bytes&>(), "file"_a, "count"_a, "threads"_a,
           "key"_a)
      .def("step", &WalkingWorlds::step, "q"_a, "v"_a, "loads"_a.none(), "commands"_a.noconvert(),
           "status"_a.noconvert(), "residuals"_a.noconvert(), "x"_a.noconvert())
      .def("go", &WalkingWorlds::go, "world"_a, "forward"_a, "left"_a, "turn"_a)
      .def("follow", &WalkingWorlds::follow, "world"_a, "footholds"_a)
      .def("stop", &WalkingWorlds::stop, "world"_a)
      .def("halt", &WalkingWorlds::halt, "world"_a, "reason"_a)
      .def("resume", &WalkingWorlds::resume, "world"_a)
      .def("reset", &WalkingWorlds::reset, "world"_a)
      .def("why", &WalkingWorlds::why, "world"_a)
      .def_prop_ro("phases", &WalkingWorlds::phases)
      .def_prop_ro("supports", &WalkingWorlds::supports)
      .def_prop_ro("velocities", &WalkingWorlds::velocities)
      .def_prop_ro("sizes", &WalkingWorlds::sizes)
      .def_prop_ro("state", &WalkingWorlds::state)
      .def_prop_ro("threads", &WalkingWorlds::threads)
      .def_prop_ro("counters", &WalkingWorlds::counters);
  nb::class_<FilteredWorlds>(module, "Filters")
      .def(nb::init<const nb::bytes&, std::size_t, std::size_t, const nb::bytes&>(), "file"_a, "count"_a, "threads"_a,
           "key"_a)
      .def("step", &FilteredWorlds::step, "q"_a, "v"_a, "policy"_a, "commands"_a.noconvert(), "status"_a.noconvert(),
           "residuals"_a.noconvert(), "x"_a.noconvert())
      .def("stop", &FilteredWorlds::stop, "world"_a, "reason"_a)
      .def("resume", &FilteredWorlds::resume, "world"_a)
      .def("reset", &FilteredWorlds::reset, "world"_a)
      .def_prop_ro("sizes", &FilteredWorlds::sizes)
      .def_prop_ro("state", &FilteredWorlds::state)
      .def_prop_ro("threads", &FilteredWorlds::threads)
      .def_prop_ro("counters", &FilteredWorlds::counters);
  nb::class_<Session>(module, "Session")
      .def(nb::init<const nb::bytes&, const nb::bytes&>(), "file"_a, "key"_a)
      .def("step", &Session::step, "q"_a, "v"_a, "command"_a.noconvert(), "x"_a.noconvert(), "residuals"_a.noconvert(),
           "time"_a.none(), "now"_a)
      .def("stop", &Session::stop, "reason"_a)
      .def("resume", &Session::resume)
      .def_prop_ro("stopped", [](const Session& s) { return s.get().stopped(); })
      .def("begin", &Session::begin, "command"_a, "q"_a.none(), "v"_a.none())
      .def("set_reference", &Session::set_reference, "reference"_a, "what"_a, "values"_a)
      .def("held", &Session::held, "reference"_a)
      .def("say", &Session::say, "reference"_a, "present"_a)
      .def("phase", &Session::phase, "name"_a)
      .def("change", &Session::change, "stack"_a, "over"_a)
      .def_prop_ro("transition", [](const Session& s) { return s.get().transition(); })
      .def_prop_ro("stacks", [](const Session& s) { return s.get().stacks(); })
      .def("integrate", &Session::integrate, "q"_a, "v"_a, "dt"_a, "out"_a.noconvert())
      .def("reset", &Session::reset)
      .def_prop_ro("counters", [](const Session& s) { return counters_of(s.get().counters()); })
      .def_prop_ro("heartbeat", [](const Session& s) { return s.get().heartbeat(); })
      .def_prop_ro("sizes", &Session::sizes)
      .def_prop_ro("names", &Session::names)
      .def_prop_ro("robot", [](const Session& s) { return s.get().robot(); })
      .def_prop_ro("fingerprint", [](const Session& s) { return s.get().fingerprint(); })
      .def_prop_ro("joint_names", [](const Session& s) { return s.get().joint_names(); })
      .def_prop_ro("home", [](const Session& s) { return s.get().home(); })
      .def_prop_ro("nq", [](const Session& s) { return s.get().nq(); })
      .def_prop_ro("nv", [](const Session& s) { return s.get().nv(); })
      .def_prop_ro("dt", [](const Session& s) { return s.get().dt(); });
}
