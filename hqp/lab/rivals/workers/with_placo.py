"""placo: one weighted QP; hard constraints are its hard tasks.  Targets are scaled: it meets a task in one step."""

from __future__ import annotations

import numpy as np
import placo
from side import cost, main


class Placo:
    def __init__(self, scene, dt, targets):
        self.robot = robot = placo.RobotWrapper("", placo.Flags.ignore_collisions, scene["urdf"])
        self.dt, self.names, self.floating = dt, scene["joints"], scene["floating"]
        self.model = robot.model
        ids = [self.model.getJointId(n) for n in self.names]
        self.at = [self.model.joints[i].idx_q for i in ids]
        self.columns = [self.model.joints[i].idx_v for i in ids]
        q = np.array(robot.state.q)
        if self.floating:
            q[:7] = scene["base"]
        q[self.at] = scene["angles"]
        robot.state.q = q
        robot.update_kinematics()
        self.q = q
        self.solver = solver = placo.KinematicsSolver(robot)
        solver.dt = dt
        if not self.floating:
            solver.mask_fbase(True)
        if scene["limits"]:
            solver.enable_joint_limits(True)
            solver.enable_velocity_limits(True)
        self.tasks = {}
        for t in scene["tasks"]:
            self._add(t, targets[t["name"]])
        self.v = np.zeros(len(self.names))

    def _add(self, t, target):
        hard = t["level"] < 0
        priority = "hard" if hard else "soft"
        w = 1.0 if hard else cost(t["level"], t["weight"]) ** 2  # placo's weight multiplies the square
        kind, name = t["kind"], t["name"]
        if kind == "posture":
            task = self.solver.add_joints_task()
            task.set_joints({n: float(self.robot.get_joint(n)) for n in self.names})
            task.configure(name, priority, w)
            held = [float(self.robot.get_joint(n)) for n in self.names]
            self.tasks[name] = (task, kind, t, np.array(held))
            return
        if kind == "com":
            task = self.solver.add_com_task(self.robot.com_world())
            task.mask.set_axises(t["axes"], "task")
            task.configure(name, priority, w)
            goal = np.array(self.robot.com_world())
        elif kind == "pose":
            task = self.solver.add_frame_task(t["frame"], self.robot.get_T_world_frame(t["frame"]))
            task.configure(name, priority, w, w)
            goal = np.array(self.robot.get_T_world_frame(t["frame"]))
        elif kind == "position":
            goal = np.array(self.robot.get_T_world_frame(t["frame"]))[:3, 3].copy()
            task = self.solver.add_position_task(t["frame"], goal)
            task.mask.set_axises(t["axes"], "task")
            task.configure(name, priority, w)
        else:
            goal = np.array(self.robot.get_T_world_frame(t["frame"]))[:3, :3].copy()
            task = self.solver.add_orientation_task(t["frame"], goal)
            task.mask.set_axises(t["axes"], "task")
            task.configure(name, priority, w)
        self.tasks[name] = (task, kind, t, goal)
        self.aim(name, target)

    def aim(self, name, value):
        task, kind, t, goal = self.tasks[name]
        if kind in ("com", "position"):
            goal = np.array(goal)
            goal[["xyz".index(a) for a in t["axes"]]] = value
            self.tasks[name] = (task, kind, t, goal)
        else:
            self.tasks[name] = (task, kind, t, value.reshape(4, 4) if kind == "pose" else value.reshape(3, 3))

    def prepare(self):
        """Set the target of this step: the share gain dt of the way, so that the law is the one of the others."""
        robot = self.robot
        for task, kind, t, goal in self.tasks.values():
            share = min(1.0, t["gain"] * self.dt)
            if kind == "com":
                here = np.array(robot.com_world())
                task.target_world = here + share * (goal - here)
            elif kind == "position":
                here = np.array(robot.get_T_world_frame(t["frame"]))[:3, 3]
                task.target_world = here + share * (goal - here)
            elif kind == "posture":
                here = self.q[self.at]
                task.set_joints(dict(zip(self.names, here + share * (goal - here), strict=True)))
            elif kind == "pose":
                task.T_world_frame = placo.interpolate_frames(robot.get_T_world_frame(t["frame"]), goal, share)
            else:
                whole = np.eye(4)
                whole[:3, :3] = goal
                here = np.array(robot.get_T_world_frame(t["frame"]))
                here[:3, 3] = 0.0
                task.R_world_frame = placo.interpolate_frames(here, whole, share)[:3, :3]

    def solve(self):
        self.solver.solve(True)
        self.robot.update_kinematics()
        q = np.array(self.robot.state.q)
        self.v = (q[self.at] - self.q[self.at]) / self.dt
        self.next = q

    def stop(self):
        self.next, self.v = self.q, np.zeros(len(self.names))
        self.robot.state.q = self.q
        self.robot.update_kinematics()

    def advance(self):
        self.q = self.next

    def base(self):
        return self.q[:7].copy()

    def angles(self):
        return self.q[self.at]

    def speeds(self):
        return self.v

    def com(self):
        return np.array(self.robot.com_world())


main(Placo)
