// The centre of mass over a ZMP inside the support. See tasks/balance.py for the equations.
#pragma once

#include <memory>
#include <utility>

#include "barrier.hpp"

namespace hqp {

class Balance final : public Operation {
 public:
  Balance(Target out, std::unique_ptr<Numbers> own, std::unique_ptr<Com> com, std::vector<Corner> corners, double k,
          double height, double gravity, const Tree& tree)
      : out_(out),
        own_(std::move(own)),
        com_(std::move(com)),
        hull_(std::move(corners)),
        k_(k),
        height_(height),
        gravity_(gravity),
        tree_(tree) {}
  void run(const double* q, const double* v) override {
    com_->run(q, v);  // rows and drift are those of the centre of mass
    hull_.update();
    fit_plane();
    const int nv = out_.nv;
    const double c[2] = {own_->error[0], own_->error[1]}, z = (1.0 / tree_.mass(0) * tree_.moment(0))[2];
    const double omega = std::sqrt(gravity_ / (height_ > 0.0 ? height_ : over(z, c)));
    double wanted[2], p[2] = {c[0], c[1]};
    for (int i = 0; i < 2; ++i) {
      const double speed = product(out_.row(i), v, nv) / out_.weight;
      wanted[i] = out_.reference[i] + (1.0 + k_ / omega) * (c[i] + speed / omega - out_.reference[2 + i]);
    }
    hull_.nearest(wanted, p);
    const double share = gravity_ / over(z, p);
    for (int i = 0; i < 2; ++i) {
      out_.error[i] = share * (p[i] - c[i]);
      if (out_.drift) out_.drift[i] = own_->drift[i];
    }
  }
  bool hold(const double* q, const double* v, double* value) override {
    com_->run(q, v);
    for (int i = 0; i < 4; ++i) value[i] = own_->error[i % 2];
    return true;
  }
  void stand(const std::string& contact, bool there) override { hull_.stand(contact, there); }

 private:
  static constexpr double kLeast = 0.05;  // least height of the pendulum [m]
  static constexpr double kLine = 1e-9;   // feet in a line from above have no slope across it

  double over(double z, const double* p) const {
    return std::max(z - (mean_[2] + slope_[0] * (p[0] - mean_[0]) + slope_[1] * (p[1] - mean_[1])), kLeast);
  }
  void fit_plane() {  // through all points that are present, least squares
    const int n = hull_.size();
    int count = 0;
    for (int i = 0; i < n; ++i) count += hull_.present(i);
    mean_ = {};
    for (int i = 0; i < n; ++i)
      if (hull_.present(i)) mean_ = mean_ + (1.0 / count) * Vec3{hull_.x(i), hull_.y(i), hull_.z(i)};
    double xx = 0.0, xy = 0.0, yy = 0.0, xz = 0.0, yz = 0.0;
    for (int i = 0; i < n; ++i) {
      if (!hull_.present(i)) continue;
      const double x = hull_.x(i) - mean_[0], y = hull_.y(i) - mean_[1], z = hull_.z(i) - mean_[2];
      xx += x * x, xy += x * y, yy += y * y, xz += x * z, yz += y * z;
    }
    const double size = xx * yy - xy * xy;
    const bool line = !(size > kLine * (xx + yy) * (xx + yy));
    slope_[0] = line ? 0.0 : (yy * xz - xy * yz) / size;
    slope_[1] = line ? 0.0 : (xx * yz - xy * xz) / size;
  }
  Target out_;
  std::unique_ptr<Numbers> own_;  // x and y of the centre of mass and its drift
  std::unique_ptr<Com> com_;
  Hull hull_;
  double k_, height_, gravity_;
  const Tree& tree_;
  Vec3 mean_{};
  double slope_[2] = {};
};

}  // namespace hqp
