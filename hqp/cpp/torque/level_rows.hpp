// Rows of all levels on the torque, from qdd = X tau + c.
#pragma once

#include <algorithm>
#include <utility>
#include <vector>

#include "../solver/dense.hpp"
#include "elimination.hpp"

namespace hqp {
inline namespace HQP_ISA {

class LevelRows final : public TorqueRows {
 public:
  LevelRows(const double* map, int nv, int n) : map_(map), nv_(nv), n_(n), c_(nv) {}

  void product(const double* J, const AccelerationRows& rows) override { products_.push_back({J, rows}); }
  void pick(std::vector<int> index, std::vector<double> weight, const AccelerationRows& rows) override {
    picks_.push_back({std::move(index), std::move(weight), rows});
  }
  void motion(std::vector<double> scale, double rest, double* F, double* f) override {
    scale_ = std::move(scale);
    rest_ = rest;
    F_ = F;
    f_ = f;
  }

  void run(const double* v, const double* c) override {
    const int w = n_ + 1;
    if (F_) {
      for (int i = 0; i < nv_; ++i) {
        const double s = scale_[i];
        for (int k = 0; k < n_; ++k) F_[i * n_ + k] = s * map_[i * w + k];
        f_[i] = -s * (map_[i * w + n_] + rest_ * v[i]);
      }
    }
    for (int i = 0; i < nv_; ++i) c_[i] = c ? c[i] : map_[i * w + n_];
    for (const auto& [J, rows] : products_) {
      std::fill(rows.A, rows.A + rows.m * n_, 0.0);
      for (int i = 0; i < rows.m; ++i) {
        const double* row = J + i * nv_;
        add_rows(rows.A + i * n_, map_, w, nv_, 1.0, row, 1, n_);
        shift(rows, i, dot_any(row, c_.data(), nv_));
      }
    }
    for (const auto& [index, weight, rows] : picks_) {
      for (int i = 0; i < rows.m; ++i) {
        const double factor = weight.empty() ? 1.0 : weight[i];
        const double* x = map_ + index[i] * w;
        for (int k = 0; k < n_; ++k) rows.A[i * n_ + k] = factor * x[k];
        shift(rows, i, factor * c_[index[i]]);
      }
    }
  }

 private:
  struct Product {
    const double* J;
    AccelerationRows rows;
  };
  struct Pick {
    std::vector<int> index;
    std::vector<double> weight;
    AccelerationRows rows;
  };

  static void shift(const AccelerationRows& rows, int i, double offset) {
    rows.lower[i] = rows.demand_lower[i] - offset;
    rows.upper[i] = rows.demand_upper[i] - offset;
  }

  const double* map_;
  int nv_, n_;
  std::vector<double> c_, scale_;
  double rest_ = 0.0;
  double *F_ = nullptr, *f_ = nullptr;
  std::vector<Product> products_;
  std::vector<Pick> picks_;
};

}  // namespace HQP_ISA
}  // namespace hqp
