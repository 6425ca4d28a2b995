"""tsid: accelerations and contact forces in one QP of two levels; feet are contacts, the rest weighs in the second.

A gain g [1/s] becomes Kp = 4 g^2 and Kd = 4 g, critically damped; accelerations are integrated.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pinocchio as pin
import tsid.tsid_pywrap as tsid  # the wheel has no __init__
from side import cost, main

SOLE = np.array([[-0.1, -0.1, 0.1, 0.1], [-0.05, 0.05, -0.05, 0.05], [0.0, 0.0, 0.0, 0.0]])


class Tsid:
    def __init__(self, scene, dt, targets):
        self.folder = tempfile.TemporaryDirectory()
        path = Path(self.folder.name) / "robot.urdf"
        path.write_text(scene["urdf"])
        paths = pin.StdVec_StdString()
        if scene["floating"]:
            self.robot = tsid.RobotWrapper(str(path), paths, pin.JointModelFreeFlyer(), False)
        else:
            self.robot = tsid.RobotWrapper(str(path), paths, False)
        self.model = model = self.robot.model()
        self.dt, self.names, self.floating = dt, scene["joints"], scene["floating"]
        ids = [model.getJointId(n) for n in self.names]
        self.at = [model.joints[i].idx_q for i in ids]
        self.columns = [model.joints[i].idx_v for i in ids]
        q = pin.neutral(model)
        if self.floating:
            q[:7] = scene["base"]
        q[self.at] = scene["angles"]
        self.q, self.v, self.t = q, np.zeros(model.nv), 0.0
        self.data = model.createData()
        self.form = tsid.InverseDynamicsFormulationAccForce("tsid", self.robot, False)
        self.form.computeProblemData(0.0, q, self.v)
        self.tasks, self.held = {}, []
        for t in scene["tasks"]:
            self._add(t, targets[t["name"]])
        if scene["limits"]:
            self._limit(scene)
        self.solver = tsid.SolverHQuadProgFast("qp")
        self.solver.resize(self.form.nVar, self.form.nEq, self.form.nIn)

    def _add(self, t, target):
        g, kind, hard = t["gain"], t["kind"], t["level"] < 0
        level, w = (0, 1.0) if hard else (1, cost(t["level"], t["weight"]) ** 2)
        kp, kd = 4.0 * g * g, 4.0 * g
        if kind == "posture":
            task = tsid.TaskJointPosture(t["name"], self.robot)
            n = self.robot.na
            task.setKp(kp * np.ones(n))
            task.setKd(kd * np.ones(n))
            sample = tsid.TrajectorySample(n)
            sample.value(self.q[7:].copy() if self.floating else self.q.copy())
            sample.derivative(np.zeros(n))
            sample.second_derivative(np.zeros(n))
            task.setReference(sample)
            self.form.addMotionTask(task, w, level, 0.0)
            self.held.append(task)
            return
        if kind == "com":
            task = tsid.TaskComEquality(t["name"], self.robot)
            task.setKp(kp * np.ones(3))
            task.setKd(kd * np.ones(3))
            task.setMask(np.array([1.0 if a in t["axes"] else 0.0 for a in "xyz"]))
            goal, size = np.array(self.robot.com(self.form.data())), 3
            self.form.addMotionTask(task, w, level, 0.0)
        else:
            place = self.robot.framePosition(self.form.data(), model_frame(self.model, t["frame"]))
            goal, size = place, 12
            if hard and kind == "pose" and self.floating and "held" not in t["name"]:
                contact = tsid.Contact6d(t["name"], self.robot, t["frame"], SOLE, np.array([0, 0, 1.0]), 0.6, 1.0, 3e3)
                contact.setKp(kp * np.ones(6))
                contact.setKd(kd * np.ones(6))
                contact.setReference(place)
                self.form.addRigidContact(contact, 1e-5)
                self.held.append(contact)
                return
            task = tsid.TaskSE3Equality(t["name"], self.robot, t["frame"])
            task.setKp(kp * np.ones(6))
            task.setKd(kd * np.ones(6))
            task.useLocalFrame(False)
            axes = [1.0 if a in t["axes"] else 0.0 for a in "xyz"]
            none = [0.0, 0.0, 0.0]
            mask = {"pose": [1.0] * 6, "position": axes + none, "orientation": none + axes}[kind]
            task.setMask(np.array(mask))
            self.form.addMotionTask(task, w, level, 0.0)
        self.tasks[t["name"]] = (task, kind, t["axes"], goal, tsid.TrajectorySample(size, min(size, 6)))
        self.aim(t["name"], target)

    def _limit(self, scene):
        task = tsid.TaskJointPosVelAccBounds("limits", self.robot, self.dt, False)
        low = self.model.lowerPositionLimit[7 if self.floating else 0 :]
        high = self.model.upperPositionLimit[7 if self.floating else 0 :]
        speed = self.model.velocityLimit[6 if self.floating else 0 :]
        task.setPositionBounds(low, high)
        task.setVelocityBounds(speed)
        task.setAccelerationBounds(np.full(self.robot.na, 1e3))
        self.form.addMotionTask(task, 1.0, 0, 0.0)
        self.held.append(task)

    def aim(self, name, value):
        task, kind, axes, goal, sample = self.tasks[name]
        if kind == "com":
            goal = np.array(goal)
            goal[["xyz".index(a) for a in axes]] = value
            sample.value(goal)
            sample.derivative(np.zeros(3))
            sample.second_derivative(np.zeros(3))
            task.setReference(sample)
            return
        whole = pin.SE3(goal)
        if kind == "pose":
            whole = pin.SE3(value.reshape(4, 4))
        elif kind == "orientation":
            whole.rotation = value.reshape(3, 3)
        else:
            place = whole.translation.copy()
            place[["xyz".index(a) for a in axes]] = value
            whole.translation = place
        sample.value(np.concatenate((whole.translation, whole.rotation.ravel(order="F"))))
        sample.derivative(np.zeros(6))
        sample.second_derivative(np.zeros(6))
        task.setReference(sample)

    def prepare(self):
        pass

    def solve(self):
        problem = self.form.computeProblemData(self.t, self.q, self.v)
        answer = self.solver.solve(problem)
        if answer.status != 0:
            raise RuntimeError(f"solver status {answer.status}")
        self.dv = self.form.getAccelerations(answer)
        self.now = self.v + self.dt * self.dv

    def stop(self):
        self.now = np.zeros(self.model.nv)

    def advance(self):
        self.v = self.now
        self.q = pin.integrate(self.model, self.q, self.dt * self.v)
        self.t += self.dt

    def base(self):
        return self.q[:7].copy()

    def angles(self):
        return self.q[self.at]

    def speeds(self):
        return self.now[self.columns] if hasattr(self, "now") else self.v[self.columns]

    def com(self):
        return pin.centerOfMass(self.model, self.data, self.q)


def model_frame(model, name):
    return model.getFrameId(name)


main(Tsid)
