// What the references of a tick set: targets, ground normals, rates and feedforward of elements.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace hqp {

enum class Plain { kNo, kNumbers, kRotation, kPose };  // whether a target is taken as it is, and what it has to be

// Where an element's reference goes; the arrays are live.
struct Slot {
  double* target = nullptr;  // null where it has none
  std::vector<int> shape;    // of the target
  double* normal = nullptr;  // (3,), null where its rows do not ask for it
  double* rate = nullptr;    // (rows,)
  double* feedforward = nullptr;
  int rows = 0;
  bool elsewhere = false;  // whether the value is read by Python
  Plain plain = Plain::kNo;
  std::vector<double> hold;  // the target where no reference is given, flat
  bool moved = false;        // whether a reference has been put there

  void settle() {
    if (target) std::copy(hold.begin(), hold.end(), target);
    if (normal) normal[0] = normal[1] = 0.0, normal[2] = 1.0;
    std::fill(rate, rate + rows, 0.0);
    std::fill(feedforward, feedforward + rows, 0.0);
  }
};

inline double squared(const double* a, int size) {
  double sum = 0.0;
  for (int i = 0; i < size; ++i) sum += a[i] * a[i];
  return sum;
}
inline bool finite(const double* a, int size) { return squared(a, size) < std::numeric_limits<double>::infinity(); }

}  // namespace hqp
