// What the references of a tick set: targets, ground normals, rates and feedforward of elements.
#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "rotations.hpp"

namespace hqp {

enum class Plain { kNo, kNumbers, kRotation, kPose };  // whether a target is taken as it is, and what it has to be

// Where an element's reference goes; the arrays are live.
struct Slot {
  double* target = nullptr;  // null where it has none
  std::vector<int> shape;    // of the target
  double* normal = nullptr;  // (3,) of the ground, null if it takes none
  double* rate = nullptr;    // (rows,)
  double* feedforward = nullptr;
  int rows = 0;
  bool elsewhere = false;  // whether the value is read by Python
  Plain plain = Plain::kNo;
  std::vector<double> hold;                       // the target where no reference is given, flat
  bool moved = false;                             // whether a reference has been put there
  int operation = -1;                             // that tells what the element is at, -1 for none
  std::array<double, 3> usual = {0.0, 0.0, 1.0};  // the normal if a reference gives none

  void settle() {
    if (target) std::copy(hold.begin(), hold.end(), target);
    if (normal) std::copy(usual.begin(), usual.end(), normal);
    std::fill(rate, rate + rows, 0.0);
    std::fill(feedforward, feedforward + rows, 0.0);
    moved = false;
  }
  int size() const {  // numbers of a value, none where the element takes none
    int n = shape.empty() ? 0 : 1;
    for (const int each : shape) n *= each;
    return n;
  }
  // Whether what was put there are numbers, and a target that has to be one is a rotation.
  bool is_finite() const {
    return finite(target, size()) && finite(rate, rows) && finite(feedforward, rows) && (!normal || finite(normal, 3));
  }
  bool is_rotation() const {
    return (plain != Plain::kRotation || rotation(target, 3)) && (plain != Plain::kPose || pose(target));
  }
};

// Hold values in place of the references that were given, or everywhere.
inline void settle(std::vector<Slot>& slots, bool everywhere) {
  for (Slot& slot : slots)
    if (everywhere || slot.moved) slot.settle();
}

}  // namespace hqp
