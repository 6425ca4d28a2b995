// Parts of a session, read from its plan: names and motors of the robot, limits on states and commands, braking.
#pragma once

#include <cmath>
#include <memory>
#include <numeric>
#include <string>
#include <vector>

#include "follow_watch.hpp"
#include "guards.hpp"
#include "halt.hpp"
#include "jerk_limiter.hpp"
#include "limit_watch.hpp"
#include "line.hpp"
#include "rest.hpp"

namespace hqp {

// Names of the robot and its joints; joints: actuated coordinates; picks: their indices in x.
struct RobotNames {
  std::string kind, name;
  std::vector<std::string> joint_names;
  std::vector<double> home;
  std::vector<int> joints, picks;

  template <class Node>
  static RobotNames of(const Node& root, const Line& line) {
    const Node robot = root.part("robot");
    RobotNames found{root.part("motion").text("kind"),
                     robot.text("name"),
                     robot.texts("joint_names"),
                     robot.numbers("home", std::size_t(line.nq())),
                     robot.places("actuated", std::size_t(line.nv())),
                     {}};
    found.picks = found.joints;
    if (found.kind == "torque") std::iota(found.picks.begin(), found.picks.end(), 0);
    if (found.joint_names.size() != found.picks.size())
      throw PlanError("the plan lists " + std::to_string(found.joint_names.size()) + " joint names for " +
                      std::to_string(found.picks.size()) + " commands: export it anew");
    for (const int pick : found.picks)
      if (pick < 0 || pick >= line.size())
        throw PlanError("joint index " + std::to_string(pick) + " of the plan is outside 0 to " +
                        std::to_string(line.size() - 1) + ": export it anew");
    return found;
  }
};

template <class Node>
StateCheck state_check(const Node& root, const Line& line) {
  const Node p = root.part("guards").part("state"), robot = root.part("robot");
  const std::size_t nv = std::size_t(line.nv());
  StateBounds bounds{p.numbers("low", nv), p.numbers("high", nv),  p.numbers("speed", nv),
                     p.number("distance"), robot.flag("floating"), robot.texts("coordinates")};
  return {std::move(bounds),
          robot.texts("places"),
          robot.texts("speeds"),
          p.number("ordinary"),
          p.has("max_age") ? std::make_unique<StateAge>(p.number("max_age")) : nullptr,
          line.kinematics()};
}

// Null if the plan limits no rates.
template <class Node>
std::unique_ptr<RateLimiter> rate_limiter(const Node& root, const Line& line, const RobotNames& robot) {
  const Node guards = root.part("guards");
  if (!guards.has("rates")) return nullptr;
  return std::make_unique<RateLimiter>(robot.joint_names, guards.numbers("rates"), line.dt(), "rate");
}

// Null if the plan checks no limits of the motors.
template <class Node>
std::unique_ptr<MotorLimits> motor_limits(const Node& root, const Line& line, const RobotNames& robot) {
  const Node guards = root.part("guards");
  if (!guards.has("motors")) return nullptr;
  const Node p = guards.part("motors");
  const double braking = robot.kind == "acceleration" ? guards.part("braking").number("deceleration") : 0.0;
  return std::make_unique<MotorLimits>(robot.joint_names, p.numbers("inverse"), p.texts("units"), line.dt(), braking);
}

// Null if the plan limits no jerk.
template <class Node>
std::unique_ptr<JerkLimiter> jerk_limiter(const Node& root, const Line& line, const RobotNames& robot) {
  const Node guards = root.part("guards");
  if (!guards.has("jerk")) return nullptr;
  const Node p = guards.part("jerk");
  JerkLimits limits{robot.joint_names, p.numbers("inverse"), p.numbers("change"), p.numbers("low"),
                    p.numbers("high"), p.numbers("speed"),   p.texts("elements"), p.number("rate")};
  return std::make_unique<JerkLimiter>(std::move(limits), robot.joints, robot.picks, std::size_t(line.size()),
                                       line.dt());
}

// Null without an age limit of states: it bounds the motion that a joint may lack.
template <class Node>
std::unique_ptr<FollowWatch> follow_watch(const Node& root, const Line& line, const RobotNames& robot) {
  const Node guards = root.part("guards");
  if (!guards.has("following")) return nullptr;
  const Node p = guards.part("following");
  std::vector<double> efforts(robot.joints.size(), 0.0);
  const std::vector<double> limits = root.part("robot").numbers("effort_limit");
  for (std::size_t i = 0; line.torque() && i < efforts.size(); ++i)
    efforts[i] = limits.at(std::size_t(robot.joints[i]));
  return std::make_unique<FollowWatch>(robot.joint_names, p.numbers("speed"), efforts, p.texts("units"), robot.joints,
                                       line.order(), p.number("delay"));
}

template <class Node>
Outgoing outgoing(const Node& root, const Line& line, const RobotNames& robot) {
  const Node guards = root.part("guards");
  const std::vector<std::string> statuses = guards.texts("statuses");
  if (statuses.size() != kStatuses)
    throw PlanError("the plan lists " + std::to_string(statuses.size()) + " status texts, needed " +
                    std::to_string(kStatuses) + ": export it anew");
  return line.outgoing(robot.picks, guards.numbers("gradual"), guards.number("violation"), statuses);
}

inline ContactWatch contact_watch(const Line& line) {
  std::vector<std::string> names;
  for (const Member& member : line.members()) names.push_back(member.name);
  return {std::move(names), line.dt()};
}

inline LimitWatch limit_watch(const Line& line) {
  LimitWatch::Parts parts;
  std::vector<std::string> names;
  for (const Member* member : line.placed()) {
    if (member->units.empty()) continue;
    parts.emplace_back(line.start(*member) + member->first, line.start(*member) + member->last);
    names.insert(names.end(), member->row_names.begin(), member->row_names.end());
  }
  return {std::move(parts), std::move(names), line.dt()};
}

template <class Node>
std::shared_ptr<Halt> halt(const Node& root, const Line& line) {
  const Node braking = root.part("guards").part("braking");
  const std::string resume = braking.text("resume");
  const double after = std::ceil(braking.number("after") / line.dt());
  if ((resume != "auto" && resume != "ask") || !(after > 0.0 && after < 1e15))
    throw PlanError("braking resumes by '" + resume + "', allowed auto and ask, after " +
                    std::to_string(braking.number("after")) + " s, allowed above 0: export the plan anew");
  return std::make_shared<Halt>(resume == "ask" ? std::int64_t(after) : 0, line.dt());
}

template <class Node>
std::unique_ptr<Rest> rest(const Node& root, const Line& line, const RobotNames& robot) {
  const Node braking = root.part("guards").part("braking"), p = root.part("robot");
  const double deceleration = braking.number("deceleration");
  const std::size_t nv = std::size_t(line.nv());
  std::unique_ptr<Rest> found;
  if (robot.kind == "velocity") {
    found = std::make_unique<SlowDown>(p.numbers("lower", nv), p.numbers("upper", nv), robot.joints, deceleration,
                                       line.dt());
  } else if (robot.kind == "acceleration") {
    found = std::make_unique<Brake>(nv, robot.joints, deceleration, line.dt());
  } else if (line.torque()) {
    std::vector<double> limit;
    for (const int i : robot.joints) limit.push_back(p.numbers("effort_limit").at(std::size_t(i)));
    found = std::make_unique<Hold>(limit, braking.number("damping"), line.dt());
  } else {
    throw PlanError("the plan is of kind '" + robot.kind + "'; allowed: velocity, acceleration, torque");
  }
  if (found->size() != std::size_t(line.size()))
    throw PlanError("the braking of the plan has " + std::to_string(found->size()) + " variables, its solver " +
                    std::to_string(line.size()) + ": export it anew");
  return found;
}

}  // namespace hqp
