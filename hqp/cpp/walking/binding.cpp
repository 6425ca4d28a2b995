// Python's view of walks: plans, footsteps, swings, walkers and the estimator.
#include "binding.hpp"

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include "../rows/live_plan.hpp"
#include "feet_estimator.hpp"
#include "rate_observer.hpp"
#include "walker.hpp"

namespace binding {

using namespace nb::literals;

namespace {

using Two = std::tuple<double, double>;
using Velocity = std::tuple<double, double, double>;
using Place = std::tuple<int, double, double, double, double>;  // side, x, y, z, yaw
using Four = std::array<double, 4>;

hqp::Vec2 vec2(const Two& a) { return {std::get<0>(a), std::get<1>(a)}; }
Two pair(const hqp::Vec2& a) { return {a.x, a.y}; }
hqp::Command command(const Velocity& a) { return {std::get<0>(a), std::get<1>(a), std::get<2>(a)}; }
Velocity numbers(const hqp::Command& a) { return {a.forward, a.left, a.turn}; }
hqp::Foothold foothold(const Place& a) {
  return {std::get<0>(a), std::get<1>(a), std::get<2>(a), std::get<3>(a), std::get<4>(a)};
}
Place numbers(const hqp::Foothold& a) { return {a.side, a.x, a.y, a.z, a.yaw}; }
std::vector<Place> numbers(const std::vector<hqp::Foothold>& all) {
  std::vector<Place> found;
  for (const hqp::Foothold& one : all) found.push_back(numbers(one));
  return found;
}
std::vector<hqp::Foothold> footholds(const std::vector<Place>& all) {
  std::vector<hqp::Foothold> found;
  for (const Place& one : all) found.push_back(foothold(one));
  return found;
}
hqp::Reach reach(const Four& a) { return {a[0], a[1], a[2], a[3]}; }
hqp::Gait gait(const std::array<double, 6>& a) { return {a[0], a[1], a[2], a[3], a[4], a[5]}; }

void require(bool fits, const char* what) {
  if (!fits) throw nb::value_error((std::string(what) + ": wrong shape").c_str());
}

// A walker on the state of a robot, whose joints, bodies and soles the tree has.
class LiveWalker {
 public:
  explicit LiveWalker(const nb::object& tree)
      : walker_(LivePlan(tree, kept_)),
        kinematics_(plan(tree).part("motion"), frames(plan(tree)), plan(tree).integer("nv")) {}
  LiveWalker(const LiveWalker&) = delete;

  void step(const Vector& q, const Vector& v, const std::optional<Vector>& loads) {
    require(int(q.size()) == kinematics_.nq() && int(v.size()) == kinematics_.nv(), "q or v");
    require(!loads || loads->size() == 2, "loads");
    kinematics_.update(q.data(), v.data());
    walker_.biped().read(kinematics_);
    walker_.step(loads ? loads->data() : nullptr);
  }
  // On a state without a robot: soles as position, then rotation row by row.
  void step_on(const std::array<double, 3>& com, const std::array<double, 3>& velocity,
               const std::array<std::array<double, 12>, 2>& soles, const std::optional<Vector>& loads) {
    hqp::BipedState& biped = walker_.biped();
    biped.com = hqp::load(com.data()), biped.velocity = hqp::load(velocity.data());
    for (std::size_t side = 0; side < 2; ++side) {
      biped.position[side] = hqp::load(soles[side].data());
      for (std::size_t i = 0; i < 9; ++i) biped.rotation[side].column[i % 3][int(i / 3)] = soles[side][3 + i];
    }
    walker_.step(loads ? loads->data() : nullptr);
  }
  void finish(const Written& torques, const std::optional<Vector>& loads) {
    require(torques.size() == walker_.motors() && (!loads || loads->size() == 2), "command or loads");
    walker_.finish(loads ? loads->data() : nullptr, torques.data());
  }
  void observe(const Vector& v, const Written& found) {
    require(int(v.size()) == kinematics_.nv() && int(found.size()) == kinematics_.nv(), "v");
    const std::vector<double>& rates = walker_.observe(v.data());
    std::copy(rates.begin(), rates.end(), found.data());
  }
  // acceleration: change of the rates in time (nv), none for an unsolved tick.
  void moves(const std::optional<Vector>& acceleration) {
    require(!acceleration || int(acceleration->size()) == kinematics_.nv(), "acceleration");
    walker_.moves([&](std::size_t column) { return acceleration ? acceleration->data()[column] : 0.0; });
  }
  hqp::Walker& get() { return walker_; }

 private:
  LivePlan plan(const nb::object& tree) { return {tree, kept_}; }
  static std::vector<LivePlan> frames(const LivePlan& plan) {
    std::vector<LivePlan> found;
    for (const LivePlan& one : plan.parts("soles")) found.push_back(one.part("frame"));
    return found;
  }

  std::vector<nb::object> kept_;  // declared before the pointers into it
  hqp::Walker walker_;
  hqp::FeetKinematics kinematics_;
};

class LiveEstimator {
 public:
  LiveEstimator(const nb::object& tree, const Vector& q) : estimator_(LivePlan(tree, kept_), q.data()) {
    require(int(q.size()) == estimator_.nq(), "q");
  }
  LiveEstimator(const LiveEstimator&) = delete;

  void update(const Vector& q, const Vector& v, const Vector& specific_force, const Vector& loads,
              const Written& found_q, const Written& found_v) {
    const auto nq = std::size_t(estimator_.nq()), nv = std::size_t(estimator_.nv());
    require(q.size() == nq && v.size() == nv && found_q.size() == nq && found_v.size() == nv, "q or v");
    require(specific_force.size() == 3 && loads.size() == estimator_.feet(), "specific force or loads");
    estimator_.update(q.data(), v.data(), specific_force.data(), loads.data(), found_q.data(), found_v.data());
  }
  std::vector<bool> slipping() const {
    std::vector<bool> found;
    for (std::size_t i = 0; i < estimator_.feet(); ++i) found.push_back(estimator_.slipping(i));
    return found;
  }

 private:
  std::vector<nb::object> kept_;
  hqp::FeetEstimator estimator_;
};

// Rates of the columns of a robot.
class LiveRates {
 public:
  LiveRates(const std::vector<std::size_t>& columns, std::size_t nv, double keeps, double most)
      : observer_(columns, keeps, most), nv_(nv) {
    for (const std::size_t column : columns) require(column < nv, "columns");
  }
  void update(const Written& v) { require(v.size() == nv_, "v"), observer_.update(v.data()); }
  void expect(const Vector& v) {
    require(v.size() == nv_, "v");
    observer_.expect([&](std::size_t column) { return v.data()[column]; });
  }
  void forget() { observer_.forget(); }

 private:
  hqp::RateObserver observer_;
  std::size_t nv_;
};

template <class T, std::size_t n>
auto view(LiveWalker& owner, const std::array<T, n>& numbers) {
  return nb::ndarray<nb::numpy, const double, nb::ndim<1>>(numbers.data(), {n}, nb::find(owner));
}

void bind_parts_of_walks(nb::module_& module) {
  module.def("next_foothold",
             [](double period, double width, const Four& limits, const Place& stance, const Velocity& velocity) {
               return numbers(hqp::Footsteps{period, width, reach(limits)}.next(foothold(stance), command(velocity)));
             });
  module.def("within_reach", [](const Four& limits, const Place& wanted, const Place& stance) {
    return numbers(hqp::Footsteps{1.0, 0.0, reach(limits)}.within(foothold(wanted), foothold(stance)));
  });
  module.def("adjusted", [](const Place& stance, const Place& planned, const Two& offset, double left, double period,
                            const Four& limits, const Two& error, const Two& ankle, double omega, const Two& now,
                            const std::array<double, 5>& bounds) {
    const auto [found, time] = hqp::adjusted({foothold(stance), foothold(planned), vec2(offset), left},
                                             {period, 0.0, reach(limits)}, vec2(error), vec2(ankle), omega,
                                             {vec2(now), bounds[0], bounds[1], bounds[2], bounds[3], bounds[4]});
    return std::make_pair(numbers(found), time);
  });
  nb::class_<hqp::Ability>(module, "Ability")
      .def("__init__",
           [](hqp::Ability* self, const std::array<double, 6>& times, const Four& limits, double width, double height,
              double gravity) { new (self) hqp::Ability{gait(times), reach(limits), width, height, gravity}; })
      .def("allowed",
           [](const hqp::Ability& self, const Velocity& requested) {
             std::vector<std::string> why;
             const hqp::Command found =
                 self.allowed(command(requested), [&](const hqp::Limited& one) { why.push_back(one.text()); });
             return std::make_pair(numbers(found), why);
           })
      .def("paced", [](const hqp::Ability& self, const Velocity& now,
                       const Velocity& requested) { return numbers(self.paced(command(now), command(requested))); })
      .def("paces",
           [](const hqp::Ability& self, const Velocity& now, const Velocity& requested, int most) {
             std::vector<hqp::Command> paces;
             self.paces(command(now), command(requested), paces, most);
             std::vector<Velocity> found;
             for (const hqp::Command& one : paces) found.push_back(numbers(one));
             return found;
           })
      .def("haste", [](const hqp::Ability& self, const Velocity& pace) { return self.haste(command(pace)); })
      .def_prop_ro("change", &hqp::Ability::change);
  nb::class_<hqp::DcmPlan>(module, "DcmPlan")
      .def("__init__",
           [](hqp::DcmPlan* self, const std::vector<std::tuple<double, Two, Two>>& given, double omega) {
             std::vector<hqp::Piece> pieces;
             for (const auto& [duration, start, end] : given) pieces.push_back({duration, vec2(start), vec2(end)});
             new (self) hqp::DcmPlan(pieces.size());
             self->plan(pieces, omega);
           })
      .def("at",
           [](const hqp::DcmPlan& self, double time) {
             const auto [zmp, dcm] = self.at(time);
             return std::make_pair(pair(zmp), pair(dcm));
           })
      .def_prop_ro("duration", &hqp::DcmPlan::duration);
  nb::class_<hqp::Swing> swing(module, "Swing");
  swing.def(nb::init<const Four&, const Four&, double, double, double, double>())
      .def("step", &hqp::Swing::step)
      .def("retarget", &hqp::Swing::retarget)
      .def("clear", &hqp::Swing::clear)
      .def("__deepcopy__", [](const hqp::Swing& self, const nb::handle&) { return self; })
      .def_prop_ro("left", &hqp::Swing::left)
      .def_prop_ro("soonest", &hqp::Swing::soonest)
      .def_rw("duration", &hqp::Swing::duration)
      .def_rw("time", &hqp::Swing::time)
      .def_rw("x", &hqp::Swing::x)
      .def_ro("v", &hqp::Swing::v)
      .def_ro("a", &hqp::Swing::a)
      .def_ro("goal", &hqp::Swing::goal);
  swing.attr("RISE") = hqp::Swing::kRise, swing.attr("LEAD") = hqp::Swing::kLead;
  swing.attr("FOLLOWS") = hqp::Swing::kFollows, swing.attr("SINKS") = hqp::Swing::kSinks,
  swing.attr("FALLS") = hqp::Swing::kFalls;
  module.attr("QUICK") = hqp::Ability::kQuick, module.attr("COMFORT") = hqp::Ability::kComfort;
  module.attr("TURNS") = hqp::Ability::kTurns;
}

// A field of a walker's state, converted both ways.
template <auto field, class From, class To>
void convert(nb::class_<hqp::WalkState>& of, const char* name, const From& from, const To& to) {
  of.def_prop_rw(
      name, [from](const hqp::WalkState& s) { return from(s.*field); },
      [to](hqp::WalkState& s, const decltype(from(std::declval<hqp::WalkState>().*field))& given) {
        s.*field = to(given);
      });
}

void bind_state(nb::module_& module) {
  using State = hqp::WalkState;
  nb::class_<State> state(module, "WalkState");
  state.def_rw("stance", &State::stance)
      .def_rw("entered", &State::entered)
      .def_rw("walking", &State::walking)
      .def_ro("started", &State::started)
      .def_ro("edge", &State::edge)
      .def_rw("stepped", &State::stepped)
      .def_rw("wait", &State::wait)
      .def_rw("swing", &State::swing)
      .def_rw("t", &State::t)
      .def_rw("duration", &State::T)
      .def_rw("since", &State::since)
      .def_rw("time", &State::time)
      .def_rw("z", &State::z)
      .def_rw("raised", &State::raised)
      .def_rw("share", &State::share)
      .def_rw("yaw", &State::yaw)
      .def_rw("felt", &State::felt)
      .def_rw("due", &State::due)
      .def_rw("heavier", &State::heavier)
      .def_prop_rw(
          "phase", [](const State& s) { return static_cast<int>(s.phase); },
          [](State& s, int phase) { s.phase = static_cast<hqp::WalkPhase>(phase); })
      .def_prop_rw(
          "holds", [](const State& s) { return std::make_pair(numbers(s.holds[0]), numbers(s.holds[1])); },
          [](State& s, const std::pair<Place, Place>& given) {
            s.holds[0] = foothold(given.first), s.holds[1] = foothold(given.second);
          })
      .def_prop_rw(
          "sunk", [](const State& s) { return Two{s.sunk[0], s.sunk[1]}; },
          [](State& s, const Two& given) { std::tie(s.sunk[0], s.sunk[1]) = given; })
      .def_prop_rw(
          "planned",
          [](const State& s) {
            return std::make_tuple(numbers(s.planned.stance), numbers(s.planned.foothold), pair(s.planned.offset),
                                   s.planned.left);
          },
          [](State& s, const std::tuple<Place, Place, Two, double>& given) {
            const auto& [stance, planned, offset, left] = given;
            s.planned = {foothold(stance), foothold(planned), vec2(offset), left};
          });
  const auto place = [](const hqp::Foothold& a) { return numbers(a); };
  const auto velocity = [](const hqp::Command& a) { return numbers(a); };
  convert<&State::nominal>(state, "nominal", place, foothold);
  convert<&State::target>(state, "target", place, foothold);
  convert<&State::command>(state, "command", velocity, command);
  convert<&State::pace>(state, "pace", velocity, command);
  convert<&State::zmp>(state, "zmp", pair, vec2);
  convert<&State::sum>(state, "sum", pair, vec2);
  convert<&State::capture_point>(state, "capture_point", pair, vec2);
}

}  // namespace

void bind_walking(nb::module_& module) {
  bind_parts_of_walks(module);
  bind_state(module);
  nb::class_<LiveWalker> walker(module, "Walker");
  walker.def(nb::init<const nb::object&>(), "tree"_a)
      .def(
          "go", [](LiveWalker& w, const Velocity& requested) { w.get().go(command(requested)); }, "velocity"_a)
      .def(
          "refuse", [](LiveWalker& w, const std::string& reason) { w.get().refuse(reason); }, "reason"_a)
      .def(
          "follow", [](LiveWalker& w, const std::vector<Place>& wanted) { w.get().follow(footholds(wanted)); },
          "footholds"_a)
      .def("stop", [](LiveWalker& w) { w.get().stop(); })
      .def("step", &LiveWalker::step, "q"_a, "v"_a, "loads"_a.none())
      .def("step_on", &LiveWalker::step_on, "com"_a, "velocity"_a, "soles"_a, "loads"_a.none())
      .def("observe", &LiveWalker::observe, "v"_a, "found"_a.noconvert())
      .def("moves", &LiveWalker::moves, "acceleration"_a.none())
      .def("finish", &LiveWalker::finish, "command"_a.noconvert(), "loads"_a.none())
      .def(
          "planned", [](LiveWalker& w, double time) { return pair(w.get().plan().at(time).first); }, "time"_a)
      .def_prop_ro("why", [](LiveWalker& w) { return w.get().why(); })
      .def_prop_ro("ahead", [](LiveWalker& w) { return numbers(w.get().ahead()); })
      .def_prop_ro("stands", [](LiveWalker& w) { return w.get().stands(); })
      .def_prop_ro("support", [](LiveWalker& w) { return w.get().support(); })
      .def_prop_ro("stopping_time", [](LiveWalker& w) { return w.get().stopping_time(); })
      .def_prop_ro(
          "state", [](LiveWalker& w) -> hqp::WalkState& { return w.get().state(); }, nb::rv_policy::reference_internal)
      .def_prop_ro("pieces",
                   [](LiveWalker& w) {
                     std::vector<std::tuple<double, Two, Two>> found;
                     for (const hqp::Piece& one : w.get().pieces())
                       found.emplace_back(one.duration, pair(one.start), pair(one.end));
                     return found;
                   })
      .def_prop_ro("height", [](LiveWalker& w) { return w.get().references().height; })
      .def_prop_ro("share", [](LiveWalker& w) { return w.get().references().share; })
      .def_prop_ro("balance", [](LiveWalker& w) { return view(w, w.get().references().balance); })
      .def_prop_ro("swing", [](LiveWalker& w) { return view(w, w.get().references().swing); })
      .def_prop_ro("swing_velocity", [](LiveWalker& w) { return view(w, w.get().references().swing_velocity); })
      .def_prop_ro("swing_acceleration", [](LiveWalker& w) { return view(w, w.get().references().swing_acceleration); })
      .def_prop_ro("trunk", [](LiveWalker& w) { return view(w, w.get().references().trunk); })
      .def_prop_ro("normals", [](LiveWalker& w) {
        return std::make_pair(view(w, w.get().references().normal[0]), view(w, w.get().references().normal[1]));
      });
  const std::pair<const char*, double> constants[] = {
      {"TOUCH", hqp::Walker::kTouch},     {"EARLY", hqp::Walker::kEarly},
      {"LATE", hqp::Walker::kLate},       {"FADE", hqp::Walker::kFade},
      {"SLEW", hqp::Walker::kSlew},       {"TAKE", hqp::Walker::kTake},
      {"AHEAD", hqp::Walker::kAhead},     {"CORRECTION", hqp::Walker::kCorrection},
      {"CREEPS", hqp::Walker::kCreeps},   {"LAST", hqp::Walker::kLast},
      {"HEAVIER", hqp::Walker::kHeavier}, {"WEIGHING", hqp::Walker::kWeighing},
      {"SETTLES", hqp::Walker::kSettles}, {"UNFELT", hqp::Walker::kUnfelt},
      {"SAG", hqp::Walker::kSag},         {"NOISE", hqp::Walker::kNoise}};
  for (const auto& [name, value] : constants) walker.attr(name) = value;
  nb::class_<LiveEstimator>(module, "FeetEstimator")
      .def(nb::init<const nb::object&, const Vector&>(), "tree"_a, "q"_a)
      .def("update", &LiveEstimator::update, "q"_a, "v"_a, "specific_force"_a, "loads"_a, "found_q"_a.noconvert(),
           "found_v"_a.noconvert())
      .def_prop_ro("slipping", &LiveEstimator::slipping);
  nb::class_<LiveRates>(module, "RateObserver")
      .def(nb::init<const std::vector<std::size_t>&, std::size_t, double, double>(), "columns"_a, "nv"_a, "keeps"_a,
           "most"_a)
      .def("update", &LiveRates::update, "v"_a.noconvert())
      .def("expect", &LiveRates::expect, "v"_a)
      .def("forget", &LiveRates::forget);
}

}  // namespace binding
