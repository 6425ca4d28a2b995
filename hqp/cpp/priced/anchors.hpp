// What an unmet level a leaves to a level k below it (docs/calm.md): its rows stay near y_a = A_a x_a, and motion
// beyond x_a costs by how long the columns of those rows are,
//   ||v_a||^2 / (2 eta c_a omega_a) + t_a omega_a^2 / 2 sum_j d_aj^2 (F (x - x_a))_j^2,   d_aj = ||B_a A_a F^+ e_j||,
// v_a = A_a x - y_a for equalities, for inequalities what their slack grows by, B_a = diag(1 or |w_ai| / omega_a).
// The second term only weighs the rows of F anew: with E it is again a motion, of other numbers.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "coordinates.hpp"
#include "stages.hpp"

namespace hqp {
inline namespace HQP_ISA {

struct Anchor {
  int level = 0, first = 0;  // its first row among all rows
  double omega = 0.0;        // ||w_a||
  double give = 0.0;         // eta c_a omega_a
  double turning = 0.0;      // t_a omega_a^2
  std::vector<char> held;    // (m,) rows that are anchored
  std::vector<double> low;   // (m,) where they cost nothing: y_ai, or from the lower to the upper bound and y_ai
  std::vector<double> high;
  std::vector<double> part;    // (m,) of B_a
  std::vector<double> weight;  // (rows of F,) t_a omega_a^2 d_aj^2
  std::vector<double> from;    // (rows of F,) F x_a
};

// The motion of a hierarchy, F (r, n), or a diagonal where r = 0, or the identity, and the motion of its stages.
class Motions {
 public:
  Motions(int n, double flat) : n_(n), base_(n, flat), here_(n, flat), row_(padded(n)), step_(padded(n)) {}

  void set(const double* F, const double* f, int r) {
    F_ = F;
    f_ = f;
    r_ = r;
    base_.set(F, f, r);
    count_ = r ? r : n_;
  }

  const Coordinates& base() const { return base_; }
  bool diagonal() const { return r_ == 0; }
  int count() const { return count_; }  // rows of F

  // F_jj where F is a diagonal.
  double size(int j) const { return F_ ? F_[j] : 1.0; }
  const double* row(int j) const { return F_ + static_cast<std::size_t>(j) * n_; }
  // (F x)_j.
  double moved(int j, const double* x) const { return r_ ? dot_any(row(j), x, n_) : size(j) * x[j]; }

  // sum[j] += scale (a F^+ e_j)^2 for a row a.
  void add_columns(const double* a, double scale, double* sum) {
    if (!r_) {
      for (int j = 0; j < n_; ++j) {
        const double part = a[j] / size(j);
        sum[j] += scale * part * part;
      }
      return;
    }
    base_.row(a, row_.data());
    std::fill(row_.begin() + base_.rank(), row_.end(), 0.0);  // F^+ has no direction without motion
    base_.step(row_.data(), step_.data());
    for (int j = 0; j < r_; ++j) {
      const double part = dot_any(row(j), step_.data(), n_);
      sum[j] += scale * part * part;
    }
  }

  // The anchor of a level that ended unmet at x, its rows, what they are worth and how far they are off given.
  template <class Row>
  void complete(Anchor& anchor, double turning, const double* x, const Row& row_of) {
    anchor.turning = turning * anchor.omega * anchor.omega;
    anchor.weight.assign(count_, 0.0);
    anchor.from.resize(count_);
    for (int j = 0; j < count_; ++j) anchor.from[j] = moved(j, x);
    if (anchor.turning > 0.0)
      for (std::size_t i = 0; i < anchor.held.size(); ++i)
        if (anchor.held[i] && anchor.part[i] > 0.0)
          add_columns(row_of(static_cast<int>(i)), anchor.turning * anchor.part[i] * anchor.part[i],
                      anchor.weight.data());
  }

  // weight (count,) and mean (count,) of E, or of 0 E, and what the anchors add: the sum of
  // weight_j ((F x)_j - mean_j)^2 / 2.
  void weigh(const std::vector<Anchor>& anchors, double own) {
    weight_.assign(count_, own);
    mean_.assign(count_, 0.0);
    if (f_)
      for (int j = 0; j < count_; ++j) mean_[j] = own * f_[j];
    for (const Anchor& anchor : anchors)
      for (int j = 0; j < count_; ++j) {
        weight_[j] += anchor.weight[j];
        mean_[j] += anchor.weight[j] * anchor.from[j];
      }
    for (int j = 0; j < count_; ++j)
      if (weight_[j] > 0.0) mean_[j] /= weight_[j];
  }
  double weight(int j) const { return weight_[j]; }
  double mean(int j) const { return mean_[j]; }

  // Coordinates y in which E and what the anchors add to it is |y|^2 / 2.
  const Coordinates& among(const std::vector<Anchor>& anchors) {
    if (anchors.empty()) return base_;
    weigh(anchors, 1.0);
    scaled_.resize(count_);
    for (int j = 0; j < count_; ++j) scaled_[j] = std::sqrt(weight_[j]);
    if (r_) {
      here_.set(base_, F_, scaled_.data(), mean_.data(), r_);
      return here_;
    }
    for (int j = 0; j < n_; ++j) {
      mean_[j] *= scaled_[j];
      scaled_[j] *= size(j);
    }
    here_.set(scaled_.data(), mean_.data(), 0);
    return here_;
  }

 private:
  int n_, r_ = 0, count_ = 0;
  const double *F_ = nullptr, *f_ = nullptr;
  Coordinates base_, here_;
  std::vector<double> row_, step_, weight_, mean_, scaled_;
};

}  // namespace HQP_ISA
}  // namespace hqp
