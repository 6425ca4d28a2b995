// Rows of a transition request the motion of another stack, or a point on the way there, ahead of their solve: the
// equations of hqp/transition/easing.py.
#pragma once

#include <cmath>
#include <optional>
#include <vector>

#include <nanobind/stl/optional.h>

#include "../common/capsule.hpp"
#include "live_plan.hpp"

namespace binding {

using RowBlock = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

class EasedRows final : public hqp::SolveCall {
 public:
  // Live rows A (m, n) and their bounds; error and pull (m): parts of the error on which b depends linearly.
  void add(const RowBlock& A, const Written& lower, const Written& upper, const std::optional<Vector>& error,
           const std::optional<Vector>& pull) {
    const std::size_t m = A.shape(0);
    if (lower.shape(0) != m || upper.shape(0) != m || (!parts_.empty() && A.shape(1) != n_) ||
        error.has_value() != pull.has_value() || (error && (error->shape(0) != m || pull->shape(0) != m)))
      throw nb::value_error("rows: wrong shape");
    n_ = A.shape(1);
    parts_.push_back(
        {m, A.data(), lower.data(), upper.data(), error ? error->data() : nullptr, pull ? pull->data() : nullptr});
    kept_.append(nb::make_tuple(A, lower, upper, error, pull));
  }

  // Set the share k of the way from the other stack's x (n); here: b without the error.
  void aim(const Vector& other, double k, bool here) {
    if (other.shape(0) != n_) throw nb::value_error("x: wrong shape");
    other_.assign(other.data(), other.data() + n_);
    k_ = k, here_ = here;
  }

  void rewrite() {
    if (other_.empty() || (k_ == 1.0 && !here_)) return;
    for (const Part& p : parts_) {
      if (p.m == 0 || !(p.lower[0] > -INFINITY)) continue;  // left out of this tick
      for (std::size_t i = 0; i < p.m; ++i) {
        if (here_ && p.error) p.upper[i] = p.lower[i] += p.pull[i] * p.error[i];
        double there = 0.0;
        for (std::size_t j = 0; j < n_; ++j) there += p.A[i * n_ + j] * other_[j];
        there *= 1.0 - k_;
        p.lower[i] = k_ * p.lower[i] + there;
        p.upper[i] = k_ * p.upper[i] + there;
      }
    }
  }

  // The rows, then that solve.
  nb::capsule before(const nb::capsule& next) {
    next_ = hqp::call_of(next);
    next_kept_ = next;
    return hqp::capsule_of(this);
  }
  hqp::Solved run(const double* v) override {
    rewrite();
    return next_->run(v);
  }

 private:
  struct Part {
    std::size_t m;
    const double* A;
    double *lower, *upper;
    const double *error, *pull;
  };
  std::size_t n_ = 0;
  std::vector<Part> parts_;
  std::vector<double> other_;
  double k_ = 1.0;
  bool here_ = false;
  hqp::SolveCall* next_ = nullptr;
  nb::list kept_;
  nb::object next_kept_;
};

}  // namespace binding
