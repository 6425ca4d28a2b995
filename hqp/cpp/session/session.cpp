// The session behind its header, for the widest instruction set of the machine.
#include "session.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>

#include "../policies/filtered.hpp"
#include "../walking/steered.hpp"
#include "filtering.hpp"
#include "stacks.hpp"
#include "walking.hpp"

namespace hqp {

Kernel* make_kernel(int n, int levels, const int* m, bool metric) {
  return HQP_FOR_MACHINE(make, n, levels, m, metric);
}

const char* name(Status status) {
  static const char* const names[] = {"OPTIMAL",           "RANK_UNCERTAIN",  "NOT_STRICT",      "CONSTRAINTS_VIOLATED",
                                      "INVALID_REFERENCE", "INVALID_ELEMENT", "CONTACT_LOST",    "ITERATION_LIMIT",
                                      "TIME_LIMIT",        "NOT_CERTIFIED",   "DYNAMICS_FAILED", "NOT_FOLLOWING",
                                      "INVALID_STATE",     "STOPPED"};
  return names[static_cast<int>(status)];
}

namespace {

std::string number(const char* format, double x) {
  if (std::isnan(x)) return "nan";
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, format, x);
  return buffer;
}

}  // namespace

std::string Note::text() const {
  const std::string at = where[0] ? std::string(where) + ": " : "", left = ": left out of this tick";
  const auto is = [](double x) { return number("%g", x); };
  const auto g3 = [](double x) { return number("%.3g", x); };
  const auto g4 = [](double x) { return number("%.4g", x); };
  const auto wrong = [&](const char* what) {
    if (!std::isfinite(amount)) return std::string("its ") + what + " is not finite" + left;
    return std::string("its ") + what + " is too large (" + number("%.1e", amount) + ", allowed " +
           number("%.0e", allowed) + ")" + left;
  };
  switch (cause) {
    case Cause::kNotFinite:
      return where[0] ? at + "position " + is(amount) + " is not a finite number" : "the solution is not finite";
    case Cause::kNotFiniteV:
      return at + "velocity " + is(amount) + " is not a finite number";
    case Cause::kTooLarge:
      return "q and v are too large: their squares overflow";
    case Cause::kQuaternion:
      return at + "quaternion of length " + g4(amount) + ", allowed 1 +- " + is(allowed);
    case Cause::kPair:
      return at + "(cos, sin) pair of length " + g4(amount) + ", allowed 1 +- " + is(allowed);
    case Cause::kPosition:
      return at + "position " + g4(amount) + " is too large, allowed " + g4(allowed) + " to " + g4(most);
    case Cause::kVelocity:
      return at + "velocity " + g4(amount) + " is too large, allowed at most " + is(allowed);
    case Cause::kBase:
      return at + "position " + g4(amount) + " m is too far from the origin, allowed " + is(allowed) + " m";
    case Cause::kNoTime:
      return "it has no time, but max_age needs one";
    case Cause::kAhead:
      return "its time is " + g3(amount) + " s ahead of the session's clock, allowed " + is(allowed) +
             " s: use one clock for both";
    case Cause::kAge:
      return "it is " + g3(amount) + " s old, allowed " + is(allowed) + " s";
    case Cause::kReference:
    case Cause::kRotation:
      return std::string("its reference is ") + (cause == Cause::kReference ? "not finite" : "not a rotation") +
             (left_out ? left : ": its hold value is used instead");
    case Cause::kJacobian:
      return wrong("Jacobian");
    case Cause::kDemand:
      return wrong("demand");
    case Cause::kBounds:
      return "its bounds are NaN or lower > upper in row " + std::to_string(row) + " (" + is(amount) + ", " +
             is(allowed) + ")" + left;
    case Cause::kOff: {
      std::string text =
          "violated by up to " + g3(amount) + (where[0] ? " by the " + std::string(where) + " limit" : "");
      const int shown = std::min(row_count, 3);
      for (int i = 0; i < shown; ++i) {
        text += (i ? ", " : ": ") + std::string(rows[i].name) + " " + g3(rows[i].amount);
        if (rows[i].of_shapes) text += " at " + number("%.1f", 1e3 * rows[i].distance) + " mm";
      }
      return row_count > shown ? text + " and " + std::to_string(row_count - shown) + " more" : text;
    }
    case Cause::kRate:
      return std::string(where) + " would change by " + g3(amount) + "/s, allowed " + g3(allowed) +
             "/s: the change of the command is scaled down";
    case Cause::kMotor:
      return std::string(where) + " would be sent " + g3(amount) + " " + rows[0].name + ", allowed " + g3(allowed) +
             " " + rows[0].name + ": the command is scaled down";
    case Cause::kJerk:
      return std::string(rows[0].name) + " is sent a jerk of " + g3(amount) + "/s^3, allowed " + g3(allowed) +
             "/s^3: '" + where + "' allows no less";
    case Cause::kContact:
      return "has carried less than " + is(allowed) + " N for " + number("%.0f", amount) + " ms, by its measured load";
    case Cause::kRestless:
      return "its command alternates between its limits " + number("%.0f", amount) +
             " times a second: set a price on the levels, or move the target within reach";
    case Cause::kOverrun:
      return "it cannot brake in time within its acceleration limit: its position limit will be exceeded by " +
             g3(amount) + " " + where;
    case Cause::kOutside:
    case Cause::kReturns:
      return "is " + g3(amount) + " " + where + " outside its range [" + g4(allowed) + ", " + g4(most) + "]" +
             (cause == Cause::kReturns ? " and returns" : "");
    case Cause::kSolver:
    case Cause::kForeign:
      return where;
    case Cause::kDynamics:
      return "the joint-space inertia is not positive definite";
    case Cause::kBears:
      return "cannot be released: it still carries " + g3(amount) + " N" +
             (most >= 0.0 ? " and " + g3(most) + " N m" : "") + "; unload it first";
    case Cause::kAnyAge:
      return "states carry their time, but the session has no max_age: old states are used, and joints that do not "
             "follow "
             "are not found; declare session(..., max_age=...)";
    case Cause::kFollow:
      return std::string(where) + " lacks " + g3(amount) + " " + rows[0].name + " of what it was sent, allowed " +
             g3(allowed) + " " + rows[0].name +
             (status == Status::kNotFollowing
                  ? ": a frozen sensor, a blocked joint, or joints in another order; the command comes to rest"
                  : ": a load or contact that the model lacks, a frozen sensor, or a blocked joint");
    case Cause::kNoState:
      return "no valid state so far: the command is zero";
    case Cause::kStopped:
      return std::string(where) + (amount > 0.0 ? " for " + g3(amount) + " s" : "") +
             ": the robot rests until resume() is called";
    case Cause::kStart:
      return "the command sent before the first tick is unknown: rates start from the torque that holds the robot; "
             "call begin(command=...) with the command that the robot is sent now";
  }
  return "";
}

void Reference::set(What what, const double* values, std::size_t size) { session_->set(element_, what, values, size); }
void Reference::on(bool in) { session_->say(element_, in); }
std::size_t Reference::size() const { return held().size(); }
const std::vector<double>& Reference::held() const { return static_cast<const Stacks*>(session_)->held(element_); }
const std::string& Reference::name() const { return session_->names()[element_]; }

Session::Session(std::shared_ptr<const Plan> plan) : stacks_(made<Stacks>(plan)), fingerprint_(plan->fingerprint()) {}
Session::~Session() = default;
Session::Session(Session&&) noexcept = default;
Session& Session::operator=(Session&&) noexcept = default;

Reference Session::reference(const std::string& name) { return {*stacks_, stacks_->element(name)}; }
void Session::phase(const std::string& name) { stacks_->phase(name); }
void Session::change(const std::string& stack, double over) { stacks_->change(stack, over); }
double Session::transition() const noexcept { return stacks_->transition(); }
std::vector<std::string> Session::stacks() const { return stacks_->stacks(); }
void Session::begin(const double* command, const double* q, const double* v) { stacks_->begin(command, q, v); }
const Tick& Session::step(const double* q, const double* v) noexcept { return stacks_->step(q, v); }
const Tick& Session::step(const double* q, const double* v, double time) noexcept {
  return step(q, v, time, std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count());
}
const Tick& Session::step(const double* q, const double* v, double time, double now) noexcept {
  StateFacts facts;
  facts.time = &time, facts.now = now;
  return stacks_->step(q, v, facts);
}
const Tick& Session::tick() const { return stacks_->tick(); }
Counts Session::counters() const noexcept { return stacks_->shared().timing().counters().counts(); }
std::int64_t Session::heartbeat() const noexcept { return stacks_->shared().timing().counters().heartbeat(); }
void Session::integrate(const double* q, const double* v, double dt, double* out) const {
  stacks_->current().line().kinematics()->integrate(q, v, dt, out);
}
void Session::reset() { stacks_->reset(); }
void Session::stop(const std::string& reason) { stacks_->shared().halt().stop(reason); }
void Session::resume() { stacks_->shared().halt().resume(); }
std::string Session::stopped() const {
  const char* why = stacks_->shared().halt().why();
  return why ? why : "";
}
std::size_t Session::levels() const { return stacks_->levels(); }
int Session::nq() const { return stacks_->current().line().nq(); }
int Session::nv() const { return stacks_->current().line().nv(); }
double Session::dt() const { return stacks_->current().line().dt(); }
const std::string& Session::robot() const { return stacks_->current().robot().name; }
const std::vector<std::string>& Session::joint_names() const { return stacks_->current().robot().joint_names; }
std::vector<std::string> Session::names() const { return stacks_->names(); }
const std::vector<double>& Session::home() const { return stacks_->current().robot().home; }

// See WalkingSession.
class Walk {
 public:
  explicit Walk(const std::shared_ptr<const Plan>& plan)
      : stacks(made<Stacks>(plan)),
        walker(walker_of(plan)),
        steered(plan, *stacks),
        command(walker->motors()),
        start(Node(plan->root(), Memory(*plan)).part("walker").numbers("start")) {
    if (start.size() != std::size_t(stacks->current().line().nq()))
      throw PlanError("the start of the plan's walker has another size than q: export it anew");
  }
  const Tick& step(const double* q, const double* v, const double* loads, const StateFacts& facts) {
    if (!stopping.empty() && (!walker->state().started || walker->stands())) {
      stacks->shared().halt().stop(stopping);
      stopping.clear();
    }
    return steered.step(*walker, *stacks, q, v, loads, facts, command.data());
  }
  // Give the walker an order, unless the session is stopped.
  template <class Order>
  void order(const Order& order) {
    const char* halted = stacks->shared().halt().why();
    if (halted || !stopping.empty()) walker->refuse(halted ? halted : stopping);
    else order(*walker);
  }

  std::unique_ptr<Stacks> stacks;
  std::unique_ptr<Walker> walker;
  Steered steered;
  std::vector<double> command, start;
  std::string stopping;  // reason of a stop that waits for the end of the walk
};

WalkingSession::WalkingSession(const std::shared_ptr<const Plan>& plan) : walk_(std::make_unique<Walk>(plan)) {}
WalkingSession::~WalkingSession() = default;
WalkingSession::WalkingSession(WalkingSession&&) noexcept = default;
WalkingSession& WalkingSession::operator=(WalkingSession&&) noexcept = default;

void WalkingSession::go(double forward, double left, double turn) {
  walk_->order([&](Walker& walker) { walker.go({forward, left, turn}); });
}
void WalkingSession::follow(const std::vector<Foothold>& footholds) {
  walk_->order([&](Walker& walker) { walker.follow(footholds); });
}
std::vector<Foothold> WalkingSession::ahead() const { return walk_->walker->ahead(); }
std::vector<std::string> WalkingSession::why() const { return walk_->walker->why(); }
std::array<double, 3> WalkingSession::velocity() const {
  const Command& command = walk_->walker->state().command;
  return {command.forward, command.left, command.turn};
}
void WalkingSession::stop() { walk_->walker->stop(); }
void WalkingSession::halt(const std::string& reason) { stop(), walk_->stopping = reason; }
void WalkingSession::resume() {
  walk_->stopping.clear();
  walk_->stacks->shared().halt().resume();
}
const Tick& WalkingSession::step(const double* q, const double* v, const double* loads) noexcept {
  return walk_->step(q, v, loads, {});
}
const Tick& WalkingSession::step(const double* q, const double* v, const double* loads, double time,
                                 double now) noexcept {
  StateFacts facts;
  facts.time = &time, facts.now = now;
  return walk_->step(q, v, loads, facts);
}
const std::vector<double>& WalkingSession::command() const { return walk_->command; }
const char* WalkingSession::phase() const {
  static constexpr const char* kNames[] = {"stand", "shift", "swing"};
  return kNames[int(walk_->walker->state().phase)];
}
const char* WalkingSession::support() const { return walk_->walker->support(); }
bool WalkingSession::walking() const { return walk_->walker->state().walking; }
double WalkingSession::time() const { return walk_->walker->state().time; }
std::array<double, 2> WalkingSession::capture_point() const {
  const Vec2& found = walk_->walker->state().capture_point;
  return {found.x, found.y};
}
const std::vector<double>& WalkingSession::start() const { return walk_->start; }
int WalkingSession::nq() const { return walk_->stacks->current().line().nq(); }
int WalkingSession::nv() const { return walk_->stacks->current().line().nv(); }
double WalkingSession::dt() const { return walk_->stacks->current().line().dt(); }
const std::vector<std::string>& WalkingSession::joint_names() const {
  return walk_->stacks->current().robot().joint_names;
}

// See FilterSession.
class Filtering {
 public:
  explicit Filtering(const std::shared_ptr<const Plan>& plan)
      : stacks(made<Stacks>(plan)),
        filter(filter_of(plan)),
        filtered(plan, *filter, *stacks),
        command(filter->motors()) {}
  const Tick& step(const double* q, const double* v, const double* policy, const StateFacts& facts) {
    return filtered.step(*filter, *stacks, q, v, policy, facts, command.data());
  }

  std::unique_ptr<Stacks> stacks;
  std::unique_ptr<Filter> filter;
  Filtered filtered;
  std::vector<double> command;
};

FilterSession::FilterSession(const std::shared_ptr<const Plan>& plan) : filtering_(std::make_unique<Filtering>(plan)) {}
FilterSession::~FilterSession() = default;
FilterSession::FilterSession(FilterSession&&) noexcept = default;
FilterSession& FilterSession::operator=(FilterSession&&) noexcept = default;

const Tick& FilterSession::step(const double* q, const double* v, const double* policy) noexcept {
  return filtering_->step(q, v, policy, {});
}
const Tick& FilterSession::step(const double* q, const double* v, const double* policy, double time,
                                double now) noexcept {
  StateFacts facts;
  facts.time = &time, facts.now = now;
  return filtering_->step(q, v, policy, facts);
}
const std::vector<double>& FilterSession::command() const { return filtering_->command; }
const std::vector<std::uint8_t>& FilterSession::limited() const { return filtering_->filter->limited(); }
void FilterSession::stop(const std::string& reason) { filtering_->stacks->shared().halt().stop(reason); }
void FilterSession::resume() { filtering_->stacks->shared().halt().resume(); }
void FilterSession::reset() { filtering_->stacks->reset(), filtering_->filter->reset(); }
int FilterSession::nq() const { return filtering_->stacks->current().line().nq(); }
int FilterSession::nv() const { return filtering_->stacks->current().line().nv(); }
double FilterSession::dt() const { return filtering_->stacks->current().line().dt(); }
const std::vector<std::string>& FilterSession::joint_names() const {
  return filtering_->stacks->current().robot().joint_names;
}

std::shared_ptr<const Plan> read(const std::string& path, const std::string& key) { return read_plan(path, key); }
Session load(const std::string& path, const std::string& key) { return Session(read(path, key)); }

}  // namespace hqp
