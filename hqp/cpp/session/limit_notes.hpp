// Notes on joint limits: alternating limits, positions that will pass theirs, and positions outside.
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
  // marks, slacks: sides and violations of all rows in a tick of that number; q: its state; around:
  // velocity at the centre of the limits' windows.
  template <class Report>
  void look(const std::int8_t* marks, const double* slacks, std::int64_t tick, const double* q, const double* around,
            const Report& report) {
    bool noted = false;
    watch_.look(marks, tick, [&](const Note& note) { noted = true, report(note); });
    const bool passing = noted || watch_.meet();
    for (const Member* member : line_.placed()) {
      if (member->units.empty() || member->operation < 0) continue;
      const Operation& rows = *line_.assembly().operation(member->operation);
      line_.assembly().overrun(passing ? member->operation : -1, q, around, over_);
      for (std::size_t i = 0; i < member->units.size(); ++i) {
        Note why{member->row_names[i].c_str()};
        const char* unit = member->units[i].c_str();
        double low = 0.0, high = 0.0;
        const double out = rows.outside(static_cast<int>(i), q, low, high);
        const double slack = slacks[line_.start(*member) + member->first + static_cast<int>(i)];
        if ((i < over_.size() && LimitWatch::passed(over_[i], unit, why)) ||
            LimitWatch::outside(out, low, high, slack, unit, why))
          report(why);
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
