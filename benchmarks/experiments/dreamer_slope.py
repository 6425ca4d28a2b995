"""Dreamer pulled up a slope of 7 degrees and pushed back by a hand (Sentis et al. 2012, section IV, Fig. 5)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from benchmarks.experiments.cases import Case, carry_out
from benchmarks.experiments.compliance import Compliance, refusal
from benchmarks.experiments.human import Walk
from benchmarks.experiments.outcome import Figure, Outcome, Table, holds, number, table
from benchmarks.experiments.outing import RAMP_START, Measures, Outing, Scene, measure
from benchmarks.experiments.setting import Setting

NAMES = {"dreamer": "ball wheels", "dreamer_rollers": "rollers"}

PULL = Walk(speed=0.33, distance=0.95)
"""The human's way; the robot, on a spring, runs at 0.35 m/s."""

IMU_ONLY = Compliance(normals="base", gravity_share=0.65)
IMU_WALK = Walk(speed=0.30, distance=1.1)
"""The spring that carries a third of the robot's weight along the slope stretches: a longer way."""

MAPPED = Compliance(normals="map")
"""Full gravity compensation with normals from the robot's own map: IMU and wheel encoders, no force sensor."""

STAGED = Scene(
    plant="dreamer_rollers", out_of_place=1.0, enable=(8.0, 10.0), walk=replace(PULL, start=15.0)
)  # fmt: skip
"""The paper's timeline: upper body on at 8 s, base on at 10 s, pull from 15 s."""

TILT = Scene(slope=0.0, tilt=math.radians(7.0), enable=(0.0, math.inf), push=(0.0, 0.0, 0.0), seconds=8.0)
"""Fig. 3: the base is tilted by hand, its wheels braked."""


def experiment(setting: Setting) -> Outcome:
    """Both plants up and back; in full every variant, Fig. 5's timeline, Fig. 3's tilt and the negative tests."""
    outcome = Outcome("dreamer-slope")
    outcome.parameters = {
        "slope [deg]": 7.0,
        "ramp begins ahead of the base's middle at [m]": RAMP_START,
        "human": "spring 200 N/m, damper 200 N s/m, at most 120 N, in the ground plane",
        "human's way": PULL,
        "gains": Compliance(),
        "joint speed limits": "not enforced; see rates over the table's limits",
    }
    nominal = {}
    for plant in ("dreamer", "dreamer_rollers"):
        run = Outing(Scene(plant=plant, walk=PULL), Compliance(), setting.solver, setting.show).run()
        nominal[plant] = run
        outcome.figures += acceptance(NAMES[plant], measure(run))
        setting.log(outcome, plant, run.log)
        setting.advance()
    rollers = nominal["dreamer_rollers"]
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
    measures = carry_out(variants(setting.full), setting.solver, setting.jobs, setting.advance)
    outcome.figures += variant_figures(measures, setting.full)
    outcome.tables += [_limits(nominal), *([_variants(measures)] if setting.full else [])]
    negative = carry_out(negatives(setting.full), setting.solver, setting.jobs, setting.advance)
    outcome.figures += negative_figures(negative)
    refused = refusal(Compliance(axle_rolling=True))
    outcome.figures.append(holds("rolling rows along the axles are refused when compiled", bool(refused)))
    outcome.notes.append(f"Refusal of rolling rows along the axles: {refused}")
    setting.plot(outcome, "slope_panels", rollers)
    if setting.full:
        staged = Outing(STAGED, Compliance(), setting.solver, setting.show).run()
        outcome.figures += _staged(staged)
        setting.log(outcome, "staged", staged.log)
        setting.plot(outcome, "staged_panels", staged)
        tilted = Outing(TILT, Compliance(normals="base"), setting.solver, setting.show).run()
        outcome.figures += _tilted(tilted)
        setting.log(outcome, "tilt", tilted.log)
        setting.plot(outcome, "tilt_panels", tilted)
    return outcome


def acceptance(where: str, m: Measures) -> list[Figure]:
    """The figures of a run at 0.35 m/s on 7 degrees."""
    ball = where == NAMES["dreamer"]
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


def variants(full: bool) -> list[Case]:
    """IMU only and the robot's own map; in full also other speeds, control rate, flat ground and plateau."""
    rollers = Scene(plant="dreamer_rollers", walk=PULL)
    imu = [
        Case(
            name="IMU only, rollers",
            scene=replace(rollers, walk=IMU_WALK, seconds=None),
            choice=IMU_ONLY,
        ),
        Case(name="own map of heights, rollers", scene=rollers, choice=MAPPED),
    ]
    if not full:
        return imu
    return [
        *imu,
        Case(name="IMU only, ball wheels", scene=Scene(walk=IMU_WALK), choice=IMU_ONLY),
        Case(name="IMU only, full compensation, rollers", scene=rollers, choice=replace(IMU_ONLY, gravity_share=1.0)),
        Case(name="own map of heights, ball wheels", scene=Scene(walk=PULL), choice=MAPPED),
        Case(
            name="own map of heights, onto a plateau, rollers",
            scene=replace(rollers, top=0.06, walk=replace(PULL, distance=1.5)),
            choice=MAPPED,
        ),
        Case(name="0.2 m/s, ball wheels", scene=Scene(walk=replace(PULL, speed=0.19))),
        Case(name="0.2 m/s, rollers", scene=replace(rollers, walk=replace(PULL, speed=0.19))),
        Case(name="0.12 m/s, ball wheels", scene=Scene(walk=replace(PULL, speed=0.115))),
        Case(name="1 kHz, ball wheels", scene=Scene(walk=PULL), choice=Compliance(period=0.001)),
        Case(name="1 kHz, rollers", scene=rollers, choice=Compliance(period=0.001)),
        Case(name="flat, ball wheels", scene=Scene(slope=0.0, walk=PULL)),
        Case(name="flat, rollers", scene=replace(rollers, slope=0.0)),
        Case(name="onto a plateau, rollers", scene=replace(rollers, top=0.06, walk=replace(PULL, distance=1.5))),
        Case(name="projector, rollers", scene=rollers, solver="nullspace"),
    ]


def variant_figures(m: Mapping[str, Measures], full: bool) -> list[Figure]:
    """What is asked of the variants."""
    figures = []
    for name, r in m.items():
        reduced, mapped = name.startswith("IMU only") and "full" not in name, name.startswith("own map")
        if not reduced and not mapped:
            continue
        up, back, travel, pull = ("8.2", "7.5", "0.956", "54") if reduced else ("", "", "", "")
        figures += [
            Figure(f"{name}: CoM error, way up", r.com_up, "mm", high=10.0, before=up),
            Figure(f"{name}: CoM error, way back", r.com_back, "mm", high=10.0, before=back),
            Figure(f"{name}: travel", r.travel, "m", low=0.9, before=travel),
            Figure(f"{name}: pull, max", r.pull, "N", high=60.0, before=pull),
        ]
    if not full:
        return figures
    fell = m["IMU only, full compensation, rollers"].fell
    figures.append(holds("IMU only with full gravity compensation falls on the way back", fell > PULL.turn))
    for plant in NAMES.values():
        slow, fast = m[f"0.2 m/s, {plant}"], m[f"1 kHz, {plant}"]
        before = "2.1" if plant == "rollers" else "1.9"
        figures += [
            Figure(f"0.2 m/s, {plant}: speed", slow.speed, "m/s", 0.18, 0.22),
            Figure(f"0.2 m/s, {plant}: CoM error", slow.com, "mm", high=2.5, before=before),
            Figure(f"1 kHz, {plant}: CoM error", fast.com, "mm", high=6.0, before="4.8"),
        ]
    careful = m["0.12 m/s, ball wheels"]
    figures += [
        Figure("0.12 m/s: speed", careful.speed, "m/s", 0.11, 0.13),
        Figure("0.12 m/s: CoM error", careful.com, "mm", before="1.2"),
        Figure(
            f"0.12 m/s: joint speed over its limit, max ({careful.rate_joint})",
            careful.rate_ratio,
            high=1.0,
            before="0.78",
        ),
        Figure("0.12 m/s: torque over its limit, max", careful.torque_ratio, high=1.0),
    ]
    return figures


def negatives(full: bool) -> list[Case]:
    """Readings of the paper that fail, and how."""
    short = replace(PULL, back=False)
    scene = Scene(walk=short)
    cases = [Case(name="absolute Jacobians", scene=scene, choice=Compliance(absolute_jacobians=True))]
    if not full:
        return cases
    start = Scene(out_of_place=1.0, walk=replace(short, distance=0.3))
    uncapped = Compliance(com_acceleration=math.inf)
    return [
        *cases,
        Case(name="absolute damping", scene=scene, choice=Compliance(absolute_damping=True)),
        Case(name="CoM goal at the axles' height", scene=scene, choice=Compliance(goal_at_axles=True)),
        Case(name="no gyro", scene=scene, choice=Compliance(gyro=False)),
        Case(name="vertical normals", scene=scene, choice=Compliance(normals="vertical")),
        Case(name="contact normals in all rows", scene=scene, choice=Compliance(normals="contact in all")),
        Case(name="no CoM offset", scene=scene, choice=Compliance(com_goal=(0.0, 0.0))),
        Case(name="start out of place, CoM task unsaturated", scene=start, choice=uncapped),
        Case(name="start out of place, CoM task saturated", scene=start),
    ]


def negative_figures(m: Mapping[str, Measures]) -> list[Figure]:
    """Each mistake seen to fail in its own way."""
    figures = [holds("absolute Jacobians: falls", math.isfinite(m["absolute Jacobians"].fell), before="0.7 s of pull")]
    if len(m) == 1:
        return figures
    figures += [
        Figure("absolute damping: CoM error", m["absolute damping"].com_up, "mm", low=25.0, before="39"),
        Figure("goal at the axles: CoM error", m["CoM goal at the axles' height"].com_up, "mm", 11.0, 18.0, "14.4"),
        Figure("no gyro: CoM error", m["no gyro"].com_up, "mm", low=10.0, before="14.3"),
        Figure("vertical normals: gets no further than", m["vertical normals"].travel, "m", high=0.8, before="0.52"),
        holds("contact normals in all rows: falls", math.isfinite(m["contact normals in all rows"].fell)),
        Figure("no CoM offset: CoM error", m["no CoM offset"].com_up, "mm", low=25.0, before="38"),
        Figure("no CoM offset: posture error", m["no CoM offset"].posture, "deg", low=40.0, before="70"),
        holds(
            "start out of place, CoM task unsaturated: falls",
            math.isfinite(m["start out of place, CoM task unsaturated"].fell),
            before="0.6 s",
        ),
        holds(
            "start out of place, CoM task saturated: falls",
            math.isfinite(m["start out of place, CoM task saturated"].fell),
            wanted=False,
        ),
    ]
    return figures


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


def _variants(m: Mapping[str, Measures]) -> Table:
    header = ("run", "outcome", "CoM up / back [mm]", "travel [m]", "speed [m/s]", "pull [N]", "hand [mm]", "tick [us]")
    rows = [
        (
            name,
            "stands" if math.isnan(r.fell) else f"falls at {r.fell:.1f} s",
            f"{number(r.com_up)} / {number(r.com_back)}",
            number(r.travel),
            number(r.speed),
            number(r.pull),
            number(r.hand_pulled),
            f"{r.tick_us:.0f}",
        )
        for name, r in m.items()
    ]
    return table("Variants", header, rows)


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


def _tilted(run: Outing) -> list[Figure]:
    tilt = math.degrees(float(run.log["base"][:, 4].max()))
    return [
        holds("base tilted by hand: stays upright", not run.fallen),
        Figure("base tilted by hand: tilt reached", tilt, "deg", low=6.0),
        Figure("base tilted by hand: CoM error", measure(run).com, "mm", high=10.0, before="the paper's own claim: 10"),
    ]
