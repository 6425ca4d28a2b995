// One stage: min ||T y - t|| + c/2 |y|^2 over lower <= C y <= upper, by a primal active set from a point of that set.
// On the face of a working set the minimiser is known (secular.hpp), so every step goes to it or to the first row in
// the way, and the value falls at every step that is not zero; after a zero step the lowest index leaves and enters
// (Bland's rule), so that no working set comes back.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <vector>

#include "row_space.hpp"
#include "secular.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr double kRounding = 1e-15;     // of a value, relative to 1 + |y|
constexpr double kAtBound = 1e-10;      // rows at their bounds
constexpr double kOnFace = 1e-12;       // rows that are not held keep to their bounds
constexpr double kHeldOnFace = 1e-9;    // and those held, of which some may nearly depend on others
constexpr double kNoDirection = 1e-13;  // what is left of a row whose direction the face has not
constexpr double kRotatedAway = 1e-4;   // square of a rotated row, relative to the longest row's
constexpr double kNoStep = 1e-12;       // a step that is rounding, relative to 1 + |y|
constexpr double kNoFlatStep = 1e-14;   // and one where motion may be flat
constexpr double kFar = 1e3;            // a start so far away, relative to 1 + |y| at the end, leaves its rounding
constexpr double kOnRow = 1e-13;        // rounding of a row's value, relative to its terms

// Rows of unit length, two-sided; an equality where the bounds agree.
struct StageRows {
  int ld = 0, count = 0;
  bool flat = false;  // motion may be: short ways here are long ones of x
  std::vector<double> C, lower, upper;
  std::vector<double> unit;    // what a row of unit length in x is here: long ones move far where motion is flat
  std::vector<double> length;  // before it was scaled to 1
  std::vector<char> equal;
  std::vector<int> only;  // the one entry that is not zero, -1 where there are more

  void room(int rows, int stride) {
    ld = stride;
    C.assign(static_cast<std::size_t>(rows) * ld, 0.0);
    lower.resize(rows);
    upper.resize(rows);
    unit.resize(rows);
    length.resize(rows);
    equal.resize(rows);
    only.resize(rows);
  }
  double* row(int i) { return &C[static_cast<std::size_t>(i) * ld]; }
  const double* row(int i) const { return &C[static_cast<std::size_t>(i) * ld]; }
  double value(int i, const double* y, int N) const {
    return only[i] < 0 ? dot_any(row(i), y, N) : row(i)[only[i]] * y[only[i]];
  }

  // By how much row i may be off at y of a given length, `off` being relative to its length in x and its bound.
  double allowed(int i, double off, double bound, double size) const {
    return off * (unit[i] + std::abs(bound)) + kRounding * (1.0 + size);
  }

  // Scale row i, already written, to unit length; a row of no length or no bound is dropped by the caller.  in_x: its
  // length there.
  bool close(int i, int N, double low, double high, double in_x) {
    double* c = row(i);
    length[i] = std::sqrt(dot_any(c, c, N));
    if (!(length[i] > 1e-13) || (low == -INFINITY && high == INFINITY)) return false;
    for (int j = 0; j < N; ++j) c[j] /= length[i];
    only[i] = -1;
    unit[i] = std::fmin(1.0, in_x / length[i]);
    bound(i, low, high);
    return true;
  }

  // Row i picks coordinate j: low <= c y_j <= high.
  bool pick(int i, int j, double c, double low, double high) {
    length[i] = std::abs(c);
    if (!(length[i] > 1e-13)) return false;
    std::fill(row(i), row(i) + ld, 0.0);
    row(i)[j] = c > 0.0 ? 1.0 : -1.0;
    only[i] = j;
    unit[i] = 1.0;
    bound(i, low, high);
    return true;
  }

 private:
  void bound(int i, double low, double high) {
    lower[i] = low / length[i];
    upper[i] = high / length[i];
    equal[i] = low == high;
  }
};

class StageSearch {
 public:
  StageSearch(int most_rows, int variables)
      : space_(variables, padded(variables)),
        rate_(most_rows),
        side_(most_rows),
        kept_(most_rows),
        aim_(padded(variables)),
        gradient_(padded(variables)),
        lambda_(variables),
        bound_(variables) {}

  // Every solve from now on ends once so many seconds have gone by; never for 0.
  void limit(double seconds) {
    limited_ = seconds > 0.0 && std::isfinite(seconds);
    if (limited_)
      end_ = Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  }

  // Whether that time has gone by.
  bool late() const { return limited_ && Clock::now() > end_; }

  // The stages of another problem follow.
  void restart() {
    space_.uncertain = secular_.uncertain = false;
    set_.clear();
    fixed_ = scanned_ = 0;
    spanned_.clear();
  }

  // Minimise from y (N), which keeps to the rows; the first `lasting` rows stay for the stages that follow.  warm: rows
  // (index + 1, negative at the lower side) to begin with. Returns whether the optimum was reached; `working` holds the
  // rows active at the end, as warm.
  bool solve(const StageRows& rows, int lasting, int N, const double* T, const double* t, int m, double price,
             double* y, std::vector<int>& working, int& iterations) {
    rows_ = &rows;
    N_ = N;
    begin();
    if (late()) return false;
    for (; scanned_ < lasting; ++scanned_) hold(scanned_);
    ++iterations;
    bool reached = !working.empty() && on_the_face_of(working, T, t, m, price, y);
    if (!reached) {
      const double far = dot_any(y, y, N_);
      reached = descend(working, T, t, m, price, y, iterations);
      list(working);
      if (reached && far > kFar * kFar * (1.0 + dot_any(y, y, N_))) {  // the rounding of a long way
        begin();
        if (!on_the_face_of(working, T, t, m, price, y)) return reached;
      }
    }
    list(working);
    return reached;
  }

  // Whether directions were uncertain since the restart: rows nearly depend on others, or differ much in length.
  bool uncertain() const { return space_.uncertain || secular_.uncertain; }

  // The rows held at the end, and their multipliers.
  const std::vector<int>& held() const { return set_; }
  const std::vector<double>& multipliers() const { return lambda_; }

 private:
  // From y along faces, beginning with the rows of the working set given that y meets; whether the optimum was reached.
  bool descend(const std::vector<int>& working, const double* T, const double* t, int m, double price, double* y,
               int& iterations) {
    if (!working.empty()) begin();
    for (int entry : working) {
      const int i = std::abs(entry) - 1, side = entry > 0 ? 1 : -1;
      if (i < rows_->count && !rows_->equal[i] && at_bound(i, side, y)) enter(i, side);
    }
    const int cap = 20 * (N_ + rows_->count);
    bool zero = false;
    int left = -1;  // row that left a moment ago
    for (int step = 0; step < cap; ++step) {
      if (late()) return false;
      ++iterations;
      through(y);
      minimiser(T, t, m, price, y);
      double far = 1.0;
      const double least = (rows_->flat ? kNoFlatStep : kNoStep) * (1.0 + size_);
      const bool there = length_ <= least;
      const int blocking = there ? -1 : first_in_the_way(y, zero, far);
      if (there || far * length_ > least) {
        for (int j = 0; j < N_; ++j) y[j] += far * aim_[j];
        zero = zero && there;
        if (!there) std::fill(kept_.begin(), kept_.end(), 0);
      } else {
        zero = true;
      }
      if (blocking >= 0) {
        enter(blocking, rate_[blocking] > 0.0 ? 1 : -1);
        kept_[blocking] = zero && blocking == left;  // a row is in the way of its own release: its sign was rounding
        continue;
      }
      const int out = wrong_sign(T, m, price, y, zero);
      if (out < 0) return true;
      left = set_[out];
      leave(out);
    }
    return false;
  }

  // The rows held beside the equalities, as `warm`.
  void list(std::vector<int>& working) const {
    working.clear();
    for (std::size_t k = fixed_; k < set_.size(); ++k) working.push_back(side_[set_[k]] * (set_[k] + 1));
  }

  // Only the equalities are held, all of them rows that stay.
  void begin() {
    std::fill(side_.begin(), side_.begin() + rows_->count, 0);
    std::fill(kept_.begin(), kept_.begin() + rows_->count, 0);
    set_.resize(fixed_);
    space_.cut(fixed_);
    dependent_.clear();
    for (int i : set_) side_[i] = 1;
    for (int i : spanned_) side_[i] = 2;
  }

  void hold(int i) {
    if (!rows_->equal[i]) return;
    enter(i, 1);
    if (side_[i] == 2) spanned_.push_back(i);
    fixed_ = static_cast<int>(set_.size());
  }

  // Whether the minimiser on the face of the working set given keeps to all rows and is the optimum: in a loop it
  // mostly is the set of the last tick. y moves there, or stays.
  bool on_the_face_of(const std::vector<int>& working, const double* T, const double* t, int m, double price,
                      double* y) {
    for (int entry : working) {
      const int i = std::abs(entry) - 1;
      if (i < rows_->count && side_[i] == 0 && std::isfinite(entry > 0 ? rows_->upper[i] : rows_->lower[i]))
        enter(i, entry > 0 ? 1 : -1);
    }
    on_bounds();
    minimiser(T, t, m, price, y);
    for (int j = 0; j < N_; ++j) aim_[j] += y[j];
    const double size = std::sqrt(dot_any(aim_.data(), aim_.data(), N_));
    for (int i = 0; i < rows_->count; ++i) {
      const double off = std::abs(side_[i]) == 1 ? kHeldOnFace : kOnFace;
      const double value = rows_->value(i, aim_.data(), N_), low = rows_->lower[i], high = rows_->upper[i];
      if (value < low - rows_->allowed(i, off, low, size) || value > high + rows_->allowed(i, off, high, size))
        return false;
    }
    if (wrong_sign(T, m, price, aim_.data(), false) >= 0) return false;
    std::copy(aim_.begin(), aim_.begin() + N_, y);
    return true;
  }

  bool at_bound(int i, int side, const double* y) const {
    const double bound = side > 0 ? rows_->upper[i] : rows_->lower[i];
    if (std::isinf(bound)) return false;  // the row had another meaning a tick ago
    const double size = std::sqrt(dot_any(y, y, N_));
    return std::abs(rows_->value(i, y, N_) - bound) <= rows_->allowed(i, kAtBound, bound, size);
  }

  // A row that depends on those held stays where it is without being held.
  void enter(int i, int side) {
    if (!space_.add(rows_->row(i), N_, rows_->only[i])) {
      side_[i] = 2;
      if (!rows_->equal[i]) dependent_.push_back(i);
      return;
    }
    side_[i] = side;
    set_.push_back(i);
  }

  void leave(int k) {
    side_[set_[k]] = 0;
    std::vector<int>& rest = rest_;
    rest.assign(set_.begin() + k + 1, set_.end());
    set_.resize(k);
    space_.cut(k);
    for (int i : dependent_) side_[i] = 0;
    dependent_.clear();
    for (int i : rest) {
      const int side = side_[i];
      enter(i, side);
    }
  }

  // aim_ = the shortest point of the face on which the rows held are at their bounds.
  void on_bounds() {
    for (std::size_t k = 0; k < set_.size(); ++k)
      bound_[k] = side_[set_[k]] < 0 ? rows_->lower[set_[k]] : rows_->upper[set_[k]];
    space_.shortest(bound_.data(), aim_.data(), N_);
  }

  // aim_ = the shortest point of the face through y. What a row held misses of its bound stays: to mend it along nearly
  // dependent rows would be a step of that much over their smallest pivot, out of all other rows.
  void through(const double* y) {
    std::copy(y, y + N_, aim_.begin());
    space_.project(aim_.data(), N_);
    for (int j = 0; j < N_; ++j) aim_[j] = y[j] - aim_[j];
  }

  // aim_ = the step from y to the minimiser on the face whose shortest point aim_ is.
  void minimiser(const double* T, const double* t, int m, double price, const double* y) {
    M_.assign(static_cast<std::size_t>(m) * padded(N_), 0.0);
    e_.resize(m);
    const int ld = padded(N_);
    double longest = 0.0;
    for (int i = 0; i < m; ++i) {
      double* row = &M_[static_cast<std::size_t>(i) * ld];
      std::copy(T + static_cast<std::size_t>(i) * rows_->ld, T + static_cast<std::size_t>(i) * rows_->ld + N_, row);
      e_[i] = t[i] - dot_any(row, aim_.data(), N_);
      const double whole = dot_any(row, row, N_);
      longest = larger(longest, whole);
      space_.project(row, N_);
      const double left = dot_any(row, row, N_);
      if (left <= kNoDirection * kNoDirection * whole) std::fill(row, row + N_, 0.0);
      else space_.uncertain = space_.uncertain || left < kUncertain * kUncertain * whole;
    }
    secular_.solve(M_.data(), ld, N_, e_.data(), m, price);
    for (int i = 0; i < m; ++i) {
      double* row = &M_[static_cast<std::size_t>(i) * ld];
      if (dot_any(row, row, N_) < kRotatedAway * longest) space_.project(row, N_);  // of long rows little was left
      add_any(aim_.data(), row, secular_.weight(i), N_);
    }
    size_ = std::sqrt(dot_any(y, y, N_));
    for (int j = 0; j < N_; ++j) aim_[j] -= y[j];
    length_ = std::sqrt(dot_any(aim_.data(), aim_.data(), N_));
  }

  // The row that the step meets first and how far that is, -1 for none within the step.
  int first_in_the_way(const double* y, bool lowest, double& far) {
    int found = -1;
    const double floor = 1e-12 * length_;
    for (int i = 0; i < rows_->count; ++i) {
      if (side_[i] != 0) continue;
      rate_[i] = rows_->value(i, aim_.data(), N_);
      if (std::abs(rate_[i]) <= floor && !left(i, y)) continue;
      const double bound = rate_[i] > 0.0 ? rows_->upper[i] : rows_->lower[i];
      if (std::isinf(bound)) continue;
      const double times = larger(0.0, (bound - rows_->value(i, y, N_)) / rate_[i]);
      if (times < far - (lowest ? 1e-13 : 0.0)) {
        far = times;
        found = i;
      }
    }
    return found;
  }

  // Whether a step that hardly moves row i takes it out of its bounds by more than the rounding of its terms: a step
  // from far away is long.
  bool left(int i, const double* y) const {
    if (rate_[i] == 0.0 || rows_->only[i] >= 0) return false;
    const double value = rows_->value(i, y, N_) + rate_[i], *row = rows_->row(i);
    const double bound = rate_[i] > 0.0 ? rows_->upper[i] : rows_->lower[i];
    const double off = rate_[i] > 0.0 ? value - bound : bound - value;
    return off > kOnRow * (std::abs(bound) + absolute_dot(row, y, N_) + absolute_dot(row, aim_.data(), N_));
  }

  // The place in the set of a row whose multiplier has the wrong sign, -1 for none; the worst, or the lowest index.
  int wrong_sign(const double* T, int m, double price, const double* y, bool lowest) {
    u_.resize(m);
    secular_.direction(price, u_.data());
    for (int j = 0; j < N_; ++j) gradient_[j] = price * y[j];
    double scale = price * std::sqrt(dot_any(y, y, N_));
    for (int i = 0; i < m; ++i) {
      const double* row = T + static_cast<std::size_t>(i) * rows_->ld;
      add_any(gradient_.data(), row, u_[i], N_);
      scale = larger(scale, std::abs(u_[i]) * std::sqrt(dot_any(row, row, N_)));
    }
    space_.multipliers(gradient_.data(), lambda_.data(), N_);
    int found = -1;
    double worst = 1e-11 * scale;
    for (std::size_t k = fixed_; k < set_.size(); ++k) {
      const double wrong = side_[set_[k]] * lambda_[k];  // the gradient must point into the side: lambda <= 0 at upper
      if (wrong <= worst || kept_[set_[k]]) continue;
      if (lowest && found >= 0 && set_[k] > set_[found]) continue;
      if (!lowest) worst = wrong;
      found = static_cast<int>(k);
    }
    return found;
  }

  using Clock = std::chrono::steady_clock;

  const StageRows* rows_ = nullptr;
  bool limited_ = false;
  Clock::time_point end_;
  int N_ = 0, fixed_ = 0, scanned_ = 0;
  RowSpace space_;
  Secular secular_;
  std::vector<int> set_, rest_, dependent_, spanned_;
  std::vector<double> rate_;
  std::vector<int> side_;
  std::vector<char> kept_;  // rows that no wrong sign releases until the point moves
  std::vector<double> aim_, gradient_, lambda_, bound_, M_, e_, u_;
  double size_ = 0.0, length_ = 0.0;
};

}  // namespace HQP_ISA
}  // namespace hqp
