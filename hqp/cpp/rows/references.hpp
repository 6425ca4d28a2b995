// References of a tick: targets, ground normals, rates and feedforward of elements.
#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "rotations.hpp"

namespace hqp {

enum class Plain { kNo, kNumbers, kRotation, kPose };  // check of a target that is used unchanged

// Buffers of an element's reference; the arrays are live.
struct Slot {
  double* target = nullptr;  // null where it has none
  std::vector<int> shape;    // shape of the target
  double* normal = nullptr;  // (3,) of the ground, null if it takes none
  double* rate = nullptr;    // (rows,)
  double* feedforward = nullptr;
  int rows = 0;
  bool elsewhere = false;  // true if Python reads the value
  Plain plain = Plain::kNo;
  std::vector<double> hold;                       // the target where no reference is given, flat
  bool moved = false;                             // true if a reference has been stored
  int operation = -1;                             // operation with the hold value, -1 for none
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
  // Return true if the stored numbers are finite, and a target that must be a rotation is one.
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
