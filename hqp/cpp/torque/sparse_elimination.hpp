// The sparse and the small parts of eliminating constraint forces; hqp/torque/dynamics.py has the equations.
//
// The inertia is factored as A = H^T H with H lower triangular: H[i][j] is zero unless coordinate j carries i, so that
// the elimination stays within the branches of the tree (Featherstone 2005).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "../solver/dense.hpp"
#include "dependent_rows.hpp"
#include "elimination.hpp"

namespace hqp {
inline namespace HQP_ISA {

class SparseElimination final : public Elimination {
 public:
  // parents: the coordinate before each on its way to the world, -1 for none; lower than itself.
  SparseElimination(const std::vector<int>& parents, Motors motors, int rows, const std::int8_t* out)
      : out_(out),
        motors_(std::move(motors)),
        nv_(static_cast<int>(parents.size())),
        n_(static_cast<int>(motors_.own.size())),
        rows_(rows),
        m_(rows),
        ld_(padded(n_)),
        H_(static_cast<std::size_t>(nv_) * nv_),
        way_(nv_),
        ranges_(nv_, {n_, 0}),
        moving_(nv_),
        R_(static_cast<std::size_t>(nv_) * rows),
        Q_(R_.size()),
        y_(rows),
        taus_(rows),
        work_(rows),
        whole_(n_),
        block_(static_cast<std::size_t>(nv_ + ld_) * ld_ + kPad) {
    rows_in_common_.reserve(nv_, rows_), given_.reserve(rows_), in_.reserve(rows_);
    dependent_.reserve(static_cast<std::size_t>(std::max(nv_, n_ + 1)) * rows_);
    for (int i = 0; i < nv_; ++i) {
      if (parents[i] >= 0) way_[i] = way_[parents[i]];
      way_[i].push_back(i);
    }
    std::vector<int> joints(n_);
    for (const Motors::Entry& e : motors_.entries) {
      joints[e.motor] += e.factor == 1.0 ? 1 : 2;
      for (int i : way_[e.joint])
        ranges_[i] = {std::min(ranges_[i].first, e.motor), std::max(ranges_[i].second, e.motor + 1)};
    }
    for (int k = 0; k < n_; ++k)
      if (joints[k] == 1) single_.push_back(k);
  }

  int eliminate(const double* A, const double* bias, const double* J, const double* gamma, double tolerance,
                double* map, double* phi, double* Q, double* T, double* top) override {
    if (!factor(A)) return -1;
    columns(bias, map);
    if (constraints(J, gamma, tolerance, Q, T)) {
      project(Q, top, map, phi);
    } else {
      depend(J, gamma, tolerance, Q);
      project(Q, top, map, phi);
      spread(T, top);
    }
    const int rank = m_;
    motions(map, n_ + 1);
    // in exact numbers they are the same; to the bit, one is kept where both are written down
    for (int k : single_) std::copy(phi + k * n_, phi + (k + 1) * n_, map + motors_.own[k] * (n_ + 1));
    return rank;
  }

  int rows() const override { return rows_; }
  void towards(const double* requested, double* motion) override {
    prescribe(requested);
    std::fill(motion, motion + nv_, 0.0);
    each_row([&](int i, const double* q) {
      for (int k = 0; k < m_; ++k) motion[i] += q[k] * y_[k];
    });
    motions(motion, 1);
  }

 private:
  static constexpr double kRoundings = 4.0;  // of an entry of Y - Q Q^T Y, for each row of Q

  // A: its upper triangle, column-major. False unless positive definite.
  bool factor(const double* A) {
    for (int i = 0; i < nv_; ++i)
      for (std::size_t p = 0; p < way_[i].size(); ++p) H(i)[p] = A[i * nv_ + way_[i][p]];
    for (int k = nv_ - 1; k >= 0; --k) {
      double *row = H(k), *own = row + above(k);
      if (!(*own > 0.0)) return false;
      *own = std::sqrt(*own);
      scale(row, above(k), 1.0 / *own);
      for (int p = above(k) - 1; p >= 0; --p) add_any(H(way_[k][p]), row, -row[p], p + 1);
    }
    return true;
  }

  // Y (nv, n + 1) row-major: H^-T [U^T, -bias]. Columns of U^T stay within the coordinates that carry their joints.
  void columns(const double* bias, double* Y) const {
    const int w = n_ + 1;
    std::fill(Y, Y + nv_ * w, 0.0);
    for (const Motors::Entry& e : motors_.entries) Y[e.joint * w + e.motor] = e.factor;
    for (int i = 0; i < nv_; ++i) Y[i * w + n_] = -bias[i];
    for (int i = nv_ - 1; i >= 0; --i) {
      double* y = Y + i * w;
      const double inverse = 1.0 / H(i)[above(i)];
      const auto [first, last] = ranges_[i];
      scale(y + first, last - first, inverse);
      y[n_] *= inverse;
      for (int p = 0; p < above(i); ++p) {
        double* other = Y + way_[i][p] * w;
        add_any(other + first, y + first, -H(i)[p], last - first);
        other[n_] -= H(i)[p] * y[n_];
      }
    }
  }

  // Q (nv, m) and T (m, m) row-major with H^-T J^T = Q T; keeps y = T^-T gamma. False where T is singular within
  // tolerance. Coordinates that move no constraint are left out of the reflections: their rows are zero. So are
  // constraints that are out; m_ are in.
  bool constraints(const double* J, const double* gamma, double tolerance, double* Q, double* T) {
    in_.clear(), given_.clear();
    for (int k = 0; k < rows_; ++k)
      if (!out_[k]) in_.push_back(k);
    m_ = static_cast<int>(in_.size());
    for (int i = 0; i < nv_; ++i) {
      double size = 0.0;
      for (int k = 0; k < m_; ++k) size += std::abs(R(i)[k] = J[in_[k] * nv_ + i]);
      moving_[i] = size != 0.0;
    }
    for (int i = nv_ - 1; i >= 0; --i) {
      if (!moving_[i]) continue;
      scale(R(i), m_, 1.0 / H(i)[above(i)]);
      for (int p = 0; p < above(i); ++p) {
        add_any(R(way_[i][p]), R(i), -H(i)[p], m_);
        moving_[way_[i][p]] = true;
      }
    }
    count_ = 0;
    for (int i = 0; i < nv_; ++i)
      if (moving_[i]) std::copy(R(i), R(i) + m_, R(count_++));
    if (m_ > count_ || !reflect(tolerance)) return false;
    std::fill(T, T + rows_ * rows_, 0.0);
    for (int k = 0; k < rows_; ++k)
      if (out_[k]) T[k * rows_ + k] = 1.0;
    for (int k = 0; k < m_; ++k)
      for (int c = k; c < m_; ++c) T[in_[k] * rows_ + in_[c]] = R(k)[c];
    accumulate();
    write(Q);
    prescribe(gamma);
    return true;
  }

  // Write Q (nv, m) row-major, from its factors.
  void write(double* Q) const {
    std::fill(Q, Q + nv_ * rows_, 0.0);
    each_row([&](int i, const double* q) {
      for (int k = 0; k < m_; ++k) Q[i * rows_ + in_[k]] = q[k];
    });
  }
  template <class Visit>
  void each_row(Visit visit) const {
    const double* q = Q_.data();
    for (int i = 0; i < nv_; ++i)
      if (moving_[i]) visit(i, q), q += m_;
  }

  // Compute y with T^T y = requested (m): the prescribed motion along Q, for dependent constraints in least squares.
  void prescribe(const double* requested) {
    if (!given_.empty()) {
      for (std::size_t k = 0; k < given_.size(); ++k) work_[k] = requested[given_[k]];
      return rows_in_common_.towards(work_.data(), y_.data());
    }
    for (int k = 0; k < m_; ++k) {
      double left = requested[in_[k]];
      for (int c = 0; c < k; ++c) left -= R(c)[k] * y_[c];
      y_[k] = left / R(k)[k];
    }
  }

  // Handle dependent constraints: Q (nv, r) of their r combinations, y of these, whose rows come first.
  void depend(const double* J, const double* gamma, double tolerance, double* Q) {
    given_ = in_;
    const int m = m_;
    dependent_.assign(static_cast<std::size_t>(nv_) * m, 0.0);
    std::vector<double>& B = dependent_;
    for (int i = 0; i < nv_; ++i)
      for (int k = 0; k < m; ++k) B[i * m + k] = J[in_[k] * nv_ + i];
    for (int i = nv_ - 1; i >= 0; --i) {
      scale(B.data() + i * m, m, 1.0 / H(i)[above(i)]);
      for (int p = 0; p < above(i); ++p) add_any(B.data() + way_[i][p] * m, B.data() + i * m, -H(i)[p], m);
    }
    m_ = rows_in_common_.factor(B.data(), nv_, m, tolerance);
    prescribe(gamma);
    in_.clear();
    for (int k = 0; k < m_; ++k) in_.push_back(k);
    for (int i = 0; i < nv_; ++i) {
      moving_[i] = true;
      for (int k = 0; k < m_; ++k) Q_[i * m_ + k] = rows_in_common_.direction(i, k);
    }
    write(Q);
  }
  // Rows of those combinations as forces of least norm of the constraints: T is the identity.
  void spread(double* T, double* top) {
    const int w = n_ + 1, m = static_cast<int>(given_.size());
    dependent_.assign(static_cast<std::size_t>(m) * w, 0.0);
    for (int c = 0; c < w; ++c) {
      rows_in_common_.spread(top + c, w, work_.data());
      for (int k = 0; k < m; ++k) dependent_[k * w + c] = work_[k];
    }
    std::fill(top, top + rows_ * w, 0.0);
    for (int k = 0; k < m; ++k) std::copy_n(dependent_.data() + k * w, w, top + given_[k] * w);
    std::fill(T, T + rows_ * rows_, 0.0);
    for (int k = 0; k < rows_; ++k) T[k * rows_ + k] = 1.0;
  }

  // With Y as columns() writes it: top (m, n + 1) = Q^T Y - [0, y], Y - Q top in the place of Y, and phi (n, n), the
  // products of its first n columns.  A torque that the constraints bear whole leaves rounding errors: its column is
  // zero, for the errors have no scale if nothing else moves.
  void project(const double* Q, double* top, double* Y, double* phi) {
    const int w = n_ + 1;
    std::fill(whole_.begin(), whole_.end(), 0.0);
    for (int i = 0; i < nv_; ++i)
      for (int k = 0; k < n_; ++k) whole_[k] += Y[i * w + k] * Y[i * w + k];
    std::fill(top, top + rows_ * w, 0.0);
    for (int k = 0; k < m_; ++k) top[in_[k] * w + n_] = -y_[k];
    for (int k = 0; k < m_; ++k) add_rows(top + in_[k] * w, Y, w, nv_, 1.0, Q + in_[k], rows_, w);
    for (int i = 0; i < nv_; ++i)
      if (moving_[i]) add_rows(Y + i * w, top, w, rows_, -1.0, Q + i * rows_, 1, w);
    double *rows = aligned(block_.data()), *products = rows + nv_ * ld_;
    for (int i = 0; i < nv_; ++i) std::copy(Y + i * w, Y + i * w + n_, rows + i * ld_);
    gram(products, ld_, rows, ld_, nv_, lanes(n_));
    const double error = kRoundings * (nv_ + m_) * std::numeric_limits<double>::epsilon();  // relative to Y
    for (int k = 0; k < n_; ++k) {
      if (!m_ || products[k * ld_ + k] > error * error * whole_[k]) continue;
      for (int i = 0; i < nv_; ++i) Y[i * w + k] = 0.0;
      for (int c = 0; c < n_; ++c) products[std::min(k, c) * ld_ + std::max(k, c)] = 0.0;
    }
    for (int k = 0; k < n_; ++k)
      for (int c = k; c < n_; ++c) phi[k * n_ + c] = phi[c * n_ + k] = products[k * ld_ + c];
  }

  // B (nv, w) row-major: H^-1 B in its place.
  void motions(double* B, int w) const {
    for (int i = 0; i < nv_; ++i) {
      double* b = B + i * w;
      for (int p = 0; p < above(i);) {
        Terms terms;
        for (; p < above(i) && terms.count < kTerms; ++p) terms.add(B + way_[i][p] * w, -H(i)[p]);
        terms.to(b, w);
      }
      scale(b, w, 1.0 / H(i)[above(i)]);
    }
  }

  // Row i of H, of the coordinates on the way to i alone, i last: the way to one of them is where the way to i begins.
  double* H(int i) { return H_.data() + i * nv_; }
  const double* H(int i) const { return H_.data() + i * nv_; }
  int above(int i) const { return static_cast<int>(way_[i].size()) - 1; }
  double* R(int i) { return R_.data() + i * m_; }

  // Reflect by I - tau u u^T for each column k, u = (1, entries below the diagonal).
  bool reflect(double tolerance) {
    double least = INFINITY, largest = 0.0;
    for (int k = 0; k < m_; ++k) {
      double below = 0.0;
      for (int i = k + 1; i < count_; ++i) below += R(i)[k] * R(i)[k];
      const double leading = R(k)[k], norm = std::copysign(std::sqrt(leading * leading + below), leading);
      least = std::min(least, std::abs(norm));
      largest = std::max(largest, std::abs(norm));
      if (!(std::abs(norm) > 0.0)) return false;
      taus_[k] = (leading + norm) / norm;
      for (int i = k + 1; i < count_; ++i) R(i)[k] /= leading + norm;
      R(k)[k] = -norm;
      turn(R(k) + k + 1, k, m_ - k - 1);
    }
    return m_ == 0 || least > tolerance * largest;
  }

  // The first m columns of the product of the reflections.
  void accumulate() {
    std::fill(Q_.begin(), Q_.end(), 0.0);
    for (int k = m_ - 1; k >= 0; --k) {
      double* q = Q_.data() + k * m_ + k;  // rows and columns from k on are all that is there
      q[0] = 1.0;
      turn(q, k, m_ - k);
    }
  }

  // Apply reflection k to a block of `columns` columns; its row k begins at `top`, and R sets the row stride.
  void turn(double* top, int k, int columns) {
    std::copy(top, top + columns, work_.begin());
    add_rows(work_.data(), top + m_, m_, count_ - k - 1, 1.0, R(k + 1) + k, m_, columns);
    scale(work_.data(), columns, taus_[k]);
    add_any(top, work_.data(), -1.0, columns);
    for (int i = k + 1; i < count_; ++i) add_any(top + (i - k) * m_, work_.data(), -R(i)[k], columns);
  }

  const std::int8_t* out_;
  Motors motors_;
  std::vector<int> single_, in_;            // single_: motors of one joint; in_: the constraints that are not out
  int nv_, n_, rows_, m_, ld_, count_ = 0;  // count_: number of coordinates that move a constraint
  std::vector<double> H_;
  std::vector<std::vector<int>> way_;                    // coordinates from the world to each, itself the last
  std::vector<std::pair<int, int>> ranges_;              // ranges of the actuated joints in a coordinate's subtree
  std::vector<char> moving_;                             // flags of coordinates that move a constraint
  std::vector<double> R_, Q_, y_, taus_, work_, whole_;  // whole_ (n): squares of Y's columns before the projection
  DependentRows rows_in_common_;
  std::vector<int> given_;         // for dependent constraints, those that are not out
  std::vector<double> dependent_;  // (nv, m), then (m, n + 1)
  std::vector<double> block_;      // (nv, n) and (n, n) in padded rows, zero in the padding
};

}  // namespace HQP_ISA
}  // namespace hqp
