// The outgoing command: the answer, the continuation of a cut answer, or a command that comes to rest, within the rate
// limits, with notes on violated rows of subject_to.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "../rows/rows.hpp"
#include "contact_watch.hpp"
#include "guards.hpp"
#include "jerk_limiter.hpp"
#include "late.hpp"
#include "rest.hpp"

namespace hqp {

// Answer of a solver, with slacks and marks of all rows.
struct Answered {
  Status status;
  const double *x, *slack;
  const std::int8_t* marks;
  const char* detail = "";
  const double* points = nullptr;  // stage points, null without stages
  std::size_t point_count = 0;
  int iterations = 0, factorisations = 0;
  const double* allowed = nullptr;  // the permitted excess of the rows of the constraints, null without one
};

// Return true if slacks w (m) of an element's rows exceed rounding at these bounds; why: the largest slack, and the
// worst rows if each has a name.  operation: it names rows that change, null for none.  allowed (m): further excess of
// each row that counts as none, or null.
inline bool violated(const double* w, const double* lower, const double* upper, const double* allowed, std::size_t m,
                     double tolerance, const std::vector<std::string>& names, const Operation* operation, Note& why) {
  bool any = false;
  for (std::size_t i = 0; i < m; ++i) {
    NotedRow row{nullptr, std::fabs(w[i]), false, 0.0};
    if (row.amount > why.amount) why.amount = row.amount;
    const double most = tolerance * (1.0 + std::fmin(std::fabs(lower[i]), std::fabs(upper[i])));
    if (!(row.amount > most + (allowed ? allowed[i] : 0.0))) continue;
    any = true;
    if (names.size() != m) continue;
    row.name = names[i].c_str();
    if (const RowName now = operation ? operation->row_name(static_cast<int>(i)) : RowName(); now.name)
      row.name = now.name, row.of_shapes = std::isfinite(now.distance), row.distance = now.distance;
    ++why.row_count;
    for (NotedRow& known : why.rows)
      if (known.name == row.name) {  // a pair with several rows counts once
        row.amount = std::max(row.amount, known.amount);
        known = {}, --why.row_count;
      }
    for (NotedRow& known : why.rows)
      if (!known.name || row.amount > known.amount) std::swap(known, row);
  }
  return any;
}

// State before a tick: the last x, true if an answer was usable before, and the number of the tick.
struct Before {
  const double* x;
  bool good;
  std::int64_t tick;
};

class Outgoing {
 public:
  static constexpr double kOut = 1e-6;  // share of 1 + |bound| above rounding

  // Rows of an element of subject_to: first to last of a level, with names.
  struct Part {
    std::string name;
    int level, first, last;
    std::vector<std::string> names;
    const Operation* operation = nullptr;  // with names that change, null for none
  };

  // levels, law: live, see Late.  motors: their indices in x.  changes: largest change of each in a tick towards a cut
  // answer.  sentences: one per status.
  Outgoing(int n, std::vector<Level> levels, int constraints, const Law& law, std::vector<Part> parts,
           std::vector<int> motors, std::vector<double> changes, double violation, std::vector<std::string> sentences)
      : n_(n),
        levels_(std::move(levels)),
        parts_(std::move(parts)),
        motors_(std::move(motors)),
        changes_(std::move(changes)),
        violation_(violation),
        constraints_(constraints),
        sentences_(std::move(sentences)),
        late_(n, levels_, constraints, law, violation),
        trend_(std::size_t(n)),
        ahead_(std::size_t(n)),
        first_(std::size_t(n)) {
    if (changes_.size() != motors_.size())
      throw PlanError("largest changes of commands: " + std::to_string(changes_.size()) + " numbers for " +
                      std::to_string(motors_.size()) + " motors: export the plan anew");
    for (const Level& level : levels_) {
      starts_.push_back(slack_.size());
      slack_.resize(slack_.size() + std::size_t(level.m));
    }
  }

  int size() const { return n_; }
  // Largest change of each motor's command in a tick of a transition.
  const std::vector<double>& changes() const { return changes_; }
  Trend& trend() { return trend_; }  // trend of the sent answers
  std::size_t rows() const { return slack_.size(); }

  // Write the answer or its replacement into x; return false if it is unusable, and the command must come to rest.
  // rest, from(): as below. Until a search has ended the robot comes to rest: at rest its problem stays the same, so
  // that a search that continues from tick to tick ends; cut answers would move it off its balance.
  template <class From, class Report>
  bool take(const Answered& answer, const Before& before, Rest& rest, From&& from, const ContactWatch& contacts,
            const MotorLimits* motors, const double* v, JerkLimiter* jerk, const RateLimiter* limiter, double* x,
            const Report& report) {
    const bool finite = squared(answer.x, n_) < std::numeric_limits<double>::infinity();
    allowed_ = answer.allowed;
    if (answer.status != Status::kOptimal) {
      const bool off = off_by(answer.slack, "", report), out = leaves_box(answer.slack);
      const Status status = out ? std::max(answer.status, Status::kNotCertified) : answer.status;
      const char* why = *answer.detail ? answer.detail : sentences_[std::size_t(status)].c_str();
      if (!off || status != Status::kConstraintsViolated) report(Note{"solver", status, Cause::kSolver, why});
      if (status >= Status::kNotCertified) return false;
    } else if (!finite) {
      report(Note{"solver", Status::kNotCertified, Cause::kNotFinite});
    }
    if (!finite) return false;
    const bool cut = answer.status == Status::kIterationLimit || answer.status == Status::kTimeLimit;
    const double* sent = answer.x;
    if (cut && trend_.known()) {
      trend_.after(before.x, before.tick, ahead_.data());
      sent = late_.choose(answer.x, before.x, ahead_.data(), motors_, changes_);
    } else if (cut) {
      rest.begin(from(), before.x, true);
      rest.next(first_.data());
      sent = first_.data();
    }
    std::copy(sent, sent + n_, x);
    contacts.lost(report);
    if (motors) hold(*motors, v, x, report);
    if (jerk) smooth(*jerk, from().angles, before.x, std::numeric_limits<double>::infinity(), x, report);
    if (limiter) limit(*limiter, before.x, x, report);
    if (jerk) jerk->sent(before.x, x);
    if (!cut) trend_.take(x, before.tick);
    return true;
  }

  // Write the next x towards rest.  held: ticks without a usable answer.  why: status of the worst note.  fit: true if
  // this state is valid; from(): this state, or the last valid one.
  template <class From, class Report>
  void rest(Rest& rest, From&& from, bool fit, std::int64_t held, Status why, const Before& before,
            const RateLimiter* limiter, double* x, const Report& report) {
    trend_.forget();
    allowed_ = nullptr;
    if (fit || held == 1) rest.begin(from(), before.x, fit);
    if (!before.good && !fit) report(Note{"session", why, Cause::kNoState});
    rest.next(x);
    if (limiter) limit(*limiter, before.x, x, report);
  }

  // Move x back to the point that the limiter allows; report rows of subject_to that are violated by it.
  template <class Report>
  void limit(const RateLimiter& limiter, const double* last, double* x, const Report& report) {
    Note why;
    const double share = limiter.share(last, x, motors_, why);
    if (share == 1.0) return;
    for (int i = 0; i < n_; ++i) x[i] = last[i] + share * (x[i] - last[i]);
    report(why);
    off_at(x, limiter.name(), report);
  }

  // Move from the last command towards x with limited jerk and an acceleration that falls to `most` changes a tick;
  // inequalities of subject_to that the answer keeps are kept.
  template <class Report>
  void smooth(JerkLimiter& jerk, const double* angles, const double* last, double most, double* x,
              const Report& report) {
    jerk.approach(last, changes_.data(), most, x);
    jerk.keep_within_limits(angles, x);
    const double* answer = jerk.answer().data();
    for (const Part& part : parts_) {
      if (jerk.declared_by(part.name)) continue;  // its rows keep a distance; keep_within_limits has the limits
      const Level& level = levels_[std::size_t(part.level)];
      for (int i = part.first; i < part.last; ++i)
        if (level.lower[i] < level.upper[i])
          jerk.keep_within(value(level, i, x, n_), value(level, i, answer, n_), level.lower[i], level.upper[i],
                           part.name.c_str());
    }
    Note why;
    if (jerk.give_way(last, x, why)) report(why);
  }

  // Move x into the limits of the motors; report rows of subject_to that are violated by it.
  template <class Report>
  void hold(const MotorLimits& motors, const double* v, double* x, const Report& report) {
    Note why;
    if (!motors.hold(x, std::size_t(n_), v, motors_, why)) return;
    report(why);
    off_at(x, motors.name(), report);
  }

 private:
  template <class Report>
  void off_at(const double* x, const char* limit, const Report& report) {
    double* w = slack_.data();
    for (const Level& level : levels_)
      for (int i = 0; i < level.m; ++i) *w++ = slack(value(level, i, x, n_), level.lower[i], level.upper[i]);
    off_by(slack_.data(), limit, report);
  }
  // Return true if an answer violates bounds on single variables in the first level. Such bounds can always be met,
  // so that no optimum violates them.
  bool leaves_box(const double* slack) const {
    if (constraints_ == 0 || !levels_.front().index) return false;
    const Level& box = levels_.front();
    for (int i = 0; i < box.m; ++i) {
      const double bound = slack[i] > 0.0 ? box.upper[i] : box.lower[i];
      if (!(std::fabs(slack[i]) > kOut * (1.0 + std::fabs(bound)))) continue;
      bool alone = true;  // no other row keeps the variable off that bound
      for (int j = 0; j < box.m; ++j) {
        const double there = box.scale[j] * bound / box.scale[i];
        alone = alone && (box.index[j] != box.index[i] || (box.lower[j] <= there && there <= box.upper[j]) || j == i);
      }
      if (alone) return true;
    }
    return false;
  }
  // Report violated elements of subject_to, by a limit of that name; return true if there is one.
  template <class Report>
  bool off_by(const double* slack, const char* limit, const Report& report) const {
    bool any = false;
    for (const Part& part : parts_) {
      Note why{part.name.c_str(), Status::kConstraintsViolated, Cause::kOff, limit};
      const Level& level = levels_[std::size_t(part.level)];
      const std::size_t first = starts_[std::size_t(part.level)] + std::size_t(part.first);
      if (!violated(slack + first, level.lower + part.first, level.upper + part.first,
                    allowed_ ? allowed_ + first : nullptr, std::size_t(part.last - part.first), violation_, part.names,
                    part.operation, why))
        continue;
      report(why), any = true;
    }
    return any;
  }

  int n_;
  std::vector<Level> levels_;
  std::vector<Part> parts_;
  std::vector<int> motors_;
  std::vector<double> changes_;
  double violation_;
  int constraints_;
  std::vector<std::string> sentences_;
  Late late_;
  Trend trend_;
  std::vector<double> ahead_, first_, slack_;
  const double* allowed_ = nullptr;  // of the latest answer
  std::vector<std::size_t> starts_;  // first row of each level
};

}  // namespace hqp
