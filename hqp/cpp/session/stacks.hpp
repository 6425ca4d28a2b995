// The stacks of a plan at work: one of them, or transitions to it from others.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "guarded.hpp"
#include "node.hpp"
#include "transition.hpp"

namespace hqp {

// The state of a session while other worlds are stepped; nothing at first.
struct World {
  struct Line {
    std::size_t stack, number;  // line of a stack
    WarmState state;
  };
  struct Leg {
    std::size_t route;
    double ticks;
    std::size_t lines;  // without the first one, which the leg before ends with
    WarmState state;
  };
  WarmState halt;
  std::vector<WarmState> rows;  // per stack, nothing if it was not at work so far
  std::vector<WarmSets> sets;   // per stack
  std::vector<Line> lines;
  std::vector<Leg> legs;
  std::size_t at = 0;

  bool empty() const { return lines.empty(); }
  void clear() {
    halt.clear(), lines.clear(), legs.clear(), at = 0;
    for (WarmState& one : rows) one.clear();
    for (WarmSets& one : sets) one.forget();
  }
  std::size_t bytes() const {
    std::size_t sum = halt.bytes();
    for (const WarmState& one : rows) sum += one.bytes();
    for (const WarmSets& one : sets) sum += one.bytes();
    for (const Line& one : lines) sum += one.state.bytes();
    for (const Leg& one : legs) sum += one.state.bytes();
    return sum;
  }
};

class Stacks {
 public:
  // Throws PlanError if the plan is inconsistent.
  explicit Stacks(std::shared_ptr<const Plan> plan) : plan_(std::move(plan)) {
    const auto memory = std::make_shared<const Memory>(*plan_);
    const Node root(plan_->root(), *memory);
    add(FileSource(plan_, memory, plan_->root()), "");
    if (root.has("stacks"))
      for (const Json& one : plan_->root()["stacks"].items)
        add(FileSource(plan_, memory, one), Node(one, *memory).text("name"));
    if (root.has("ways"))
      for (const Node& one : root.parts("ways")) {
        const std::size_t from = std::size_t(one.place("from", named_.size())),
                          to = std::size_t(one.place("to", named_.size()));
        ways_.push_back({from, to, one.places("through", stacks_.size()), std::make_unique<Way>(one)});
        if (ways_.back().through.size() != ways_.back().way->stops.size())
          throw PlanError("a transition has " + std::to_string(ways_.back().through.size()) + " stacks and " +
                          std::to_string(ways_.back().way->stops.size()) + " stops: export the plan anew");
      }
    for (const Route& route : ways_) check(route);
    for (const std::size_t k : named_)
      for (const Member& member : stacks_[k].lines[0]->line().members())
        if (member.slot >= 0 && std::find(names_.begin(), names_.end(), member.name) == names_.end())
          names_.push_back(member.name);
    for (Stack& stack : stacks_) {
      for (const std::string& name : names_) stack.members.push_back(index(*stack.lines[0], name));
      if (stacks_.size() > 1) stack.lines[0]->share_rows();
      stack.lines[0]->join(*stacks_[0].lines[0]);
    }
    stale_.assign(stacks_.size(), false);
    current_ = first_ = stacks_[0].lines[0].get();
    tick_ = &current_->tick();
  }
  Stacks(const Stacks&) = delete;

  const Tick& step(const double* q, const double* v, const StateFacts& facts = {}) {
    tidy();
    tick_ = legs_.empty() ? &current_->step(q, v, facts) : &legs_.back().transition->step(q, v, facts);
    return *tick_;
  }
  const Tick& tick() const { return *tick_; }
  // Progress of a change of stack, 1 without one.
  double transition() const { return legs_.empty() ? 1.0 : legs_.back().transition->progress(); }

  // Switch to the stack of that name, at once or within `over` seconds at least. Throws ReferenceError for a name that
  // the plan does not have or a bad duration.
  void change(const std::string& name, double over) {
    std::size_t to = 0;
    while (to < named_.size() && stacks_[named_[to]].name != name) ++to;
    if (to == named_.size()) throw ReferenceError("the plan has no stack '" + name + "'; allowed: " + known());
    if (!(over >= 0.0 && std::isfinite(over)))
      throw ReferenceError("a change takes " + std::to_string(over) + " s, allowed 0 or above");
    tidy();
    const auto way =
        std::find_if(ways_.begin(), ways_.end(), [&](const Route& one) { return one.from == at_ && one.to == to; });
    if (way == ways_.end()) throw ReferenceError("the plan has no way to stack '" + name + "': export it with stacks");
    if (over == 0.0) {
      Guarded& next = fresh(named_[to]);
      for (const std::string& held : way->way->stops.back().first_kept) Transition::keep_hold(*current_, next, held);
      if (legs_.empty()) next.follow(*current_, current_->latest().x.data());
      else legs_.back().transition->pass_on(next);
      retire();
      current_ = &next;
    } else {
      if (!legs_.empty() && legs_.back().transition->depth() >= Transition::kDeepest) {
        legs_.back().transition->end();  // too many changes at a time: the oldest ones end here
        retire();
      }
      Leg leg{std::size_t(way - ways_.begin()), over / current_->line().dt(), {current_}, nullptr};
      for (std::size_t k = 1; k < way->through.size(); ++k) {
        Guarded& next = fresh(std::size_t(way->through[k]), leg.lines);
        for (const std::string& held : way->way->stops[k].first_kept) Transition::keep_hold(*current_, next, held);
        leg.lines.push_back(&next);
      }
      begin_leg(std::move(leg));
    }
    at_ = to;
  }
  // Names of the stacks, "" for the one that a session begins with.
  std::vector<std::string> stacks() const {
    std::vector<std::string> found;
    for (const std::size_t k : named_) found.push_back(stacks_[k].name);
    return found;
  }

  // Elements of all stacks that take a reference.
  const std::vector<std::string>& names() const { return names_; }
  // Index of an element; throws ReferenceError if no element with a reference has that name.
  std::size_t element(const std::string& name) const {
    const auto found = std::find(names_.begin(), names_.end(), name);
    if (found != names_.end()) return std::size_t(found - names_.begin());
    return stacks_[0].lines[0]->inputs().references().member(name);  // throws, and lists the names
  }
  // Set a field or the presence of an element in the stacks at work. Throws ReferenceError if none has the element.
  void set(std::size_t element, int field, const double* values, std::size_t size) {
    require(element, offer(element, field, values, size));
  }
  // Return false if no stack at work has the element.
  bool offer(std::size_t element, int field, const double* values, std::size_t size) {
    const bool any =
        each(element, [&](Guarded& line, std::size_t member) { line.inputs().set(member, field, values, size); });
    if (field == Reference::kLoad)
      for (const Leg& leg : legs_) leg.transition->measure(names_[element], *values);
    return any;
  }
  void say(std::size_t element, bool in) {
    require(element, each(element, [&](Guarded& line, std::size_t member) { line.inputs().say(member, in); }));
  }
  // Count of numbers in a field of the element's reference.
  std::size_t width(std::size_t element, int field) const {
    std::size_t k = 0;
    while (stacks_[k].members[element] < 0) ++k;
    return stacks_[k].lines[0]->inputs().references().width(std::size_t(stacks_[k].members[element]), field);
  }
  const std::vector<double>& held(std::size_t element) const {
    const Guarded* line = current_;
    int member = index(*line, names_[element]);
    for (std::size_t k = 0; member < 0; ++k) line = stacks_[k].lines[0].get(), member = stacks_[k].members[element];
    return line->line().slots()[std::size_t(line->line().members()[std::size_t(member)].slot)].hold;
  }
  // Set the phase of the following ticks, "" for none, in the stacks that have it.
  void phase(const std::string& name) {
    tidy();
    if (!current_->inputs().knows(name) &&
        (legs_.empty() || std::none_of(legs_.begin(), legs_.end(), [&](const Leg& leg) { return leg.knows(name); })))
      current_->inputs().phase(name);  // throws, and lists the phases
    phase_ = name;
    if (legs_.empty()) current_->inputs().phase(name);
    for (const Leg& leg : legs_)
      for (Guarded* line : leg.lines) line->inputs().phase(line->inputs().knows(name) ? name : "");
  }
  void begin(const double* command, const double* q, const double* v) {
    tidy();
    if (legs_.empty()) current_->begin(command, q, v);
    for (const Leg& leg : legs_) {
      for (Guarded* line : leg.lines) line->begin(command, q, v);
      leg.transition->begin_sent();
    }
  }
  // Return to the state after construction.
  void reset() {
    legs_.clear(), ended_.clear();
    for (Stack& stack : stacks_) {
      for (const auto& line : stack.lines) line->renew();
      stack.lines[0]->reset_rows();
    }
    stale_.assign(stacks_.size(), false);
    current_->timing().pause();
    phase_.clear(), at_ = 0;
    current_ = stacks_[0].lines[0].get();
    tick_ = &current_->tick();
  }
  // Continue with a world, as new if it is empty.
  void load(World& world) {
    world.rows.resize(stacks_.size()), world.sets.resize(stacks_.size());
    if (world.empty()) return stacks_[0].lines[0]->halt().resume(), reset();
    const Guarded* const alone = legs_.empty() ? current_ : nullptr;
    legs_.clear(), ended_.clear();
    for (std::size_t k = 0; k < stacks_.size(); ++k) {
      stale_[k] = world.rows[k].empty();
      if (stale_[k]) continue;
      CarryOver rows = CarryOver::from(world.rows[k]);
      stacks_[k].lines[0]->keep_rows(rows);
      stacks_[k].lines[0]->exchange(world.sets[k]);
    }
    std::vector<Guarded*> lines;
    for (const World::Line& one : world.lines) lines.push_back(&line(one.stack, one.number));
    for (Guarded* one : lines)
      if (one != alone || lines.size() > 1) one->renew();
    current_ = lines[0], at_ = world.at;
    std::size_t used = 1;
    for (const World::Leg& one : world.legs) {
      Leg leg{one.route, one.ticks, {lines[used - 1]}, nullptr};
      for (std::size_t k = 0; k < one.lines; ++k) leg.lines.push_back(lines[used++]);
      begin_leg(std::move(leg));
    }
    for (std::size_t k = 0; k < lines.size(); ++k) {
      CarryOver state = CarryOver::from(world.lines[k].state);
      lines[k]->keep(state);
    }
    for (std::size_t k = 0; k < legs_.size(); ++k) {
      CarryOver state = CarryOver::from(world.legs[k].state);
      legs_[k].transition->keep(state);
    }
    CarryOver halt = CarryOver::from(world.halt);
    current_->halt().keep(halt);
    tick_ = legs_.empty() ? &current_->tick() : &legs_.back().transition->tick();
  }
  void store(World& world) {
    tidy();
    world.rows.resize(stacks_.size()), world.sets.resize(stacks_.size());
    std::vector<std::pair<std::size_t, Guarded*>> lines;
    if (legs_.empty()) lines.emplace_back(named_[at_], current_);
    for (std::size_t k = 0; k < legs_.size(); ++k)
      for (std::size_t i = k > 0 ? 1 : 0; i < legs_[k].lines.size(); ++i)
        lines.emplace_back(std::size_t(ways_[legs_[k].route].through[i]), legs_[k].lines[i]);
    world.lines.resize(lines.size()), world.legs.resize(legs_.size());
    for (std::size_t k = 0; k < lines.size(); ++k) {
      World::Line& one = world.lines[k];
      one.stack = lines[k].first, one.number = number(lines[k].first, lines[k].second);
      CarryOver state = CarryOver::to(one.state);
      lines[k].second->keep(state);
    }
    for (std::size_t k = 0; k < legs_.size(); ++k) {
      World::Leg& one = world.legs[k];
      one.route = legs_[k].route, one.ticks = legs_[k].ticks, one.lines = legs_[k].lines.size() - 1;
      CarryOver state = CarryOver::to(one.state);
      legs_[k].transition->keep(state);
    }
    for (std::size_t k = 0; k < stacks_.size(); ++k) {
      const bool works = std::any_of(lines.begin(), lines.end(), [&](const auto& one) { return one.first == k; });
      if (!works && world.rows[k].empty()) continue;
      CarryOver rows = CarryOver::to(world.rows[k]);
      stacks_[k].lines[0]->keep_rows(rows);
      stacks_[k].lines[0]->exchange(world.sets[k]);
    }
    CarryOver halt = CarryOver::to(world.halt);
    current_->halt().keep(halt);
    world.at = at_;
  }
  // Finish every answer from now on, and accept states of any age.
  void without_deadline() {
    unlimited_ = true;
    for (Stack& stack : stacks_)
      for (const auto& line : stack.lines) line->without_deadline();
  }

  // A session whose counters and stops are those of all stacks; any thread may use these.
  Guarded& shared() { return *first_; }
  const Guarded& shared() const { return *first_; }
  // The stack at work, in a change the one that takes over.
  Guarded& current() { return *current_; }
  const Guarded& current() const { return *current_; }
  std::size_t levels() const {  // largest number in a stack
    std::size_t most = 0;
    for (const Stack& stack : stacks_) most = std::max(most, stack.lines[0]->line().levels().size());
    return most;
  }

 private:
  struct Stack {
    FileSource source;
    std::string name;
    std::vector<std::unique_ptr<Guarded>> lines;  // all of them share its rows and its solver
    std::vector<int> members;                     // index of each of names_, -1 for a name without a member
  };
  struct Route {
    std::size_t from, to;      // of named_
    std::vector<int> through;  // of stacks_
    std::unique_ptr<Way> way;
  };
  struct Leg {  // a transition that is under way to the next one, or to the current stack
    std::size_t route = 0;
    double ticks = 0.0;
    std::vector<Guarded*> lines;
    std::unique_ptr<Transition> transition;

    bool knows(const std::string& phase) const {
      return std::any_of(lines.begin(), lines.end(), [&](const Guarded* line) { return line->inputs().knows(phase); });
    }
  };

  static int index(const Guarded& line, const std::string& name) {
    const std::vector<Member>& members = line.line().members();
    for (std::size_t m = 0; m < members.size(); ++m)
      if (members[m].name == name && members[m].slot >= 0) return int(m);
    return -1;
  }
  void add(FileSource source, const std::string& name) {
    std::vector<std::unique_ptr<Guarded>> lines;
    lines.push_back(made<Guarded>(source));
    lines.back()->first();
    if (stacks_.empty() || !name.empty()) named_.push_back(stacks_.size());
    stacks_.push_back({std::move(source), name, std::move(lines), {}});
  }
  // Throws PlanError unless a transition on that way can begin.
  void check(const Route& route) const {
    for (std::size_t k = 0; k < route.through.size(); ++k) {
      const Guarded &one = *stacks_[std::size_t(route.through[k])].lines[0], &first = *stacks_[0].lines[0];
      if (one.line().nq() != first.line().nq() || one.line().nv() != first.line().nv() ||
          one.line().size() != first.line().size() || one.robot().picks != first.robot().picks)
        throw PlanError("stacks of the plan differ in their numbers of coordinates or commands: export it anew");
      const auto eased = [&](const Eased* rows, std::size_t before) {
        const std::size_t at = std::size_t(rows && rows->second ? route.through[k] : route.through[before]);
        if (rows) Easing(stacks_[at].lines[0]->line(), *rows);
      };
      if (k > 0) eased(route.way->stops[k].eased.get(), k - 1);
      if (k + 1 == route.through.size() && route.way->direct) eased(route.way->direct->eased.get(), 0);
    }
  }
  void begin_leg(Leg leg) {
    leg.transition = std::make_unique<Transition>(leg.lines, *ways_[leg.route].way, leg.ticks,
                                                  legs_.empty() ? nullptr : legs_.back().transition.get(), no_hooks_);
    current_ = leg.lines.back();
    legs_.push_back(std::move(leg));
  }
  // Forget the transitions that have ended; their ticks stay until the next step.
  void tidy() {
    if (legs_.empty()) return;
    std::size_t done = 0;
    for (std::size_t k = 0; k < legs_.size(); ++k)
      if (legs_[k].transition->done()) done = k + 1;
    if (done == 0) return;
    ended_.clear();
    ended_.insert(ended_.end(), std::make_move_iterator(legs_.begin()),
                  std::make_move_iterator(legs_.begin() + std::ptrdiff_t(done)));
    legs_.erase(legs_.begin(), legs_.begin() + std::ptrdiff_t(done));
  }
  void retire() {
    if (legs_.empty()) return;
    tick_ = &legs_.back().transition->tick();
    ended_ = std::move(legs_), legs_.clear();
  }
  bool works(const Guarded* line, const std::vector<Guarded*>& others) const {
    const auto among = [&](const std::vector<Guarded*>& some) {
      return std::find(some.begin(), some.end(), line) != some.end();
    };
    return line == current_ || among(others) ||
           std::any_of(legs_.begin(), legs_.end(), [&](const Leg& leg) { return among(leg.lines); });
  }
  // A line of a stack that is not at work, as new except for rows and solver.
  Guarded& fresh(std::size_t k, const std::vector<Guarded*>& others = {}) {
    Stack& stack = stacks_[k];
    for (const auto& line : stack.lines) line->inputs().all_in();
    std::size_t at = 0;
    while (at < stack.lines.size() && works(stack.lines[at].get(), others)) ++at;
    Guarded& line = this->line(k, at);
    if (stale_[k]) stack.lines[0]->reset_rows(), stale_[k] = false;
    line.renew();
    if (line.inputs().knows(phase_)) line.inputs().phase(phase_);
    return line;
  }
  template <class Do>
  bool each(std::size_t element, const Do& run) {
    tidy();
    bool any = false;
    const auto one = [&](std::size_t stack, Guarded& line) {
      const int member = stacks_[stack].members[element];
      if (member >= 0) run(line, std::size_t(member)), any = true;
    };
    if (legs_.empty()) one(named_[at_], *current_);
    for (std::size_t k = 0; k < legs_.size(); ++k)
      for (std::size_t i = k > 0 ? 1 : 0; i < legs_[k].lines.size(); ++i)
        one(std::size_t(ways_[legs_[k].route].through[i]), *legs_[k].lines[i]);
    return any;
  }
  void require(std::size_t element, bool any) const {
    if (!any) throw ReferenceError(names_[element] + ": the stack at work does not have it");
  }
  Guarded& line(std::size_t k, std::size_t number) {
    Stack& stack = stacks_[k];
    while (stack.lines.size() <= number) {
      for (const auto& other : stack.lines) other->inputs().all_in();
      stack.lines.push_back(made<Guarded>(stack.source));
      stack.lines.back()->share_rows(), stack.lines.back()->join(*stacks_[0].lines[0]);
      if (unlimited_) stack.lines.back()->without_deadline();
    }
    return *stack.lines[number];
  }
  std::size_t number(std::size_t k, const Guarded* line) const {
    std::size_t found = 0;
    while (stacks_[k].lines[found].get() != line) ++found;
    return found;
  }
  std::string known() const {
    std::string found;
    for (const std::size_t k : named_)
      if (k > 0) found += (found.empty() ? "" : ", ") + stacks_[k].name;
    return found.empty() ? "none" : found;
  }

  std::shared_ptr<const Plan> plan_;
  std::vector<Stack> stacks_;
  std::vector<std::size_t> named_;  // stacks with a name, and the first one
  std::vector<Route> ways_;
  std::vector<std::string> names_;
  std::vector<Leg> legs_, ended_;
  Guarded *current_ = nullptr, *first_ = nullptr;
  const Tick* tick_ = nullptr;
  std::size_t at_ = 0;  // of named_
  std::string phase_;
  bool unlimited_ = false;
  std::vector<bool> stale_;  // stacks whose rows are those of another world
  Transition::Hooks no_hooks_;
};

}  // namespace hqp
