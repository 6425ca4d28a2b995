// Vectors, turns and bounds in the plane of the ground.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

namespace hqp {

struct Vec2 {
  double x = 0.0, y = 0.0;
};

inline Vec2 operator+(const Vec2& a, const Vec2& b) { return {a.x + b.x, a.y + b.y}; }
inline Vec2 operator-(const Vec2& a, const Vec2& b) { return {a.x - b.x, a.y - b.y}; }
inline Vec2 operator*(double s, const Vec2& a) { return {s * a.x, s * a.y}; }
inline Vec2 operator/(const Vec2& a, double s) { return {a.x / s, a.y / s}; }
inline double dot(const Vec2& a, const Vec2& b) { return a.x * b.x + a.y * b.y; }

// The vector turned by an angle about the vertical, and back.
inline Vec2 turned(double yaw, const Vec2& a) {
  const double c = std::cos(yaw), s = std::sin(yaw);
  return {c * a.x - s * a.y, s * a.x + c * a.y};
}
inline Vec2 turned_back(double yaw, const Vec2& a) {
  const double c = std::cos(yaw), s = std::sin(yaw);
  return {c * a.x + s * a.y, c * a.y - s * a.x};
}

inline double held(double x, double low, double high) { return std::min(std::max(x, low), high); }
// Bounds by axis would know the heading: shorten the vector to a length.
inline Vec2 within(const Vec2& a, double length) {
  const double size = std::hypot(a.x, a.y);
  return size <= length ? a : (length / size) * a;
}
// The equal angle within [-pi, pi], NaN unless finite.
inline double wrapped(double angle) {
  constexpr double kTurn = 6.283185307179586476925286766559;
  return std::isfinite(angle) ? std::remainder(angle, kTurn) : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace hqp
