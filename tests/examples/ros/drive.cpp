// Steps the ros2_control controller as a controller manager does, with perfect servos, and prints where the joints end:
//   drive ur5.hqp hand X Y Z: the shift of its target [m]; a fixed base, velocity commands
#include <cstdio>
#include <cstdlib>

#include "../../../examples/ros2_control/hqp_controller.hpp"

int main(int argc, char** argv) {
  if (argc != 6) return 2;
  hqp_ros::HqpController controller;
  if (controller.on_init() != hqp_ros::Callback::SUCCESS) return 2;
  auto& parameters = controller.get_node()->parameters;
  const rclcpp_lifecycle::State state;
  parameters["plan"] = "missing.hqp";
  if (controller.on_configure(state) != hqp_ros::Callback::ERROR) return 3;  // it reports the error and continues
  parameters["plan"] = argv[1], parameters["element"] = argv[2];
  if (controller.on_configure(state) != hqp_ros::Callback::SUCCESS) return 2;

  hqp::Session model = hqp::load(argv[1]);
  std::vector<double> q = model.home(), v(q.size(), 0.0), sent(q.size(), 0.0);
  if (controller.state_interface_configuration().names.size() != 2 * q.size()) return 4;
  if (controller.command_interface_configuration().names.size() != q.size()) return 4;
  for (std::size_t i = 0; i < q.size(); ++i) {
    controller.state_interfaces_.emplace_back(&q[i]);
    controller.state_interfaces_.emplace_back(&v[i]);
    controller.command_interfaces_.emplace_back("joint", "velocity", &sent[i]);
  }
  auto references = controller.references();
  if (controller.on_activate(state) != hqp_ros::Callback::SUCCESS) return 5;

  controller.update(true);  // without a reference the element holds what it is at
  model.step(q, v);
  const std::vector<double> held = model.reference(argv[2]).held();
  for (std::size_t i = 0; i < references.size(); ++i) references[i].set_value(held[i] + std::atof(argv[3 + i]));
  for (int tick = 0; tick < 500; ++tick) {
    if (controller.update(true) != hqp_ros::Return::OK) return 6;
    v = sent;
    model.integrate(q.data(), v.data(), model.dt(), q.data());
  }
  for (double angle : q) std::printf("%.9f\n", angle);
}
