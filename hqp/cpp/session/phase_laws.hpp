// Law of each element in each phase; LawChange has the change from one to the next.
#pragma once

#include <utility>
#include <vector>

#include "line.hpp"
#include "presence.hpp"

namespace hqp {

class PhaseLaws {
 public:
  template <class Node>
  PhaseLaws(const Node& root, Line& line, std::size_t phases) : demands_(line.assembly().demands()), dt_(line.dt()) {
    const std::vector<Member>& members = line.members();
    for (const Node& one : root.parts("laws")) {
      std::size_t m = 0;
      while (m < members.size() && members[m].name != one.text("name")) ++m;
      if (m == members.size())
        throw PlanError("a law names element '" + one.text("name") + "', which the plan does not have");
      const int start = members[m].row, stop = members[m].row_end;
      if (stop > demands_.size())
        throw PlanError("the law of element '" + one.text("name") + "' ends at row " + std::to_string(stop) +
                        ", the plan has " + std::to_string(demands_.size()) + ": export it anew");
      const std::vector<Node> laws = one.parts("laws");
      for (const Node& law : laws) demands_.add(rows_law(law, start, stop));
      elements_.push_back({m, start, stop, one.places("of", laws.size())});
      if (elements_.back().of.size() != phases || phases == 0)
        throw PlanError("element '" + one.text("name") + "' has laws for " +
                        std::to_string(elements_.back().of.size()) + " phases, the plan has " + std::to_string(phases) +
                        ": export it anew");
    }
  }

  // Set the laws of a tick in a phase; out: absent elements of the tick before, null for the first one.
  void obey(std::size_t phase, const Presence::Out* out) {
    if (std::exchange(phase_, phase) != phase)
      for (const Element& one : elements_) aim(one, phase, !out || (*out)[one.member]);
    demands_.go_on(dt_);
  }
  // Return to the declared laws.
  void reset() {
    for (const Element& one : elements_) aim(one, 0, true);
    phase_ = kNone;
  }

 private:
  struct Element {
    std::size_t member;
    int start, stop;
    std::vector<int> of;  // by phase
  };
  static constexpr std::size_t kNone = std::size_t(-1);

  void aim(const Element& one, std::size_t phase, bool at_once) {
    demands_.aim(one.start, one.stop, std::size_t(one.of[phase]), at_once);
  }

  Demands& demands_;
  double dt_;
  std::vector<Element> elements_;
  std::size_t phase_ = kNone;
};

}  // namespace hqp
