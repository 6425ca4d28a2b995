// From one stack to another without a jump: neighbours on a way of stacks are solved side by side and blended, one pair
// after the other.  See Ramp and Easing.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "easing.hpp"
#include "guarded.hpp"
#include "ramp.hpp"

namespace hqp {

// Stacks that a transition passes through: hqp/loop/way.py.
struct Way {
  struct Stop {
    bool switches = false;                      // the reaction constraints change on the way to the next one
    std::vector<std::string> released, taken;   // contacts that go and come then
    std::vector<std::string> kept, first_kept;  // elements with the hold value of the stop before, of the first stop
    std::unique_ptr<Eased> eased;               // rows of the pair that ends here, or null
  };

  template <class Node>
  explicit Way(const Node& p) : here(p.texts("here")), light(p.number("light")) {
    for (const Node& one : p.parts("stops")) stops.push_back(stop(one));
    if (p.has("direct")) direct = std::make_unique<Stop>(stop(p.part("direct")));
    if (stops.size() < 2 || (stops.size() > 2 && !direct))
      throw PlanError("a transition has " + std::to_string(stops.size()) +
                      " stacks, needed two, or more and a direct way: export it anew");
  }

  std::vector<Stop> stops;
  std::unique_ptr<Stop> direct;   // the last stop as the second one, if measured loads show that contacts have switched
  std::vector<std::string> here;  // contacts on their way out that are held where they are
  double light;                   // load up to which a contact is let go as it is [N]

 private:
  template <class Node>
  static Stop stop(const Node& p) {
    Stop found;
    found.switches = p.flag("switch");
    found.released = p.texts("released"), found.taken = p.texts("taken");
    found.kept = p.texts("kept"), found.first_kept = p.texts("first_kept");
    if (p.has("eased")) found.eased = std::make_unique<Eased>(Eased::of(p.part("eased")));
    return found;
  }
};

class Transition {
 public:
  static constexpr int kDeepest = 3;             // transitions that may be under way at a time
  static constexpr double kBearsNothing = 1e-2;  // largest force of a contact that is released [N, N m]

  // Called around the ticks of stacks, by their indices on the way, for rows that Python writes.
  struct Hooks {
    virtual ~Hooks() = default;
    virtual void begins(std::size_t, std::size_t, bool) {}  // first and second stack; true if the second one is last
    virtual void before(std::size_t) {}
    virtual void after(std::size_t) {}
    virtual void sent() {}
  };

  // Tick that represents the blend, by its stack, and the notes to add to its own; see tick().
  struct Sent {
    std::size_t stack = 0, first = 0, second = 0;
    bool held = false, done = false;
    std::vector<Note> waits, limited;  // contacts that still bear a force; limits and rest
  };

  // stacks: one for each stop; the first one is at work, or the last one of `under_way`, if that is not null.  ticks:
  // least number of ticks for the whole way.
  Transition(std::vector<Guarded*> stacks, const Way& way, double ticks, Transition* under_way, Hooks& hooks)
      : stacks_(std::move(stacks)),
        way_(way),
        under_way_(under_way),
        hooks_(hooks),
        ramp_(ticks, changes(stacks_), stacks_[0]->robot().picks),
        gradual_(stacks_[0]->robot().joint_names, inverse_of(ramp_.caps()), stacks_[0]->line().dt(), "transition"),
        x_(under_way ? under_way->x_ : stacks_[0]->latest().x),
        rest_(under_way ? under_way->rest_->copy() : stacks_[0]->resting().copy()),
        good_(under_way ? under_way->good_ : stacks_[0]->latest().good),
        ordinary_(under_way ? under_way->ordinary_ : stacks_[0]->ordinary()),
        reached_(ordinary_ && !under_way),
        chosen_(way.stops.size() == 2) {
    if (stacks_.size() != way_.stops.size()) throw PlanError("a transition needs a session for each of its stacks");
    const Guarded& from = under_way_ ? under_way_->latest() : *stacks_[0];
    const Tick& tick = under_way_ ? under_way_->tick_ : stacks_[0]->tick();
    tick_ = tick;
    tick_.notes_.resize(2 * tick.notes_.size());
    held_ = tick.held();
    sent_.waits.reserve(4), sent_.limited.reserve(tick_.notes_.size());
    if (!under_way_) stacks_[0]->aside();
    stacks_[0]->inputs().lasting(true);
    for (std::size_t k = 1; k < stacks_.size(); ++k) stacks_[k]->follow(from, x_.data()), stacks_[k]->aside();
    for (std::size_t k = 0; k < stacks_.size(); ++k) order_.push_back(k);
    for (const Guarded* one : stacks_) {
      tick_.residuals_.reserve(one->tick().residuals_.size());
      tick_.marks_.reserve(one->tick().marks_.size());
    }
    if (under_way_) under_way_->leaving_ = true;
    take_way();
  }
  Transition(const Transition&) = delete;

  // Carry over to the next tick, for stacks that have been carried over.
  void keep(CarryOver& state) {
    ramp_.keep(state);
    state.take(x_.data(), x_.size()), state.take(tick_.count_), state.take(held_), state.take(progress_);
    state.take(good_), state.take(ordinary_), state.take(reached_), state.take(chosen_), state.take(begun_);
    state.take(direct_), state.take(leaving_), state.take(sent_.stack);
    if (held_ > 0) rest_->keep(state);
    if (state.writes()) return;
    order_.clear();
    for (std::size_t k = 0; k < stacks_.size(); ++k) order_.push_back(k);
    take_way();
    sent_.done = false, tick_.held_ = held_;
    if (!begun_) return;
    stack(0).inputs().lasting(true), stack(1).inputs().lasting(!ramp_.arriving() || leaving_);
    if (Easing* const ease = easings_[ramp_.at()].get()) stack(ease->second() ? 1 : 0).line().ahead(ease);
  }

  // Load that a contact was measured to bear in the next tick [N].
  void measure(const std::string& name, double load) {
    if (!chosen_) loads_.emplace_back(name, load);
  }

  const Tick& step(const double* q, const double* v, const StateFacts& facts) {
    const double start = Timing::now();
    if (!std::exchange(chosen_, true)) choose_way();
    loads_.clear();
    if (!std::exchange(begun_, true)) begin();
    Easing* const ease = easings_[ramp_.at()].get();
    Guarded &first = stack(0), &second = stack(1);
    bool here = ease && ease->stands();
    for (std::size_t k = 0; here && k < ease->elements().size(); ++k) here = !first.inputs().named(ease->elements()[k]);
    if (!here && order_[ramp_.at()] == 0) hold_here(0, way_.here);
    sent_.waits.clear(), sent_.limited.clear();
    double h = 0.0;
    if (ease && !ease->second()) {
      const Tick& b = run(1, q, v, facts);
      h = ramp_.target(false);
      ease->aim(b.x().data(), h, here);
      run(0, q, v, facts);
    } else {
      const Tick& a = run(0, q, v, facts);
      if (a.held() == 0) bear(a.x().data());
      h = ramp_.target(!sent_.waits.empty());
      if (ease) ease->aim(a.x().data(), h, here);
      run(1, q, v, facts);
    }
    const Tick &a = tick_of(0), &b = tick_of(1);
    if (!good_ && tick_.count_ == 0) x_ = first.latest().start;
    sent_.first = order_[ramp_.at()], sent_.second = order_[ramp_.at() + 1];
    sent_.held = a.held() > 0 || b.held() > 0, sent_.done = false;
    if (sent_.held) rest(second, a, b);
    else blend(first, second, a, b, h);
    tick_.count_ = b.count();
    for (std::size_t k = is_under_way(0) ? 1 : 0; k < stacks_.size(); ++k)
      if (k != sent_.first && k != sent_.second) stacks_[k]->inputs().forget();
    if (is_under_way(0) && under_way_->done())
      under_way_ = nullptr, stacks_[0]->aside(), stacks_[0]->inputs().lasting(true);
    std::copy(tick_.x_.begin(), tick_.x_.end(), x_.begin());
    if (sent_.done) end();  // from x_
    else if (ramp_.advance()) begun_ = false, first.line().ahead(nullptr);
    progress_ = ramp_.progress();
    const std::vector<int>& picks = second.robot().picks;
    for (std::size_t i = 0; i < picks.size(); ++i) tick_.command_[i] = x_[std::size_t(picks[i])];
    hooks_.sent();
    if (!leaving_) count(start);
    return tick_;
  }
  // Start from the command that all stacks have begun with.
  void begin_sent() { x_ = last().latest().x, good_ = true, held_ = 0; }
  // Let the last stack take over from the last command.
  void end() {
    for (Guarded* one : stacks_) one->line().ahead(nullptr);
    pass_on(last());
    under_way_ = nullptr;
  }
  // Let another stack continue alone from the last command.
  void pass_on(Guarded& other) const {
    if (&other != &latest()) other.follow(latest(), x_.data());
    other.alone(x_.data());
    other.hold(held_, *rest_);
  }

  // Hold an element at the hold value of another stack, if that has one.
  static void keep_hold(const Guarded& from, Guarded& to, const std::string& name) {
    const std::vector<double>* held = from.inputs().references().held(name);
    if (!held) return;
    for (const Member& member : to.line().members())
      if (member.name == name && member.slot >= 0 &&
          to.line().slots()[std::size_t(member.slot)].hold.size() == held->size())
        to.inputs().references().keep_hold(std::size_t(member.slot), held->data());
  }

  const Tick& tick() const { return tick_; }
  const Sent& sent() const { return sent_; }
  double progress() const { return progress_; }  // 0 at the start, 1 at the end of the way
  bool done() const { return sent_.done; }
  bool good() const { return good_; }
  int depth() const { return 1 + (under_way_ ? under_way_->depth() : 0); }
  Guarded& last() const { return *stacks_.back(); }

 private:
  // Largest change of each motor in a tick that all stacks allow.
  static std::vector<double> changes(const std::vector<Guarded*>& stacks) {
    std::vector<double> found = stacks[0]->outgoing().changes();
    for (Guarded* one : stacks)
      for (std::size_t i = 0; i < found.size(); ++i) found[i] = std::min(found[i], one->outgoing().changes()[i]);
    return found;
  }
  static std::vector<double> inverse_of(std::vector<double> values) {
    for (double& one : values) one = 1.0 / one;
    return values;
  }
  Guarded& stack(std::size_t k) const { return *stacks_[order_[ramp_.at() + k]]; }
  bool is_under_way(std::size_t k) const { return under_way_ && order_[ramp_.at() + k] == 0; }
  const Tick& tick_of(std::size_t k) const { return is_under_way(k) ? under_way_->tick_ : stack(k).tick(); }
  // Stack whose rows the latest tick has.
  const Guarded& latest() const {
    return sent_.stack == 0 && under_way_ ? under_way_->latest() : *stacks_[sent_.stack];
  }
  void hold_here(std::size_t k, const std::vector<std::string>& names) {
    if (!is_under_way(k)) return stack(k).inputs().hold_here(names);
    for (const std::size_t side : {0, 1}) under_way_->hold_here(side, names);
  }

  const Tick& run(std::size_t k, const double* q, const double* v, const StateFacts& facts) {
    if (is_under_way(k)) return under_way_->step(q, v, facts);
    const std::size_t at = order_[ramp_.at() + k];
    hooks_.before(at);
    const Tick& tick = stack(k).step(q, v, facts);
    hooks_.after(at);
    return tick;
  }

  // Choose the way by the loads that contacts were measured to bear: if the ground is known to be under those that are
  // taken up, and those that are released bear little, answers may be blended as they are: forces follow from the
  // torques, and so from the measurement.
  void choose_way() {
    const auto all = [&](const std::vector<std::string>& names, bool bears) {
      return std::all_of(names.begin(), names.end(), [&](const std::string& name) {
        double load = bears ? 0.0 : INFINITY;
        for (const auto& [contact, measured] : loads_)
          if (contact == name) load = measured;
        return bears ? load >= ContactWatch::kLeastLoad : load <= way_.light;
      });
    };
    for (const Way::Stop& stop : way_.stops)
      if (!all(stop.taken, true) || !all(stop.released, false)) return;
    direct_ = true;
    take_way();
  }
  void take_way() {
    std::vector<double> spans;
    easings_.clear();
    if (direct_) order_ = {0, stacks_.size() - 1};
    for (std::size_t k = 0; k + 1 < order_.size(); ++k) {
      const double span = way_.stops[order_[k]].switches ? 0.0 : 1.0;
      const Eased* eased = span > 0.0 ? stop(k + 1).eased.get() : nullptr;
      // with tasks out of reach the answer changes too fast with the force of the released contact
      if (eased && !eased->second && !reached_) eased = nullptr;
      spans.push_back(span);
      easings_.push_back(eased ? std::make_unique<Easing>(stacks_[order_[k + (eased->second ? 1 : 0)]]->line(), *eased)
                               : nullptr);
    }
    ramp_.take(std::move(spans));
  }
  const Way::Stop& stop(std::size_t k) const { return direct_ && k == 1 ? *way_.direct : way_.stops[order_[k]]; }

  // Begin a pair: hold values and references of the second stack, and its eased rows.
  void begin() {
    Guarded &first = stack(0), &second = stack(1);
    if (Easing* const ease = easings_[ramp_.at()].get()) (ease->second() ? second : first).line().ahead(ease);
    const Way::Stop& to = stop(ramp_.at() + 1);
    for (const std::string& name : to.first_kept) keep_hold(*stacks_[0], second, name);
    for (const std::string& name : to.kept) keep_hold(first, second, name);
    if (!ramp_.arriving() || leaving_) second.inputs().adopt(first.inputs()), second.inputs().lasting(true);
    hooks_.begins(order_[ramp_.at()], order_[ramp_.at() + 1], ramp_.arriving());
  }
  // Note the contacts that have to bear nothing now, for they leave the dynamics, and still do.
  void bear(const double* x) {
    const std::vector<std::string>& released = way_.stops[order_[ramp_.at()]].released;
    if (released.empty() || direct_) return;
    const Guarded& rows = is_under_way(0) ? under_way_->latest() : stack(0);
    for (const std::string& name : released)
      for (const Member& contact : rows.line().members()) {
        if (contact.name != name || contact.level >= 0 || !rows.line().torque()) continue;
        const int size = contact.row_end - contact.row;
        const double* force = rows.line().force(contact, x, force_);
        double most = 0.0, squares[2] = {0.0, 0.0};
        for (int i = 0; i < size; ++i) {
          most = std::max(most, std::fabs(force[i]));
          squares[i / 3 > 0] += force[i] * force[i];
        }
        if (!(most > kBearsNothing)) continue;
        Note why{contact.name.c_str(), Status::kOptimal, Cause::kBears, "", std::sqrt(squares[0])};
        why.most = size > 3 ? std::sqrt(squares[1]) : -1.0;
        sent_.waits.push_back(why);
      }
  }

  void blend(Guarded& first, Guarded& second, const Tick& a, const Tick& b, double h) {
    const bool smooth = !leaving_ && last().limits_jerk();
    const bool beyond = ramp_.blend(a.x().data(), b.x().data(), x_.data(), h, easings_[ramp_.at()].get(), direct_,
                                    smooth, tick_.x_.data(), x_.size());
    tick_.note_count_ = 0;
    for (const Note& note : a.notes()) tick_.add(note);
    const bool waits = !sent_.waits.empty();  // the contact is still there: so are the dynamics of the first stack
    tick_.status_ = waits ? a.status() : std::max(a.status(), b.status());
    for (const Note& note : sent_.waits) tick_.add(note);
    for (std::size_t k = 0, known = tick_.note_count_; !waits && k < b.notes().size(); ++k)
      if (std::none_of(tick_.notes_.begin(), tick_.notes_.begin() + std::ptrdiff_t(known),
                       [&](const Note& note) { return note.same(b.notes()[k]); }))
        tick_.add(b.notes()[k]);
    Guarded& stands = waits ? first : second;
    const auto limit = [&](const RateLimiter* limiter) {
      if (limiter)
        stands.outgoing().limit(*limiter, x_.data(), tick_.x_.data(),
                                [&](const Note& note) { sent_.limited.push_back(note); });
    };
    if (smooth) last().smooth(x_.data(), ramp_.most(), tick_.x_.data(), [&](const Note& note) { tick_.add(note); });
    else if (beyond) limit(&gradual_);
    limit(stands.rates());
    if (!sent_.limited.empty()) ramp_.limited();
    take_limited();
    stand(waits ? 0 : 1, waits ? a : b);
    tick_.held_ = held_ = 0, good_ = true;
    sent_.done = ramp_.done();
  }

  // One of the two stacks has no usable answer.
  void rest(Guarded& second, const Tick& a, const Tick& b) {
    const Tick& worst = b.held() > 0 ? b : a;
    const Status why = worst.status();
    tick_.note_count_ = 0, tick_.status_ = why;
    for (const Note& note : worst.notes())
      if (std::strcmp(note.element, "session") != 0) tick_.add(note);
    stand(b.held() > 0 ? 1 : 0, worst);
    ordinary_ = false;
    const bool fit = !has(worst, Status::kInvalidState) && !has(worst, Status::kDynamicsFailed);
    const Tick& rested = second.rest(*rest_, x_.data(), good_, ++held_, fit, why);
    std::copy(rested.x().begin(), rested.x().end(), tick_.x_.begin());
    for (const Note& note : rested.notes()) sent_.limited.push_back(note);
    take_limited();
    tick_.held_ = held_;
  }

  // The blend has the rows of that stack of the pair, with their residuals and marks.
  void stand(std::size_t k, const Tick& tick) {
    sent_.stack = order_[ramp_.at() + k];
    tick_.residuals_ = tick.residuals_;
    tick_.marks_ = tick.marks_;
    ordinary_ = is_under_way(k) ? under_way_->ordinary_ : stack(k).ordinary();
  }
  static bool has(const Tick& tick, Status status) {
    const View<Note> notes = tick.notes();
    return std::any_of(notes.begin(), notes.end(), [&](const Note& note) { return note.status == status; });
  }
  void count(double start) {
    std::int64_t rejected = 0;
    for (const Note& note : tick_.notes()) rejected += note.status == Status::kInvalidReference;
    const Status status = tick_.status_;
    last().timing().count({start, Timing::now(), status == Status::kIterationLimit || status == Status::kTimeLimit,
                           held_ > 0, has(tick_, Status::kInvalidState), rejected},
                          last().line().dt());
  }
  void take_limited() {
    for (const Note& note : sent_.limited) tick_.add(note), tick_.status_ = std::max(tick_.status_, note.status);
  }

  std::vector<Guarded*> stacks_;
  const Way& way_;
  Transition* under_way_;
  Hooks& hooks_;
  Ramp ramp_;
  RateLimiter gradual_;
  std::vector<double> x_, force_;  // x_: sent last
  std::unique_ptr<Rest> rest_;     // braking of the blend
  bool good_, ordinary_, reached_, chosen_, begun_ = false, direct_ = false,
                                            leaving_ = false;  // reached_: all tasks were within reach
                                                               // at first; leaving_: another transition has begun
  std::int64_t held_ = 0;
  std::vector<std::size_t> order_;  // stacks that are passed
  std::vector<std::unique_ptr<Easing>> easings_;
  std::vector<std::pair<std::string, double>> loads_;
  double progress_ = 0.0;
  Sent sent_;
  Tick tick_;
};

}  // namespace hqp
