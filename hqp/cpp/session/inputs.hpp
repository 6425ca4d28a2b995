// Inputs of a tick besides the state: references, measured loads, phase and presence of the elements.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "contact_watch.hpp"
#include "errors.hpp"
#include "guard_parts.hpp"
#include "phase_laws.hpp"
#include "presence.hpp"
#include "references.hpp"

namespace hqp {

class Inputs {
 public:
  // live: true if a program writes into the line's arrays between ticks.
  template <class Node>
  Inputs(const Node& root, Line& line, Foreign* foreign, bool live)
      : line_(line),
        foreign_(foreign),
        live_(live),
        references_(line, live),
        contacts_(contact_watch(line)),
        presence_(root, line.members()),
        laws_(root, line, presence_.names().size()),
        out_(line.members().size(), false),
        absent_(out_.size(), 0),
        named_(out_.size(), false),
        naming_(out_.size(), false) {}

  // Store a field of an element's next reference, its hold value or its measured load; throws ReferenceError.
  void set(std::size_t member, int field, const double* values, std::size_t size) {
    if (field != Reference::kHold) name(member);
    if (field != Reference::kLoad) return references_.set(member, field, values, size);
    const Member& contact = line_.members()[member];
    if (!contact.contact) throw ReferenceError(contact.name + " is not a contact: it takes no measured load");
    contacts_.measure(member, values[0]);
  }
  // Set the presence of an element in the next tick. At torque level contacts switch by phases, which are checked to
  // leave enough of them.
  void say(std::size_t member, bool in) {
    const Member& element = line_.members()[member];
    if (line_.torque() && element.level < 0 && !live_)
      throw ReferenceError(element.name + ": switch a contact at torque level by phases, not by on()");
    name(member), presence_.say(member, in);
  }
  // The element has a reference in the next tick.
  void name(std::size_t member) { naming_[member] = true; }
  bool named(std::size_t member) const { return naming_[member]; }
  // Set the phase of the following ticks, "" for none.
  void phase(const std::string& name) { presence_.phase(name); }
  bool knows(const std::string& phase) const { return presence_.knows(phase); }
  // Hold these elements in the next tick where they are, unless they have a reference.
  void hold_here(const std::vector<std::string>& names) {
    for (std::size_t m = 0; m < out_.size(); ++m)
      if (std::find(names.begin(), names.end(), line_.members()[m].name) != names.end()) here_.push_back(m);
  }
  // Forget the inputs of the next tick.
  void forget() {
    references_.forget(), presence_.forget();
    naming_.assign(naming_.size(), false);
  }

  References& references() { return references_; }
  const References& references() const { return references_; }
  ContactWatch& contacts() { return contacts_; }
  std::size_t size() const { return out_.size(); }  // count of elements

  // Begin a tick with the stored inputs.
  void begin() {
    named_.swap(naming_);
    naming_.assign(naming_.size(), false);
  }
  // Take phase, laws and presence of the tick.
  template <class Report>
  void attend(const Report& report) {
    laws_.obey(presence_.phase(), attended_ ? &out_ : nullptr);
    switch_to(presence_.take(named_), report);
  }
  // End a tick that has no rows; attended: true after attend().
  void skip(bool attended) {
    references_.skip(named_), here_.clear();
    if (!attended) presence_.take(named_);
  }
  // Write references into the rows, and mark elements with an invalid one in left_out.
  template <class Report>
  void apply(const double* q, const double* v, std::vector<bool>& left_out, const Report& report) {
    for (const std::size_t m : here_)
      if (!named_[m] && !out_[m] && line_.members()[m].slot >= 0)
        references_.hold_here(std::size_t(line_.members()[m].slot));
    here_.clear();
    references_.take_holds(q, v);
    references_.apply(out_, named_, left_out, report);
  }

  // See References::lasting and References::adopt.
  void lasting(bool lasts) { references_.lasting(lasts), presence_.lasting(lasts); }
  void adopt(const Inputs& other) { references_.adopt(other.references_, naming_); }
  // Let all elements into the rows: another session of the stack writes into them.
  void all_in() {
    out_.assign(out_.size(), false), absent_.assign(out_.size(), 0);
    line_.go_without(out_), attended_ = false;
  }
  // Take the presence of all elements anew in the next tick: another session may have written into the rows.
  void attend_anew() { attended_ = false; }
  // Return to the state after construction.
  void renew() {
    all_in(), forget();
    references_.forget_all(), presence_.forget_all();
    laws_.reset();
  }
  void keep(CarryOver& state) {
    contacts_.keep(state), references_.keep(state), presence_.keep(state);
    state.take(absent_.data(), absent_.size());
  }

 private:
  // Switch elements off and on for this tick; returning elements hold their present value.
  template <class Report>
  void switch_to(const Presence::Out& wanted, const Report& report) {
    const bool kept =
        attended_ && std::equal(out_.begin(), out_.end(), absent_.begin());  // the rows' world is this one
    if (kept && wanted == out_) return;
    const Presence::Out& out = supported(wanted, report);
    if (kept && out == out_) return;
    attended_ = true;
    line_.go_without(out);
    if (line_.solver()) line_.solver()->turn(out);
    if (foreign_) foreign_->go_without(out);
    for (std::size_t m = 0; m < out.size(); ++m) {
      const int slot = line_.members()[m].slot;
      contacts_.judge(m, out[m]);
      if (slot >= 0 && absent_[m] && !out[m]) references_.renew(std::size_t(slot));
      absent_[m] = out[m];
    }
    out_ = out;
  }
  // Return the elements that may leave; report the contacts that must stay.
  template <class Report>
  const Presence::Out& supported(const Presence::Out& wanted, const Report& report) {
    if (!foreign_ || !line_.torque()) return wanted;
    leaving_ = wanted;
    const char* why = foreign_->supported(leaving_, staying_);
    for (std::size_t m = 0; why && m < staying_.size(); ++m)
      if (staying_[m]) report(Note{line_.members()[m].name.c_str(), Status::kInvalidReference, Cause::kForeign, why});
    return why ? leaving_ : wanted;
  }

  Line& line_;
  Foreign* foreign_;
  bool live_;
  References references_;
  ContactWatch contacts_;
  Presence presence_;
  PhaseLaws laws_;
  Presence::Out out_, leaving_, staying_;  // out_: elements that are out of the rows
  std::vector<char> absent_;               // elements that were absent in the last tick of this world
  Presence::Out named_, naming_;           // elements with a reference in this tick, and in the next one
  std::vector<std::size_t> here_;          // elements to be held in the next tick where they are
  bool attended_ = false;                  // out_ is that of the rows
};

}  // namespace hqp
