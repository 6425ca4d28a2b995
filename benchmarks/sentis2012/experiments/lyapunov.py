"""Eqs. (36) to (44) in physics: the posture law's Lyapunov function along the motion of the simulated robot."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from benchmarks.lab.outcome import Figure, Table, number, table
from benchmarks.lab.setting import Setting
from benchmarks.sentis2012.experiments.compliance import Compliance
from benchmarks.sentis2012.experiments.dreamer_run import Outing
from benchmarks.sentis2012.experiments.human import Walk
from benchmarks.sentis2012.experiments.scene import Scene
from hqp.arrays import Vec
from hqp.torque.self_motion import free_directions

STILL = Scene(slope=0.0, out_of_place=0.5, walk=Walk(start=99.0), seconds=2.0)
"""Scene without a pull; posture errors of 4 to 10 degrees at the start."""

FROM, TO = 0.3, 1.0
"""Window of the rate of decay [s], after the saturation of the CoM task."""


def followed(setting: Setting, ke: float, plant: str = "dreamer") -> tuple[Vec, Vec]:
    """Times and V = E^T E / 2 at each tick, E = Phi (-kp e - kv qd), Phi onto the null space of the tasks above."""
    choice = Compliance(self_motion=ke)
    times: list[float] = []
    values: list[float] = []

    def seen(run: Outing) -> None:
        rows = run.session.program.assembly  # contacts, coupling and the tasks above: the posture picks coordinates
        index = run.robot.joints("upper_body")
        basis = free_directions(rows.J, index)
        y = -choice.posture * run.log.last("posture") - 2.0 * math.sqrt(choice.posture) * run.log.last("v")[index]
        times.append(run.t)
        values.append(0.5 * float(np.sum((basis.T @ y) ** 2)))

    Outing(replace(STILL, plant=plant), choice, setting.solver, seen).run()
    return np.array(times), np.array(values)


def decay(setting: Setting) -> tuple[list[Figure], Table]:
    """The rate at which V falls in physics against 2 k_E, for three k_E and on both plants."""
    figures, rows = [], []
    for plant in ("dreamer", "dreamer_rollers"):
        for ke in (1.0, 2.0, 4.0):
            t, V = followed(setting, ke, plant)
            on = (t >= FROM) & (t <= TO)
            rate = -float(np.polyfit(t[on], np.log(V[on]), 1)[0])
            rows.append((plant, f"{ke:g}", f"{2.0 * ke:g}", number(rate), number(float(V[-1] / V[0]))))
            if plant == "dreamer" and ke == 2.0:
                what = "V of eq. (40) falls at a rate of, k_E = 2/s (2 k_E by eq. 43)"
                figures.append(Figure(what, rate, "1/s", 3.6, 4.4))
    header = ("plant", "k_E [1/s]", "2 k_E [1/s]", f"rate of V, {FROM:g} to {TO:g} s [1/s]", "V after 2 s / at first")
    return figures, table("Lyapunov's function of the posture law, eqs. (36) to (44), in physics", header, rows)
