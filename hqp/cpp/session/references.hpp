// References of a session's elements: stored by name until the next tick, then written into its rows.
#pragma once

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "../common/carry_over.hpp"
#include "contact_watch.hpp"
#include "line.hpp"
#include "session.hpp"

namespace hqp {

class References {
 public:
  // live: true if a program writes into the line's arrays between ticks.
  References(Line& line, bool live) : line_(line), live_(live), given_(line.slots().size()) {
    for (std::size_t k = 0; k < given_.size(); ++k) {
      const Slot& slot = line_.slots()[k];
      const int sizes[] = {slot.size(), slot.rows, slot.rows, 3};
      for (int field = 0; field < 4; ++field) given_[k].numbers[field].resize(std::size_t(sizes[field]));
    }
    renewed_.reserve(2 * given_.size());
  }

  // Index of the element; throws ReferenceError if no element with a reference has that name.
  std::size_t member(const std::string& name) const {
    const std::vector<Member>& all = line_.members();
    for (std::size_t k = 0; k < all.size(); ++k)
      if (all[k].name == name && all[k].slot >= 0) return k;
    std::string known;
    for (const Member& one : all)
      if (one.slot >= 0) known += (known.empty() ? "" : ", ") + one.name;
    throw ReferenceError("the plan has no element '" + name + "' with a reference; allowed: " + known);
  }

  // Store a field of the next reference, or the hold value; throws ReferenceError for a wrong size. Loads go to
  // ContactWatch.
  void set(std::size_t member, int field, const double* values, std::size_t size) {
    static const char* const names[] = {"value", "velocity", "acceleration", "normal"};
    const Member& element = line_.members()[member];
    Given& given = given_[std::size_t(element.slot)];
    Slot& slot = line_.slots()[std::size_t(element.slot)];
    if (field == Reference::kHold) {
      if (size != slot.hold.size() || !finite(values, static_cast<int>(size)))
        throw ReferenceError(element.name + ": a hold value needs " + std::to_string(slot.hold.size()) +
                             " finite numbers, given " + std::to_string(size));
      std::copy(values, values + size, slot.hold.begin());
      slot.settle();
      given.held = true;
      return;
    }
    std::vector<double>& to = given.numbers[field];
    if (size != to.size())
      throw ReferenceError(element.name + ": its " + names[field] + " needs " + std::to_string(to.size()) +
                           " numbers, given " + std::to_string(size));
    std::copy(values, values + size, to.begin());
    mark(std::size_t(element.slot), field);
  }
  // Count of numbers in a field of the element's reference.
  std::size_t width(std::size_t member, int field) const {
    return field < 4 ? given_[std::size_t(line_.members()[member].slot)].numbers[field].size() : 1;
  }
  // Numbers of a field, to be written before mark().
  double* numbers(std::size_t slot, int field) { return given_[slot].numbers[field].data(); }
  void mark(std::size_t slot, int field) { given_[slot].fields |= 1u << field; }
  void forget(std::size_t slot) { given_[slot].fields = 0; }
  void forget() {
    for (Given& given : given_) given.fields = 0;
  }
  void forget_all() {
    for (Given& given : given_) given.fields = given.last = 0, given.kept = false;
    renewed_.clear();
  }
  // Another session writes into the line's arrays between ticks.
  void share() { live_ = shared_ = true; }

  // The references that an element had last hold as long as it has no other one; else each holds for one tick.
  void lasting(bool lasts) { lasting_ = lasts; }
  // Take the last references of another stack, by the names of elements, but for those with a new one.
  void adopt(const References& other, const std::vector<bool>& named) {
    for (std::size_t m = 0; m < named.size(); ++m) {
      const Member& member = line_.members()[m];
      const Given* theirs = member.slot < 0 || named[m] ? nullptr : other.given(member.name);
      if (!theirs) continue;
      Given& mine = given_[std::size_t(member.slot)];
      mine.last = theirs->last;
      for (int field = 0; field < 4; ++field) {
        if (theirs->numbers[field].size() == mine.numbers[field].size()) mine.numbers[field] = theirs->numbers[field];
        else mine.last &= ~(1u << field);
      }
    }
  }
  // Hold value of an element, null if it has none so far.
  const std::vector<double>* held(const std::string& name) const {
    const Given* given = this->given(name);
    if (!given || !(holds_known_ || given->kept)) return nullptr;
    return &line_.slots()[std::size_t(given - given_.data())].hold;
  }
  // Hold an element in this tick where it is.
  void hold_here(std::size_t slot) {
    given_[slot].last = 0;
    renewed_.push_back(&line_.slots()[slot]);
  }

  // Hold the value of another stack until the element is left out.
  void keep_hold(std::size_t slot, const double* values) {
    Slot& to = line_.slots()[slot];
    std::copy(values, values + to.hold.size(), to.hold.begin());
    to.settle();
    given_[slot].kept = true;
  }
  // Renew the hold value of an element that returns, unless a program has set it.
  void renew(std::size_t slot) {
    if (!given_[slot].held) renewed_.push_back(&line_.slots()[slot]);
  }
  // Take hold values of returned elements from the state, in the first tick those of all elements.
  void take_holds(const double* q, const double* v) {
    if (!std::exchange(holds_known_, true)) {
      renewed_.clear();
      for (std::size_t k = 0; k < given_.size(); ++k)
        if (!std::exchange(given_[k].kept, false)) renew(k);
    }
    if (renewed_.empty()) return;
    if (line_.kinematics()) line_.kinematics()->update(q);
    line_.assembly().take_holds(q, v, renewed_);
  }

  // Write references into the rows and hold values elsewhere, skipping absent elements. Mark soft elements with an
  // invalid reference in left_out, reporting each by note().
  // named: elements with a reference in this tick.
  template <class Report>
  void apply(const std::vector<bool>& absent, const std::vector<bool>& named, std::vector<bool>& left_out,
             const Report& note) {
    const std::vector<Member>& members = line_.members();
    settle(line_.slots(), live_);
    for (std::size_t m = 0; m < members.size(); ++m) {
      left_out[m] = false;
      if (members[m].slot < 0) continue;
      Slot& slot = line_.slots()[std::size_t(members[m].slot)];
      Given& given = given_[std::size_t(members[m].slot)];
      const unsigned fields = take(given, named[m]);
      if (absent[m] || !fields) continue;
      write(slot, given.numbers, fields);
      const bool finite = slot.is_finite();
      if (finite && (!(fields & 1) || slot.is_rotation())) continue;
      slot.settle();
      left_out[m] = !members[m].hard;
      Note why{members[m].name.c_str(), Status::kInvalidReference, finite ? Cause::kRotation : Cause::kReference};
      why.left_out = left_out[m];
      note(why);
    }
  }

  // End a tick without rows.
  void skip(const std::vector<bool>& named) {
    for (const Member& member : line_.members())
      if (member.slot >= 0)
        take(given_[std::size_t(member.slot)], named[std::size_t(&member - line_.members().data())]);
  }

  // Carry hold values over to the next tick of this world, and the latest values: a robot that comes to rest bears the
  // loads of its last rows.
  void keep(CarryOver& state) {
    state.take(holds_known_);
    for (std::size_t k = 0; k < given_.size(); ++k) {
      Slot& slot = line_.slots()[k];
      state.take(given_[k].held);
      state.take(slot.hold.data(), slot.hold.size());
      if (slot.target) state.take(slot.target, slot.hold.size());
      if (slot.normal) state.take(slot.normal, 3);
      if (!state.writes()) slot.moved = true;
      if (!shared_) continue;
      state.take(given_[k].last), state.take(given_[k].kept);
      for (std::vector<double>& numbers : given_[k].numbers) state.take(numbers.data(), numbers.size());
    }
  }

 private:
  // Reference of one element in the next tick: value, velocity, acceleration, normal, and a bit for each given field.
  struct Given {
    std::vector<double> numbers[4];
    unsigned fields = 0, last = 0;  // last: fields of the last tick, 0 if a number was not finite
    bool held = false;              // true if a program has set the hold value
    bool kept = false;              // true if the hold value comes from another stack
  };

  const Given* given(const std::string& name) const {
    for (const Member& member : line_.members())
      if (member.name == name) return member.slot < 0 ? nullptr : &given_[std::size_t(member.slot)];
    return nullptr;
  }
  // Fields of the reference in this tick.
  unsigned take(Given& given, bool named) const {
    const unsigned fields = std::exchange(given.fields, 0);
    if (!named && lasting_) return given.last;
    given.last = fields;
    for (int field = 0; field < 4; ++field)
      if (fields >> field & 1 && !finite(given.numbers[field].data(), static_cast<int>(given.numbers[field].size())))
        given.last = 0;
    return fields;
  }

  static void write(Slot& slot, const std::vector<double>* numbers, unsigned fields) {
    double* const to[] = {slot.target, slot.rate, slot.feedforward, slot.normal};
    for (int field = 0; field < 4; ++field)
      if (fields >> field & 1 && to[field]) std::copy(numbers[field].begin(), numbers[field].end(), to[field]);
    slot.moved = true;
  }

  Line& line_;
  bool live_;
  std::vector<Given> given_;
  std::vector<Slot*> renewed_;
  bool holds_known_ = false, lasting_ = false, shared_ = false;
};

}  // namespace hqp
