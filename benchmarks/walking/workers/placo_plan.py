"""A walk by placo, from a question in JSON to joint angles in NPZ; runs where placo is installed and hqp is not."""

from __future__ import annotations

import json
import sys

import numpy as np
import placo

DT = 0.002
SUPPORT_STEPS, PLANNED = 10, 60
"""Steps of the planner in a single support, and in all."""


def main(question: str, answer: str) -> None:
    """Plan, follow with kinematic tasks, write q ``(n, 7 + joints)``."""
    with open(question, encoding="utf-8") as file:
        asked = json.load(file)
    robot = placo.HumanoidRobot("", int(placo.Flags.ignore_collisions), asked["urdf"])
    at = [robot.model.joints[robot.model.getJointId(name)].idx_q for name in asked["names"]]
    start, q = np.array(asked["q"]), np.array(robot.state.q)
    q[:7], q[at] = start[:7], start[7:]
    robot.state.q = q
    robot.update_kinematics()
    solver = placo.KinematicsSolver(robot)
    solver.enable_velocity_limits(False)
    tasks = placo.WalkTasks()
    tasks.initialize_tasks(solver, robot)
    joints = solver.add_joints_task()
    joints.set_joints({n: float(x) for n, x in zip(asked["names"], start[7:], strict=True) if n not in asked["legs"]})
    joints.configure("joints", "soft", 1.0)
    solver.add_regularization_task(1e-6)
    tasks.reach_initial_pose(np.array(_left(robot)), asked["spacing"], asked["height"], 0.0)
    way = _planned(robot, asked)
    found = []
    for k in range(int(way.t_end / DT) + 1):
        tasks.update_tasks_from_trajectory(way, k * DT)
        robot.update_kinematics()
        for _ in range(1 if k else 20):  # the first frame settles
            solver.solve(True)
            robot.update_kinematics()
        now = np.array(robot.state.q)
        found.append(np.concatenate((now[:7], now[at])))
    np.savez(answer, q=np.array(found))


def _left(robot):
    return placo.flatten_on_floor(robot.get_T_world_left())


def _planned(robot, asked):
    """The walk pattern of steps of one length, beginning with the left foot."""
    p = placo.HumanoidParameters()
    p.single_support_duration, p.single_support_timesteps = asked["single"], SUPPORT_STEPS
    p.double_support_ratio = asked["double"] / asked["single"]
    p.startend_double_support_ratio = asked["first"] / asked["single"]
    p.planned_timesteps = PLANNED
    p.walk_com_height, p.walk_foot_height, p.walk_trunk_pitch = asked["height"], asked["lift"], 0.0
    p.walk_foot_rise_ratio, p.zmp_margin = 0.2, 0.02
    p.foot_length, p.foot_width, p.feet_spacing = asked["length"], asked["width"], asked["spacing"]
    p.foot_zmp_target_x, p.foot_zmp_target_y = asked["middle"], 0.0
    p.walk_max_dx_forward, p.walk_max_dx_backward, p.walk_max_dy, p.walk_max_dtheta = 0.5, 0.3, 0.3, 0.5
    planner = placo.FootstepsPlannerRepetitive(p)
    planner.configure(asked["speed"] * (asked["single"] + asked["double"]), 0.0, 0.0, asked["steps"])
    right = placo.flatten_on_floor(robot.get_T_world_right())
    steps = planner.plan(placo.HumanoidRobot_Side.left, _left(robot), right)
    supports = placo.FootstepsPlanner.make_supports(steps, 0.0, True, p.has_double_support(), True)
    return placo.WalkPatternGenerator(robot, p).plan(supports, robot.com_world(), 0.0)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
