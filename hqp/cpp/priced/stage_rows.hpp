// The rows of a stage, read in place: lower <= a x + share y_band <= upper, two-sided, an equality if
// the bounds agree. Only active rows are written in the coordinates y of the stage.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "coordinates.hpp"

namespace hqp {
inline namespace HQP_ISA {

struct StageRow {
  const double* a = nullptr;  // (n,), or null if it picks one variable
  int only = -1;
  double scale = 1.0;
  double lower = 0.0, upper = 0.0;
  int number = -1;     // among all rows of the hierarchy
  int band = -1;       // its own coordinate of y, -1 without one
  double share = 0.0;  // factor of the band
  double size = 0.0;   // |a|, or the share of an added row if that is larger

  bool equal() const { return lower == upper; }
  double value(const double* x, const double* y, int n) const {
    const double own = a ? dot_any(a, x, n) : scale * x[only];
    return band < 0 ? own : own + share * y[band];
  }
  double bound(int side) const { return side > 0 ? upper : lower; }
};

class StageRows {
 public:
  // numbers: largest number of a row, plus one.
  StageRows(int n, int rows, int numbers, int stride)
      : n_(n), ld_(stride), C_(static_cast<std::size_t>(rows) * stride), formed_(rows), place_(numbers, -1) {
    all_.reserve(rows);
    grade_.assign(stride, 1.0);
  }

  // Begin a stage in coordinates y of n variables.
  void begin(const Coordinates& at, int n) {
    n_ = n;
    for (const StageRow& row : all_)
      if (row.number >= 0) place_[row.number] = -1;
    all_.clear();
    at_ = &at;
    std::fill(grade_.begin(), grade_.end(), 1.0);
    at.grade(grade_.data());
  }
  // Add a row; return false if it has zero length or no bounds.
  bool add(StageRow row) {
    if (row.lower == -INFINITY && row.upper == INFINITY) return false;
    if (row.band >= 0) row.size = larger(row.size, std::fabs(row.share) * grade_[row.band]);
    if (!(row.size * row.size > kTiny)) return false;
    if (row.number >= 0) place_[row.number] = static_cast<int>(all_.size());
    formed_[all_.size()] = 0;
    all_.push_back(row);
    return true;
  }
  // Set the rounding length in x.
  void rounding(double length) { rounding_ = length; }
  double rounding() const { return rounding_; }
  void grade(int band, double worth) { grade_[band] = worth; }
  // Set the origin of row i's band.
  void count_from(int i, double here) {
    all_[i].lower -= all_[i].share * here;
    all_[i].upper -= all_[i].share * here;
  }

  int n() const { return n_; }
  int count() const { return static_cast<int>(all_.size()); }
  const StageRow& operator[](int i) const { return all_[i]; }
  const Coordinates& at() const { return *at_; }
  const double* grades() const { return grade_.data(); }
  // The index of a row by its number, -1 if absent.
  int place(int number) const { return place_[number]; }

  // The single coordinate of y in row i, -1 if it has several or is rounding.
  int only(int i) const {
    const StageRow& row = all_[i];
    return row.a || row.band >= 0 || !at_->diagonal() || !(row.size > rounding_) ? -1 : row.only;
  }
  // Its entry there.
  double entry(int i) const { return at_->picked(all_[i].only, all_[i].scale); }

  // Mark all rows but the equalities for rewriting.
  void forget_turned() {
    for (int i = 0; i < count(); ++i)
      if (!all_[i].equal()) formed_[i] = 0;
  }
  // Row i on y (N); turn: transformation applied when it is written.
  template <class Turn>
  const double* row(int i, int N, const Turn& turn) {
    double* c = &C_[static_cast<std::size_t>(i) * ld_];
    if (formed_[i] == N) return c;
    const StageRow& row = all_[i];
    std::fill(row.a ? c + n_ : c, c + N, 0.0);
    if (row.a) at_->row(row.a, c);
    else at_->picked_row(row.only, row.scale, c);
    if (row.band >= 0) c[row.band] = row.share;
    turn(c);
    formed_[i] = N;
    return c;
  }
  // Value of the row at y = 0.
  double shift(int i) const {
    const StageRow& row = all_[i];
    return row.a ? dot_any(row.a, at_->still(), n_) : row.scale * at_->still()[row.only];
  }

 private:
  int n_, ld_;
  double rounding_ = 0.0;
  const Coordinates* at_ = nullptr;
  std::vector<StageRow> all_;
  std::vector<double> C_, grade_;
  std::vector<int> formed_, place_;
};

}  // namespace HQP_ISA
}  // namespace hqp
