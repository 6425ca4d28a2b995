"""pink: one weighted QP; hard constraints are its equality constraints."""

from __future__ import annotations

import pink
import pinocchio as pin
from pink.tasks import ComTask, FrameTask, PostureTask
from side import WeighedTasks, main


class Pink(WeighedTasks):
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
        self.take(scene, targets)
        self.limits = None if scene["limits"] else []

    def com_task(self, cost, gain):
        return ComTask(cost, gain=gain)

    def posture_task(self, cost, gain):
        return PostureTask(cost, gain=gain)

    def frame_task(self, frame, position, orientation, gain):
        return FrameTask(frame, position, orientation, gain=gain)

    def moved(self, pose, kind, mask, value):
        if kind == "pose":
            return pin.SE3(value.reshape(4, 4))
        goal = pose.copy()
        if kind == "orientation":
            goal.rotation = value.reshape(3, 3)
        else:
            place = goal.translation.copy()
            place[mask] = value
            goal.translation = place
        return goal

    def solve(self):
        self.configuration.update(self.q)
        self.v = pink.solve_ik(
            self.configuration, self.soft, self.dt, "daqp", limits=self.limits, constraints=self.hard or None,
            safety_break=False,
        )  # fmt: skip

    def advance(self):
        self.q = pin.integrate(self.model, self.q, self.v * self.dt)

    def base(self):
        return self.q[:7].copy()

    def com(self):
        return pin.centerOfMass(self.model, self.configuration.data, self.q)


main(Pink)
