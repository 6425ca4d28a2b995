// The rows of a stage, which stay where they lie: lower <= a x + share y_band <= upper, two-sided, an equality where
// the bounds agree. Only rows that are held are written in the coordinates y of the stage.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "coordinates.hpp"

namespace hqp {
inline namespace HQP_ISA {

struct StageRow {
  const double* a = nullptr;  // (n,), or null where it picks one variable
  int only = -1;
  double scale = 1.0;
  double lower = 0.0, upper = 0.0;
  int number = -1;         // among all rows of the hierarchy
  int band = -1;           // a coordinate of its own, of y, -1 for none
  double share = 0.0;      // of the row
  double size = 0.0;       // |a|; of a row that was added, the share if that is more
  double spare = 0.0;      // by how much its bounds are further away for a choice
  double tolerated = 0.0;  // by how much a choice may leave these

  bool equal() const { return lower == upper; }
  double value(const double* x, const double* y, int n) const {
    const double own = a ? dot_any(a, x, n) : scale * x[only];
    return band < 0 ? own : own + share * y[band];
  }
  double bound(int side) const { return side > 0 ? upper : lower; }
};

class StageRows {
 public:
  // numbers: of rows that have one.
  StageRows(int n, int rows, int numbers, int stride)
      : n_(n), ld_(stride), C_(static_cast<std::size_t>(rows) * stride), formed_(rows), place_(numbers, -1) {
    all_.reserve(rows);
    grade_.assign(stride, 1.0);
  }

  // Rows for a stage in coordinates y of n variables.
  void begin(const Coordinates& at, int n) {
    n_ = n;
    for (const StageRow& row : all_)
      if (row.number >= 0) place_[row.number] = -1;
    all_.clear();
    at_ = &at;
    std::fill(grade_.begin(), grade_.end(), 1.0);
    at.grade(grade_.data());
  }
  // A row of no length, or of no bound, is none; whether it is one.
  bool add(StageRow row) {
    if (row.lower == -INFINITY && row.upper == INFINITY) return false;
    if (row.band >= 0) row.size = larger(row.size, std::fabs(row.share) * grade_[row.band]);
    if (!(row.size > 1e-150)) return false;
    if (row.number >= 0) place_[row.number] = static_cast<int>(all_.size());
    formed_[all_.size()] = 0;
    all_.push_back(row);
    return true;
  }
  // A length in x that is rounding.
  void rounding(double length) { rounding_ = length; }
  double rounding() const { return rounding_; }
  void grade(int band, double worth) { grade_[band] = worth; }
  // The band of row i counts from here on.
  void count_from(int i, double here) {
    all_[i].lower -= all_[i].share * here;
    all_[i].upper -= all_[i].share * here;
  }

  int n() const { return n_; }
  int count() const { return static_cast<int>(all_.size()); }
  const StageRow& operator[](int i) const { return all_[i]; }
  const Coordinates& at() const { return *at_; }
  const double* grades() const { return grade_.data(); }
  // Where the row of a number is, -1 for nowhere.
  int place(int number) const { return place_[number]; }

  // The one coordinate of y that row i sees, -1 where it sees more, or is rounding.
  int only(int i) const {
    const StageRow& row = all_[i];
    return row.a || row.band >= 0 || !at_->diagonal() || !(row.size > rounding_) ? -1 : row.only;
  }
  // Its entry there.
  double entry(int i) const { return at_->picked(all_[i].only, all_[i].scale); }

  // Rows but the equalities are to be written anew.
  void forget_turned() {
    for (int i = 0; i < count(); ++i)
      if (!all_[i].equal()) formed_[i] = 0;
  }
  // Row i on y (N); turn: what becomes of it when it is written.
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
  // What the row is at y = 0.
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
