// A filter around a session of its stack: a state and a policy's command in, the command to send out.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "../session/stacks.hpp"
#include "filter.hpp"

namespace hqp {

template <class Make>
auto of_filter(const std::shared_ptr<const Plan>& plan, const Memory& memory, const Make& make) {
  return of_part(plan, memory, "filter", "PolicyFilterSession.export", make);
}
inline std::unique_ptr<Filter> filter_of(const std::shared_ptr<const Plan>& plan) {
  const Memory memory(*plan);
  return of_filter(plan, memory, [](const Node& node) { return std::make_unique<Filter>(node); });
}

// Model and places of the elements, shared by filters that take turns at a session.
class Filtered {
 public:
  Filtered(const std::shared_ptr<const Plan>& plan, const Filter& filter, Stacks& session)
      : memory_(*plan), model_(of_filter(plan, memory_, [](const Node& node) {
          return std::make_unique<InverseDynamics>(node.part("model"));
        })) {
    const Line& line = session.current().line();
    if (model_->kinematics().size() != line.nq() || model_->nv() != line.nv() ||
        filter.nq() != std::size_t(line.nq()) || filter.nv() != std::size_t(line.nv()) ||
        filter.motors() != session.tick().command().size())
      throw PlanError("the filter of the plan is not one of its robot: export it anew");
    policy_ = element(session, "policy", filter.motors());
    still_.resize(filter.motors());
    if (filter.forces()) lacking_ = element(session, "lacking", filter.lacking().size());
  }
  Filtered(const Filtered&) = delete;

  // One tick; command: the one to send.
  const Tick& step(Filter& filter, Stacks& session, const double* q, const double* v, const double* policy,
                   const StateFacts& facts, double* command) {
    filter.begin(*model_, policy, q, v);
    if (filter.forces()) {
      offer(session, policy_, kValue, filter.free());
      offer(session, lacking_, kValue, filter.lacking());
    } else {
      offer(session, policy_, kValue, still_);
      offer(session, policy_, kVelocity, filter.free());
    }
    const Tick& tick = session.step(filter.middle().data(), v, facts);
    filter.end(tick.command().data(), tick.solved(), command);
    return tick;
  }

 private:
  enum Field { kValue, kVelocity };  // fields of a Reference

  static std::size_t element(const Stacks& session, const char* name, std::size_t size) {
    const std::size_t found = session.element(name);
    if (session.width(found, kValue) != size)
      throw PlanError(std::string("the element '") + name + "' is not one of the filter: export it anew");
    return found;
  }
  static void offer(Stacks& session, std::size_t element, Field field, const std::vector<double>& numbers) {
    session.offer(element, field, numbers.data(), numbers.size());
  }

  Memory memory_;
  std::unique_ptr<InverseDynamics> model_;
  std::size_t policy_ = 0, lacking_ = 0;
  std::vector<double> still_;
};

}  // namespace hqp
