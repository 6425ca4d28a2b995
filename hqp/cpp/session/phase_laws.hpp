// Laws that hold in a phase: the demand of an element goes over to that of its new law; see hqp/loop/phase_laws.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "line.hpp"
#include "presence.hpp"

namespace hqp {

class PhaseLaws {
 public:
  PhaseLaws(Line& line, std::size_t phases) : line_(line) {
    const std::vector<Member>& members = line.members();
    const Node all = line.root().part("motion").part("laws");
    const std::size_t total = std::size_t(line.assembly().demands().size());
    for (const Node& one : line.root().parts("laws")) {
      Element found;
      while (found.member < members.size() && members[found.member].name != one.text("name")) ++found.member;
      if (found.member == members.size()) throw PlanError("the plan has no element " + one.text("name"));
      const Member& member = members[found.member];
      const std::size_t rows = std::size_t(member.row_end - member.row);
      if (std::size_t(member.row_end) > total) throw PlanError("a law of the plan is of no rows");
      found.row = member.row, found.row_end = member.row_end;
      found.kp = all.doubles("kp", total) + found.row, found.kd = all.doubles("kd", total) + found.row;
      for (const Node& law : one.parts("laws")) {
        const std::vector<double> held = law.numbers("held", 3);
        found.laws.push_back({{found.row, found.row_end, held[0], held[1], held[2]},
                              law.numbers("kp", rows),
                              law.numbers("kd", rows),
                              law.numbers("pace", rows)});
      }
      found.of = one.places("of", found.laws.size());
      if (found.of.size() != phases || phases == 0) throw PlanError("a phase of the plan has no law");
      elements_.push_back(std::move(found));
    }
  }

  // The laws of the tick that begins, in a phase; out: who was out of the tick before, null for the first one.
  void obey(std::size_t phase, const Presence::Out* out) {
    if (phase != phase_)
      for (Element& one : elements_) aim(one, one.of[phase], !out || (*out)[one.member]);
    phase_ = phase;
    for (Element& one : elements_)
      if (one.going) go_on(one);
  }
  // As declared.
  void reset() {
    for (Element& one : elements_) settle(one, one.of[0]);
    phase_ = kNone;
  }

 private:
  struct Law {
    Saturation held;
    std::vector<double> kp, kd, pace;
  };
  struct Share {  // of each row, of one law
    int law;
    std::vector<double> rows;
  };
  // The law that an element has or goes over to, and the laws beside it: at first, and in the latest tick.
  struct Element {
    std::size_t member = 0;
    int row = 0, row_end = 0;
    double *kp = nullptr, *kd = nullptr;
    std::vector<Law> laws;
    std::vector<int> of;  // by phase
    int law = 0;
    bool going = false;
    double age = 0.0;
    std::vector<double> pace;
    std::vector<Share> former, now;
  };
  static constexpr std::size_t kNone = std::size_t(-1);

  void aim(Element& one, int law, bool idle) {
    if (idle) return settle(one, law);
    if (law == one.law) return;
    std::vector<double> left(one.laws[0].kp.size());
    for (std::size_t i = 0; i < left.size(); ++i) {
      double others = 0.0;
      for (const Share& share : one.now) others += share.rows[i];
      left[i] = 1.0 - others;
    }
    one.former = one.now;
    one.former.push_back({one.law, std::move(left)});
    one.law = law, one.age = 0.0, one.going = true;
    one.pace = one.laws[std::size_t(law)].pace;
    for (const Share& share : one.former)
      for (std::size_t i = 0; i < one.pace.size(); ++i)
        one.pace[i] = std::max(one.pace[i], one.laws[std::size_t(share.law)].pace[i]);
  }
  void go_on(Element& one) {
    one.age += line_.dt();
    one.now.clear();
    bool any = false;
    for (const Share& share : one.former) {
      if (share.law == one.law) continue;
      one.now.push_back(share);
      for (std::size_t i = 0; i < one.pace.size(); ++i) {
        const double left = one.pace[i] > 0.0 ? 1.0 - std::min(1.0, one.age * one.pace[i]) : 0.0;
        one.now.back().rows[i] *= left;
        any = any || left != 0.0;
      }
    }
    if (!any) return settle(one, one.law);
    take(one);
  }
  void settle(Element& one, int law) {
    one.law = law, one.going = false;
    one.former.clear(), one.now.clear();
    take(one);
  }
  void take(const Element& one) {
    const Law& law = one.laws[std::size_t(one.law)];
    std::copy(law.kp.begin(), law.kp.end(), one.kp);
    std::copy(law.kd.begin(), law.kd.end(), one.kd);
    std::vector<Former> beside;
    for (const Share& share : one.now) {
      const Law& other = one.laws[std::size_t(share.law)];
      beside.push_back({other.held, other.kp, other.kd, share.rows});
    }
    line_.assembly().saturate(law.held);
    line_.assembly().beside(one.row, one.row_end, std::move(beside));
  }

  Line& line_;
  std::vector<Element> elements_;
  std::size_t phase_ = kNone;
};

}  // namespace hqp
