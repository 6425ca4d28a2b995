"""pink's task objects in strict levels, by hqp's solve_ik.  Needs pin-pink."""

import numpy as np
import pink
from pink.tasks import ComTask, FrameTask, PostureTask

import hqp
from hqp.adapters.pink import solve_ik

robot = hqp.robots.load("g1")
configuration = pink.Configuration(robot.model, robot.model.createData(), robot.home)
feet = [FrameTask(sole, 1.0, 1.0) for sole in robot.landmarks["soles"]]
com, posture = ComTask(1.0, gain=0.1), PostureTask(1.0, gain=0.02)
hand = FrameTask("right_wrist_yaw_link", 1.0, 0.0, gain=0.1)
for task in (*feet, com, hand, posture):
    task.set_target_from_configuration(configuration)
goal = hand.transform_target_to_world.copy()
goal.translation += np.array([0.1, 0.0, 0.15])
hand.set_target(goal)

dt = 0.01
for _ in range(200):
    velocity = solve_ik(configuration, [feet, [com], [hand], [posture]], dt, safety_break=False)
    configuration.integrate_inplace(velocity, dt)
error = np.linalg.norm(hand.compute_error(configuration)[:3])
print(f"hand {1e3 * error:.2f} mm off")
