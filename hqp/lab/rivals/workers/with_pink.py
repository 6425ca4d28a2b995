"""pink: one weighted QP; hard constraints are its equality constraints."""

from __future__ import annotations

import numpy as np
import pink
import pinocchio as pin
from pink.tasks import ComTask, FrameTask, PostureTask
from side import main, weighed


class Pink:
    def __init__(self, scene, dt, targets):
        root = pin.JointModelFreeFlyer() if scene["floating"] else None
        model = pin.buildModelFromXML(scene["urdf"], root) if root is not None else pin.buildModelFromXML(scene["urdf"])
        self.dt, self.model, self.names = dt, model, scene["joints"]
        self.q = pin.neutral(model)
        if scene["floating"]:
            self.q[:7] = scene["base"]
        ids = [model.getJointId(n) for n in self.names]
        self.at = [model.joints[i].idx_q for i in ids]
        self.columns = [model.joints[i].idx_v for i in ids]
        self.q[self.at] = scene["angles"]
        self.configuration = pink.Configuration(model, model.createData(), self.q)
        self.tasks, self.hard, self.soft = {}, [], []
        for t in scene["tasks"]:
            self._add(t, targets[t["name"]])
        self.limits = None if scene["limits"] else []
        self.v = np.zeros(model.nv)

    def _add(self, t, target):
        w, gain, mask = weighed(t, self.dt)
        kind = t["kind"]
        if kind == "com":
            task = ComTask(w * mask, gain=gain)
        elif kind == "posture":
            task = PostureTask(w, gain=gain)
        else:
            place, turn = (w * mask, 0.0), (0.0, w * mask)
            position, orientation = {"position": place, "orientation": turn, "pose": (w, w)}[kind]
            task = FrameTask(t["frame"], position, orientation, gain=gain)
        task.set_target_from_configuration(self.configuration)
        self.tasks[t["name"]] = (task, kind, mask > 0.0)
        (self.hard if t["level"] < 0 else self.soft).append(task)
        if kind != "posture":
            self.aim(t["name"], target)

    def aim(self, name, value):
        task, kind, mask = self.tasks[name]
        if kind == "com":
            goal = task.target_com.copy()
            goal[mask] = value
            task.set_target(goal)
            return
        goal = task.transform_target_to_world.copy()
        if kind == "pose":
            goal = pin.SE3(value.reshape(4, 4))
        elif kind == "orientation":
            goal.rotation = value.reshape(3, 3)
        else:
            place = goal.translation.copy()
            place[mask] = value
            goal.translation = place
        task.set_target(goal)

    def prepare(self):
        pass

    def solve(self):
        self.configuration.update(self.q)
        self.v = pink.solve_ik(
            self.configuration, self.soft, self.dt, "daqp", limits=self.limits, constraints=self.hard or None,
            safety_break=False,
        )  # fmt: skip

    def stop(self):
        self.v = np.zeros(self.model.nv)

    def advance(self):
        self.q = pin.integrate(self.model, self.q, self.v * self.dt)

    def base(self):
        return self.q[:7].copy()

    def angles(self):
        return self.q[self.at]

    def speeds(self):
        return self.v[self.columns]

    def com(self):
        return pin.centerOfMass(self.model, self.configuration.data, self.q)


main(Pink)
