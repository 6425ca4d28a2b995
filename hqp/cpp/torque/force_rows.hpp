// Rows on the forces of the constraints: lower <= C f <= upper with f = -lambda seen in the axes of the contacts.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "../dynamics/spatial.hpp"
#include "../solver/dense.hpp"
#include "elimination.hpp"

namespace hqp {
inline namespace HQP_ISA {

class RowsOfForces final : public ForceRows {
 public:
  RowsOfForces(int m, int n) : m_(m), n_(n), map_(m * (n + 1)), turned_(map_.size()) {}

  void ground(const GroundAxes& contact) override { ground_.push_back(contact); }
  void turn(int first, const double* rotation) override { turns_.push_back({first, rotation}); }
  void add(const double* C, const AccelerationRows& rows) override { rows_.push_back({C, rows}); }
  void share(const Shared& contacts) override { shared_.push_back(contacts); }

  void run(const double* T, const double* top, const double* shift) override {
    const int w = n_ + 1;
    std::copy(top, top + m_ * w, map_.begin());
    for (int i = m_ - 1; i >= 0; --i) {  // lambda = T^-1 top (tau, 1)
      add_rows(row(map_, i), row(map_, i + 1), w, m_ - i - 1, -1.0, T + i * m_ + i + 1, 1, w);
      scale(row(map_, i), w, 1.0 / T[i * m_ + i]);
    }
    if (shift)
      for (int i = 0; i < m_; ++i)
        for (int k = 0; k < n_; ++k) row(map_, i)[n_] -= row(map_, i)[k] * shift[k];
    for (const GroundAxes& contact : ground_) stand(contact);
    for (const Shared& contacts : shared_) write(contacts);
    turned_ = map_;
    for (const auto& [first, rotation] : turns_)
      for (int i = 0; i < 3; ++i) {
        std::fill(row(turned_, first + i), row(turned_, first + i + 1), 0.0);
        add_rows(row(turned_, first + i), row(map_, first), w, 3, 1.0, rotation + 3 * i, 1, w);
      }
    for (const auto& [C, rows] : rows_)
      for (int i = 0; i < rows.m; ++i) {
        std::fill(sum_.begin(), sum_.end(), 0.0);
        add_rows(sum_.data(), turned_.data(), w, m_, 1.0, C + i * m_, 1, w);
        std::copy(sum_.begin(), sum_.begin() + n_, rows.A + i * n_);
        rows.lower[i] = rows.demand_lower[i] - sum_[n_];
        rows.upper[i] = rows.demand_upper[i] - sum_[n_];
      }
  }

 private:
  double* row(std::vector<double>& block, int i) { return block.data() + i * (n_ + 1); }

  static constexpr double kAligned = 1e-6;  // sine below which an axis is along the normal and gives no direction

  static void stand(const GroundAxes& contact) {
    Vec3 n = load(contact.normal);
    n = (1.0 / std::sqrt(dot(n, n))) * n;
    Vec3 u{};
    bool across = contact.across;
    for (int k = 0; k < 2; ++k, across = !across) {
      u = load(contact.rotation + (across ? 3 : 0));
      u = u - dot(u, n) * n;
      const double size = std::sqrt(dot(u, u));
      if (size > kAligned) {
        u = (1.0 / size) * u;
        break;
      }
    }
    if (across) u = cross(u, n);
    const Vec3 columns[] = {u, cross(n, u), n};
    for (int k = 0; k < 3; ++k)
      for (int i = 0; i < 3; ++i) contact.axes[3 * k + i] = columns[k][i];
  }

  void write(const Shared& shared) const {  // rows of (1 - s) w_2 - s w_1 on wrenches in the contacts' axes
    const double s = std::min(std::max(*shared.share, 0.0), 1.0);
    for (int k = 0; k < 2; ++k) {
      const double f = shared.factor[k] * (k ? 1.0 - s : -s), g = f / shared.arm;
      const Vec3 middle = shared.middle[k][0] * load(shared.sole[k]) + shared.middle[k][1] * load(shared.sole[k] + 3);
      const double x = dot(load(shared.rotation[k]), middle), y = dot(load(shared.rotation[k] + 3), middle),
                   z = dot(load(shared.rotation[k] + 6), middle);
      for (int i = 0; i < 3; ++i) {
        const double* R = shared.rotation[k] + i;  // row i: R[0], R[3], R[6]
        double* force = shared.C + i * m_ + shared.first[k];
        double* moment = shared.C + (i + 3) * m_ + shared.first[k];
        for (int c = 0; c < 3; ++c) {
          force[c] = f * R[3 * c];
          moment[3 + c] = g * R[3 * c];
        }
        moment[0] = g * (y * R[6] - z * R[3]);  // -R (x, y, z) x f
        moment[1] = g * (z * R[0] - x * R[6]);
        moment[2] = g * (x * R[3] - y * R[0]);
      }
    }
  }

  struct Bound {
    const double* C;
    AccelerationRows rows;
  };

  int m_, n_;
  std::vector<double> map_, turned_, sum_ = std::vector<double>(n_ + 1);
  std::vector<std::pair<int, const double*>> turns_;
  std::vector<Bound> rows_;
  std::vector<Shared> shared_;
  std::vector<GroundAxes> ground_;
};

}  // namespace HQP_ISA
}  // namespace hqp
