// Bounds kept with declared rates: on the value of any task, on the centre of mass over a polygon. See
// tasks/within.py and tasks/support_polygon.py for the equations.
#pragma once

#include <limits>
#include <memory>

#include "com.hpp"
#include "hull.hpp"
#include "turns.hpp"

namespace hqp {

struct Barrier {
  double rate, recovery, outset, dt;  // outset: acceleration with which a return sets in

  double fastest(double way) const {  // largest velocity towards a bound
    return way >= 0.0 ? rate * way : -recovery * std::tanh(rate * -way / recovery);
  }
  // Speed of the next tick, at a speed in this one.
  double next(double way, double speed) const {
    const double wanted = fastest(way), outwards = std::max(speed, 0.0);
    if (!(way < 0.0)) return wanted;
    return std::max(wanted, speed - dt * outset - std::min(1.0, dt * (1.0 + kFast) * rate) * outwards);
  }
  double hardest(double way, double speed) const {  // largest acceleration towards it
    if (std::isinf(way)) return way;
    const double wanted = fastest(way), share = way >= 0.0 ? 0.0 : wanted / recovery;
    const double most = kFast * rate * (wanted - speed) - rate * (1.0 - share * share) * speed;
    return way < 0.0 ? std::max(most, -outset - (1.0 + kFast) * rate * std::max(speed, 0.0)) : most;
  }

 private:
  static constexpr double kFast = 4.0;  // the second pole over the first
};

struct Numbers {  // buffers of an operation besides the rows of its element
  explicit Numbers(int m, int nv)
      : J(static_cast<std::size_t>(m) * nv), error(m), drift(m), lower(m), upper(m), zeros(m) {}
  // J: destination of the rows, null for its own. reference: null for zero, else `given` numbers.
  Target target(double* rows, const double* reference, std::size_t given, double weight, int nv, bool moving) {
    return {rows ? rows : J.data(),
            error.data(),
            moving ? drift.data() : nullptr,
            lower.data(),
            upper.data(),
            reference ? reference : zeros.data(),
            nullptr,
            weight,
            nv,
            nullptr,
            nullptr,
            error.size(),
            reference ? given : zeros.size()};
  }
  std::vector<double> J, error, drift, lower, upper, zeros;
};

inline double product(const double* a, const double* b, int n) {
  double sum = 0.0;
  for (int i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

// Bounds on the value of a task, or on its rate.
class Within final : public Operation {
 public:
  using Part = std::unique_ptr<Operation>;

  Within(Target out, std::unique_ptr<Numbers> own, Part task, std::vector<double> low, std::vector<double> high,
         Barrier barrier, bool rates, int turn, int nv, int order)
      : out_(out),
        own_(std::move(own)),
        task_(std::move(task)),
        low_(std::move(low)),
        high_(std::move(high)),
        barrier_(barrier),
        rates_(rates),
        turn_(turn),
        nv_(nv),
        order_(order),
        along_(low_.size()),
        push_(low_.size()) {}
  void run(const double* q, const double* v) override {
    task_->run(q, v);
    std::copy_n(out_.rate, low_.size(), along_.begin());
    std::copy_n(out_.feedforward, low_.size(), push_.begin());
    double* J = out_.J ? out_.J : own_->J.data();
    if (turn_ >= 0) make_rate(J + static_cast<std::ptrdiff_t>(turn_) * nv_, v);
    for (std::size_t i = 0; i < low_.size(); ++i) {
      const double e = rates_ ? 0.0 : own_->error[i], up = high_[i] - e, down = e - low_[i], along = along_[i];
      if (order_ == 1 && rates_) {
        out_.upper[i] = along + high_[i];
        out_.lower[i] = along + low_[i];
        continue;
      }
      const double speed = product(J + i * nv_, v, nv_) / out_.weight - along;
      if (order_ == 1) {
        out_.upper[i] = along + barrier_.next(up, speed);
        out_.lower[i] = along - barrier_.next(down, -speed);
        continue;
      }
      const double push = push_[i] - own_->drift[i];
      out_.upper[i] = push + (rates_ ? barrier_.rate * (high_[i] - speed) : barrier_.hardest(up, speed));
      out_.lower[i] = push + (rates_ ? barrier_.rate * (low_[i] - speed) : -barrier_.hardest(down, -speed));
    }
  }
  bool hold(const double* q, const double* v, double* value) override { return turn_ >= 0 && task_->hold(q, v, value); }
  void begin() override { task_->begin(); }
  void keep(CarryOver& state) override { task_->keep(state); }

 private:
  void make_rate(double* J, const double* v) {  // turns angular velocities into rates of the rotation vector
    const Vec3 turn = load(own_->error.data() + turn_);
    const RotationVector vector(turn), back(-1.0 * turn);
    double *drift = own_->drift.data() + turn_, *along = along_.data() + turn_, *push = push_.data() + turn_;
    const Vec3 omega =
        (1.0 / out_.weight) * Vec3{product(J, v, nv_), product(J + nv_, v, nv_), product(J + 2 * nv_, v, nv_)};
    for (int c = 0; c < nv_; ++c) {
      const Vec3 rate = vector.rate({J[c], J[c + nv_], J[c + 2 * nv_]});
      for (int i = 0; i < 3; ++i) J[c + i * nv_] = rate[i];
    }
    const Vec3 wanted = load(along), carried = back.rate(wanted), rate = vector.rate(omega);
    for (int i = 0; i < 3; ++i) along[i] = carried[i];
    if (order_ == 1) return;
    const Vec3 found = vector.rate(load(drift)) + vector.change(rate, omega);
    const Vec3 pushed = back.rate(load(push)) + back.change(carried - rate, wanted) + vector.change(carried, omega);
    for (int i = 0; i < 3; ++i) drift[i] = found[i], push[i] = pushed[i];
  }

  Target out_;
  std::unique_ptr<Numbers> own_;
  Part task_;
  std::vector<double> low_, high_;
  Barrier barrier_;
  bool rates_;
  int turn_, nv_, order_;
  std::vector<double> along_, push_;  // velocity and acceleration of the bounds
};

// The centre of mass inside the convex hull of points, a row for each.
class SupportPolygon final : public Operation {
 public:
  SupportPolygon(Target out, std::unique_ptr<Numbers> own, std::unique_ptr<Com> com, std::vector<Corner> corners,
                 double margin, Barrier barrier, int order)
      : out_(out),
        own_(std::move(own)),
        com_(std::move(com)),
        hull_(std::move(corners)),
        margin_(margin),
        barrier_(barrier),
        order_(order) {}
  void run(const double* q, const double* v) override {
    constexpr double kNone = std::numeric_limits<double>::infinity();
    com_->run(q, v);
    if (out_.given) hull_.move(out_.reference);
    hull_.update();
    const std::vector<int>& hull = hull_.corners();
    const int m = hull_.size(), nv = out_.nv;
    std::fill(out_.lower, out_.lower + m, -kNone);
    std::fill(out_.upper, out_.upper + m, kNone);
    std::fill(out_.J, out_.J + static_cast<std::ptrdiff_t>(m) * nv, 0.0);
    const double *Jx = own_->J.data(), *Jy = Jx + nv;
    for (std::size_t k = 0; k < hull.size(); ++k) {
      const int i = hull[k], j = hull[(k + 1) % hull.size()];
      const double dx = hull_.x(j) - hull_.x(i), dy = hull_.y(j) - hull_.y(i), length = std::hypot(dx, dy);
      if (!(length > 0.0)) continue;
      const double nx = dy / length, ny = -dx / length;
      const double way = nx * (hull_.x(i) - own_->error[0]) + ny * (hull_.y(i) - own_->error[1]) - margin_;
      double* J = out_.row(i);
      for (int c = 0; c < nv; ++c) J[c] = out_.weight * (nx * Jx[c] + ny * Jy[c]);
      const double speed = product(J, v, nv) / out_.weight;
      if (order_ == 1) {
        out_.upper[i] = barrier_.next(way, speed);
      } else {
        const double drift = nx * own_->drift[0] + ny * own_->drift[1];
        out_.upper[i] = barrier_.hardest(way, speed) - drift;
      }
    }
  }
  void stand(const std::string& contact, bool there) override { hull_.stand(contact, there); }

 private:
  Target out_;
  std::unique_ptr<Numbers> own_;  // x and y of the centre of mass, its Jacobian and drift
  std::unique_ptr<Com> com_;
  Hull hull_;
  double margin_;
  Barrier barrier_;
  int order_;
};

}  // namespace hqp
