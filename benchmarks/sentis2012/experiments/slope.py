"""Dreamer pulled up a slope of 7 degrees and pushed back by a hand (Sentis et al. 2012, section IV, Fig. 5)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from benchmarks.lab.outcome import Figure, Outcome, Table, holds, table
from benchmarks.lab.setting import Setting
from benchmarks.sentis2012.experiments import lyapunov
from benchmarks.sentis2012.experiments.cases import carry_out
from benchmarks.sentis2012.experiments.compliance import Compliance, gravity_share
from benchmarks.sentis2012.experiments.dreamer_run import Outing
from benchmarks.sentis2012.experiments.least_posture import least_posture_error, rms
from benchmarks.sentis2012.experiments.measures import Measures, measure
from benchmarks.sentis2012.experiments.scene import GROUND, RAMP_START, Scene
from benchmarks.sentis2012.experiments.variants import (
    IMU_ONLY,
    NAMES,
    PULL,
    SENSED,
    negative_figures,
    negatives,
    refusal,
    variant_figures,
    variant_table,
    variants,
)

STAGED = Scene(
    plant="dreamer_rollers", out_of_place=1.0, enable=(8.0, 10.0), walk=replace(PULL, start=15.0)
)  # fmt: skip
"""The paper's timeline: upper body on at 8 s, base on at 10 s, pull from 15 s."""

TILT = Scene(slope=0.0, tilt=math.radians(7.0), enable=(0.0, math.inf), push=(0.0, 0.0, 0.0), seconds=8.0)
"""Fig. 3: the base is tilted by hand, its wheels braked."""


def experiment(setting: Setting) -> Outcome:
    """Run up and back: on the robot's own sensing, and both plants with privileged normals.

    In full, also every variant, Fig. 5's timeline, Fig. 3's tilt and the negative controls.
    """
    outcome = Outcome("dreamer-slope")
    outcome.parameters = {
        "slope [deg]": 7.0,
        "ramp begins ahead of the base's middle at [m]": RAMP_START,
        "ground, MuJoCo's numbers": GROUND,
        "human": "spring 200 N/m, damper 200 N s/m, at most 120 N, in the ground plane",
        "human's way": PULL,
        "gains": Compliance(),
        "joint speed limits": "not enforced; see rates over the table's limits",
    }
    sensed = Outing(SENSED.scene, SENSED.choice, setting.solver, setting.show).run()
    setting.log(outcome, "own_map", sensed.log)
    setting.advance()
    nominal = {}
    for plant in ("dreamer", "dreamer_rollers"):
        run = Outing(Scene(plant=plant, walk=PULL), Compliance(), setting.solver, setting.show).run()
        nominal[plant] = run
        outcome.figures += acceptance(f"{NAMES[plant]}, privileged", measure(run), plant == "dreamer")
        setting.log(outcome, plant, run.log)
        setting.advance()
    rollers = nominal["dreamer_rollers"]
    outcome.figures += _least(nominal["dreamer"])
    outcome.figures += setting.speed(rollers.real_time, 3.0)
    outcome.figures.append(
        Figure(
            "tick, sensors to torque, median",
            measure(rollers).tick_us,
            "us",
            high=400.0,
            before="600 in NumPy",
            binding=False,
        )
    )
    others = carry_out(variants(setting.full), setting.solver, setting.jobs, setting.advance)
    measures = {SENSED.name: measure(sensed), **others}
    outcome.figures += variant_figures(measures, setting.full)
    outcome.tables += [
        _shares(nominal["dreamer"]),
        _limits(nominal),
        *([variant_table(measures)] if setting.full else []),
    ]
    negative = carry_out(negatives(setting.full), setting.solver, setting.jobs, setting.advance)
    outcome.figures += negative_figures(negative)
    refused = refusal(Compliance(axle_rolling=True))
    outcome.figures.append(holds("rolling rows along the axles are refused when compiled", bool(refused)))
    outcome.notes.append(f"Refusal of rolling rows along the axles: {refused}")
    setting.plot(outcome, "slope_panels", sensed)
    if setting.full:
        staged = Outing(STAGED, Compliance(), setting.solver, setting.show).run()
        outcome.figures += _staged(staged)
        setting.log(outcome, "staged", staged.log)
        setting.plot(outcome, "staged_panels", staged)
        tilted = Outing(TILT, Compliance(normals="base"), setting.solver, setting.show).run()
        outcome.figures += _tilted(tilted)
        rolling = Outing(replace(TILT, enable=(0.0, 0.0)), Compliance(), setting.solver, setting.show).run()
        outcome.figures += _tilted(rolling, "base tilted by hand, wheels rolling")
        moved = 1e3 * float(np.abs(rolling.log["base"][:, :2]).max())
        outcome.figures.append(Figure("base tilted by hand, wheels rolling: it rolls by", moved, "mm"))
        found, falling = lyapunov.decay(setting)
        outcome.figures += found
        outcome.tables.append(falling)
        setting.log(outcome, "tilt", tilted.log)
        setting.plot(outcome, "tilt_panels", tilted)
    return outcome


def acceptance(where: str, m: Measures, ball: bool) -> list[Figure]:
    """Figures of a run at 0.35 m/s on 7 degrees, with earlier studies' results on ball wheels or rollers."""
    return [
        holds(f"{where}: stays upright", math.isnan(m.fell)),
        Figure(f"{where}: CoM error, way up", m.com_up, "mm", high=6.0, before="4.4" if ball else "4.8"),
        Figure(f"{where}: CoM error, way back", m.com_back, "mm", high=6.0, before="2.8"),
        Figure(f"{where}: travel", m.travel, "m", low=0.9, before=".969" if ball else ".954"),
        Figure(f"{where}: speed, median of the pull", m.speed, "m/s", 0.30, 0.40, before=".352" if ball else ".339"),
        Figure(f"{where}: speed, peak", m.peak_speed, "m/s", before=".39" if ball else ".40"),
        Figure(f"{where}: pull, max", m.pull, "N", high=50.0, before="32" if ball else "35"),
        Figure(f"{where}: hand error under pull", m.hand_pulled, "mm", high=40.0, before="12"),
        Figure(f"{where}: hand error at rest", m.hand_rest, "mm", high=1.0, before=".000" if ball else ".002"),
        Figure(f"{where}: posture error, max", m.posture, "deg", high=32.0, before="27" if ball else "28"),
        Figure(f"{where}: biarticular coupling", m.coupling, "deg", high=0.02, before=".009"),
        Figure(f"{where}: time with an unloaded wheel", 1e3 * m.unloaded, "ms", high=0.0, before="0"),
        Figure(f"{where}: wheel load, 0.5 % quantile", m.load_quantile, "N", low=60.0, before="144" if ball else "96"),
        Figure(f"{where}: wheel load, min", m.load_least, "N", before="12" if ball else "59"),
        Figure(f"{where}: wheel torque, max", m.wheel_torque, "N m", high=10.0, before="5.8" if ball else "7.2"),
        Figure(f"{where}: slip of a wheel, max", m.slip, "m/s", before=".021" if ball else ".005"),
    ]


def _least(run: Outing) -> list[Figure]:
    """Posture error while the human stands still on the slope, against the least under the levels above."""
    t, walk = run.log["t"], run.scene.walk
    at = int(np.argmin(np.abs(t - (walk.turn - 0.2))))
    found, least = least_posture_error(run, run.log["q"][at])
    return [
        Figure("posture error at rest on the slope, RMS of joints", rms(found), "deg"),
        Figure("the least that CoM and hand leave there", rms(least), "deg"),
        Figure("posture error over the least", rms(found) / rms(least), high=1.05),
    ]


def _shares(run: Outing) -> Table:
    """Share of the weight along the slope that the wheels hold if the robot knows only the tilt."""
    weight = 9.81 * run.robot.mass
    rows = []
    for degrees in (0.0, 1.0, 2.0, 3.0, 5.0, 7.0, 8.0, 10.0):
        angle = math.radians(degrees)
        share = gravity_share(np.array([-math.sin(angle), 0.0, math.cos(angle)]), IMU_ONLY.carried, weight)
        along = weight * math.sin(angle)
        rows.append((f"{degrees:g}", f"{share:.2f}", f"{along:.0f}", f"{(1.0 - share) * along:.0f}"))
    header = ("tilt [deg]", "share the wheels hold", "weight along the slope [N]", "left to the human [N]")
    return table("IMU only: share = 1 - min(0.4, 40 N / (m g sin tilt))", header, rows)


def _limits(runs: Mapping[str, Outing]) -> Table:
    """Joint speeds and torques of the nominal runs over the table's limits."""
    rows = []
    for plant, run in runs.items():
        on = run.log["t"] >= 0.5
        robot = run.robot
        speed = abs(run.log["rate"][on]).max(axis=0) / robot.velocity_limit[robot.actuated]
        torque = abs(run.log["torque"][on]).max(axis=0) / robot.effort_limit[robot.actuated]
        rows += [
            (NAMES[plant], "speed", *(f"{x:.2f}" for x in speed)),
            (NAMES[plant], "torque", *(f"{x:.2f}" for x in torque)),
        ]
    names = next(iter(runs.values())).robot.joint_names
    return table("Largest speed and torque over the table's limit", ("plant", "", *names), rows)


def _staged(run: Outing) -> list[Figure]:
    base_on = run.scene.enable[1]
    t, com = run.log["t"], 1e3 * (run.log["com"] ** 2).sum(axis=1) ** 0.5
    upper_on = run.scene.enable[0]
    before, at_base_on = (float(com[(t >= on - 0.1) & (t < on)].max()) for on in (upper_on, base_on))
    settled = measure(run, since=run.scene.walk.start - 1.0)
    posture = abs(run.log["posture"])
    return [
        holds("paper's timeline: stays upright", not run.fallen),
        Figure("paper's timeline: posture error before the upper body is on", 57.3 * float(posture[0].max()), "deg"),
        Figure("paper's timeline: CoM error when the upper body comes on", before, "mm", before="62"),
        Figure("paper's timeline: CoM error when the base comes on", at_base_on, "mm"),
        Figure("paper's timeline: CoM error, way up", settled.com_up, "mm", high=6.0, before="4.5 to 5.2"),
        Figure("paper's timeline: CoM error, way back", settled.com_back, "mm", high=6.0),
        Figure("paper's timeline: posture error just before the pull", _before_pull(run), "deg"),
    ]


def _before_pull(run: Outing) -> float:
    t, start = run.log["t"], run.scene.walk.start
    return math.degrees(float(abs(run.log["posture"][(t > start - 0.1) & (t < start)]).max()))


def _tilted(run: Outing, what: str = "base tilted by hand") -> list[Figure]:
    tilt = math.degrees(float(run.log["base"][:, 4].max()))
    return [
        holds(f"{what}: stays upright", not run.fallen),
        Figure(f"{what}: tilt reached", tilt, "deg", low=6.0),
        Figure(f"{what}: CoM error", measure(run).com, "mm", high=10.0, before="the paper's own claim: 10"),
    ]
