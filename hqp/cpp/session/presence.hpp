// Which elements are in a tick: by its phase, by what it is told of them, and by the contacts that they go with.
#pragma once

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "line.hpp"

namespace hqp {

class Presence {
 public:
  using Out = std::vector<bool>;  // of every member of the line, whether it is out

  template <class Node>
  Presence(const Node& root, const std::vector<Member>& members)
      : said_(members.size(), 0), out_(members.size()), before_(members.size()) {
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

  // The first one has no name: it is that of ticks without a phase.
  const std::vector<std::string>& names() const { return names_; }
  void phase(std::size_t k) { phase_ = k; }
  std::size_t phase() const { return phase_; }
  // Whether a member is in, for the next tick only.
  void say(std::size_t m, bool in) { said_[m] = in ? 1 : -1; }
  void forget() { std::fill(said_.begin(), said_.end(), 0); }

  // Who is out of the tick that begins.
  const Out& take() {
    out_ = declared_[phase_];
    for (std::size_t m = 0; m < out_.size(); ++m) {
      if (said_[m]) out_[m] = said_[m] < 0;
      said_[m] = 0;
    }
    follow();
    return out_;
  }

 private:
  struct Follower {
    std::size_t member;
    bool every;  // out where all of these are, else where one is
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
  std::vector<int> said_;
  std::size_t phase_ = 0;
  Out out_, before_;
};

}  // namespace hqp
