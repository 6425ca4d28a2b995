// A biped that walks: phases, plan of the DCM, swing foot, and the references of its stack. See walking/walker.py.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "../session/errors.hpp"
#include "ability.hpp"
#include "adjustment.hpp"
#include "biped.hpp"
#include "joint_friction.hpp"
#include "pendulum.hpp"
#include "rate_observer.hpp"
#include "swing.hpp"

namespace hqp {

enum class WalkPhase { kStand, kShift, kSwing };  // shift: both feet, the ZMP on its way to the next stance foot

// Plain data of a walker between two ticks.
struct WalkState {
  WalkPhase phase = WalkPhase::kStand;
  int stance = kRight;
  bool entered = false, walking = false, started = false, edge = false;
  Command command, pace;
  Foothold holds[2];         // present or last footholds
  Foothold nominal, target;  // foothold of the swing foot: planned, and corrected
  Swing swing;
  Landing planned{};
  double t = 0.0, T = 0.0, since = 0.0, time = 0.0;  // time in the phase, its duration, time in the plan [s]
  double z = 0.0, raised = 0.0, share = 0.5, yaw = 0.0;
  double felt = 1.0, due = 1.0, heavier = 1.0;  // mean load, the one due to the motion, weight: shares of the model's
  double soon_felt = 1.0, soon_due = 1.0;       // felt and due, means of kSettles
  double rising = 0.0;                          // rate of the CoM's height one tick before [m/s]
  double sunk[2] = {};
  double quick = 1.0;    // time of the step, a share of that of the gait
  double wait = 0.0;     // time from the last landing to the shift of the ZMP [s]
  Vec3 stood[2]{};       // places of the frames then
  bool stepped = false;  // true if the latest shift follows a landing
  Vec2 zmp, sum, capture_point;

  bool swings() const { return phase == WalkPhase::kSwing; }
};

// References of a walk's elements in one tick.
struct WalkReferences {
  std::array<double, 4> balance{};  // ZMP, DCM
  double height = 0.0, share = 0.5;
  std::array<double, 16> swing{};  // pose of the swing foot, row by row
  std::array<double, 6> swing_velocity{}, swing_acceleration{};
  std::array<double, 9> trunk{};                  // rotation, row by row
  std::array<std::array<double, 3>, 2> normal{};  // normals of the soles
};

class Walker {
 public:
  // Largest distance of a landed foot below its path, or height of its path above the goal [m]; else it has scuffed.
  static constexpr double kTouch = 0.05, kHeld = 5e-3, kDown = 0.02;
  static constexpr double kEarly = 0.55;  // share of the swing time before which a foot does not land
  static constexpr double kLate = 0.015;  // share of the weight that confirms a landing after the swing time
  static constexpr double kPress = 0.1;   // least share of a foot that has landed
  static constexpr double kFade = 0.08;   // fade time of a torque jump, for a joint's largest torque [s]
  static constexpr double kSlew = 0.02;   // shortest time in which a torque changes by the largest of all limits [s]
  static constexpr double kNoise = 0.06;  // largest difference of a rate from its measurement [rad/s]
  static constexpr double kTake = 0.06;   // shortest time in which a foot's share changes from 0 to 1 [s]
  static constexpr double kIntegral = 0.5, kMost = 0.03;  // integral of the DCM error: gain [1/s], limit [m s]
  static constexpr double kLeast = 0.015;  // DCM error above which a step corrects its foothold and time [m]
  static constexpr double kCorrection = 1.5, kCreeps = 0.2;  // speed of a goal, and shortly before the landing [m/s]
  static constexpr double kChases = 0.4;                     // speed of a goal without ground at the landing time [m/s]
  static constexpr double kLast = 0.08;                      // remaining time below which the landing time is fixed [s]
  static constexpr double kLongest = 1.6;                    // limit of the landing time as a share of the swing time
  static constexpr double kHurry = 3.0;                      // largest rate of change of the landing time [s/s]
  static constexpr double kAhead = 0.02;                     // largest error of a blocked swing foot's reference [m]
  static constexpr double kSoonest = 0.05;                   // after lift-off, and to the landing, of a correction [s]
  static constexpr double kWeighs = 2.0, kSag = 0.02;  // integral of the CoM's height error: gain [1/s], limit [m]
  static constexpr double kWeighing = 10.0, kHeavier = 0.25;  // mean load: time constant [s], largest change of torques
  static constexpr double kSettles = 0.1;                     // time constant at the start [s]
  static constexpr double kUnfelt = 0.5;  // share of the load that is due below which something else bears the rest

  // Fields: see walking/walker.py.
  template <class Plan>
  explicit Walker(const Plan& p)
      : dt_(p.number("dt")),
        height_(p.number("height")),
        omega_(p.number("omega")),
        pendulum_(p.number("pendulum")),
        k_(p.number("k")),
        weight_(p.number("weight")),
        gravity_(p.number("gravity")),
        steepest_(p.number("steepest")),
        half_(p.number("half")),
        aims_(p.texts("why")),
        weakest_(p.text("weakest")),
        rates_(std::size_t(p.integer("nv"))),
        observer_(turning(rates_.size()), p.number("keeps"), kNoise) {
    const std::vector<double> gait = p.numbers("gait", 6), reach = p.numbers("reach", 4);
    const std::vector<double> bears = p.numbers("bears", 2);
    share_ = bears[0], most_ = bears[1];
    gait_ = {gait[0], gait[1], gait[2], gait[3], gait[4], gait[5]};
    footsteps_ = {gait_.period(), p.number("width"), {reach[0], reach[1], reach[2], reach[3]}};
    ability_ = {gait_, footsteps_.reach, footsteps_.width, height_, gravity_};
    ability_.reach.forward = p.number("planned");
    for (const Plan& one : p.parts("soles")) soles_.push_back(Sole::of(one));
    need(soles_.size() == 2, "a walker has two soles");
    need(!weakest_.empty(), "the weakest joint of a walker has a name");
    const std::vector<double> upright = p.numbers("upright", 9);
    std::copy(upright.begin(), upright.end(), upright_.begin());
    limits_ = p.numbers("limits");
    for (const double limit : limits_) slew_ = std::max(slew_, limit * dt_ / kSlew);
    rest_.resize(limits_.size()), sent_.resize(limits_.size()), overcome_.resize(limits_.size());
    for (const Plan& one : p.parts("friction")) {
      friction_.push_back(JointFriction::of(one));
      need(friction_.back().motor < limits_.size() && friction_.back().column < rates_.size(),
           "friction is that of a motor");
    }
    support_ = std::make_unique<Support>(biped_, soles_);
    paces_.reserve(Ability::kMost + 4), pieces_.reserve(kPieces);
  }
  Walker(const Walker&) = delete;

  // Velocity from now on: the nearest one that steps can follow.
  void go(const Command& requested) {
    forget();
    state_.command = ability_.allowed(requested, [this](const Limited& one) { limited_.push_back(one); });
    state_.walking = true;
    yield();
  }
  // Step on footholds, left and right in turn, then stand on the last two: the nearest ones within reach of each other.
  void follow(const std::vector<Foothold>& wanted) {
    for (std::size_t k = 0; k < wanted.size(); ++k) {
      const Foothold& one = wanted[k];
      if ((one.side != kLeft && one.side != kRight) || (k && one.side == wanted[k - 1].side))
        throw ReferenceError("footholds are left and right in turn");
      if (!std::isfinite(one.x + one.y + one.z + one.yaw)) throw ReferenceError("a foothold is not finite");
    }
    forget();
    state_.command = {};
    state_.walking = !wanted.empty();
    route_ = wanted;
    moved_.reserve(2 * (wanted.size() + 1) * (Moved::kAdded + 1));
    yield();
    if (state_.started) check();
  }
  // Stand, because the session is stopped.
  void refuse(const std::string& reason) {
    forget();
    refused_ = reason, state_.command = {};
  }
  // Come to stand with the feet side by side, over as many steps as it takes.
  void stop() {
    if (!state_.walking) return;
    state_.command = {}, state_.walking = false;
    end_route();
  }
  // Reasons for each difference from the latest `go` or `follow`, for a ZMP beside the middle of a sole, and for
  // masses that differ from the model's by one percent or more.
  std::vector<std::string> why() const {
    if (!refused_.empty()) return {"stopped (" + refused_ + "): call session.resume()"};
    std::vector<std::string> found = aims_;
    if (yields_) found.push_back(yielded());
    for (const Limited& one : limited_) found.push_back(one.text());
    for (const Moved& one : moved_) found.push_back(one.text());
    if (std::lround(100.0 * state_.heavier) != 100) found.push_back(weighed());
    return found;
  }
  // Footholds ahead, of a route.
  std::vector<Foothold> ahead() const { return {route_.begin() + std::ptrdiff_t(next_), route_.end()}; }
  bool stands() const { return state_.phase == WalkPhase::kStand && state_.t >= state_.T; }
  double stopping_time() {  // longest time from `stop` to standing [s]
    ability_.paces(state_.pace, {}, paces_);
    return static_cast<double>(paces_.size() + 1) * gait_.period() + 2.0 * gait_.first;
  }

  BipedState& biped() { return biped_; }
  WalkState& state() { return state_; }
  const WalkState& state() const { return state_; }
  const WalkReferences& references() const { return references_; }
  const DcmPlan& plan() const { return dcm_; }
  const std::vector<Piece>& pieces() const { return pieces_; }
  const Ability& ability() const { return ability_; }
  const Footsteps& footsteps() const { return footsteps_; }
  // Name of the standing feet: the phase of the stack.
  const char* support() const {
    static constexpr const char* kNames[] = {"left", "right"};
    return state_.swings() ? kNames[state_.stance] : "both";
  }
  std::size_t motors() const { return limits_.size(); }

  // Rates of this tick without their noise (nv), from measured ones that are finite; then step().
  const std::vector<double>& observe(const double* v) {
    double sum = 0.0;
    for (std::size_t i = 0; i < rates_.size(); ++i) sum += 0.0 * (rates_[i] = v[i]);
    if (sum == 0.0) observer_.update(rates_.data());
    return rates_;
  }
  // References for the state in biped(); loads: normal forces of the feet [N], null for none: then a foot has landed
  // when its time is up.  A state that is not finite leaves the references as they are.
  void step(const double* loads) {
    state_.entered = false;
    if (!biped_.finite()) return;
    if (!state_.started) start();
    yield();
    advance(loads);
    touches_ = loads && state_.swings() && loads[1 - state_.stance] > kTouch * weight_;
    refer();
  }
  // The accelerations (nv) that the torques of this tick cause: the next rates, and the friction to overcome.
  template <class Acceleration>
  void moves(const Acceleration& acceleration) {
    observer_.expect([&](std::size_t column) { return rates_[column] + dt_ * acceleration(column); });
    for (const JointFriction& one : friction_)
      overcome_[one.motor] = one.torque(rates_[one.column], acceleration(one.column));
  }
  // End of a tick: weigh the robot, and overcome friction; after a switch go on from the torques before, within the
  // limits and at a bounded rate.
  void finish(const double* loads, double* command) {
    if (loads) weigh(loads[0] + loads[1]);
    for (std::size_t i = 0; i < limits_.size(); ++i) {
      command[i] += overcome_[i];
      if (state_.entered && has_sent_) rest_[i] = sent_[i] - command[i];
      const double fading = limits_[i] * dt_ / kFade;
      rest_[i] -= held(rest_[i], -fading, fading);
      const double most = has_sent_ ? slew_ : limits_[i];
      command[i] = held(held(command[i] + rest_[i], -limits_[i], limits_[i]), sent_[i] - most, sent_[i] + most);
      sent_[i] = command[i];
    }
    has_sent_ = true;
    state_.t += dt_;
    if (!state_.swings() || state_.t < state_.T) state_.since += dt_;  // later the plan waits for the foot
    state_.time += dt_;
  }

 private:
  static constexpr std::size_t kPreview = 3, kPieces = 2 * (Ability::kMost + 2) + 6;  // steps, pieces of the plan

  // Columns of gyroscope and encoders: all but the velocity of the base, which has no noise of its own.
  static std::vector<std::size_t> turning(std::size_t nv) {
    std::vector<std::size_t> found;
    for (std::size_t column = 3; column < nv; ++column) found.push_back(column);
    return found;
  }

  void start() {
    WalkState& s = state_;
    s.started = true;
    for (const int side : {kLeft, kRight}) s.holds[side] = biped_.placed(side, soles_[std::size_t(side)]);
    s.z = biped_.com[2];
    s.zmp = {biped_.com[0], biped_.com[1]};
    s.yaw = mean_yaw();
    s.nominal = s.target = s.holds[kLeft];
    s.t = 0.0, s.T = gait_.first;
    check();
    plan_ahead();
  }

  // Take the next phase where this one is over.
  void advance(const double* loads) {
    WalkState& s = state_;
    if (s.phase == WalkPhase::kStand && s.walking && s.t >= s.T) {
      s.stance = routed() ? 1 - route_.front().side : kRight, s.wait = 0.0, s.stepped = false;
      enter(WalkPhase::kShift, gait_.first);
    } else if (s.phase == WalkPhase::kShift && s.stepped && lost(s.stance, loads)) {
      swing_on();
    } else if (s.phase == WalkPhase::kShift && (s.t >= s.T || lost(1 - s.stance, loads))) {
      if (!routed()) s.pace = ability_.paced(s.pace, s.command);
      s.quick = routed() ? 1.0 : ability_.haste(s.pace);
      enter(WalkPhase::kSwing, s.quick * gait_.single_support);
    } else if (s.swings() && landed(loads)) {
      const int side = 1 - s.stance;
      s.holds[side] = biped_.placed(side, soles_[std::size_t(side)]);
      s.sunk[side] = held(s.sunk[side] + 0.7 * (biped_.position[side][2] - s.swing.x[2]), -kSag, kSag);
      s.stance = side;
      s.share = static_cast<double>(1 - side);  // the other foot still bears it all
      s.stepped = true, s.wait = 0.0;
      if (routed() && next_ == route_.size()) s.walking = false, s.pace = {}, end_route();
      const bool last = !s.walking && s.pace == Command() && stays(side);
      const double most = std::max(s.T - s.t, 0.0);
      enter(last ? WalkPhase::kStand : WalkPhase::kShift, doubled(s.quick, last));
      if (loads) pause(most);
    }
  }
  // True if the ankles of both feet lead the DCM back, or no step does: it is beside the foot that has landed.
  bool stays(int side) {
    support_->stand(true, true);
    const Vec2 off = state_.capture_point - support_->nearest(state_.capture_point);
    if (std::hypot(off.x, off.y) < 1e-6) return true;
    const Vec2 seen = turned_back(state_.holds[side].yaw, off);
    return Footsteps::outwards(side) * seen.y > std::fabs(seen.x);
  }
  // Begin the shift after a landing later, by at most some time, or do it faster, so that the DCM is least off its
  // plan.
  void pause(double most) {
    WalkState& s = state_;
    const double usual = s.T, least = std::min(kTake, usual) - usual;
    const Vec2 com{biped_.com[0], biped_.com[1]}, rate{biped_.velocity[0], biped_.velocity[1]};
    double smallest = std::numeric_limits<double>::infinity(), best = 0.0;
    const auto plan = [&](double wait) { s.wait = wait, s.T = usual + wait, plan_ahead(); };
    for (int k = 0; k <= kLandingTimes; ++k) {
      const double wait = least + k * (most - least) / kLandingTimes;
      plan(wait);
      const Vec2 off = com + rate / omega_ - dcm_.at(0.0).second;
      if (dot(off, off) < smallest) smallest = dot(off, off), best = wait;
    }
    plan(best);
  }
  // True if a foot bears nothing and has left its place of the last landing: it stands on air, or was thrown off.
  bool lost(int side, const double* loads) const {
    if (!loads) return false;
    const Vec3 off = biped_.position[side] - state_.stood[side];
    return loads[side] < kLate * weight_ && dot(off, off) > kHeld * kHeld;
  }
  // Lower the foot that has lost the ground from where it is.
  void swing_on() {
    WalkState& s = state_;
    const int side = s.stance;
    s.stance = 1 - side, s.share = static_cast<double>(s.stance);
    s.swing.time += s.t;
    s.phase = WalkPhase::kSwing, s.entered = true, s.t = s.swing.time;
    const Vec3& p = biped_.position[side];
    s.nominal = s.target = s.holds[side] = biped_.placed(side, soles_[std::size_t(side)]);
    s.nominal.z = s.target.z = s.holds[s.stance].z;
    s.swing.lower({p[0], p[1], p[2], biped_.yaw(side)}, goal());
    s.T = s.swing.duration;
    plan_ahead();
    const double rest = std::max(s.swing.left(), 0.0);
    s.planned = {s.holds[s.stance], s.nominal, dcm_.at(rest).second - s.nominal.xy(), rest};
  }
  // True if the swing foot stands: its time is up, or it bears load near its path or its goal.
  bool landed(const double* loads) {
    WalkState& s = state_;
    if (!loads) return s.t >= s.T;
    const double least = s.t < s.T ? kTouch : kLate;
    if (loads[1 - s.stance] > least * weight_ && s.t > kEarly * s.T) {
      const double z = biped_.position[1 - s.stance][2], path = s.swing.x[2];
      if (z > path - kHeld || path < s.swing.goal[2] + kDown || !s.swing.clear(z)) return true;
    }
    return s.t > s.T + gait_.patience;
  }
  void enter(WalkPhase phase, double duration) {
    WalkState& s = state_;
    s.phase = phase, s.entered = true, s.t = 0.0, s.T = duration;
    if (!s.swings()) {
      for (const int side : {kLeft, kRight}) s.stood[side] = biped_.position[side];
      return plan_ahead();
    }
    const int side = 1 - s.stance;
    s.holds[s.stance] = biped_.placed(s.stance, soles_[std::size_t(s.stance)]);  // after it has settled
    s.nominal = s.target = routed() ? step_on(s.holds[s.stance]) : next(s.holds[s.stance], s.pace);
    const Vec3& p = biped_.position[side];
    s.swing = Swing({p[0], p[1], p[2], biped_.yaw(side)}, goal(), duration, gait_.height, gait_.search);
    plan_ahead();
    s.planned = {s.holds[s.stance], s.nominal, dcm_.at(duration).second - s.nominal.xy(), duration};
  }

  // ZMP and DCM from now on: three steps, or all until it stands.
  void plan_ahead() {
    WalkState& s = state_;
    Foothold holds[2] = {s.holds[0], s.holds[1]};
    int stance = s.stance;
    Vec2 at = s.zmp;
    pieces_.clear();
    const auto to = [&](double duration, const Vec2& where) {
      if (!(duration > 0.0)) return;
      pieces_.push_back({duration, at, where});
      at = where;
    };
    const auto middle = [&] { return 0.5 * (holds[0].xy() + holds[1].xy()); };
    if (!s.swings()) {
      to(s.wait, at);
      const double rest = std::max(s.T - std::max(s.wait, 0.0) - s.t, dt_);
      to(rest, s.phase == WalkPhase::kStand ? middle() : holds[stance].xy());
    }
    if (s.phase != WalkPhase::kStand) {
      const std::size_t swings = s.swings() ? 1 : 0;
      if (!s.walking && swings && s.pace == Command()) paces_.clear();
      else ability_.paces(s.pace, s.command, paces_);
      if (s.walking) paces_.resize(kPreview - swings, s.command);
      const std::size_t left = routed() ? route_.size() - next_ : paces_.size(), ahead = std::min(left, paces_.size());
      const bool ends = routed() ? ahead == left : !s.walking;
      for (std::size_t k = 0; k < ahead + swings; ++k) {
        const bool under_way = k < swings;
        const std::size_t i = under_way ? 0 : k - swings;
        const double quick = under_way ? s.quick : routed() ? 1.0 : ability_.haste(paces_[i]);
        to(std::max(under_way ? s.T - s.t : quick * gait_.single_support, dt_), holds[stance].xy());
        holds[1 - stance] = under_way  ? s.nominal
                            : routed() ? reached(next_ + i, holds[stance])
                                       : next(holds[stance], paces_[i]);
        stance = 1 - stance;
        const bool last = ends && k + 1 == ahead + swings;
        to(doubled(quick, last), last ? middle() : holds[stance].xy());
      }
      if (!ends) to((routed() ? 1.0 : ability_.haste(s.command)) * gait_.single_support, holds[stance].xy());
    }
    to(0.5, at);
    const Vec2 before = dcm_.duration() > 0.0 ? dcm_.at(s.since).second : s.zmp;
    dcm_.plan(pieces_, omega_);
    if (s.phase == WalkPhase::kShift && !s.stepped) lead_away(before);
    s.since = 0.0;
  }
  // Let the ZMP of the first shift lead the DCM away from where it is: half way it is displaced by d, with
  // xi(0) += d (1 - exp(-omega T / 2))^2 / (omega T / 2).
  void lead_away(const Vec2& dcm) {
    const Piece shift = pieces_.front();
    const double half = 0.5 * shift.duration, part = 1.0 - std::exp(-omega_ * half);
    support_->stand(true, true);
    const Vec2 off = omega_ * half / (part * part) * (dcm - dcm_.at(0.0).second);
    const Vec2 middle = support_->nearest(0.5 * (shift.start + shift.end) + off);
    pieces_.front() = {half, shift.start, middle};
    pieces_.insert(pieces_.begin() + 1, {half, middle, shift.end});
    dcm_.plan(pieces_, omega_);
  }
  // Time of both feet on the ground after a step of a quickness [s].
  double doubled(double quick, bool last) const { return last ? gait_.first : quick * gait_.double_support; }
  bool routed() const { return !route_.empty(); }
  void end_route() { route_.clear(), next_ = 0; }
  void forget() { yields_ = false, refused_.clear(), limited_.clear(), moved_.clear(), end_route(); }
  // Keep a change of a foothold of the route for why().
  auto noting(std::size_t k) {
    return [this, k](Moved::Axis axis, double requested, double allowed) {
      if (moved_.size() < moved_.capacity())  // in a tick no memory is taken
        moved_.push_back({axis, static_cast<int>(k) + first_, route_[k].side, requested, allowed});
    };
  }
  // Bring the route within the reach of planned steps, each foothold from the one before.
  void check() {
    const WalkState& s = state_;
    if (!routed()) return;
    const bool stands = s.phase == WalkPhase::kStand;
    Foothold stance = s.swings() ? s.nominal : s.holds[stands ? 1 - route_.front().side : s.stance];
    floor_ = stance.z;
    first_ = stance.side == route_.front().side ? 0 : 1;
    if (first_ == 0) {
      route_.insert(route_.begin(), footsteps_.next(stance, {}));
      moved_.push_back({Moved::kAdded, first_, route_.front().side, 0.0, 0.0});
    }
    for (std::size_t k = 0; k < route_.size(); ++k) {
      const double before = k ? route_[k - 1].z : stance.z;
      stance = route_[k] = ability_.reached(route_[k], stance, ability_.reach, half_, route_[k].z - before, noting(k));
    }
  }
  // A foothold of the route, from where the other foot stands.
  template <class Report>
  Foothold reached(std::size_t k, const Foothold& stance, const Report& moved) const {
    const double rise = route_[k].z - (k ? route_[k - 1].z : floor_);
    return ability_.reached(route_[k], stance, footsteps_.reach, half_, rise, moved);
  }
  Foothold reached(std::size_t k, const Foothold& stance) const {
    return reached(k, stance, [](Moved::Axis, double, double) {});
  }
  // The next foothold of the route; its step is as fast as one of a walk.
  Foothold step_on(const Foothold& stance) {
    const Foothold found = reached(next_, stance, noting(next_));
    ++next_;
    const Vec2 step = turned_back(stance.yaw, found.xy() - stance.xy()) / gait_.period();
    state_.pace = {step.x, 0.0, 0.0};
    return found;
  }
  Foothold next(const Foothold& stance, const Command& pace) const {
    Footsteps steps = footsteps_;
    steps.period = ability_.haste(pace) * gait_.period();
    return steps.next(stance, pace);
  }
  Swing::Four goal() const {
    const Foothold& target = state_.target;
    const Sole& sole = soles_[std::size_t(target.side)];
    const double yaw = target.yaw + sole.yaw;
    const Vec2 at = target.xy() - turned(yaw, sole.middle);
    return {at.x, at.y, target.z, yaw};
  }

  void refer() {
    WalkState& s = state_;
    support_->stand(!s.swings() || s.stance == kLeft, !s.swings() || s.stance == kRight);
    const auto [zmp, dcm] = dcm_.at(s.since);
    s.zmp = zmp;
    const Vec2 com{biped_.com[0], biped_.com[1]}, rate{biped_.velocity[0], biped_.velocity[1]};
    s.capture_point = com + rate / omega_;
    const Vec2 error = s.capture_point - dcm, aim = zmp + kIntegral * s.sum;
    const Vec2 wanted = aim + (1.0 + k_ / pendulum_) * (com + rate / pendulum_ - dcm),
               reached = support_->nearest(wanted);
    s.edge = std::hypot(reached.x - wanted.x, reached.y - wanted.y) > 1e-6;
    if (!s.edge || dot(error, s.sum) < 0.0) s.sum = within(s.sum + dt_ * omega_ * error, kMost);
    references_.balance = {aim.x, aim.y, dcm.x, dcm.y};
    references_.height = height(biped_.com[2]);
    if (s.swings()) swing(error, reached - zmp);
    else references_.share = share(reached);
    const double yaw = next_yaw(), c = std::cos(yaw), sine = std::sin(yaw);
    for (std::size_t j = 0; j < 3; ++j) {
      references_.trunk[j] = c * upright_[j] - sine * upright_[3 + j];
      references_.trunk[3 + j] = sine * upright_[j] + c * upright_[3 + j];
      references_.trunk[6 + j] = upright_[6 + j];
    }
    for (std::size_t side = 0; side < 2; ++side) {
      const Vec3 n = normal(biped_.rotation[side].column[2]);
      references_.normal[side] = {n[0], n[1], n[2]};
    }
  }
  // Normal of the ground below a sole: the sole's, unless that is so steep that the sole has rolled over an edge.
  Vec3 normal(const Vec3& up) const {
    const double level = std::hypot(up[0], up[1]), angle = std::atan2(level, up[2]);
    if (!(angle > steepest_)) return up;
    const double part = std::sin(steepest_) / level;
    return {part * up[0], part * up[1], std::cos(steepest_)};
  }
  // Height of the CoM in the world, at bounded speed, raised by its recent deficit.
  double height(double com) {
    WalkState& s = state_;
    const double ground = s.swings() ? s.holds[s.stance].z : 0.5 * (s.holds[0].z + s.holds[1].z);
    const double most = Ability::kClimb * height_ * dt_;
    s.z += held(ground + height_ - s.z, -most, most);
    s.raised = held(s.raised + kWeighs * dt_ * (s.z - com), -kSag, kSag);
    return s.z + s.raised;
  }
  // Yaw of the trunk: between the feet, with a swing foot where it is to be.
  double next_yaw() {
    const double most = 0.8 * dt_;
    return state_.yaw += held(wrapped(mean_yaw() - state_.yaw), -most, most);
  }
  double mean_yaw() const {
    const double one = state_.holds[state_.stance].yaw;
    const double other = state_.swings() ? state_.target.yaw : state_.holds[1 - state_.stance].yaw;
    return one + 0.5 * wrapped(other - one);
  }
  // Share of the right foot: by where the ZMP is between the feet, at the end of a shift all on the stance foot.
  double share(const Vec2& zmp) {
    WalkState& s = state_;
    const Vec2 apart = s.holds[1].xy() - s.holds[0].xy(), along = zmp - s.holds[0].xy();
    double share = held(dot(along, apart) / dot(apart, apart), 0.0, 1.0);
    const double left = s.T - s.t;
    if (s.phase == WalkPhase::kShift && left < 2.0 * kTake)
      share += (s.stance - share) * std::min(1.0, (2.0 * kTake - left) / kTake);
    if (s.phase == WalkPhase::kShift && s.stepped)  // press on the foot that has landed
      share = s.stance == kRight ? std::max(share, kPress) : std::min(share, 1.0 - kPress);
    const double most = dt_ / kTake;
    return s.share += held(share - s.share, -most, most);
  }
  // Move the landing of the swing foot, in place and time, to where the DCM is met.
  void adjust(const Vec2& error, const Vec2& ankle) {
    WalkState& s = state_;
    const double single = s.quick * gait_.single_support;
    double left = std::max(s.T - s.t, 0.0);
    const double speed = left > kLast ? kCorrection : left > 0.0 ? kCreeps : kChases;
    s.target = s.planned.foothold;
    if (s.edge) {  // inside the sole the ankle leads every error back
      Landing planned = s.planned;
      planned.left = left;
      const Vec2 middle = turned(s.swing.x[3], soles_[std::size_t(s.target.side)].middle);
      const Vec2 now = Vec2{s.swing.x[0], s.swing.x[1]} + middle;
      std::tie(s.target, left) =
          adjusted(planned, footsteps_, error, ankle, omega_,
                   {now, std::max(kSoonest, s.swing.soonest()), kLongest * single - s.t, single - s.t, speed, kLeast});
    }
    s.swing.retarget(goal(), speed, dt_);
    const double later = s.t + left - s.T;
    if (!(std::fabs(later) > dt_ && s.T - s.t > kLast)) return;
    s.T += std::copysign(std::min(kHurry * dt_, std::fabs(later)), later);
    s.swing.duration = s.T;
    plan_ahead();
  }
  // Pose of the swing foot; its goal moves to where the error of the DCM is met.
  void swing(const Vec2& error, const Vec2& pushed) {
    WalkState& s = state_;
    const int side = 1 - s.stance;
    if (s.t > kSoonest) adjust(error, pushed);
    s.swing.step(dt_);
    const Swing& path = s.swing;
    const Vec3& here = biped_.position[side];
    s.swing.lead({here[0], here[1]}, kAhead, touches_, dt_);
    s.swing.x[2] = std::max(path.x[2], here[2] - kAhead);
    const double z = s.swing.x[2] - s.sunk[side] * std::min(1.0, s.t / (0.3 * s.T));
    const double c = std::cos(path.x[3]), sine = std::sin(path.x[3]);
    references_.swing = {c, -sine, 0.0, path.x[0], sine, c, 0.0, path.x[1], 0.0, 0.0, 1.0, z, 0.0, 0.0, 0.0, 1.0};
    references_.swing_velocity = {path.v[0], path.v[1], path.v[2], 0.0, 0.0, path.v[3]};
    references_.swing_acceleration = {path.a[0], path.a[1], path.a[2], 0.0, 0.0, path.a[3]};
  }
  // Come to stand if the weakest joint of the legs lets the body fall under its weight.
  void yield() {
    if (!state_.walking || share_ * state_.heavier <= most_) return;
    stop();
    yields_ = true;
  }
  std::string yielded() const {
    char found[200];
    std::snprintf(found, sizeof found, " needs %.0f %% of its torque on one foot, walks fall above %.0f: it stands; ",
                  100.0 * share_ * state_.heavier, 100.0 * most_);
    return weakest_ + found + "a Gait with less time on one foot and more on both, or a lighter robot, walks";
  }
  std::string weighed() const {
    char found[160];
    std::snprintf(found, sizeof found, "masses x %.2f: the feet bear %.0f N in the mean, %.0f by the model",
                  state_.heavier, state_.felt * weight_, state_.due * weight_);
    return found;
  }
  // A robot heavier than its model needs more torque, within the limits of its motors: its mass is the impulse of the
  // feet over that due to gravity and to the motion of the CoM, F dt = m (g dt + dv), also through impacts and flights.
  void weigh(double load) {
    WalkState& s = state_;
    const double v = biped_.velocity[2], due = 1.0 + (s.time > 0.0 ? (v - s.rising) / (gravity_ * dt_) : 0.0);
    if (!std::isfinite(load + v)) return;
    s.rising = v;
    const double settles = dt_ / kSettles, part = dt_ / std::min(std::max(s.time, kSettles), kWeighing);
    s.soon_felt += settles * (load / weight_ - s.soon_felt), s.soon_due += settles * (due - s.soon_due);
    if (s.soon_felt < kUnfelt * s.soon_due) return;
    s.felt += part * (load / weight_ - s.felt), s.due += part * (due - s.due);
    if (s.due > 0.0) s.heavier = held(s.felt / s.due, 1.0 - kHeavier, 1.0 + kHeavier);
  }

  double dt_, height_, omega_, pendulum_, k_, weight_, gravity_, steepest_,
      half_;                       // half: half the length of a sole [m]
  std::vector<std::string> aims_;  // reasons for a ZMP beside the middle of a sole
  std::string weakest_;  // joint of the legs that bears least, its share of torque by the model, the largest one
  double share_ = 0.0, most_ = 0.0;
  bool yields_ = false;
  std::vector<double> rates_;
  RateObserver observer_;
  Gait gait_{};
  Footsteps footsteps_{};
  Ability ability_{};
  std::vector<Sole> soles_;
  std::array<double, 9> upright_{};
  std::vector<double> limits_, rest_, sent_, overcome_;
  double slew_ = 0.0;  // largest change of a torque in a tick [N m]
  std::vector<JointFriction> friction_;
  bool has_sent_ = false, touches_ = false;  // touches: the swing foot bears load
  BipedState biped_;
  std::unique_ptr<Support> support_;
  WalkState state_;
  WalkReferences references_;
  DcmPlan dcm_{kPieces};
  std::vector<Piece> pieces_;
  std::vector<Command> paces_;
  std::vector<Limited> limited_;
  std::vector<Foothold> route_;  // footholds to step on, the next one at next_
  std::size_t next_ = 0;
  int first_ = 1;       // number of the first one, 0 for a step in place
  double floor_ = 0.0;  // height of the ground before the route [m]
  std::vector<Moved> moved_;
  std::string refused_;
};

}  // namespace hqp
