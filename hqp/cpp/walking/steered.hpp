// A walker ahead of a session of its stack: references in, torques out.
#pragma once

#include <algorithm>
#include <array>
#include <memory>
#include <string>
#include <vector>

#include "../session/stacks.hpp"
#include "walker.hpp"

namespace hqp {

template <class Make>
auto of_walker(const std::shared_ptr<const Plan>& plan, const Memory& memory, const Make& make) {
  return of_part(plan, memory, "walker", "Walker.export", make);
}
inline std::unique_ptr<Walker> walker_of(const std::shared_ptr<const Plan>& plan) {
  const Memory memory(*plan);
  return of_walker(plan, memory, [](const Node& node) { return std::make_unique<Walker>(node); });
}

// Kinematics and places of the elements, shared by walkers that take turns at a session.
class Steered {
 public:
  Steered(const std::shared_ptr<const Plan>& plan, Stacks& session)
      : memory_(*plan), kinematics_(of_walker(plan, memory_, [&](const Node& node) {
          std::vector<Node> feet;
          for (const Node& one : node.parts("soles")) feet.push_back(one.part("frame"));
          need(feet.size() == 2, "a walker has two soles");
          elements_ = node.texts("elements");
          motors_ = node.numbers("limits").size();
          return std::make_unique<FeetKinematics>(node.part("motion"), feet, node.integer("nv"));
        })) {
    const Line& line = session.current().line();
    constexpr std::size_t kWidths[] = {4, 1, 9, 1, 16, 16};
    if (kinematics_->nq() != line.nq() || kinematics_->nv() != line.nv() ||
        motors_ != session.tick().command().size() || elements_.size() != places_.size())
      throw PlanError("the walker of the plan is not one of its robot: export it anew");
    for (std::size_t k = 0; k < places_.size(); ++k) {
      places_[k] = session.element(elements_[k]);
      const bool sole = k >= std::size(kWidths);
      if (session.width(places_[k], sole ? kNormal : kValue) != (sole ? 3 : kWidths[k]))
        throw PlanError("the element '" + elements_[k] + "' is not one of a walk: export it anew");
    }
    for (const char* phase : {"left", "right", "both"}) session.phase(phase);
  }
  Steered(const Steered&) = delete;

  // One tick; command: the torques, those of the tick with friction, bounded by the walker.
  const Tick& step(Walker& walker, Stacks& session, const double* q, const double* v, const double* loads,
                   const StateFacts& facts, double* command) {
    const double* rates = walker.observe(v).data();
    kinematics_->update(q, rates);
    walker.biped().read(*kinematics_);
    walker.step(loads);
    session.phase(walker.support());
    session.current().line().assembly().weigh(walker.state().heavier);
    refer(walker, session);
    const Tick& tick = session.step(q, rates, facts);
    std::copy(tick.command().begin(), tick.command().end(), command);
    walker.moves([&](std::size_t column) {
      return tick.solved() ? session.current().line().torque()->acceleration(column, tick.x().data()) : 0.0;
    });
    walker.finish(loads, command);
    return tick;
  }

 private:
  enum Element { kBalance, kHeight, kTrunk, kShare, kSwing, kSole = 6 };
  enum Field { kValue, kVelocity, kAcceleration, kNormal };  // fields of a Reference

  void refer(const Walker& walker, Stacks& session) const {
    const WalkReferences& found = walker.references();
    const auto offer = [&](int element, int field, const double* numbers, std::size_t size) {
      session.offer(places_[std::size_t(element)], field, numbers, size);
    };
    const WalkState& state = walker.state();
    offer(kBalance, kValue, found.balance.data(), 4);
    offer(kHeight, kValue, &found.height, 1);
    if (state.swings()) {
      const int swing = kSwing + 1 - state.stance;
      offer(swing, kValue, found.swing.data(), 16);
      offer(swing, kVelocity, found.swing_velocity.data(), 6);
      offer(swing, kAcceleration, found.swing_acceleration.data(), 6);
    } else {
      offer(kShare, kValue, &found.share, 1);
    }
    offer(kTrunk, kValue, found.trunk.data(), 9);
    for (const int side : {kLeft, kRight})
      if (!state.swings() || side == state.stance)
        offer(kSole + side, kNormal, found.normal[std::size_t(side)].data(), 3);
  }

  Memory memory_;
  std::vector<std::string> elements_;
  std::size_t motors_ = 0;
  std::unique_ptr<FeetKinematics> kinematics_;
  std::array<std::size_t, 8> places_{};
};

}  // namespace hqp
