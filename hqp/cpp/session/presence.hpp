// Presence of elements in a tick: by its phase, by on(), and by the contacts that they follow.
#pragma once

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "../common/carry_over.hpp"
#include "line.hpp"

namespace hqp {

class Presence {
 public:
  using Out = std::vector<bool>;  // per member of the line: true if it is absent

  template <class Node>
  Presence(const Node& root, const std::vector<Member>& members)
      : said_(members.size(), 0), last_(members.size(), 0), out_(members.size()), before_(members.size()) {
    const auto member = [&](const std::string& name) {
      for (std::size_t m = 0; m < members.size(); ++m)
        if (members[m].name == name) return m;
      throw PlanError("phases or followers name element '" + name + "', which the plan does not have");
    };
    for (const Node& one : root.parts("follows")) {
      Follower found{member(one.text("name")), one.flag("every"), {}};
      for (const std::string& name : one.texts("of")) found.of.push_back(member(name));
      followers_.push_back(std::move(found));
    }
    for (const Node& one : root.parts("phases")) {
      Out out(members.size(), false);
      for (const std::string& name : one.texts("out")) out[member(name)] = true;
      names_.push_back(one.text("name"));
      declared_.push_back(std::move(out));
    }
    if (declared_.empty()) throw PlanError("the plan lists no phases, needed at least the unnamed one: export it anew");
  }

  // Names of phases; the first one is "", for ticks without a phase.
  const std::vector<std::string>& names() const { return names_; }
  void phase(std::size_t k) { phase_ = k; }
  // Throws ReferenceError if the plan has no such phase.
  void phase(const std::string& name) {
    const auto found = std::find(names_.begin(), names_.end(), name);
    if (found != names_.end()) return phase(std::size_t(found - names_.begin()));
    std::string known;
    for (std::size_t k = 1; k < names_.size(); ++k) known += (k > 1 ? ", " : "") + names_[k];
    throw ReferenceError("the plan has no phase '" + name + "'; allowed: " + (known.empty() ? "none" : known));
  }
  std::size_t phase() const { return phase_; }
  bool knows(const std::string& phase) const {
    return phase.empty() || std::find(names_.begin(), names_.end(), phase) != names_.end();
  }
  // Set the presence of a member in the next tick.
  void say(std::size_t m, bool in) { said_[m] = in ? 1 : -1; }
  void forget() { std::fill(said_.begin(), said_.end(), 0); }
  void forget_all() { forget(), std::fill(last_.begin(), last_.end(), 0), phase_ = 0; }
  void keep(CarryOver& state) { state.take(phase_), state.take(last_.data(), last_.size()); }
  // As References::lasting.
  void lasting(bool lasts) { lasting_ = lasts; }

  // Return the absent members of this tick.  named: members with a reference in it.
  const Out& take(const Out& named) {
    out_ = declared_[phase_];
    for (std::size_t m = 0; m < out_.size(); ++m) {
      if (named[m] || !lasting_) last_[m] = said_[m];
      if (last_[m]) out_[m] = last_[m] < 0;
      said_[m] = 0;
    }
    follow();
    return out_;
  }

 private:
  struct Follower {
    std::size_t member;
    bool every;  // absent if all of these are, else if one is
    std::vector<std::size_t> of;
  };
  void follow() {
    before_ = out_;
    for (const Follower& one : followers_) {
      const auto gone = [&](std::size_t m) { return bool(before_[m]); };
      if (one.every ? std::all_of(one.of.begin(), one.of.end(), gone) : std::any_of(one.of.begin(), one.of.end(), gone))
        out_[one.member] = true;
    }
  }

  std::vector<std::string> names_;
  std::vector<Out> declared_;
  std::vector<Follower> followers_;
  std::vector<int> said_, last_;
  bool lasting_ = false;
  std::size_t phase_ = 0;
  Out out_, before_;
};

}  // namespace hqp
