// Vectors of space, motions and the linear forms on them.
//
// A motion is a twist or its rate at the world's origin, linear first: a body's point p moves with v + w x p.
#pragma once

#include <algorithm>
#include <cmath>

namespace hqp {

struct Vec3 {
  double e[3];
  double operator[](int i) const { return e[i]; }
  double& operator[](int i) { return e[i]; }
};

inline Vec3 operator+(const Vec3& a, const Vec3& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
inline Vec3 operator-(const Vec3& a, const Vec3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline Vec3 operator*(double s, const Vec3& a) { return {s * a[0], s * a[1], s * a[2]}; }
inline double dot(const Vec3& a, const Vec3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline Vec3 load(const double* a) { return {a[0], a[1], a[2]}; }
inline Vec3 axis(int i) { return {i == 0 ? 1.0 : 0.0, i == 1 ? 1.0 : 0.0, i == 2 ? 1.0 : 0.0}; }

struct Mat3 {  // by columns: the world directions of a frame's axes
  Vec3 column[3];
};

inline Mat3 load_rotation(const double* R) { return {load(R), load(R + 3), load(R + 6)}; }
inline Vec3 operator*(const Mat3& R, const Vec3& a) {
  return a[0] * R.column[0] + a[1] * R.column[1] + a[2] * R.column[2];
}
inline Mat3 operator*(const Mat3& R, const Mat3& S) { return {{R * S.column[0], R * S.column[1], R * S.column[2]}}; }
inline Vec3 transposed(const Mat3& R, const Vec3& a) {
  return {dot(R.column[0], a), dot(R.column[1], a), dot(R.column[2], a)};
}
inline Mat3 transposed(const Mat3& R, const Mat3& S) {
  return {transposed(R, S.column[0]), transposed(R, S.column[1]), transposed(R, S.column[2])};
}

struct Motion {
  Vec3 linear, angular;
  Vec3 at(const Vec3& p) const { return linear + cross(angular, p); }
};

inline Motion operator+(const Motion& a, const Motion& b) { return {a.linear + b.linear, a.angular + b.angular}; }
inline Motion cross(const Motion& a, const Motion& b) {
  return {cross(a.angular, b.linear) + cross(a.linear, b.angular), cross(a.angular, b.angular)};
}

struct Form {  // a number for each motion: linear . v + angular . w
  Vec3 linear, angular;
};

inline Form operator+(const Form& a, const Form& b) { return {a.linear + b.linear, a.angular + b.angular}; }
inline Form operator*(double s, const Form& a) { return {s * a.linear, s * a.angular}; }
inline double value(const Form& a, const Motion& V) { return dot(a.linear, V.linear) + dot(a.angular, V.angular); }

// Velocity along u of a body's point p.
inline Form along(const Vec3& u, const Vec3& p) { return {u, cross(p, u)}; }
// Angular velocity along u.
inline Form about(const Vec3& u) { return {{0.0, 0.0, 0.0}, u}; }

// Rotation vector of S R0^T, R0 row-major with the given stride. Through the quaternion, which is accurate at every
// angle.
inline Vec3 rotation_error(const Mat3& S, const double* R0, int stride) {
  double E[3][3];
  for (int j = 0; j < 3; ++j) {
    const Vec3 column = S * load(R0 + j * stride);
    for (int i = 0; i < 3; ++i) E[i][j] = column[i];
  }
  const double trace = E[0][0] + E[1][1] + E[2][2];
  double w;
  Vec3 u;
  if (trace > 0.0) {
    const double s = 2.0 * std::sqrt(1.0 + trace);
    w = 0.25 * s;
    u = {(E[2][1] - E[1][2]) / s, (E[0][2] - E[2][0]) / s, (E[1][0] - E[0][1]) / s};
  } else {
    const int i = E[0][0] > E[1][1] ? (E[0][0] > E[2][2] ? 0 : 2) : (E[1][1] > E[2][2] ? 1 : 2);
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    const double s = 2.0 * std::sqrt(std::max(0.0, 1.0 + E[i][i] - E[j][j] - E[k][k]));
    w = (E[k][j] - E[j][k]) / s;
    u[i] = 0.25 * s;
    u[j] = (E[i][j] + E[j][i]) / s;
    u[k] = (E[i][k] + E[k][i]) / s;
    if (w < 0.0) {
      w = -w;
      u = -1.0 * u;
    }
  }
  const double sine = std::sqrt(dot(u, u));
  return (sine > 1e-12 ? 2.0 * std::atan2(sine, w) / sine : 2.0) * u;
}

}  // namespace hqp
