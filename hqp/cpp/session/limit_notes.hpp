// Notes on joint limits: alternating limits, and positions that will pass theirs.
#pragma once

#include <algorithm>
#include <vector>

#include "guard_parts.hpp"
#include "limit_watch.hpp"
#include "line.hpp"

namespace hqp {

class LimitNotes {
 public:
  explicit LimitNotes(Line& line) : line_(line), watch_(limit_watch(line)) { over_.reserve(std::size_t(line.nv())); }

  std::size_t size() const { return watch_.size(); }
  // marks: sides of all rows in a tick of that number; q: its state; around: velocity at the centre of the limits'
  // windows.
  template <class Report>
  void look(const std::int8_t* marks, std::int64_t tick, const double* q, const double* around, const Report& report) {
    bool noted = false;
    watch_.look(marks, tick, [&](const Note& note) { noted = true, report(note); });
    if (!noted && !watch_.meet()) return;
    for (const Member* member : line_.placed()) {
      if (member->units.empty() || member->operation < 0) continue;
      line_.assembly().overrun(std::size_t(member->operation), q, around, over_);
      for (std::size_t i = 0; i < std::min(over_.size(), member->units.size()); ++i) {
        Note why{member->row_names[i].c_str()};
        if (LimitWatch::passed(over_[i], member->units[i].c_str(), why)) report(why);
      }
    }
  }
  void keep(CarryOver& state) { watch_.keep(state); }

 private:
  Line& line_;
  LimitWatch watch_;
  std::vector<double> over_;
};

}  // namespace hqp
