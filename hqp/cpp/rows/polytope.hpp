// Distance between a capsule and the convex hull of a link: steps equal to those of tasks/polytopes.py.
#pragma once

#include <algorithm>
#include <numeric>
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
      Face face{triangles[k], triangles[k + 1], triangles[k + 2], {}, 0.0};
      const Vec3 &a = corners_[face.a], w = cross(corners_[face.b] - a, corners_[face.c] - a);
      face.normal = (1.0 / std::sqrt(dot(w, w))) * w;
      if (dot(face.normal, middle - a) > 0.0) std::swap(face.b, face.c), face.normal = -1.0 * face.normal;
      face.offset = dot(face.normal, a);
      const int ring[4] = {face.a, face.b, face.c, face.a};
      for (int i = 0; i < 3; ++i) add_edge(ring[i], ring[i + 1]);
      faces_.push_back(face);
    }
    std::vector<int> every(faces_.size());
    std::iota(every.begin(), every.end(), 0);
    add_part(every.begin(), every.end());
  }

  // one: axis of the capsule; pose of the hull in the same axes.  limit: a larger distance may be infinite.
  Distance distance(const Segment& one, double radius, const Vec3& origin, const Mat3& R,
                    double limit = std::numeric_limits<double>::infinity()) const {
    const Segment own = moved(one, origin, R);
    return placed(crosses(own) ? inside(own) : outside(own, limit + radius + rounding_), radius, origin, R);
  }

  // The distance from a feature that ``distance`` found: an edge, or a face and an end.
  Distance distance(int feature, const Segment& one, double radius, const Vec3& origin, const Mat3& R) const {
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

 private:
  struct Face {
    int a, b, c;  // counter-clockwise from outside
    Vec3 normal;
    double offset;
  };
  struct Edge {
    int a, b, face;  // corners, the first face
    Vec3 middle;
    double half;  // of its length
  };
  struct Part {  // a piece of the surface within a ball: two halves, or a few faces with some of their edges
    Vec3 centre;
    double radius;
    int halves[2];
    std::vector<int> faces, edges;
  };
  using Numbers = std::vector<int>::iterator;
  static constexpr std::ptrdiff_t kFaces = 4;  // the most in a part without halves

  int add_part(Numbers first, Numbers last) {
    const int number = static_cast<int>(parts_.size());
    Vec3 low = middle(*first), high = low;
    for (Numbers k = first; k < last; ++k)
      for (int i = 0; i < 3; ++i) low[i] = std::min(low[i], middle(*k)[i]), high[i] = std::max(high[i], middle(*k)[i]);
    Part part{0.5 * (low + high), 0.0, {-1, -1}, {}, {}};
    for (Numbers k = first; k < last; ++k)
      for (const int corner : {faces_[*k].a, faces_[*k].b, faces_[*k].c}) {
        const Vec3 off = corners_[corner] - part.centre;
        part.radius = std::max(part.radius, std::sqrt(dot(off, off)));
      }
    if (last - first <= kFaces) {
      part.faces.assign(first, last);
      for (std::size_t k = 0; k < edges_.size(); ++k)
        if (std::find(first, last, edges_[k].face) != last) part.edges.push_back(static_cast<int>(k));
    }
    parts_.push_back(std::move(part));
    if (last - first <= kFaces) return number;
    const Vec3 size = high - low;
    const int i = size[0] >= size[1] && size[0] >= size[2] ? 0 : size[1] >= size[2] ? 1 : 2;
    const Numbers half = first + (last - first) / 2;
    std::nth_element(first, half, last, [&](int one, int other) { return middle(one)[i] < middle(other)[i]; });
    const int halves[2] = {add_part(first, half), add_part(half, last)};
    std::copy_n(halves, 2, parts_[number].halves);
    return number;
  }
  Vec3 middle(int k) const {
    return (1.0 / 3.0) * (corners_[faces_[k].a] + corners_[faces_[k].b] + corners_[faces_[k].c]);
  }

  void add_edge(int a, int b) {
    for (const Edge& edge : edges_)
      if (edge.a == b && edge.b == a) return;
    const Vec3 half = 0.5 * (corners_[b] - corners_[a]);
    edges_.push_back({a, b, static_cast<int>(faces_.size()), corners_[a] + half, std::sqrt(dot(half, half))});
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

  static double height(const Face& face, const Vec3& p) { return dot(face.normal, p) - face.offset; }

  bool crosses(const Segment& own) const {
    double first = 0.0, last = 1.0;
    for (const Face& face : faces_) {
      const double a = height(face, own.a), b = height(face, own.b);
      if (a > 0.0 && b > 0.0) return false;
      if (a > 0.0) first = std::max(first, a / (a - b));
      if (b > 0.0) last = std::min(last, a / (a - b));
    }
    return first <= last;
  }

  // A segment that does not cross the hull.
  struct Axis : Segment {
    Vec3 along;
    double share;                           // 1 / length^2, 0 for a point
    int ends;                               // number of different ends
    double off(const Vec3& centre) const {  // squared distance
      const Vec3 w = centre - a, left = w - std::min(std::max(share * dot(w, along), 0.0), 1.0) * along;
      return dot(left, left);
    }
  };

  // The nearest feature of those within a distance.
  Distance outside(const Segment& own, double limit) const {
    const Vec3 u = own.b - own.a;
    const double size = dot(u, u);
    Distance best{limit, {}, own.a};
    look(0, {own, u, size > 0.0 ? 1.0 / size : 0.0, size > 0.0 ? 2 : 1}, best);
    if (best.feature < 0) best.value = std::numeric_limits<double>::infinity();
    return best;
  }

  void look(int number, const Axis& own, Distance& best) const {
    const Part& part = parts_[number];
    if (part.halves[0] < 0) {
      for (const int face : part.faces) {
        for (int i = 0; i < own.ends; ++i) {
          const Vec3& end = i ? own.b : own.a;
          const double h = height(faces_[face], end);
          if (h > 0.0 && h < best.value && above(faces_[face], end))
            best = {h, -1.0 * faces_[face].normal, end, static_cast<int>(edges_.size()) + 2 * face + i};
        }
      }
      for (const int edge : part.edges) {
        const double reach = best.value + edges_[edge].half;
        if (own.off(edges_[edge].middle) < reach * reach) take(edge, own, best);
      }
      return;
    }
    double least[2];
    for (int i = 0; i < 2; ++i) {
      const Part& half = parts_[part.halves[i]];
      least[i] = std::sqrt(own.off(half.centre)) - half.radius;
    }
    const int first = least[1] < least[0];
    for (const int i : {first, 1 - first})
      if (least[i] < best.value) look(part.halves[i], own, best);
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
  std::vector<Part> parts_;  // the whole first
};

}  // namespace hqp
