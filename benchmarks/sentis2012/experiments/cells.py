"""Scenes of Dreamer's controller: one change at a time, and scenes with active limits."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from benchmarks.sentis2012.experiments.cases import Case
from benchmarks.sentis2012.experiments.compliance import Compliance
from benchmarks.sentis2012.experiments.human import SpringHand
from benchmarks.sentis2012.experiments.scene import Scene
from benchmarks.sentis2012.experiments.variants import FELT, IMU_ONLY, IMU_WALK, MAPPED, NAMES, ONE, PULL
from hqp.robots.on_mujoco import Noise, Sensors

ONE_CM = 10.0
"""The paper's claim [mm]."""

NOISY = Sensors(
    orientation=Noise(1e-3), gyro=Noise(0.01), angle=Noise(1e-4), rate=Noise(0.01), force=Noise(3.0)
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A case with the limit of its CoM error [mm]: inf promises no fall, None nothing."""

    case: Case
    group: str
    limit: float | None = None


def cells() -> list[Cell]:
    """The table."""
    found: list[Cell] = []

    def add(
        group: str,
        name: str,
        scene: Scene,
        choice: Compliance = Compliance(),  # noqa: B008 (a frozen value)
        *,
        limit: float | None = None,
    ) -> None:
        found.append(Cell(case=Case(name=f"{group}, {name}", scene=scene, choice=choice), group=group, limit=limit))

    ball, rollers = Scene(walk=PULL), Scene(plant="dreamer_rollers", walk=PULL)
    for scene, slopes in ((ball, (0, 3, 5, 7, 8, 10, 12, 15, 20)), (rollers, (0, 3, 5, 7, 8, 10, 12))):
        for slope in slopes:
            limit = 6.0 if slope <= 7 else 8.0 if slope == 8 else None
            if slope in (10, 12) and scene is ball:
                limit = math.inf
            add("slope", f"{slope} deg, {NAMES[scene.plant]}", replace(scene, slope=float(slope)), limit=limit)
    for friction in (1.0, 0.5, 0.3, 0.25, 0.2, 0.15):
        limit = 6.0 if friction >= 0.25 else None
        add("friction", f"{friction:g}, rollers", replace(rollers, friction=friction), limit=limit)
    for speed in (0.2, 0.5, 0.6, 0.8):
        scene = replace(ball, walk=replace(PULL, speed=0.95 * speed, distance=max(0.95, 2.0 * speed)))
        add("pull speed", f"{speed:g} m/s, ball wheels", scene, limit=2.5 if speed <= 0.2 else None)
    for force in (20.0, 40.0, 60.0, 80.0):
        scene = Scene(slope=0.0, push=(force, 0.0, 0.0), seconds=5.0)
        add("step pull", f"{force:g} N ahead, flat", scene, limit=6.0 if force <= 60.0 else None)
    for force in (40.0, 50.0, 60.0):
        scene = Scene(slope=0.0, push=(0.0, force, 0.0), seconds=5.0)
        limit = 6.0 if force < 60.0 else None  # 60 N are promised below, by limits
        add("step pull", f"{force:g} N aside, flat", scene, limit=limit)
    add("step pull", "60 N aside, flat, motors twice as strong", replace(scene, strength=2.0))
    for hz in (100, 200, 500, 1000):
        add("control rate", f"{hz} Hz, ball wheels", ball, Compliance(period=1.0 / hz), limit=6.0)
    for ms, limit in ((2, 6.0), (4, 8.0), (10, 8.0)):
        add("delay", f"{ms} ms, ball wheels", replace(ball, delay=1e-3 * ms), limit=limit)
    add("delay", "4 ms, rollers", replace(rollers, delay=0.004), limit=9.0)
    noisy = replace(rollers, delay=0.004, sensors=NOISY)
    add("noise", "all sensors, 4 ms, rollers", noisy, limit=9.0)
    add("noise", "all sensors, ball wheels", replace(ball, sensors=NOISY), limit=9.0)
    add("noise", "all sensors, 4 ms, rollers, own map", noisy, MAPPED, limit=ONE_CM)
    for degrees, limit in ((0.25, 10.0), (0.5, 15.0), (1.0, None), (2.0, None)):
        biased = Sensors(orientation=Noise(bias=(0.0, math.radians(degrees), 0.0)))
        add("pitch bias", f"{degrees:g} deg, ball wheels", replace(ball, sensors=biased), limit=limit)
    for degrees in (0.5, 1.0):
        biased = Sensors(orientation=Noise(bias=(math.radians(degrees), 0.0, 0.0)))
        scene = replace(ball, sensors=biased)
        add("roll bias", f"{degrees:g} deg, ball wheels", scene, limit=math.inf)
    for mass in (0.5, 1.0):
        add("payload", f"{mass:g} kg at the hand, ball wheels", replace(ball, payload=mass))
    add("mass error", "upper body 10 % heavier, ball wheels", replace(ball, extra_mass=1.1))
    for degrees in (5, 10, 20, 30, 45, 60, 90):
        limit = 10.0 if degrees <= 45 else math.inf if degrees == 90 else None  # 60: promised below, the torso turns
        scene = replace(rollers if degrees <= 45 else ball, heading=math.radians(degrees))
        add("heading", f"{degrees} deg, {NAMES[scene.plant]}", scene, limit=limit)
    for degrees in (60, 90):
        for scene in (ball, rollers):
            name = f"{degrees} deg, turns to where it is led, {NAMES[scene.plant]}"
            turned = replace(scene, heading=math.radians(degrees))
            add("heading", name, turned, Compliance(turn=0.6), limit=ONE_CM)
    for degrees in (10, 20, 30, 45):
        turned = replace(rollers, heading=math.radians(degrees))
        add("heading", f"{degrees} deg, rollers, own map", turned, MAPPED, limit=ONE_CM)
    add("slope", "8 deg, rollers, own map", replace(rollers, slope=8.0), MAPPED, limit=ONE_CM)
    for degrees in (0, 3, 5, 8):
        tilted = replace(rollers, slope=float(degrees), walk=IMU_WALK)
        add("slope", f"{degrees} deg, rollers, IMU only", tilted, IMU_ONLY, limit=ONE_CM)
    # possible by physics: a hierarchy with the limits succeeds, the projector fails
    bounded = Compliance(limits=True, com_acceleration=math.inf)
    add("slope", "12 deg, rollers, with limits", replace(rollers, slope=12.0), bounded, limit=ONE_CM)
    aside = Scene(slope=0.0, push=(0.0, 60.0, 0.0), seconds=5.0)
    kept = replace(bounded, least_load=60.0)
    add("step pull", "60 N aside, flat, with limits", aside, kept, limit=ONE_CM)
    sensed = replace(bounded, least_load=90.0, normals="base")
    add("step pull", "60 N aside, flat, with limits, tilt alone", aside, sensed, limit=ONE_CM)
    on_rollers = replace(aside, plant="dreamer_rollers")
    add("step pull", "60 N aside, flat, with limits, tilt alone, rollers", on_rollers, sensed, limit=ONE_CM)
    # the benefit of a measured force at the hand
    add("step pull", "60 N aside, flat, force measured", aside, replace(kept, wrench="measured"), limit=ONE_CM)
    observed = replace(kept, wrench="observed", bandwidth=100.0)
    add("step pull", "60 N aside, flat, force observed", aside, observed, limit=ONE_CM)
    felt = replace(bounded, wrench="observed")
    add("slope", "7 deg, rollers, force observed", rollers, Compliance(wrench="observed"), limit=6.0)
    add("slope", "7 deg, rollers, own map, force observed", rollers, replace(MAPPED, wrench="observed"), limit=6.0)
    add("slope", "12 deg, rollers, with limits, force observed", replace(rollers, slope=12.0), felt, limit=ONE_CM)
    for scene in (ball, rollers):
        loaded, plant = replace(scene, payload=1.0), NAMES[scene.plant]
        known = Compliance(payload="known", wrench="observed")
        add("payload", f"1 kg, known, {plant}", loaded, known, limit=ONE_CM)
        found_out = Compliance(payload="observed", wrench="observed")
        add("payload", f"1 kg, unknown, observed, {plant}", loaded, found_out, limit=ONE_CM)
        own = replace(FELT, payload="observed", wrench="observed")
        add("payload", f"1 kg, unknown, observed, {plant}, ground felt", loaded, own, limit=ONE_CM)
        turned = replace(scene, heading=math.radians(60.0))
        add("heading", f"60 deg, kept, torso turns, {plant}", turned, Compliance(torso=1.0), limit=ONE_CM)
        own = replace(MAPPED, torso=1.0)
        add("heading", f"60 deg, kept, torso turns, {plant}, own map", turned, own)
        felt_too = replace(FELT, torso=1.0)
        add("heading", f"60 deg, kept, torso turns, {plant}, ground felt", turned, felt_too, limit=ONE_CM)
    for degrees in (30, 45, 60):
        angle, name = math.radians(degrees), f"{degrees} deg off the fall line, rollers"
        oblique = replace(rollers, heading=angle, hand=SpringHand(direction=angle))
        limit = ONE_CM if degrees == 30 else None
        add("cross slope", name, oblique, limit=limit)
        add("cross slope", f"{name}, own map", oblique, MAPPED, limit=limit)
        add("cross slope", f"{name}, ground felt", oblique, FELT, limit=ONE_CM if degrees <= 45 else None)
    for way, choice in (("", Compliance()), (", ground felt", FELT)):  # FELT cannot sense the ground in time
        told = replace(choice, torso=1.0, faces=0.0)
        add(
            "cross slope", f"60 deg off the fall line, torso told to face it, rollers{way}", oblique, told, limit=ONE_CM
        )
    add("noise", "all sensors, 4 ms, rollers, ground felt", noisy, FELT, limit=ONE_CM)
    turned = replace(noisy, heading=math.radians(45.0), hand=SpringHand(direction=math.radians(45.0)))
    add("cross slope", "45 deg, noise, 4 ms, rollers, ground felt", turned, FELT, limit=ONE_CM)
    for degrees in (0, 8, 10):
        limit = ONE_CM if degrees <= 8 else None
        add("slope", f"{degrees} deg, rollers, ground felt", replace(rollers, slope=float(degrees)), FELT, limit=limit)
    add("heading", "45 deg, rollers, ground felt", replace(rollers, heading=math.radians(45.0)), FELT, limit=ONE_CM)
    add("mass error", "upper body 10 % heavier, rollers, ground felt", replace(rollers, extra_mass=1.1), FELT)
    for name, rough in (("bumps of 5 mm", {"bumps": 0.005}), ("a step of 10 mm", {"step": 0.01})):
        for scene in (ball, rollers):
            add("rough", f"{name}, {NAMES[scene.plant]}", replace(scene, slope=0.0, **rough))  # type: ignore[arg-type]
    add("rough", "bumps of 5 mm, rollers, own map", replace(rollers, slope=0.0, bumps=0.005), MAPPED)
    add("rough", "bumps of 5 mm, rollers, ground felt", replace(rollers, slope=0.0, bumps=0.005), FELT)
    add("rough", "a step of 2 mm, rollers", replace(rollers, slope=0.0, step=0.002))
    add("heading", "180 deg, ball wheels", replace(ball, heading=math.pi))
    combined = replace(
        rollers, slope=7.0, friction=0.5, delay=0.004, heading=math.radians(5.0), extra_mass=1.02,
        sensors=replace(NOISY, orientation=Noise(1e-3, (0.0, math.radians(0.25), 0.0))),
        hand=SpringHand(stiffness=300.0),
    )  # fmt: skip
    add("combined", "rollers", combined, limit=14.0)
    for name, scene, limit in duties():
        add("one controller", name, scene, ONE, limit=limit)
    return found


def duties() -> list[tuple[str, Scene, float | None]]:
    """Duties of one configuration of the controller, with their promised CoM errors [mm]."""
    rollers, turned = Scene(plant="dreamer_rollers", walk=PULL), math.radians(45.0)
    aside = Scene(slope=0.0, push=(0.0, 60.0, 0.0), seconds=5.0)
    return [
        ("7 deg", rollers, ONE_CM),
        ("0 deg", replace(rollers, slope=0.0), ONE_CM),
        ("8 deg", replace(rollers, slope=8.0), ONE_CM),
        ("60 N ahead", replace(aside, push=(60.0, 0.0, 0.0)), ONE_CM),
        ("60 N aside, ball wheels", aside, ONE_CM),
        ("payload of 1 kg", replace(rollers, payload=1.0), ONE_CM),
        ("heading 45 deg", replace(rollers, heading=turned), ONE_CM),
        ("heading 60 deg, kept", replace(rollers, heading=math.radians(60.0)), ONE_CM),
        ("edge at 45 deg", replace(rollers, heading=turned, hand=SpringHand(direction=turned)), ONE_CM),
        ("noise, 4 ms", replace(rollers, sensors=NOISY, delay=0.004), ONE_CM),
        ("friction 0.25", replace(rollers, friction=0.25), ONE_CM),
        ("60 N aside, rollers", replace(aside, plant="dreamer_rollers"), ONE_CM),
        ("upper body 10 % heavier", replace(rollers, extra_mass=1.1), ONE_CM),
        ("bumps of 5 mm", replace(rollers, slope=0.0, bumps=0.005), ONE_CM),
        ("10 deg", replace(rollers, slope=10.0), ONE_CM),
        ("12 deg", replace(rollers, slope=12.0), None),
        ("a step of 2 mm", replace(rollers, slope=0.0, step=0.002), None),
    ]
