// State of a biped between two ticks of its walk: centre of mass and soles; the support under them.
#pragma once

#include <cmath>
#include <utility>
#include <vector>

#include "../rows/hull.hpp"
#include "feet_kinematics.hpp"
#include "footsteps.hpp"

namespace hqp {

struct Sole {
  Vec2 middle;                // planned place of the ZMP, in the frame's axes [m]
  double yaw = 0.0;           // angle from ahead to the frame's x axis at home [rad]
  std::vector<Vec2> corners;  // corners of the support that the balance may use

  template <class Plan>
  static Sole of(const Plan& p) {
    const std::vector<double> middle = p.numbers("middle", 2);
    Sole found{{middle[0], middle[1]}, p.number("yaw"), {}};
    for (const Plan& one : p.parts("corners")) {
      const std::vector<double> corner = one.numbers();
      need(corner.size() == 2, "a corner has two numbers");
      found.corners.push_back({corner[0], corner[1]});
    }
    need(found.corners.size() > 2, "a sole has three corners or more");
    return found;
  }
};

struct BipedState {
  Vec3 com{}, velocity{};  // centre of mass, and its rate
  Vec3 position[2]{};      // positions of the frames of the soles
  Mat3 rotation[2]{};

  void read(const FeetKinematics& from) {
    com = from.com(), velocity = from.com_velocity();
    for (const int side : {kLeft, kRight})
      position[side] = from.position(std::size_t(side)), rotation[side] = from.rotation(std::size_t(side));
  }
  bool finite() const {
    double sum = 0.0;  // a NaN or an infinity times zero is NaN
    for (int i = 0; i < 3; ++i) {
      sum += 0.0 * com[i] + 0.0 * velocity[i];
      for (const int side : {kLeft, kRight}) {
        sum += 0.0 * position[side][i];
        for (int j = 0; j < 3; ++j) sum += 0.0 * rotation[side].column[j][i];
      }
    }
    return sum == 0.0;
  }
  double yaw(int side) const { return yaw_of(rotation[side]); }
  Foothold placed(int side, const Sole& sole) const {
    const Vec3 at = position[side] + rotation[side] * Vec3{sole.middle.x, sole.middle.y, 0.0};
    return {side, at[0], at[1], at[2], wrapped(yaw(side) - sole.yaw)};
  }
};

// The ground under the feet that stand.
class Support {
 public:
  Support(const BipedState& state, const std::vector<Sole>& soles) : hull_(corners(state, soles)) {}
  Support(const Support&) = delete;

  void stand(bool left, bool right) { hull_.stand(kNames[kLeft], left), hull_.stand(kNames[kRight], right); }
  Vec2 nearest(const Vec2& wanted) {
    const double to[2] = {wanted.x, wanted.y};
    double found[2] = {wanted.x, wanted.y};
    hull_.update();
    hull_.nearest(to, found);
    return {found[0], found[1]};
  }

 private:
  static constexpr const char* kNames[] = {"left", "right"};

  static std::vector<Corner> corners(const BipedState& state, const std::vector<Sole>& soles) {
    std::vector<Corner> found;
    for (std::size_t side = 0; side < 2; ++side)
      for (const Vec2& corner : soles[side].corners)
        found.push_back({false,
                         {state.position[side].e, state.rotation[side].column[0].e, 0, {}},
                         {corner.x, corner.y, 0.0},
                         kNames[side]});
    return found;
  }

  Hull hull_;
};

}  // namespace hqp
