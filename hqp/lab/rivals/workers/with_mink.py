"""mink: one weighted QP on MuJoCo; hard constraints are its equality constraints."""

from __future__ import annotations

import mink
import mujoco
import numpy as np
from side import main, weighed


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


class Mink:
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
        self.tasks, self.hard, self.soft = {}, [], []
        for t in scene["tasks"]:
            self._add(t, targets[t["name"]])
        speeds = dict(zip(self.names, scene["speed"], strict=True))
        bounded = {n: s for n, s in speeds.items() if s < 1e3}
        self.limits = []
        if scene["limits"]:
            self.limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, bounded)]
        self.v = np.zeros(model.nv)

    def _add(self, t, target):
        w, gain, mask = weighed(t, self.dt)
        kind = t["kind"]
        if kind == "com":
            task = mink.ComTask(w * mask, gain=gain)
        elif kind == "posture":
            task = mink.PostureTask(self.model, w, gain=gain)
        else:
            position, orientation = {
                "position": (w * mask, 0.0), "orientation": (0.0, w * mask), "pose": (w, w)
            }[kind]  # fmt: skip
            task = mink.FrameTask(t["frame"], "body", position, orientation, gain=gain)
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
        goal = task.transform_target_to_world
        if kind == "pose":
            task.set_target(mink.SE3.from_matrix(value.reshape(4, 4)))
        elif kind == "orientation":
            turn = mink.SO3.from_matrix(value.reshape(3, 3))
            task.set_target(mink.SE3.from_rotation_and_translation(turn, goal.translation()))
        else:
            place = goal.translation().copy()
            place[mask] = value
            task.set_target(mink.SE3.from_rotation_and_translation(goal.rotation(), place))

    def prepare(self):
        pass

    def solve(self):
        self.configuration.update(self.q)
        self.v = mink.solve_ik(
            self.configuration, self.soft, self.dt, "daqp", limits=self.limits, constraints=self.hard or None
        )

    def stop(self):
        self.v = np.zeros(self.model.nv)

    def advance(self):
        mujoco.mj_integratePos(self.model, self.q, self.v, self.dt)

    def base(self):
        if not self.floating:
            return np.zeros(7)
        w, x, y, z = self.q[3:7]
        return np.array([*self.q[:3], x, y, z, w])

    def angles(self):
        return self.q[self.at]

    def speeds(self):
        return self.v[self.columns]

    def com(self):
        return self.configuration.data.subtree_com[1].copy()


main(Mink)
