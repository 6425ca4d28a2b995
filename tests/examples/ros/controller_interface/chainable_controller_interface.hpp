// The part of ROS 2 Jazzy that examples/ros2_control uses, with its signatures and without ROS: enough to compile and
// step it.
#pragma once

#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#define RCLCPP_ERROR(logger, ...) std::fprintf(stderr, __VA_ARGS__)

namespace rclcpp_lifecycle {
class State {};
}  // namespace rclcpp_lifecycle

namespace rclcpp {
class Time {
 public:
  Time() = default;
  template <class Stamp, class = decltype(Stamp::nanosec)>
  explicit Time(const Stamp& stamp) : seconds_(stamp.sec + 1e-9 * stamp.nanosec) {}
  double seconds() const { return seconds_; }

 private:
  double seconds_ = 0.0;
};
class Duration {};
struct QoS {};
struct SystemDefaultsQoS : QoS {};
struct SensorDataQoS : QoS {};

template <class Message>
struct Subscription {
  using SharedPtr = std::shared_ptr<Subscription>;
  std::function<void(std::shared_ptr<Message>)> take;
};

class Parameter {
 public:
  explicit Parameter(std::string text) : text_(std::move(text)) {}
  const std::string& as_string() const { return text_; }

 private:
  std::string text_;
};

class Node {
 public:
  std::map<std::string, std::string> parameters;

  Parameter get_parameter(const std::string& name) const { return Parameter(parameters.at(name)); }
  const char* get_name() const { return "hqp"; }
  int get_logger() const { return 0; }
  template <class Message, class Callback>
  std::shared_ptr<Subscription<Message>> create_subscription(const std::string&, const QoS&, Callback take) {
    auto made = std::make_shared<Subscription<Message>>();
    made->take = take;
    return made;
  }
};
}  // namespace rclcpp

namespace hardware_interface {
class CommandInterface {
 public:
  CommandInterface(const std::string&, const std::string& name, double* value) : name_(name), value_(value) {}
  void set_value(double value) { *value_ = value; }
  const std::string& get_interface_name() const { return name_; }

 private:
  std::string name_;
  double* value_;
};
class StateInterface {
 public:
  explicit StateInterface(const double* value) : value_(value) {}
  double get_value() const { return *value_; }

 private:
  const double* value_;
};
}  // namespace hardware_interface

namespace controller_interface {
enum class return_type { OK, ERROR };
enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };
struct InterfaceConfiguration {
  interface_configuration_type type;
  std::vector<std::string> names;
};

class ChainableControllerInterface {
 public:
  virtual ~ChainableControllerInterface() = default;
  virtual CallbackReturn on_init() = 0;
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State&) = 0;
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State&) = 0;
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;

  std::shared_ptr<rclcpp::Node> get_node() const { return node_; }
  template <class Value>
  void auto_declare(const std::string& name, const Value& value) {
    node_->parameters.emplace(name, value);
  }

  std::vector<double> reference_interfaces_;
  std::vector<hardware_interface::CommandInterface> command_interfaces_;
  std::vector<hardware_interface::StateInterface> state_interfaces_;

  // Calls of the controller manager.
  return_type update(bool chained) {
    if (!chained) update_reference_from_subscribers(rclcpp::Time(), rclcpp::Duration());
    return update_and_write_commands(rclcpp::Time(), rclcpp::Duration());
  }
  std::vector<hardware_interface::CommandInterface> references() { return on_export_reference_interfaces(); }

 protected:
  virtual std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() = 0;
  virtual bool on_set_chained_mode(bool) = 0;
  virtual return_type update_reference_from_subscribers(const rclcpp::Time&, const rclcpp::Duration&) = 0;
  virtual return_type update_and_write_commands(const rclcpp::Time&, const rclcpp::Duration&) = 0;

 private:
  std::shared_ptr<rclcpp::Node> node_ = std::make_shared<rclcpp::Node>();
};
}  // namespace controller_interface
