// A line and the guards around it: what hqp::Session is inside.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "budget.hpp"
#include "contact_watch.hpp"
#include "guards.hpp"
#include "limit_watch.hpp"
#include "line.hpp"
#include "outgoing.hpp"
#include "phase_laws.hpp"
#include "presence.hpp"
#include "rest.hpp"
#include "session.hpp"

namespace hqp {

class Guarded {
 public:
  // Throws PlanError for a plan of which no session can be made.
  template <class Source>
  static std::unique_ptr<Guarded> made(const Source& source) {
    try {
      return std::make_unique<Guarded>(source);
    } catch (const PlanError&) {
      throw;
    } catch (const std::exception& error) {  // of a part that looks at its own numbers, or out of memory
      throw PlanError(std::string("cannot make a session of the plan: ") + error.what());
    }
  }
  template <class Source>
  explicit Guarded(const Source& source) : Guarded(source.root(), source) {}

  // Of a plan: its root, and what the parts are made of.
  template <class Node, class Source>
  Guarded(const Node& root, const Source& source)
      : kept_(source.kept()),
        foreign_(source.foreign()),
        live_(Source::kLive),
        line_(root, source.parts(), foreign_),
        check_(bounds(root), root.part("robot").texts("places"), root.part("robot").texts("speeds"),
               root.part("guards").part("state").number("ordinary"), age(root.part("guards").part("state")),
               line_.kinematics()),
        kind_(root.part("motion").text("kind")),
        name_(root.part("robot").text("name")),
        joint_names_(root.part("robot").texts("joint_names")),
        home_(root.part("robot").numbers("home", std::size_t(line_.nq()))),
        joints_(root.part("robot").places("actuated", std::size_t(line_.nv()))),
        picks_(kind_ == "torque" ? counted(joints_.size()) : joints_),
        budget_(root.part("guards").number("deadline")),
        q_(std::size_t(line_.nq())),
        v_(std::size_t(line_.nv())),
        good_q_(q_.size()),
        good_v_(v_.size()),
        x_(std::size_t(line_.size())),
        given_(line_.slots().size()),
        contacts_(names_of(line_.members()), line_.dt()),
        limits_(limit_watch(line_)),
        left_out_(line_.members().size(), false),
        angles_(v_.size()),
        outgoing_(line_.outgoing(picks_, root.part("guards").number("gradual"), root.part("guards").number("violation"),
                                 root.part("guards").texts("statuses"))),
        presence_(root, line_.members()),
        laws_(root, line_, presence_.names().size()),
        out_(line_.members().size(), false) {
    const Node guards = root.part("guards");
    if (joint_names_.size() != picks_.size())
      throw PlanError("the plan lists " + std::to_string(joint_names_.size()) + " joint names for " +
                      std::to_string(picks_.size()) + " commands: export it anew");
    if (guards.texts("statuses").size() != std::size_t(Status::kInvalidState) + 1)
      throw PlanError("the plan lists " + std::to_string(guards.texts("statuses").size()) + " status texts, needed " +
                      std::to_string(std::size_t(Status::kInvalidState) + 1) + ": export it anew");
    if (guards.has("rates"))
      limiter_ = std::make_unique<RateLimiter>(joint_names_, guards.numbers("rates"), line_.dt(), "rate");
    for (const int pick : picks_)
      if (pick < 0 || std::size_t(pick) >= x_.size())
        throw PlanError("joint index " + std::to_string(pick) + " of the plan is outside 0 to " +
                        std::to_string(x_.size() - 1) + ": export it anew");
    over_.reserve(v_.size());
    rest_ = made_rest(root);
    if (rest_->size() != x_.size())
      throw PlanError("the braking of the plan has " + std::to_string(rest_->size()) + " variables, its solver " +
                      std::to_string(x_.size()) + ": export it anew");
    for (std::size_t k = 0; k < given_.size(); ++k) {
      Slot& slot = line_.slots()[k];
      const int sizes[] = {slot.size(), slot.rows, slot.rows, 3};
      for (int what = 0; what < 4; ++what) given_[k].numbers[what].resize(std::size_t(sizes[what]));
    }
    renewed_.reserve(given_.size());
    tick_.command_.resize(picks_.size());
    tick_.x_.resize(x_.size());
    tick_.residuals_.resize(line_.levels().size());
    tick_.marks_.resize(line_.rows());
    tick_.notes_.resize(Tick::kNotes + 2 * limits_.size());
    if (live_) return;  // its solver is the program's own, and no world of a batch
    CarryOver state = CarryOver::to_first(initial_);
    keep(state);
    line_.solver()->make_room(out_.size());
  }

  // What is known of a state beside its numbers.
  struct Told {
    const double* time = nullptr;    // [s], null where the state does not tell
    double now = 0.0;                // [s], of the tick
    const double* angles = nullptr;  // of q, where no kinematics tell them
    const char* fault = nullptr;     // why it is none, where that is known
  };
  const Tick& step(const double* q, const double* v) { return step(q, v, Told{}); }
  const Tick& step(const double* q, const double* v, const Told& told) {
    begin_ = filled_ = solved_ = Clock::now();
    ++tick_.count_;
    tick_.note_count_ = 0;
    tick_.status_ = Status::kOptimal;
    answered_ = false;
    std::copy(q, q + q_.size(), q_.begin());
    std::copy(v, v + v_.size(), v_.begin());
    Note why;
    if (told.fault) why = {"state", Status::kInvalidState, Cause::kForeign, told.fault};
    if (told.fault || !check_.check(q_.data(), v_.data(), told.time, told.now, told.angles, why)) {
      forget();
      return held_tick(why, false);
    }
    if (fresh_ && budget_.limited()) budget_.begin(thread_time());
    else budget_.skip();
    laws_.obey(presence_.phase(), attended_ ? &out_ : nullptr);
    attend(presence_.take());
    take_holds();
    apply_references();
    if (foreign_ && foreign_->fills) return of_filled();
    line_.write(q_.data(), v_.data(), around());
    if (foreign_ && foreign_->writes ? foreign_->failed || !line_.assembly().usable() : !line_.assembly().small())
      leave_out_unusable();
    leave_out_marked();
    filled_ = Clock::now();
    if (budget_.limited()) limit(left());
    Solved found = line_.solve(v_.data());
    if (found.outcome == kInvalid && !line_.torque()) {
      leave_out_unusable();
      found = line_.solve(v_.data());
    }
    return conclude(found);
  }

  // All that goes over from one tick to the next, but for references that no step has taken yet.
  void keep(CarryOver& state) {
    state.take(good_), state.take(holds_known_), outgoing_.trend().keep(state);
    state.take(tick_.count_), state.take(tick_.held_);
    state.take(x_.data(), x_.size());
    if (tick_.held_ > 0) rest_->keep(state);
    if (good_) state.take(good_q_.data(), good_q_.size()), state.take(good_v_.data(), good_v_.size());
    contacts_.keep(state);
    limits_.keep(state);
    for (std::size_t k = 0; k < given_.size(); ++k) {
      Slot& slot = line_.slots()[k];
      state.take(given_[k].held);
      state.take(slot.hold.data(), slot.hold.size());
      if (!state.writes()) slot.settle();
    }
    line_.assembly().keep(state);
    line_.solver()->keep(state);
  }

  void set(std::size_t member, int what, const double* values, std::size_t size);
  // Whether an element is in, in the next step. Contacts at torque level come and go by phases, which are known to
  // leave enough of them.
  void say(std::size_t member, bool in) {
    const Member& told = line_.members()[member];
    if (line_.torque() && told.level < 0 && !live_)
      throw ReferenceError(told.name + ": switch a contact at torque level by phases, not by on()");
    presence_.say(member, in);
  }
  // The phase of the steps from now on, "" for none.
  void phase(const std::string& name) {
    const std::vector<std::string>& names = presence_.names();
    for (std::size_t k = 0; k < names.size(); ++k)
      if (names[k] == name) return presence_.phase(k);
    std::string known;
    for (std::size_t k = 1; k < names.size(); ++k) known += (k > 1 ? ", " : "") + names[k];
    throw ReferenceError("the plan has no phase '" + name + "'; allowed: " + (known.empty() ? "none" : known));
  }
  std::size_t member(const std::string& name) const {
    const std::vector<Member>& all = line_.members();
    for (std::size_t k = 0; k < all.size(); ++k)
      if (all[k].name == name && all[k].slot >= 0) return k;
    std::string known;
    for (const Member& one : all)
      if (one.slot >= 0) known += (known.empty() ? "" : ", ") + one.name;
    throw ReferenceError("the plan has no element '" + name + "' with a reference; allowed: " + known);
  }

  // The next step is told nothing yet, of one element, or of all.
  void forget(std::size_t slot) { given_[slot].told = 0; }
  void forget() {
    for (Given& given : given_) given.told = 0;
    presence_.forget();
  }
  // Hold what another stack held, until the element is left out.
  void keep_hold(std::size_t slot, const double* values) {
    Slot& to = line_.slots()[slot];
    std::copy(values, values + to.hold.size(), to.hold.begin());
    to.settle();
    given_[slot].kept = true;
  }
  // The numbers that an element's next step is told as what: to be written, and told.
  double* numbers(std::size_t slot, int what) { return given_[slot].numbers[what].data(); }
  void told(std::size_t slot, int what) { given_[slot].told |= 1u << what; }
  ContactWatch& contacts() { return contacts_; }
  Outgoing& outgoing() { return outgoing_; }

  // How many numbers an element is told as what, see set().
  std::size_t width(std::size_t member, int what) const {
    const Given& given = given_[std::size_t(line_.members()[member].slot)];
    return what < 4 ? given.numbers[what].size() : 1;
  }

  // Every answer is finished from now on, however long it takes, and states may be of any age.
  void without_deadline() {
    check_.of_any_age();
    budget_ = Budget(std::numeric_limits<double>::infinity());
    line_.solver()->limit(0.0);
  }

  // As just made.
  void reset() {
    line_.solver()->reset(), attended_ = false;
    CarryOver state = CarryOver::from_first(initial_);
    keep(state);
    for (Given& given : given_) given.told = 0;
    fresh_ = true;
    presence_.forget(), presence_.phase(0);
    laws_.reset();
  }

  // Go on where another session of the robot is: with what it sent last, and its margin of time.
  void follow(const Guarded& other) {
    x_ = other.x_, good_ = other.good_, good_q_ = other.good_q_, good_v_ = other.good_v_;
    budget_ = other.budget_;
    tick_.count_ = other.tick_.count_, tick_.held_ = other.tick_.held_;
  }

  // Beside another session, that blends its answers with those of this one: without rate limits, in half of the time.
  void aside() {
    attended_ = false;  // another one may have shared its rows
    if (!std::exchange(aside_, true)) budget_ = Budget(0.5 * budget_.deadline());
  }
  // Alone again, after that x.
  void alone(const double* x) {
    if (std::exchange(aside_, false)) budget_ = Budget(2.0 * budget_.deadline());
    std::copy(x, x + x_.size(), x_.begin());
    tick_.held_ = 0;
  }
  // The x towards rest where the blend of this one and another one has no usable answer: after that x, for so many
  // ticks by now.  fit: whether the latest state is one to start from.
  const Tick& rest(const double* last, bool good, std::int64_t held, bool fit, Status why) {
    tick_.note_count_ = 0;
    tick_.status_ = why;
    const auto start = [&] { return fit || good_ ? from(!fit) : RestFrom{}; };
    outgoing_.rest(*rest_, start, fit, held, why, {last, good, tick_.count_}, limiter_.get(), tick_.x_.data(),
                   [this](const Note& why_not) { note(why_not); });
    tick_.held_ = held;
    return tick_;
  }

  // The answer of the solver in this tick, null where it was not asked; when rows and it were done [s since the begin].
  const Answered* answered() const { return answered_ ? &answer_ : nullptr; }
  std::size_t plain_notes() const { return plain_notes_; }  // notes before those on limits of joints
  double begun() const { return std::chrono::duration<double>(begin_.time_since_epoch()).count(); }
  double filling() const { return std::chrono::duration<double>(filled_ - begin_).count(); }
  double solving() const { return std::chrono::duration<double>(solved_ - filled_).count(); }
  const std::vector<double>& q() const { return q_; }  // of the tick, normalised
  const std::vector<double>& v() const { return v_; }
  const std::vector<double>& sent() const { return x_; }  // last
  bool good() const { return good_; }
  const Budget& budget() const { return budget_; }
  // Which number of a state is too large, "" for none.
  std::string too_large(const double* q, const double* v, const double* angles) {
    Note why;
    return check_.within(q, v, angles, why) ? "" : why.text();
  }

  Line& line() { return line_; }
  const Tick& tick() const { return tick_; }
  const std::string& name() const { return name_; }
  const std::vector<std::string>& joint_names() const { return joint_names_; }
  const std::vector<double>& home() const { return home_; }
  const Line& line() const { return line_; }

 private:
  using Clock = std::chrono::steady_clock;

  // Reference of one element for the next step: value, velocity, acceleration and normal, a bit for each that is set.
  struct Given {
    std::vector<double> numbers[4];
    unsigned told = 0;
    bool held = false;  // whether its hold value was told
    bool kept = false;  // whether it is that of another stack, until it is left out
  };

  static std::vector<std::string> names_of(const std::vector<Member>& members) {
    std::vector<std::string> found;
    for (const Member& member : members) found.push_back(member.name);
    return found;
  }
  static LimitWatch limit_watch(const Line& line) {
    LimitWatch::Parts parts;
    std::vector<std::string> names;
    for (const Member* member : line.placed()) {
      if (member->units.empty()) continue;
      parts.emplace_back(line.start(*member) + member->first, line.start(*member) + member->last);
      names.insert(names.end(), member->row_names.begin(), member->row_names.end());
    }
    return {std::move(parts), std::move(names), line.dt()};
  }
  static std::vector<int> counted(std::size_t n) {
    std::vector<int> found(n);
    for (std::size_t i = 0; i < n; ++i) found[i] = static_cast<int>(i);
    return found;
  }
  template <class Node>
  StateBounds bounds(const Node& root) const {
    const Node p = root.part("guards").part("state"), robot = root.part("robot");
    const std::size_t nv = std::size_t(line_.nv());
    return {p.numbers("low", nv), p.numbers("high", nv),  p.numbers("speed", nv),
            p.number("distance"), robot.flag("floating"), robot.texts("coordinates")};
  }
  template <class Node>
  static std::unique_ptr<StateAge> age(const Node& p) {
    return p.has("max_age") ? std::make_unique<StateAge>(p.number("max_age")) : nullptr;
  }
  template <class Node>
  std::unique_ptr<Rest> made_rest(const Node& root) {
    const Node braking = root.part("guards").part("braking"), robot = root.part("robot");
    const double deceleration = braking.number("deceleration");
    if (kind_ == "velocity")
      return std::make_unique<SlowDown>(robot.numbers("lower", v_.size()), robot.numbers("upper", v_.size()), joints_,
                                        deceleration, line_.dt());
    if (kind_ == "acceleration") return std::make_unique<Brake>(v_.size(), joints_, deceleration, line_.dt());
    if (!line_.torque())
      throw PlanError("the plan is of kind '" + kind_ + "'; allowed: velocity, acceleration, torque");
    std::vector<double> limit;
    for (const int i : joints_) limit.push_back(robot.numbers("effort_limit").at(std::size_t(i)));
    return std::make_unique<Hold>(limit, joints_, braking.number("damping"), line_.dt());
  }
  void limit(double seconds) {
    if (line_.solver()) line_.solver()->limit(seconds);
    else foreign_->limit(seconds);
  }
  double left() const {  // time for the solver; what comes before the first answer is done for the first time, and slow
    return budget_.left(good_ ? std::chrono::duration<double>(Clock::now() - begin_).count() : 0.0);
  }

  void note(const Note& note) {
    if (tick_.note_count_ < tick_.notes_.size()) tick_.notes_[tick_.note_count_++] = note;
    if (note.status > tick_.status_) tick_.status_ = note.status;
  }
  auto teller() {
    return [this](const Note& why) { note(why); };
  }
  const RateLimiter* limiter() const { return aside_ ? nullptr : limiter_.get(); }
  Before before() const { return {x_.data(), good_, tick_.count_}; }

  // These elements are out of this tick, and all others in: those that come back hold what they are at.
  void attend(const Presence::Out& asked) {
    if (asked == out_ && attended_) return;
    const Presence::Out& out = supported(asked);
    if (out == out_ && attended_) return;
    attended_ = true;
    line_.go_without(out);
    if (line_.solver()) line_.solver()->turn(out);
    if (foreign_) foreign_->go_without(out);
    for (std::size_t m = 0; m < out.size(); ++m) {
      const int slot = line_.members()[m].slot;
      contacts_.judge(m, out[m]);
      if (slot >= 0 && out_[m] && !out[m]) renew(std::size_t(slot));
    }
    out_ = out;
  }

  // Of elements that are to be out those that may be, with notes on the others.
  const Presence::Out& supported(const Presence::Out& asked) {
    if (!foreign_ || !line_.torque()) return asked;
    rest_of_ = asked;
    const char* why = foreign_->supported(rest_of_, stay_);
    for (std::size_t m = 0; why && m < stay_.size(); ++m)
      if (stay_[m]) note({line_.members()[m].name.c_str(), Status::kInvalidReference, Cause::kForeign, why});
    return why ? rest_of_ : asked;
  }

  // An element holds what it is at from now on, unless it was told.
  void renew(std::size_t slot) {
    if (!given_[slot].held) renewed_.push_back(&line_.slots()[slot]);
  }
  // Of those that come back, and of all in the first state.
  void take_holds() {
    if (!std::exchange(holds_known_, true)) {
      renewed_.clear();
      for (std::size_t k = 0; k < given_.size(); ++k)
        if (!std::exchange(given_[k].kept, false)) renew(k);
    }
    if (renewed_.empty()) return;
    if (line_.kinematics()) line_.kinematics()->update(q_.data());
    line_.assembly().take_holds(q_.data(), v_.data(), renewed_);
  }

  void apply_references() {
    const std::vector<Member>& members = line_.members();
    settle(line_.slots(), live_);
    for (std::size_t m = 0; m < members.size(); ++m) {
      left_out_[m] = false;
      if (members[m].slot < 0) continue;
      Slot& slot = line_.slots()[std::size_t(members[m].slot)];
      Given& given = given_[std::size_t(members[m].slot)];
      const unsigned told = std::exchange(given.told, 0);
      if (out_[m] || !told) continue;
      put(slot, given.numbers, told);
      const bool finite = slot.is_finite();
      if (!finite || (told & 1 && !slot.is_rotation())) {
        slot.settle();
        left_out_[m] = !members[m].hard;
        Note why{members[m].name.c_str(), Status::kInvalidReference, finite ? Cause::kRotation : Cause::kReference};
        why.left_out = left_out_[m];
        note(why);
      }
    }
  }
  static void put(Slot& slot, const std::vector<double>* numbers, unsigned told) {
    double* const to[] = {slot.target, slot.rate, slot.feedforward, slot.normal};
    for (int what = 0; what < 4; ++what)
      if (told >> what & 1 && to[what]) std::copy(numbers[what].begin(), numbers[what].end(), to[what]);
    slot.moved = true;
  }

  void leave_out_unusable() {
    const std::vector<Member>& members = line_.members();
    for (std::size_t m = 0; m < members.size(); ++m) {
      Note why{members[m].name.c_str(), Status::kInvalidElement};
      const Foreign::Fault fault = foreign_ ? foreign_->fault(m) : Foreign::Fault{};
      if (fault.text) why.status = fault.status, why.cause = Cause::kForeign, why.where = fault.text;
      if (left_out_[m] || (!fault.text && line_.usable(members[m], why))) continue;
      left_out_[m] = why.left_out = !fault.text || fault.leave;
      note(why);
    }
    leave_out_marked();
  }
  void leave_out_marked() {
    for (std::size_t m = 0; m < left_out_.size(); ++m)
      if (left_out_[m]) line_.leave_out(line_.members()[m]);
  }

  // Rows that are Python's business, all of them.
  const Tick& of_filled() {
    const char* why = foreign_->fill(left_out_);
    if (!why && foreign_->failed) {
      const std::vector<Member>& members = line_.members();
      for (std::size_t m = 0; m < members.size(); ++m) {
        const Foreign::Fault fault = foreign_->fault(m);
        if (left_out_[m] || !fault.text) continue;
        left_out_[m] = fault.leave;
        Note note_of{members[m].name.c_str(), fault.status, Cause::kForeign, fault.text};
        note_of.left_out = fault.leave;
        note(note_of);
      }
      why = foreign_->fill(left_out_);
    }
    if (why) return held_tick({"robot", Status::kDynamicsFailed, Cause::kForeign, why}, false);
    filled_ = Clock::now();
    if (budget_.limited()) limit(left());
    return conclude(line_.run(v_.data()));
  }

  const Tick& conclude(const Solved& found) {
    if (found.outcome == kInvalid) {
      const bool dynamics = line_.torque() != nullptr;
      return held_tick({dynamics ? "robot" : "solver", dynamics ? Status::kDynamicsFailed : Status::kNotCertified,
                        dynamics ? Cause::kDynamics : Cause::kNotFinite},
                       !dynamics);
    }
    answer_ = line_.answer(found), answered_ = true;
    solved_ = Clock::now();
    line_.residuals(answer_.slack, tick_.residuals_.data());
    std::copy(answer_.marks, answer_.marks + tick_.marks_.size(), tick_.marks_.begin());
    const auto here = [this] { return from(false); };
    if (!outgoing_.take(answer_, before(), *rest_, here, contacts_, limiter(), tick_.x_.data(), teller()))
      return held_tick({}, true);
    plain_notes_ = tick_.note_count_;
    limits();
    send();
    if (budget_.limited() && answer_.status != Status::kOptimal)
      budget_.end(thread_time(), answer_.status == Status::kTimeLimit);
    fresh_ = answer_.status != Status::kOptimal;
    std::copy(q_.begin(), q_.end(), good_q_.begin());
    std::copy(v_.begin(), v_.end(), good_v_.begin());
    good_ = true;
    tick_.held_ = 0;
    return tick_;
  }

  void send() {
    std::copy(tick_.x_.begin(), tick_.x_.end(), x_.begin());
    for (std::size_t i = 0; i < picks_.size(); ++i) tick_.command_[i] = x_[std::size_t(picks_[i])];
  }

  // No answer is usable: the command comes to rest. fit: whether this state is one to start from.
  const Tick& held_tick(const Note& why, bool fit) {
    if (why.status != Status::kOptimal) note(why);
    fresh_ = true;
    const auto start = [&] { return fit || good_ ? from(!fit) : RestFrom{}; };
    outgoing_.rest(*rest_, start, fit, ++tick_.held_, why.status, before(), limiter(), tick_.x_.data(), teller());
    send();
    return tick_;
  }

  // The velocity that limits stand around.
  const double* around() const { return line_.order() == 1 && good_ ? x_.data() : v_.data(); }
  // A state as a robot comes to rest from it: the tick's, or the last good one.
  RestFrom from(bool last) {
    if (foreign_ && (foreign_->fills || !line_.kinematics())) return foreign_->start(last);
    const double *q = last ? good_q_.data() : q_.data(), *v = last ? good_v_.data() : v_.data();
    RestFrom found;
    line_.kinematics()->angles(q, angles_.data());
    found.angles = angles_.data(), found.v = v;
    if (line_.torque() && line_.at_rest(q)) found.holding = line_.holding(), found.felt = line_.felt();
    if (live_ && line_.torque() && !last) {  // who asks about this tick reads its rows
      line_.write(q_.data(), v_.data(), around());
      leave_out_marked();
      line_.rewrite(v_.data());
    }
    return found;
  }

  // Notes on limits of joints that alternate, and on those that are passed.
  void limits() {
    const std::size_t before = tick_.note_count_;
    limits_.look(tick_.marks_.data(), tick_.count_, teller());
    if (tick_.note_count_ == before && !limits_.meet()) return;
    for (const Member* member : line_.placed()) {
      if (member->units.empty() || member->operation < 0) continue;
      line_.assembly().overrun(std::size_t(member->operation), q_.data(), around(), over_);
      for (std::size_t i = 0; i < std::min(over_.size(), member->units.size()); ++i) {
        Note why{member->row_names[i].c_str()};
        if (LimitWatch::passed(over_[i], member->units[i].c_str(), why)) note(why);
      }
    }
  }

  std::shared_ptr<const void> kept_;  // before what points into it
  Foreign* foreign_;
  bool live_;  // others write into its arrays between its ticks
  Line line_;
  StateCheck check_;
  std::unique_ptr<Rest> rest_;
  std::string kind_, name_;
  std::vector<std::string> joint_names_;
  std::vector<double> home_;
  std::vector<int> joints_, picks_;  // actuated coordinates, and where their numbers are in x
  Budget budget_;
  std::unique_ptr<RateLimiter> limiter_;
  std::vector<double> q_, v_, good_q_, good_v_, x_;
  std::vector<Given> given_;
  std::vector<Slot*> renewed_;  // those that take a fresh hold value
  WarmState initial_;
  ContactWatch contacts_;
  LimitWatch limits_;
  std::vector<bool> left_out_;
  std::vector<double> angles_, over_;
  Outgoing outgoing_;
  Presence presence_;
  PhaseLaws laws_;
  Presence::Out out_, rest_of_, stay_;
  bool aside_ = false;
  bool good_ = false, holds_known_ = false, fresh_ = true, attended_ = false;
  Clock::time_point begin_, filled_, solved_;
  Answered answer_{};
  std::size_t plain_notes_ = 0;
  bool answered_ = false;
  Tick tick_;
};

inline void Guarded::set(std::size_t member, int what, const double* values, std::size_t size) {
  static const char* const names[] = {"value", "velocity", "acceleration", "normal"};
  const Member& told = line_.members()[member];
  Given& given = given_[std::size_t(told.slot)];
  Slot& slot = line_.slots()[std::size_t(told.slot)];
  if (what == Reference::kLoad) {
    if (!told.contact) throw ReferenceError(told.name + " is not a contact: it takes no measured load");
    contacts_.measure(member, values[0]);
  } else if (what == Reference::kHold) {
    if (size != slot.hold.size() || !finite(values, static_cast<int>(size)))
      throw ReferenceError(told.name + ": a hold value needs " + std::to_string(slot.hold.size()) +
                           " finite numbers, given " + std::to_string(size));
    std::copy(values, values + size, slot.hold.begin());
    slot.settle();
    given.held = true;
  } else {
    std::vector<double>& to = given.numbers[what];
    if (size != to.size())
      throw ReferenceError(told.name + ": its " + names[what] + " needs " + std::to_string(to.size()) +
                           " numbers, given " + std::to_string(size));
    std::copy(values, values + size, to.begin());
    given.told |= 1u << what;
  }
}

}  // namespace hqp
