// Distance between a capsule and the convex hull of a link: steps equal to those of tasks/polytopes.py.
#pragma once

#include <array>
#include <utility>
#include <vector>

#include "distance.hpp"

namespace hqp {

// Convex hull of corners, swept by a ball; triangles are three corners each.
class Polytope {
 public:
  Polytope(std::vector<Vec3> corners, const std::vector<int>& triangles, double rounding)
      : corners_(std::move(corners)), rounding_(rounding) {
    Vec3 middle{};
    for (const Vec3& corner : corners_) middle = middle + (1.0 / double(corners_.size())) * corner;
    for (std::size_t k = 0; k + 2 < triangles.size(); k += 3) {
      Face face{triangles[k], triangles[k + 1], triangles[k + 2], {}, {}, 0.0};
      const Vec3 &a = corners_[face.a], w = cross(corners_[face.b] - a, corners_[face.c] - a);
      face.normal = (1.0 / std::sqrt(dot(w, w))) * w;
      if (dot(face.normal, middle - a) > 0.0) std::swap(face.b, face.c), face.normal = -1.0 * face.normal;
      face.offset = dot(face.normal, a);
      const int number = static_cast<int>(faces_.size()), ring[4] = {face.a, face.b, face.c, face.a};
      for (int i = 0; i < 3; ++i) face.edges[i] = add_edge(ring[i], ring[i + 1], number);
      faces_.push_back(face);
    }
    heights_.resize(faces_.size());
  }

  // one: axis of the capsule; pose of the hull in the same axes.
  Distance distance(const Segment& one, double radius, const Vec3& origin, const Mat3& R) const {
    const Segment own = moved(one, origin, R);
    find_heights(own);
    return placed(crosses() ? inside(own) : outside(own), radius, origin, R);
  }

  // The distance from a feature that ``distance`` found: an edge, or a face and an end.
  Distance distance(int feature, const Segment& one, double radius, const Vec3& origin, const Mat3& R) const {
    if (feature < 0) return distance(one, radius, origin, R);
    const Segment own = moved(one, origin, R);
    const int count = static_cast<int>(edges_.size());
    Distance found{std::numeric_limits<double>::infinity(), {}, own.a};
    if (feature < count) {
      take(feature, own, found);
    } else {
      const Face& face = faces_[(feature - count) / 2];
      const Vec3& end = (feature - count) % 2 ? own.b : own.a;
      found = {dot(face.normal, end) - face.offset, -1.0 * face.normal, end};
    }
    return placed(found, radius, origin, R);
  }

  // A lower bound of the distance, by the planes of the faces.
  double at_least(const Segment& one, double radius, const Vec3& origin, const Mat3& R) const {
    const Segment own = moved(one, origin, R);
    double best = -std::numeric_limits<double>::infinity();
    for (const Face& face : faces_)
      best = std::max(best, std::min(dot(face.normal, own.a), dot(face.normal, own.b)) - face.offset);
    return best - radius - rounding_;
  }

 private:
  struct Face {
    int a, b, c;  // counter-clockwise from outside
    int edges[3];
    Vec3 normal;
    double offset;
  };
  struct Edge {
    int a, b, left, right;  // corners, faces
    Vec3 middle;
    double half;  // of its length
  };

  int add_edge(int a, int b, int face) {
    const int count = static_cast<int>(edges_.size());
    for (int k = 0; k < count; ++k)
      if (edges_[k].a == b && edges_[k].b == a) {
        edges_[k].right = face;
        return k;
      }
    const Vec3 half = 0.5 * (corners_[b] - corners_[a]);
    edges_.push_back({a, b, face, face, corners_[a] + half, std::sqrt(dot(half, half))});
    return count;
  }

  static Segment moved(const Segment& one, const Vec3& origin, const Mat3& R) {
    return {transposed(R, one.a - origin), transposed(R, one.b - origin)};
  }

  Distance placed(Distance found, double radius, const Vec3& origin, const Mat3& R) const {
    found.value -= radius + rounding_;
    found.normal = R * found.normal;
    found.point = origin + R * found.point;
    return found;
  }

  void find_heights(const Segment& own) const {
    for (std::size_t k = 0; k < faces_.size(); ++k) {
      const Face& face = faces_[k];
      heights_[k] = {dot(face.normal, own.a) - face.offset, dot(face.normal, own.b) - face.offset};
    }
  }
  bool visible(int k) const { return heights_[k][0] > 0.0 || heights_[k][1] > 0.0; }

  bool crosses() const {
    double first = 0.0, last = 1.0;
    for (const auto& [a, b] : heights_) {
      if (a > 0.0 && b > 0.0) return false;
      if (a > 0.0) first = std::max(first, a / (a - b));
      if (b > 0.0) last = std::min(last, a / (a - b));
    }
    return first <= last;
  }

  Distance outside(const Segment& own) const {
    Distance best{std::numeric_limits<double>::infinity(), {}, own.a};
    std::size_t first = 0;  // the face that separates most: its edges are near
    for (std::size_t k = 1; k < faces_.size(); ++k)
      if (std::min(heights_[k][0], heights_[k][1]) > std::min(heights_[first][0], heights_[first][1])) first = k;
    for (const int k : faces_[first].edges) take(k, own, best);
    for (std::size_t k = 0; k < faces_.size(); ++k)
      for (int i = 0; i < 2; ++i) {
        const double height = heights_[k][i];
        const Vec3& end = i ? own.b : own.a;
        if (height > 0.0 && height < best.value && above(faces_[k], end))
          best = {height, -1.0 * faces_[k].normal, end, static_cast<int>(edges_.size() + 2 * k) + i};
      }
    const Vec3 u = own.b - own.a;
    const double size = dot(u, u), share = size > 0.0 ? 1.0 / size : 0.0;
    for (std::size_t k = 0; k < edges_.size(); ++k) {
      const Edge& edge = edges_[k];
      if (!visible(edge.left) && !visible(edge.right)) continue;
      const Vec3 w = edge.middle - own.a;
      const Vec3 off = w - std::min(std::max(share * dot(w, u), 0.0), 1.0) * u;
      const double reach = best.value + edge.half;
      if (dot(off, off) < reach * reach) take(static_cast<int>(k), own, best);
    }
    return best.value < std::numeric_limits<double>::infinity() ? best : inside(own);
  }

  void take(int k, const Segment& own, Distance& best) const {
    const Segment line{corners_[edges_[k].a], corners_[edges_[k].b]};
    double s, t;
    Measure::nearest(own, line, s, t);
    const Vec3 p = own.a + s * (own.b - own.a), w = line.a + t * (line.b - line.a) - p;
    const double length = std::sqrt(dot(w, w));
    if (length > Measure::kTouching && length < best.value) best = {length, (1.0 / length) * w, p, k};
  }

  // The prism above a triangle.
  bool above(const Face& face, const Vec3& p) const {
    const int ring[4] = {face.a, face.b, face.c, face.a};
    for (int i = 0; i < 3; ++i) {
      const Vec3 &a = corners_[ring[i]], &b = corners_[ring[i + 1]];
      if (dot(cross(b - a, p - a), face.normal) < 0.0) return false;
    }
    return true;
  }

  // The shortest way that takes the segment out, across a face or across an edge and the segment.
  Distance inside(const Segment& own) const {
    const Vec3 u = own.b - own.a;
    const double size = std::sqrt(dot(u, u));
    double best = std::numeric_limits<double>::infinity();
    Distance found{0.0, {0.0, 0.0, -1.0}, own.a};
    for (const Face& face : faces_) {
      const double a = dot(face.normal, own.a), b = dot(face.normal, own.b), depth = face.offset - std::min(a, b);
      if (!(depth < best)) continue;
      const double s = std::fabs(b - a) <= Measure::kTouching * size ? 0.5 : (b < a ? 1.0 : 0.0);
      best = depth;
      found = {-depth, -1.0 * face.normal, own.a + s * u};
    }
    for (const Edge& edge : edges_) {
      const Segment line{corners_[edge.a], corners_[edge.b]};
      const Vec3 w = cross(u, line.b - line.a);
      const double length = std::sqrt(dot(w, w));
      if (!(length > Measure::kTouching * size)) continue;
      for (const double sign : {-1.0, 1.0}) {
        const Vec3 normal = (sign / length) * w;
        const double reach = dot(normal, line.a), depth = reach - dot(normal, own.a);
        if (!(depth < best) || !supports(normal, reach)) continue;
        double s, t;
        Measure::nearest(own, line, s, t);
        best = depth;
        found = {-depth, -1.0 * normal, own.a + s * u};
      }
    }
    return found;
  }

  bool supports(const Vec3& normal, double reach) const {
    for (const Vec3& corner : corners_)
      if (dot(normal, corner) > reach + Measure::kTouching) return false;
    return true;
  }

  std::vector<Vec3> corners_;
  std::vector<Face> faces_;
  std::vector<Edge> edges_;
  double rounding_;
  mutable std::vector<std::array<double, 2>> heights_;  // of the ends above each face
};

}  // namespace hqp
