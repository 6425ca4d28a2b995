// The convex hull of points from above.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "relative_frame.hpp"

namespace hqp {

struct Corner {  // corner of a polygon: a point of a frame, or of the world
  bool fixed;
  Frame frame;
  Vec3 point;
  std::string of = {};  // the contact that it is one of, none for ""
  bool present = true;
};

class Hull {
 public:
  explicit Hull(std::vector<Corner> corners)
      : corners_(std::move(corners)), x_(corners_.size()), y_(corners_.size()), z_(corners_.size()) {
    order_of_.reserve(corners_.size());
    hull_.reserve(2 * corners_.size() + 1);
  }

  void update() {
    place();
    find_hull();
  }
  // Corners of the world are these from now on, two numbers each.
  void move(const double* to) {
    for (Corner& corner : corners_)
      if (corner.fixed) corner.point = {to[0], to[1], 0.0}, to += 2;
  }
  int size() const { return static_cast<int>(corners_.size()); }
  bool present(int i) const { return corners_[i].present; }
  // Corners of a contact are some of the polygon where that is there.
  void stand(const std::string& contact, bool there) {
    for (Corner& corner : corners_)
      if (corner.of == contact) corner.present = there;
  }
  double x(int i) const { return x_[i]; }
  double y(int i) const { return y_[i]; }
  double z(int i) const { return z_[i]; }
  const std::vector<int>& corners() const { return hull_; }  // counter-clockwise

  // The point of the hull nearest to another one; `found` stays if there is no point.
  void nearest(const double* to, double* found) const {
    bool inside = hull_.size() > 2;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < hull_.size(); ++k) {
      const int i = hull_[k], j = hull_[(k + 1) % hull_.size()];
      const double ux = x_[j] - x_[i], uy = y_[j] - y_[i];
      const double wx = to[0] - x_[i], wy = to[1] - y_[i], length = ux * ux + uy * uy;
      inside = inside && ux * wy - uy * wx >= 0.0;
      const double s = length > 0.0 ? std::min(std::max((ux * wx + uy * wy) / length, 0.0), 1.0) : 0.0;
      const double off = std::hypot(wx - s * ux, wy - s * uy);
      if (off < least) least = off, found[0] = x_[i] + s * ux, found[1] = y_[i] + s * uy;
    }
    if (inside) found[0] = to[0], found[1] = to[1];
  }

 private:
  static constexpr double kFlat = 2e-5;  // a corner this near to the line between its neighbours does not count [m]

  void place() {
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      const Corner& corner = corners_[i];
      const Vec3 p = corner.fixed ? corner.point
                                  : load(corner.frame.position) + load_rotation(corner.frame.rotation) * corner.point;
      x_[i] = p[0];
      y_[i] = p[1];
      z_[i] = p[2];
    }
  }
  double turn(int o, int a, int b) const {
    return (x_[a] - x_[o]) * (y_[b] - y_[o]) - (y_[a] - y_[o]) * (x_[b] - x_[o]);
  }
  void find_hull() {  // Andrew's monotone chain, then without flat corners
    order_of_.clear();
    for (int i = 0; i < size(); ++i)
      if (present(i)) order_of_.push_back(i);
    const auto before = [&](int a, int b) { return x_[a] != x_[b] ? x_[a] < x_[b] : y_[a] < y_[b]; };
    for (auto one = order_of_.begin(); one != order_of_.end(); ++one)  // takes no memory
      std::rotate(std::upper_bound(order_of_.begin(), one, *one, before), one, one + 1);
    hull_.clear();
    for (int side = 0; side < 2; ++side) {
      const std::size_t start = hull_.size();
      for (const int i : order_of_) {
        while (hull_.size() >= start + 2 && turn(hull_[hull_.size() - 2], hull_.back(), i) <= 0.0) hull_.pop_back();
        hull_.push_back(i);
      }
      if (!hull_.empty()) hull_.pop_back();
      std::reverse(order_of_.begin(), order_of_.end());
    }
    if (hull_.empty() && !order_of_.empty()) hull_.push_back(order_of_[0]);  // all points coincide
    while (hull_.size() > 3) {
      std::size_t least = 0;
      double smallest = std::numeric_limits<double>::infinity();
      const std::size_t n = hull_.size();
      for (std::size_t k = 0; k < n; ++k) {
        const int o = hull_[(k + n - 1) % n], a = hull_[k], b = hull_[(k + 1) % n];
        const double off = std::fabs(turn(o, a, b)) / std::max(std::hypot(x_[b] - x_[o], y_[b] - y_[o]), kFlat);
        if (off < smallest) smallest = off, least = k;
      }
      if (!(smallest <= kFlat)) break;
      hull_.erase(hull_.begin() + static_cast<std::ptrdiff_t>(least));
    }
  }

  std::vector<Corner> corners_;
  std::vector<double> x_, y_, z_;
  std::vector<int> order_of_, hull_;
};

}  // namespace hqp
