"""A ROS 2 node: JointState in, JointTrajectory out, stack from TOML.  Tested beside stand-ins; it has not run on ROS 2.

ros2 run ... or: python ros2_node.py STACK.toml ROBOT
"""

import sys
from time import monotonic

import numpy as np
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

import hqp
from hqp import serial


class StackNode(Node):
    """Step a session at 500 Hz and publish the desired joint positions one period later."""

    def __init__(self, stack_file: str, robot_name: str) -> None:
        super().__init__("hqp")
        self.robot = hqp.robots.load(robot_name)
        braking = hqp.Braking(resume="auto" if self.robot.floating else "ask")  # a humanoid that waits falls
        controller = hqp.Controller(serial.load(stack_file), braking=braking)
        self.session = controller.session(self.robot, dt=0.002, max_age=0.05)
        self.q, self.seen = None, 0.0
        self.v = np.zeros(self.robot.nv)
        self.create_subscription(JointState, "joint_states", self.take, 10)
        self.publisher = self.create_publisher(JointTrajectory, "joint_trajectory", 10)
        self.create_timer(0.002, self.step)

    def take(self, message: JointState) -> None:
        """Start the loop from the first measured state; afterwards it closes over the command while states come."""
        self.seen = monotonic()
        if self.q is not None:
            return
        places = dict(zip(message.name, message.position, strict=True))
        step = np.zeros(self.robot.nv)
        angles = self.robot.state(self.robot.home).angles
        for name, column in zip(self.robot.joint_names, self.robot.actuated, strict=True):
            step[column] = places[name] - angles[column]
        self.q = self.robot.integrate(self.robot.home, step, 1.0)

    def step(self) -> None:
        """Run one tick."""
        if self.q is None:
            return
        tick = self.session.step(self.robot.state(self.q, self.v, time=self.seen))
        if not tick.status.usable:
            self.get_logger().warning(f"{tick.status.name}: {tick.notes}", throttle_duration_sec=1.0)
        self.q, self.v = tick.advance()
        point = JointTrajectoryPoint()
        point.positions = self.robot.state(self.q).angles[self.robot.actuated].tolist()
        point.velocities = np.asarray(tick.command).tolist()
        point.time_from_start.nanosec = 2_000_000
        self.publisher.publish(JointTrajectory(joint_names=list(self.robot.joint_names), points=[point]))


if __name__ == "__main__":
    rclpy.init()
    rclpy.spin(StackNode(*sys.argv[1:3]))
