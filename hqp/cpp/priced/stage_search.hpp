// One stage: min ||T y - t|| + c/2 |y|^2 over the rows of the stage, or c/2 |y|^2 alone, by a primal active set from a
// point that keeps to them. On the face of a working set the minimiser is known (secular.hpp), so every step goes to
// it or to the first row in the way, and the value falls at every step that is not zero; after a zero step the lowest
// index leaves and enters (Bland's rule), so that no working set comes back. After a search that was cut it
// starts towards the end of that one, as far as the rows allow.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "../solver/deadline.hpp"
#include "../solver/tolerances.hpp"
#include "row_space.hpp"
#include "secular.hpp"
#include "stage_rows.hpp"
#include "stages.hpp"

namespace hqp {
inline namespace HQP_ISA {

// The objective of a stage beside c/2 |y|^2: rows T (m, ld), with the lengths `size` (m) in x.
struct Aim {
  const double *T = nullptr, *t = nullptr, *size = nullptr;
  int ld = 0, m = 0;
  double price = 1.0;
};

class StageSearch {
 public:
  // most: rows of an aim.  accurate: share of a row's length and terms, and of the gradient: a larger error is
  // doubtful. rounded: see RowSpace.  deadline: ends every solve.
  StageSearch(int most_rows, int n, int variables, int most, double accurate, double rounded, Deadline& deadline)
      : accurate_(accurate),
        deadline_(deadline),
        n_(n),
        ld_(padded(variables)),
        space_(variables, ld_, rounded),
        rate_(most_rows),
        side_(most_rows),
        kept_(most_rows),
        passed_(most_rows),
        y_(ld_),
        other_(ld_),
        aim_(ld_),
        x_(n),
        move_(n),
        part_(variables),
        lambda_(variables),
        own_lambda_(variables) {
    for (auto* list : {&set_, &own_set_, &rest_, &dependent_, &spanned_}) list->reserve(most_rows);
    const std::size_t rows = static_cast<std::size_t>(most);
    for (auto* rowed : {&M_, &K_, &base_, &turned_}) rowed->resize(rows * ld_);
    for (auto* part : {&e_, &u_}) part->resize(rows);
    secular_.reserve(rows);
  }

  // Minimise from y (N); return true at the optimum.  started: true if y is feasible, else only the face of the
  // working set is tried.  working: numbers of rows (+ 1, negative at the lower side) to begin with, and those active
  // at the end.  near: an x (n) to begin near, or empty.
  bool solve(StageRows& rows, int N, const Aim& aim, double* y, std::vector<int>& working, int& iterations,
             const std::vector<double>& near = {}, bool started = true) {
    rows_ = &rows;
    goal_ = aim;
    n_ = rows.n();
    N_ = ld_ = N;
    space_.uncertain = secular_.uncertain = unclear_ = false;
    space_.closest = INFINITY;
    off_ = 0.0;
    if (deadline_.passed()) return false;
    ++iterations;
    bool reached = false, equalities_alone = true;
    if (!(working.empty() && started)) {
      equalities_alone = !hold(working);
      reached = on_the_face_of(working, y);
    }
    if (!reached && !started) return false;
    if (!reached) {
      if (!equalities_alone || working.empty()) {
        hold({});
        if (!near.empty()) enter_all(working);
      }
      if (!near.empty()) approach(near, y);
      const double far = dot_any(y, y, N_);
      reached = descend(working, y, iterations);
      list(working);
      const bool long_way = kRests * kRests * far > (1.0 + dot_any(y, y, N_));
      if (reached && (long_way || leaves_its_face(y))) {  // rounding of the steps has added up
        const double off = off_;
        begin();
        if (!on_the_face_of(working, y)) {
          reached = descend(working, y, iterations);
          off_ = larger(off, off_);
        }
      }
    }
    list(working);
    unclear_ = reached && space_.closest < kEither * kEither && moves(working, y, iterations);
    return reached;
  }

  // True if the optimum of the latest solve moves with the reading of a remainder near kDirection.
  bool unclear() const { return unclear_; }
  // True if directions of the latest solve were uncertain: rows nearly depend on others, or differ much in length.
  bool uncertain() const { return space_.uncertain || secular_.uncertain; }
  // Return true if a sign is violated by more than rounding at the end of the latest solve, or if nearly opposed
  // multipliers are so large that their rounding does.
  bool strays() const { return off_ > accurate_; }
  // Return true if the end y violates a row by more than rounding, or moves where rows that it misses are met; no
  // gradient tells.  working: the rows held, by number; open: slacks of rows whose values may be those of rows that are
  // met.
  bool misses(const std::vector<int>& working, const std::vector<double>& open, const double* y) {
    at_point(y);
    const double least = rows_->rounding() * size_;  // rows no longer than that have no direction of their own
    bool missing = false;
    for (int i = 0; i < rows_->count(); ++i) {
      const StageRow& row = (*rows_)[i];
      const double off = std::abs(beyond(i, y)), more = row.number >= 0 ? std::abs(open[row.number]) : 0.0;
      if (off > allowed(row, accurate_, 0.0) + least && off > accurate_ * terms(row, x_.data(), y)) return true;
      missing = missing || (larger(off, more) > kOnRow * row.size && larger(off, more) > error(i, y));
    }
    if (!missing) return false;
    rest_ = set_;
    const bool moved = back(y, &open) > kUncertain || back(y, nullptr) > kUncertain;
    own_set_ = rest_;
    hold({});
    enter_all(working);
    set_ = own_set_;
    return moved;
  }
  // Return true if the equalities determine coordinate j.
  bool determines(int j) const { return space_.determines(j, fixed_); }

  // The rows held at the end, and their multipliers.
  const std::vector<int>& held() const { return set_; }
  const std::vector<double>& multipliers() const { return lambda_; }

 private:
  // Descend from y along faces, with the rows of the working set that are at their bound; return true at the optimum.
  bool descend(const std::vector<int>& working, double* y, int& iterations) {
    begin();
    at_point(y);
    for (const int entry : working) {
      const int i = row_of(entry), side = entry > 0 ? 1 : -1;
      if (i >= 0 && at_bound(i, side, y)) enter(i, side);
    }
    const int cap = 20 * (N_ + rows_->count());
    bool zero = false;
    int left = -1;  // row that left a moment ago
    // own: count of rows that blocked their own release; still: the longest step that they stopped. Once own exceeds
    // the number of held rows, a shorter move is rounding and releases no kept row: the search would cycle.
    std::size_t own = 0;
    double still = 0.0;
    for (int step = 0; step < cap; ++step) {
      if (deadline_.passed()) return false;
      ++iterations;
      through(y);
      minimiser();
      for (int j = 0; j < N_; ++j) aim_[j] -= y[j];
      const double length = std::sqrt(dot_any(aim_.data(), aim_.data(), N_)), size = std::sqrt(dot_any(y, y, N_));
      double far = 1.0;
      const double least = kNoStep * (1.0 + size);
      const bool there = length <= least;
      const int blocking = there ? -1 : first_in_the_way(y, zero, far);
      if (there || far * length > least) {
        add_any(y, aim_.data(), far, N_);
        at_point(y);
        zero = zero && there;
        if (!there && (own <= set_.size() || far * length > still)) std::fill(kept_.begin(), kept_.end(), 0);
      } else {
        zero = true;
      }
      if (blocking >= 0) {
        const bool itself = zero && blocking == left;  // stops its own release: its sign or its rate is rounding
        if (itself) ++own;
        if (itself && !passed_[blocking]) {
          passed_[blocking] = 1;
          continue;
        }
        enter(blocking, rate_[blocking] > 0.0 ? 1 : -1);
        kept_[blocking] = itself;
        if (itself) still = larger(still, length);
        continue;
      }
      const int out = wrong_sign(y, zero);
      if (out < 0) return true;
      left = set_[out];
      leave(out);
    }
    return false;
  }

  // Move y towards `near`, within the rows, if this lessens the objective: first on the held face, at the bounds of
  // the latest working set, then on the equalities.
  void approach(const std::vector<double>& near, double* y) {
    double least = value(y);
    for (const bool active : {true, false}) {
      if (active && set_.size() == static_cast<std::size_t>(fixed_)) continue;
      if (active) {
        for (std::size_t k = 0; k < set_.size(); ++k)
          lambda_[k] = (*rows_)[set_[k]].bound(side_[set_[k]]) - rows_->shift(set_[k]);
        space_.meet(lambda_.data(), part_.data());
      } else {
        begin();
        through(y);
      }
      rows_->at().motion(near.data(), aim_.data());
      set_bands(near.data(), true);
      space_.turn(aim_.data(), N_);
      space_.split(aim_.data(), lambda_.data());
      space_.join(aim_.data(), part_.data());
      space_.turn_back(aim_.data(), N_);
      rows_->at().point(aim_.data(), x_.data());
      set_bands(x_.data(), false);
      for (int j = 0; j < N_; ++j) aim_[j] -= y[j];
      at_point(y);
      double far = 1.0;
      first_in_the_way(y, false, far);
      for (int j = 0; j < N_; ++j) aim_[j] = y[j] + far * aim_[j];
      const double there = value(aim_.data());
      if (!(there < least)) continue;
      least = there;
      std::copy(aim_.begin(), aim_.begin() + N_, y);
    }
  }

  // Set the bands in aim_ of all rows, or of those not held: to the held bound, or to the least that x (n) needs.
  void set_bands(const double* x, bool all) {
    for (int i = 0; i < rows_->count(); ++i) {
      const StageRow& row = (*rows_)[i];
      const bool held = std::abs(side_[i]) == 1;
      if (row.band < 0 || (held && !all)) continue;
      const double own = row.a ? dot_any(row.a, x, n_) : row.scale * x[row.only];
      const double to = held ? row.bound(side_[i]) : larger(smaller(own, row.upper), row.lower);
      aim_[row.band] = (to - own) / row.share;
    }
  }

  // ||T y - t|| + c/2 |y|^2.
  double value(const double* y) const {
    double square = 0.0;
    for (int i = 0; i < goal_.m; ++i) {
      const double off = dot_any(goal_.T + static_cast<std::size_t>(i) * goal_.ld, y, N_) - goal_.t[i];
      square += off * off;
    }
    return std::sqrt(square) + 0.5 * goal_.price * dot_any(y, y, N_);
  }

  // The rows held beside the equalities, as `working`.
  void list(std::vector<int>& working) const {
    working.clear();
    for (const int i : set_)
      if (!(*rows_)[i].equal()) working.push_back(side_[i] * ((*rows_)[i].number + 1));
  }

  // Hold the equalities, and before them the rows of a working set that pick one coordinate: as the first rows they
  // need no reflection if all coordinates move. Return true if there are any.
  bool hold(const std::vector<int>& working) {
    rows_->forget_turned();  // other rows may stand before the equalities than in the search before
    set_.clear();
    cut(0);
    spanned_.clear();
    fixed_ = 0;
    begin();
    for (const int entry : working)
      if (const int i = rows_->at().rank() == n_ ? row_of(entry) : -1;
          i >= 0 && rows_->only(i) >= 0 && !(*rows_)[i].equal())
        enter(i, entry > 0 ? 1 : -1);
    const bool ahead = !set_.empty();
    for (int i = 0; i < rows_->count(); ++i) {
      if (!(*rows_)[i].equal()) continue;
      enter(i, 1);
      if (side_[i] == 2) spanned_.push_back(i);
    }
    fixed_ = static_cast<int>(set_.size());
    turn_base();
    return ahead;
  }

  // The row of an entry of a working set, -1 if it is absent, has lost its bound, or is held.
  int row_of(int entry) const {
    const int i = rows_->place(std::abs(entry) - 1);
    return i < 0 || side_[i] != 0 || !std::isfinite((*rows_)[i].bound(entry > 0 ? 1 : -1)) ? -1 : i;
  }

  // Hold the equalities alone.
  void begin() {
    std::fill(side_.begin(), side_.begin() + rows_->count(), 0);
    for (auto* marks : {&kept_, &passed_}) std::fill(marks->begin(), marks->begin() + rows_->count(), 0);
    set_.resize(fixed_);
    cut(fixed_);
    dependent_.clear();
    for (const int i : set_) side_[i] = 1;
    for (const int i : spanned_) side_[i] = 2;
  }

  // Move y to the minimiser on the face of the working set if that is the optimum within all rows; else return false.
  // In a loop the active set of the last tick is mostly the right one.
  bool on_the_face_of(const std::vector<int>& working, double* y) {
    enter_all(working);
    for (std::size_t k = 0; k < set_.size(); ++k)
      lambda_[k] = (*rows_)[set_[k]].bound(side_[set_[k]]) - rows_->shift(set_[k]);
    space_.meet(lambda_.data(), part_.data());
    minimiser();
    at_point(aim_.data());
    for (int i = 0; i < rows_->count(); ++i) {
      const StageRow& row = (*rows_)[i];
      const double off = std::abs(side_[i]) == 1 ? kActive : kNoRate, value = row.value(x_.data(), aim_.data(), n_);
      if (!(value >= row.lower - allowed(row, off, row.lower) && value <= row.upper + allowed(row, off, row.upper)))
        return false;  // also for NaN
    }
    if (wrong_sign(aim_.data(), false) >= 0) return false;
    std::copy(aim_.begin(), aim_.begin() + N_, y);
    return true;
  }

  // Return true if the motion of y, the optimum with these rows, is another if remainders near kDirection count as
  // directions, or if they do not.
  bool moves(const std::vector<int>& working, const double* y, int& iterations) {
    const double off = off_;
    own_set_ = set_, own_lambda_ = lambda_;
    bool still = true;
    for (const double reading : {kDirection / (kEither * kEither), kDirection * kEither * kEither}) {
      if (!still) break;
      space_.threshold = reading;
      hold({});
      std::copy(y, y + N_, other_.begin());
      still = on_the_face_of(working, other_.data()) || descend(working, other_.data(), iterations);
      add_any(other_.data(), y, -1.0, N_);
      still = still && apart(other_.data(), y) <= kViolated;
    }
    space_.threshold = kDirection;
    hold({});
    enter_all(working);
    set_ = own_set_, lambda_ = own_lambda_, off_ = off;
    return !still;
  }

  // Distance of a row beyond its bounds, 0 if it depends on the rows held.
  double beyond(int i, const double* y) const {
    const StageRow& row = (*rows_)[i];
    return row.equal() && side_[i] == 2 ? 0.0 : slack(row.value(x_.data(), y, n_), row.lower, row.upper);
  }
  // Rounding of a row's value and its bound.
  double error(int i, const double* y) const {
    return 2.0 * kOnRow * ((*rows_)[i].size + terms((*rows_)[i], x_.data(), y));
  }

  // The least motion, of 1 + |y|, that takes rows back that are beyond their bounds, and holds the rows held and others
  // in its way, each to its error, which grows along nearly dependent rows.  open: slacks to be taken back as well, or
  // null; the result is 0 if errors do not hide how these would fall, since the optimum of their level allows no fall.
  double back(const double* y, const std::vector<double>* open) {
    own_set_.clear();
    double fall = 0.0, hidden = 0.0;  // half the squared slacks; fall hidden by errors at length 1
    for (int i = 0; i < rows_->count(); ++i) {
      const StageRow& row = (*rows_)[i];
      const double more = open && row.number >= 0 ? (*open)[row.number] : 0.0, own = error(i, y);
      rate_[i] = beyond(i, y) + more;
      fall += more * more;
      if (more != 0.0) hidden += own * row.size;
      if (std::abs(rate_[i]) > own) own_set_.push_back(i);
    }
    const auto off = own_set_.size();
    for (const int i : rest_)
      if (std::find(own_set_.begin(), own_set_.begin() + off, i) == own_set_.begin() + off) own_set_.push_back(i);
    for (std::size_t met = 0; met < own_set_.size();) {
      rows_->forget_turned();
      cut(0);
      fixed_ = 0;
      space_.threshold = kOnRow;  // rows count, however little others leave of them
      for (const int i : own_set_)
        if (add(i)) space_.reach(-rate_[i], error(i, y), own_lambda_.data(), part_.data());
      space_.threshold = kDirection;
      std::fill(aim_.begin(), aim_.end(), 0.0);
      space_.join(aim_.data(), own_lambda_.data());
      space_.turn_back(aim_.data(), N_);
      rows_->at().step(aim_.data(), move_.data());
      met = own_set_.size();
      for (int i = 0; i < rows_->count(); ++i) {
        if (std::find(own_set_.begin(), own_set_.end(), i) != own_set_.end()) continue;
        const StageRow& row = (*rows_)[i];
        const double value = row.value(x_.data(), y, n_), rate = row.value(move_.data(), aim_.data(), n_);
        const double out = slack(value + rate, row.lower, row.upper);
        if (std::abs(out) <= error(i, y)) continue;
        rate_[i] = value - row.bound(out > 0.0 ? 1 : -1);
        own_set_.push_back(i);
      }
    }
    if (open && fall > 0.0) return fall > hidden * std::sqrt(dot_any(move_.data(), move_.data(), n_)) ? 0.0 : INFINITY;
    return own_set_.empty() ? 0.0 : apart(aim_.data(), y);
  }

  // The length of the motion in `step`, of that of y.
  double apart(const double* step, const double* y) const {
    double square = 0.0, size = 1.0;
    for (int j = 0; j < n_; ++j) {
      if (!rows_->at().moves(j)) continue;
      square += step[j] * step[j];
      size += y[j] * y[j];
    }
    return std::sqrt(square / size);
  }

  // Return true if y misses the bound of a held row by more than that row's rounding.
  bool leaves_its_face(const double* y) {
    at_point(y);
    for (const int i : set_) {
      const StageRow& row = (*rows_)[i];
      const double bound = row.bound(side_[i]);
      if (std::abs(row.value(x_.data(), y, n_) - bound) > allowed(row, kNoRate, bound)) return true;
    }
    return false;
  }

  // Compute x_ at y.
  void at_point(const double* y) {
    rows_->at().point(y, x_.data());
    size_ = std::sqrt(dot_any(x_.data(), x_.data(), n_));
  }

  // Error that a row may have at x_.
  double allowed(const StageRow& row, double off, double bound) const {
    return off * (row.size + std::abs(bound)) + kRounding * row.size * size_;
  }

  bool at_bound(int i, int side, const double* y) const {
    const StageRow& row = (*rows_)[i];
    const double bound = row.bound(side);
    return std::abs(row.value(x_.data(), y, n_) - bound) <= allowed(row, kAtBound, bound);
  }

  // Hold a row; one that depends on those held keeps its value without.
  void enter(int i, int side) {
    if (!(space_.picks() && rows_->only(i) >= 0 ? space_.pick(rows_->only(i), rows_->entry(i)) : add(i))) {
      side_[i] = 2;
      if (!(*rows_)[i].equal()) dependent_.push_back(i);
      return;
    }
    side_[i] = side;
    set_.push_back(i);
  }

  void enter_all(const std::vector<int>& working) {
    for (const int entry : working)
      if (const int i = row_of(entry); i >= 0) enter(i, entry > 0 ? 1 : -1);
  }

  bool add(int i) {
    const int turned = (*rows_)[i].equal() ? 0 : fixed_;  // the equalities' part once a stage
    const double* row = rows_->row(i, N_, [&](double* written) { space_.turn(written, N_, 0, turned); });
    return space_.add(row, N_, rows_->grades(), (*rows_)[i].size, rows_->rounding(), turned);
  }

  void leave(int k) {
    side_[set_[k]] = 0;
    rest_.assign(set_.begin() + k + 1, set_.end());
    set_.resize(k);
    cut(k);
    for (const int i : dependent_) side_[i] = 0;
    dependent_.clear();
    for (const int i : rest_) enter(i, side_[i]);
  }

  void cut(int rank) {
    space_.cut(rank);
    if (rank < turned_by_) turned_by_ = -1;
  }

  // base_ = T turned by the equalities.
  void turn_base() {
    for (int i = 0; i < goal_.m; ++i) {
      double* row = &base_[static_cast<std::size_t>(i) * ld_];
      std::copy(goal_.T + static_cast<std::size_t>(i) * goal_.ld, goal_.T + static_cast<std::size_t>(i) * goal_.ld + N_,
                row);
    }
    space_.turn(base_.data(), ld_, goal_.m, N_, 0, space_.rank());
    turned_by_ = -1;
  }
  // turned_ = T turned by all rows held: by the equalities' reflections once a stage, by those of rows that entered
  // since the last minimiser only.
  void turn_goal() {
    if (turned_by_ < 0) std::copy_n(base_.data(), goal_.m * ld_, turned_.data()), turned_by_ = fixed_;
    const int rank = space_.rank();
    space_.turn(turned_.data(), ld_, goal_.m, N_, turned_by_, rank);
    turned_by_ = rank;
  }

  // Compute part_ of the face through y. Errors of held rows stay: a correction along nearly dependent rows would be
  // the error over their smallest pivot, and violate all other rows.
  void through(const double* y) {
    std::copy(y, y + N_, y_.begin());
    space_.turn(y_.data(), N_);
    space_.split(y_.data(), part_.data());
  }

  // aim_ = the minimiser on the face of part_.
  void minimiser() {
    const int rank = space_.rank();
    const double* grade = rows_->grades();
    turn_goal();
    for (int i = 0; i < goal_.m; ++i) {
      double *row = &M_[static_cast<std::size_t>(i) * ld_], *part = &K_[static_cast<std::size_t>(i) * ld_];
      const double* turned = &turned_[static_cast<std::size_t>(i) * ld_];
      std::copy(turned, turned + N_, row);
      space_.split(row, part);
      e_[i] = goal_.t[i] - dot_any(part, part_.data(), rank);
      double left = 0.0;
      for (int j = 0; j < N_; ++j) left += row[j] * grade[j] * row[j] * grade[j];
      left = std::sqrt(left);
      if (!space_.counts(left, goal_.size[i], kOnRow * goal_.size[i])) std::fill(row, row + N_, 0.0);
      else space_.uncertain = space_.uncertain || left < kUncertain * goal_.size[i];
    }
    secular_.solve(M_.data(), ld_, N_, e_.data(), goal_.m, goal_.price);
    std::fill(aim_.begin(), aim_.begin() + N_, 0.0);
    for (int i = 0; i < goal_.m; ++i)
      add_any(aim_.data(), &M_[static_cast<std::size_t>(i) * ld_], secular_.weight(i), N_);
    space_.join(aim_.data(), part_.data());
    space_.turn_back(aim_.data(), N_);
  }

  // The row that the step aim_ meets first, and the share of the step up to it; -1 for none within the step.
  int first_in_the_way(const double* y, bool lowest, double& far) {
    int found = -1;
    rows_->at().step(aim_.data(), move_.data());
    const double floor = kNoRate * std::sqrt(dot_any(move_.data(), move_.data(), n_));
    for (int i = 0; i < rows_->count(); ++i) {
      if (side_[i] != 0) continue;
      const StageRow& row = (*rows_)[i];
      rate_[i] = row.value(move_.data(), aim_.data(), n_);
      const double bound = row.bound(rate_[i] > 0.0 ? 1 : -1), value = row.value(x_.data(), y, n_);
      if (std::isinf(bound) || std::abs(rate_[i]) <= floor * row.size) continue;
      if (passed_[i] && std::abs(value + rate_[i] - bound) <= kEither * error(i, y)) continue;
      const double times = larger(0.0, (bound - value) / rate_[i]);
      if (times < far - (lowest ? kOnRow : 0.0)) {
        far = times;
        found = i;
      }
    }
    return found;
  }

  // Sum of the absolute terms of a row at x and y.
  double terms(const StageRow& row, const double* x, const double* y) const {
    const double own = row.a ? absolute_dot(row.a, x, n_) : std::abs(row.scale * x[row.only]);
    return row.band < 0 ? own : own + std::abs(row.share * y[row.band]);
  }

  // The place in the set of a row whose multiplier has the wrong sign at y, the minimiser of its face, -1 for none;
  // the worst, or the lowest index.
  int wrong_sign(const double* y, bool lowest) {
    const int rank = space_.rank();
    const double *grade = rows_->grades(), price = goal_.price;
    secular_.direction(price, u_.data());
    double scale = 0.0;
    for (int j = 0; j < N_; ++j) scale += y[j] * grade[j] * y[j] * grade[j];
    scale = price * std::sqrt(scale);
    const double least = scale + price;
    double rounded = scale, kept = 0.0;
    for (int k = 0; k < rank; ++k) part_[k] *= price;
    for (int i = 0; i < goal_.m; ++i) {
      add_any(part_.data(), &K_[static_cast<std::size_t>(i) * ld_], u_[i], rank);
      scale = larger(scale, std::abs(u_[i]) * goal_.size[i]);
      rounded += std::abs(u_[i]) * goal_.size[i];
    }
    space_.multipliers(part_.data(), lambda_.data());
    for (std::size_t k = 0; k < set_.size(); ++k) rounded += std::abs(lambda_[k]) * (*rows_)[set_[k]].size;
    int found = -1;
    double worst = kRounding * rounded;
    for (std::size_t k = 0; k < set_.size(); ++k) {
      // the gradient must point into the side: lambda <= 0 at upper
      const double wrong = side_[set_[k]] * lambda_[k] * (*rows_)[set_[k]].size;
      if (kept_[set_[k]]) kept = larger(kept, wrong);
      if ((*rows_)[set_[k]].equal() || wrong <= worst || kept_[set_[k]]) continue;
      if (lowest && found >= 0 && set_[k] > set_[found]) continue;
      if (!lowest) worst = wrong;
      found = static_cast<int>(k);
    }
    off_ = larger(kViolated / kTurned * kRounding * rounded / least, kept / (scale + price));
    return found;
  }

  double accurate_;
  Deadline& deadline_;
  StageRows* rows_ = nullptr;
  Aim goal_;
  int n_, ld_, N_ = 0, fixed_ = 0;
  RowSpace space_;
  Secular secular_;
  std::vector<int> set_, own_set_, rest_, dependent_, spanned_;
  std::vector<double> rate_;
  std::vector<int> side_;
  std::vector<char> kept_;    // rows that no wrong sign releases until the point moves
  std::vector<char> passed_;  // rows that stop no step that leads beyond their bound by rounding alone
  std::vector<double> y_, other_, aim_, x_, move_, part_, lambda_, own_lambda_, M_, K_, base_, turned_, e_, u_;
  bool unclear_ = false;
  int turned_by_ = -1;  // count of held rows whose reflections are in turned_, -1 for none
  double size_ = 0.0;
  double off_ = 0.0;  // relative error of the gradient: signs of kept rows; of that of motion: rounding of all rows
};

}  // namespace HQP_ISA
}  // namespace hqp
