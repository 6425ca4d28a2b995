// The session behind its header, for the widest instruction set of the machine.
#include "session.hpp"

#include <cstdio>

#include "guarded.hpp"

namespace hqp {

Kernel* make_kernel(int n, int levels, const int* m, bool metric) {
  return HQP_FOR_MACHINE(make, n, levels, m, metric);
}

const char* name(Status status) {
  static const char* const names[] = {"OPTIMAL",           "RANK_UNCERTAIN",  "NOT_STRICT",      "CONSTRAINTS_VIOLATED",
                                      "INVALID_REFERENCE", "INVALID_ELEMENT", "CONTACT_LOST",    "ITERATION_LIMIT",
                                      "TIME_LIMIT",        "NOT_CERTIFIED",   "DYNAMICS_FAILED", "INVALID_STATE"};
  return names[static_cast<int>(status)];
}

std::string Note::text() const {
  const auto number = [](double x) {
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, "%.3g", x);
    return std::string(buffer);
  };
  const std::string at = where[0] ? std::string(where) + ": " : "";
  switch (cause) {
    case Cause::kNotFinite:
      return at + (where[0] ? number(amount) + " is not a finite number" : "the answer is not finite");
    case Cause::kQuaternion:
      return at + "a quaternion or (cos, sin) pair is not of length 1 within " + number(allowed);
    case Cause::kPosition:
      return at + "position " + number(amount) + " is too large, allowed up to " + number(allowed);
    case Cause::kVelocity:
      return at + "velocity " + number(amount) + " is too large, allowed at most " + number(allowed);
    case Cause::kBase:
      return at + "position " + number(amount) + " m is too far off, allowed " + number(allowed);
    case Cause::kReference:
      return "its reference is not finite, or no rotation: its hold value was taken instead";
    case Cause::kLeftOut:
      return status == Status::kInvalidReference ? "its reference is not finite, or no rotation: left out of this tick"
                                                 : "its rows are not finite or too large: left out of this tick";
    case Cause::kOff:
    case Cause::kOffByRate:
      return "off by up to " + number(amount) + (cause == Cause::kOff ? "" : " by the rate limit") +
             (where[0] ? ": " + std::string(where) : "");
    case Cause::kRate:
      return at + "it would change by " + number(amount) + "/s, allowed " + number(allowed) + "/s";
    case Cause::kContact:
      return "has carried less than " + number(allowed) + " N for " + number(amount) + " ms, by the loads given";
    case Cause::kSolver:
      return name(status);
    case Cause::kDynamics:
      return "the joint-space inertia is not positive definite, or constraints depend on each other";
    case Cause::kNoState:
      return "no good state so far: the command is zero";
  }
  return "";
}

void Reference::set(What what, const double* values, std::size_t size) { session_->set(member_, what, values, size); }
std::size_t Reference::size() const { return held().size(); }
const std::vector<double>& Reference::held() const {
  const Line& line = static_cast<const Guarded*>(session_)->line();
  return line.slots()[std::size_t(line.members()[member_].slot)].hold;
}
const std::string& Reference::name() const { return session_->line().members()[member_].name; }

Session::Session(std::shared_ptr<const Plan> plan) : guarded_(std::make_unique<Guarded>(std::move(plan))) {}
Session::~Session() = default;
Session::Session(Session&&) noexcept = default;
Session& Session::operator=(Session&&) noexcept = default;

Reference Session::reference(const std::string& name) { return {*guarded_, guarded_->member(name)}; }
const Tick& Session::step(const double* q, const double* v) noexcept { return guarded_->step(q, v); }
const Tick& Session::tick() const { return guarded_->tick(); }
void Session::integrate(const double* q, const double* v, double dt, double* out) const {
  guarded_->line().kinematics().integrate(q, v, dt, out);
}
void Session::reset() { guarded_->reset(); }
int Session::nq() const { return guarded_->line().nq(); }
int Session::nv() const { return guarded_->line().nv(); }
double Session::dt() const { return guarded_->line().dt(); }
const std::string& Session::robot() const { return guarded_->name(); }
const std::vector<std::string>& Session::joint_names() const { return guarded_->joint_names(); }
std::vector<std::string> Session::names() const {
  std::vector<std::string> found;
  for (const Member& member : guarded_->line().members())
    if (member.slot >= 0) found.push_back(member.name);
  return found;
}
const std::vector<double>& Session::home() const { return guarded_->home(); }

std::shared_ptr<const Plan> read(const std::string& path) { return read_plan(path); }
Session load(const std::string& path) { return Session(read(path)); }

}  // namespace hqp
