"""CBi by inverse dynamics (Mistry 2008, eq. (18) with [20], which the paper leaves to future work): torques, no servos.

The CoG moves from side to side as in Fig. 6.  Feet are reaction constraints; accelerations of CoG, pelvis and posture
become torques within the motors' limits and with a least load on each foot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

import hqp
from benchmarks.lab.curves import largest, rms, side, smooth
from benchmarks.lab.outcome import Figure, Outcome, Table, holds, number, table
from benchmarks.lab.recorder import Recorder
from benchmarks.lab.setting import Setting
from benchmarks.mistry2008.experiments.balance import (
    AHEAD,
    PERIOD,
    SENSES,
    SETTLE,
    SOLES,
    Knows,
    base_figures,
)
from benchmarks.mistry2008.experiments.cog import AMPLITUDE, FREQUENCY
from hqp import PD, Level, Stack
from hqp.arrays import Vec
from hqp.estimation import FeetEstimator
from hqp.robots.on_mujoco import Plane, Plant, Sensors
from hqp.tasks import Com, FixedContact, Orientation, Posture, TorqueLimits, UnilateralContact

CONTACT_LAW = PD(0.0, 40.0)
"""Contact law that damps residual motion of the feet from estimation and integration."""

LEAST_LOAD = 30.0
"""Least load of each foot [N]."""


def torque_stack() -> Stack:
    """CoG over the ground > pelvis and CoG height > posture, on two feet, within torques and loads; gains [1/s^2]."""
    feet = [FixedContact(frame=frame, name=frame) for frame in SOLES]
    loads = [UnilateralContact(contact=frame, minimum=LEAST_LOAD) for frame in SOLES]
    return Stack(
        Level(Com(axes="xy", law=PD(100.0), name="com_xy"), name="critical"),
        Level(
            Orientation(frame="pelvis", law=PD(50.0), name="base"),
            Com(axes="z", law=PD(50.0), name="com_z"),
            name="extraneous",
        ),
        Level(Posture(law=PD(50.0)), name="posture"),
        subject_to=[*feet, TorqueLimits(), *loads],
    )


@dataclass
class Swung:
    """Outcome of one run; ``error``: CoG minus goal over the ground, after settling ``(ticks, 2)`` [mm]."""

    log: Recorder
    error: Vec
    fell: float
    torque_share: float
    jump: float


def swing(setting: Setting, seconds: float, knows: Knows = "senses") -> Swung:
    """Run for ``seconds`` after the robot has settled."""
    robot = hqp.robots.load("cbi", rotors=True)
    sensors = SENSES if knows == "senses" else Sensors()
    plant = Plant(robot, actuation="torque", terrain=Plane(), sensors=sensors)
    controller = hqp.Controller(
        torque_stack(), hqp.Torque(contact_law=CONTACT_LAW), setting.solver, price=0, deadline=math.inf
    )
    session = controller.session(robot, PERIOD)
    com = session.stack.find("com_xy", Com)
    q, v = plant.reset()
    estimator = FeetEstimator(robot, SOLES, PERIOD, q) if knows == "senses" else None
    start = plant.com()[:2].copy()
    middle = np.mean([plant.place(frame)[0] for frame in SOLES], axis=0)[:2] + [AHEAD, 0.0]
    damping = np.array([plant.model.joint(name).damping[0] for name in robot.joint_names])
    limit = robot.effort_limit[robot.actuated]
    log, fell = Recorder(), math.nan

    def path(t: float) -> Vec:
        return start + smooth(t / SETTLE) * (middle - start) + side(max(t - SETTLE, 0.0), AMPLITUDE, FREQUENCY)

    h = PERIOD
    for i in range(round((SETTLE + seconds) / PERIOD)):
        t = i * PERIOD
        known = q, v
        if estimator is not None:
            reading = plant.measure()
            known = estimator.update(reading.q, reading.v, reading.accelerometer, reading.contacts.load)
        before, goal, after = path(max(t - h, 0.0)), path(t), path(t + h)
        rate, acceleration = (after - before) / (2.0 * h), (after - 2.0 * goal + before) / h**2
        state = robot.state(*known)
        tick = session.step(state, com.at(goal, velocity=rate, acceleration=acceleration))
        torque = np.clip(tick.command + damping * known[1][robot.actuated], -limit, limit)
        base_error = robot.difference(q, known[0])[:6]
        plant.step(torque, steps=round(PERIOD / plant.timestep))
        q, v = plant.state()
        log.add(t=t - SETTLE, com=plant.com(), com_goal=after, torque=torque, base_error=base_error)
        if not q[2] > 0.7 * robot.home[2]:
            fell = t
            break
    on = log["t"] >= 0.0
    error = 1e3 * (log["com"][:, :2] - log["com_goal"])[on]
    torques = log["torque"][on]
    share = float((np.abs(torques) / limit).max()) if torques.size else math.nan
    jump = float(np.abs(np.diff(torques, axis=0)).max()) if len(torques) > 1 else math.nan
    return Swung(log, error, fell, share, jump)


def experiment(setting: Setting) -> Outcome:
    """Run on the robot's own sensing, and for comparison on the simulator's base."""
    seconds = 15.0 if setting.full else 5.0
    outcome = Outcome("cbi-dynamics")
    run = swing(setting, seconds)
    setting.advance()
    outcome.figures += [
        holds(f"stands for {seconds:g} s", math.isnan(run.fell)),
        Figure("CoG left-right, RMS", rms(run.error[:, 1]), "mm", high=2.0),
        Figure("CoG front-back, RMS", rms(run.error[:, 0]), "mm", high=2.0),
        Figure("CoG, max", largest(run.error), "mm", high=5.0),
        Figure("motor torque of its limit, max", 100.0 * run.torque_share, "%", high=100.0),
        *base_figures(run.log),
    ]
    outcome.parameters = {
        "amplitude [m]": AMPLITUDE,
        "frequency [Hz]": FREQUENCY,
        "seconds": seconds,
        "sensors": SENSES,
        "contact law": CONTACT_LAW,
        "least load of a foot [N]": LEAST_LOAD,
    }
    setting.log(outcome, "run", run.log)
    outcome.tables.append(_knowing(setting, seconds, run))
    return outcome


def _knowing(setting: Setting, seconds: float, sensed: Swung) -> Table:
    rows = []
    for text, run in (
        ("IMU, encoders and feet, with noise", sensed),
        ("the simulator's base: privileged", swing(setting, seconds, "truth")),
    ):
        rms_x, rms_y = number(rms(run.error[:, 0])), number(rms(run.error[:, 1]))
        fell = "stands" if math.isnan(run.fell) else f"falls at {run.fell:.1f} s"
        rows.append((text, fell, rms_x, rms_y, number(largest(run.error)), number(run.jump)))
    header = (
        "what it knows", "outcome", "CoG x RMS [mm]", "y RMS [mm]", "max [mm]", "torque change a tick [N m]",
    )  # fmt: skip
    return table("What the controller knows", header, rows)
