#pragma once

#include <cstdint>
#include <memory>

namespace nav_msgs::msg {
struct Odometry {
  using SharedPtr = std::shared_ptr<Odometry>;
  struct {
    struct {
      std::int32_t sec = 0;
      std::uint32_t nanosec = 0;
    } stamp;
  } header;
  struct Vector3 {
    double x = 0.0, y = 0.0, z = 0.0;
  };
  struct Quaternion {
    double x = 0.0, y = 0.0, z = 0.0, w = 1.0;
  };
  struct {
    struct {
      Vector3 position;
      Quaternion orientation;
    } pose;
  } pose;
  struct {
    struct {
      Vector3 linear, angular;
    } twist;
  } twist;
};
}  // namespace nav_msgs::msg
