"""mink: one weighted QP on MuJoCo; hard constraints are its equality constraints."""

from __future__ import annotations

import mink
import mujoco
import numpy as np
from side import WeighedTasks, main


def compiled(text, floating):
    """The URDF with massless frames kept, and a free joint."""
    spec = mujoco.MjSpec.from_string(
        text.replace(
            "</robot>",
            '<mujoco><compiler fusestatic="false" boundmass="1e-6" boundinertia="1e-9" balanceinertia="true" '
            'discardvisual="true"/></mujoco></robot>',
        )
    )
    if floating:
        spec.worldbody.first_body().add_freejoint()
    return spec.compile()


class Mink(WeighedTasks):
    def __init__(self, scene, dt, targets):
        self.model = model = compiled(scene["urdf"], scene["floating"])
        self.dt, self.names, self.floating = dt, scene["joints"], scene["floating"]
        q = model.qpos0.copy()
        if self.floating:
            x, y, z, w = scene["base"][3:]
            q[:3], q[3:7] = scene["base"][:3], (w, x, y, z)
        self.at = [int(model.joint(n).qposadr[0]) for n in self.names]
        self.columns = [int(model.joint(n).dofadr[0]) for n in self.names]
        q[self.at] = scene["angles"]
        self.q = q
        self.configuration = mink.Configuration(model)
        self.configuration.update(q)
        self.take(scene, targets)
        speeds = dict(zip(self.names, scene["speed"], strict=True))
        bounded = {n: s for n, s in speeds.items() if s < 1e3}
        self.limits = []
        if scene["limits"]:
            self.limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, bounded)]

    def com_task(self, cost, gain):
        return mink.ComTask(cost, gain=gain)

    def posture_task(self, cost, gain):
        return mink.PostureTask(self.model, cost, gain=gain)

    def frame_task(self, frame, position, orientation, gain):
        return mink.FrameTask(frame, "body", position, orientation, gain=gain)

    def moved(self, pose, kind, mask, value):
        if kind == "pose":
            return mink.SE3.from_matrix(value.reshape(4, 4))
        if kind == "orientation":
            turn = mink.SO3.from_matrix(value.reshape(3, 3))
            return mink.SE3.from_rotation_and_translation(turn, pose.translation())
        place = pose.translation().copy()
        place[mask] = value
        return mink.SE3.from_rotation_and_translation(pose.rotation(), place)

    def solve(self):
        self.configuration.update(self.q)
        self.v = mink.solve_ik(
            self.configuration, self.soft, self.dt, "daqp", limits=self.limits, constraints=self.hard or None
        )

    def advance(self):
        mujoco.mj_integratePos(self.model, self.q, self.v, self.dt)

    def base(self):
        if not self.floating:
            return np.zeros(7)
        w, x, y, z = self.q[3:7]
        return np.array([*self.q[:3], x, y, z, w])

    def com(self):
        return self.configuration.data.subtree_com[1].copy()


main(Mink)
