// A chainable ros2_control controller around a session from a plan's file, for controller_interface of ROS 2 Jazzy.
// It is compiled and stepped beside stand-ins with the same signatures (make test-cpp); it has not run on ROS 2.
//
// Parameters: plan (path), element (that follows), base_topic (nav_msgs/Odometry of a floating base, "" for none).
// References: ELEMENT/0 ..., the numbers of its target; alone, they come from the topic ~/reference
// (std_msgs/Float64MultiArray). Commands: JOINT/velocity or JOINT/effort, states: JOINT/position and JOINT/velocity.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include <controller_interface/chainable_controller_interface.hpp>
#include <nav_msgs/msg/odometry.hpp>
#include <realtime_tools/realtime_buffer.hpp>
#include <std_msgs/msg/float64_multi_array.hpp>

#include <session.hpp>

namespace hqp_ros {

using Return = controller_interface::return_type;
using Callback = controller_interface::CallbackReturn;
using Interfaces = controller_interface::InterfaceConfiguration;

class HqpController : public controller_interface::ChainableControllerInterface {
 public:
  Callback on_init() override {
    auto_declare<std::string>("plan", "");
    auto_declare<std::string>("element", "");
    auto_declare<std::string>("command", "velocity");
    auto_declare<std::string>("base_topic", "");
    return Callback::SUCCESS;
  }

  Callback on_configure(const rclcpp_lifecycle::State&) override {
    try {
      session_ = std::make_unique<hqp::Session>(hqp::load(get_node()->get_parameter("plan").as_string()));
      element_ = get_node()->get_parameter("element").as_string();
      target_ = std::make_unique<hqp::Reference>(session_->reference(element_));
    } catch (const std::exception& error) {  // PlanError, ReferenceError: a sentence each
      RCLCPP_ERROR(get_node()->get_logger(), "%s", error.what());
      return Callback::ERROR;
    }
    joints_ = session_->joint_names();
    q_ = session_->home();
    v_.assign(static_cast<std::size_t>(session_->nv()), 0.0);
    base_ = q_.size() - joints_.size();
    reference_interfaces_.assign(target_->size(), std::numeric_limits<double>::quiet_NaN());
    topic_ = get_node()->create_subscription<std_msgs::msg::Float64MultiArray>(
        "~/reference", rclcpp::SystemDefaultsQoS(),
        [this](const std_msgs::msg::Float64MultiArray::SharedPtr told) { told_.writeFromNonRT(told); });
    const std::string base = get_node()->get_parameter("base_topic").as_string();
    if (base_ == 7 && base.empty()) {
      RCLCPP_ERROR(get_node()->get_logger(), "the plan has a floating base: base_topic is needed");
      return Callback::ERROR;
    }
    if (base_ == 7)
      odometry_ = get_node()->create_subscription<nav_msgs::msg::Odometry>(
          base, rclcpp::SensorDataQoS(),
          [this](const nav_msgs::msg::Odometry::SharedPtr now) { placed_.writeFromNonRT(now); });
    return base_ == 0 || base_ == 7 ? Callback::SUCCESS : Callback::ERROR;
  }

  Interfaces command_interface_configuration() const override {
    const std::string kind = get_node()->get_parameter("command").as_string();
    return {controller_interface::interface_configuration_type::INDIVIDUAL, named({kind})};
  }
  Interfaces state_interface_configuration() const override {
    return {controller_interface::interface_configuration_type::INDIVIDUAL, named({"position", "velocity"})};
  }

  // Elements take their hold values from the next state.
  Callback on_activate(const rclcpp_lifecycle::State&) override {
    session_->reset();
    told_.reset(), placed_.reset();
    std::fill(reference_interfaces_.begin(), reference_interfaces_.end(), std::numeric_limits<double>::quiet_NaN());
    return Callback::SUCCESS;
  }

 protected:
  std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() override {
    std::vector<hardware_interface::CommandInterface> found;
    for (std::size_t i = 0; i < reference_interfaces_.size(); ++i)
      found.emplace_back(get_node()->get_name(), element_ + "/" + std::to_string(i), &reference_interfaces_[i]);
    return found;
  }
  bool on_set_chained_mode(bool) override { return true; }

  Return update_reference_from_subscribers(const rclcpp::Time&, const rclcpp::Duration&) override {
    const auto told = *told_.readFromRT();
    if (told && told->data.size() == reference_interfaces_.size())
      std::copy(told->data.begin(), told->data.end(), reference_interfaces_.begin());
    return Return::OK;
  }

  // The manager's update_rate has to be that of the plan: the session integrates with its own period.
  // Joints are read right before; the base is as old as its message. A plan with a max_age refuses older states.
  Return update_and_write_commands(const rclcpp::Time& time, const rclcpp::Duration&) override {
    double seen = time.seconds();
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      q_[base_ + i] = state_interfaces_[2 * i].get_value();
      v_[v_.size() - joints_.size() + i] = state_interfaces_[2 * i + 1].get_value();
    }
    if (base_ == 7) {
      const auto now = *placed_.readFromRT();
      if (!now) return Return::OK;  // no base yet: no command
      seen = rclcpp::Time(now->header.stamp).seconds();
      const auto& place = now->pose.pose;
      const auto& rate = now->twist.twist;  // in the child frame: the base's own axes
      const double at[] = {place.position.x,    place.position.y,    place.position.z,   place.orientation.x,
                           place.orientation.y, place.orientation.z, place.orientation.w};
      const double speed[] = {rate.linear.x,  rate.linear.y,  rate.linear.z,
                              rate.angular.x, rate.angular.y, rate.angular.z};
      std::copy(at, at + 7, q_.begin());
      std::copy(speed, speed + 6, v_.begin());
    }
    if (!std::isnan(reference_interfaces_.front())) target_->at(reference_interfaces_);
    const hqp::Tick& tick = session_->step(q_, v_, seen, time.seconds());  // every status comes with a safe command
    for (std::size_t i = 0; i < joints_.size(); ++i) command_interfaces_[i].set_value(tick.command()[i]);
    return Return::OK;
  }

 private:
  std::vector<std::string> named(const std::vector<std::string>& kinds) const {
    std::vector<std::string> found;
    for (const std::string& joint : joints_)
      for (const std::string& kind : kinds) found.push_back(joint + "/" + kind);
    return found;
  }

  std::unique_ptr<hqp::Session> session_;
  std::unique_ptr<hqp::Reference> target_;
  std::string element_;
  std::vector<std::string> joints_;
  std::vector<double> q_, v_;
  std::size_t base_ = 0;
  rclcpp::Subscription<std_msgs::msg::Float64MultiArray>::SharedPtr topic_;
  rclcpp::Subscription<nav_msgs::msg::Odometry>::SharedPtr odometry_;
  realtime_tools::RealtimeBuffer<std_msgs::msg::Float64MultiArray::SharedPtr> told_;
  realtime_tools::RealtimeBuffer<nav_msgs::msg::Odometry::SharedPtr> placed_;
};

}  // namespace hqp_ros
