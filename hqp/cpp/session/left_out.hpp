// Elements left out of one tick: their reference, their rows or their code in Python is invalid.
#pragma once

#include <vector>

#include "foreign.hpp"
#include "line.hpp"

namespace hqp {

class LeftOut {
 public:
  LeftOut(Line& line, Foreign* foreign) : line_(line), foreign_(foreign), flags_(line.members().size(), false) {}

  std::vector<bool>& flags() { return flags_; }

  // Free the rows of elements whose numbers are unusable, and report each by note().
  template <class Report>
  void unusable(const Report& note) {
    const std::vector<Member>& members = line_.members();
    for (std::size_t m = 0; m < members.size(); ++m) {
      if (flags_[m]) continue;
      Note why{members[m].name.c_str(), Status::kInvalidElement};
      const Foreign::Fault fault = foreign_ ? foreign_->fault(m) : Foreign::Fault{};
      if (fault.text) take(m, fault, why);
      else if (!line_.usable(members[m], why)) flags_[m] = why.left_out = true;
      else continue;
      note(why);
    }
    free();
  }
  // Report faults of elements that Python has filled.
  template <class Report>
  void faulty(const Report& note) {
    for (std::size_t m = 0; m < flags_.size(); ++m) {
      const Foreign::Fault fault = foreign_->fault(m);
      if (flags_[m] || !fault.text) continue;
      Note why{line_.members()[m].name.c_str()};
      take(m, fault, why);
      note(why);
    }
  }
  // Free the rows of all elements that are left out.
  void free() {
    for (std::size_t m = 0; m < flags_.size(); ++m)
      if (flags_[m]) line_.leave_out(line_.members()[m]);
  }

 private:
  void take(std::size_t m, const Foreign::Fault& fault, Note& why) {
    flags_[m] = why.left_out = fault.leave;
    why.status = fault.status, why.cause = Cause::kForeign, why.where = fault.text;
  }

  Line& line_;
  Foreign* foreign_;
  std::vector<bool> flags_;
};

}  // namespace hqp
