"""Bipeds of drawn sizes as MJCF files, without a name that a walker could know."""

from __future__ import annotations

from pathlib import Path

import numpy as np

ANKLES = "pitch", "roll"


def biped(
    folder: Path,
    *,
    size: float = 1.0,
    damping: float = 0.0,
    dry: float = 0.0,
    bend: float = 0.0,
    back: float = 0.1,
    heel: float = 0.0,
    tilt: float = 0.0,
    ahead: float = 0.04,
    right_first: bool = False,
    ankles: tuple[str, ...] = ANKLES,
    pairs: bool = False,
    waist: tuple[str, ...] = (),
    rods: float = 0.0,
    hips: float = 150.0,
    name: str = "biped",
) -> Path:
    """A file of a trunk on two legs, about size * 0.8 m tall and size^3 * 36 kg, with motors.

    damping, dry: friction of each joint, as a share of size^4 (viscous, [N m s/rad]) and size^3 ([N m]).  bend: angle
    of the knees in the keyframe [rad].  back: their range to the other side [rad].  heel: angle of the soles from
    level in it, toes up [rad].  tilt: angle of the soles in the frames of their feet, toes down [rad].  ahead: distance
    of the soles' middle from the ankles, times size [m].  right_first: order of the legs.  ankles: their axes.  pairs:
    soles touch only the geom ``floor``, by pairs.  waist: axes of joints between the trunk and a pelvis that carries
    both legs.  hips: largest torque of the hips' roll, times size^4 [N m].  rods: radius of two lying
    cylinders on the lines at +-25 mm in place of a box, times size [m].
    """
    s, rub = size, f'damping="{damping * size**4:.6g}" frictionloss="{dry * size**3:.6g}"'
    touch = 'contype="0" conaffinity="0"' if pairs else ""
    axes = {"pitch": "0 1 0", "roll": "1 0 0", "yaw": "0 0 1"}
    quiet = 'contype="0" conaffinity="0"'

    def hinge(joint: str, axis: str, most: float, range_: str = "-1.5 1.5") -> str:
        armature = 0.01 * size**5
        return (
            f'<joint name="{joint}" axis="{axes[axis]}" range="{range_}" armature="{armature:.6g}" {rub} '
            f'actuatorfrcrange="{-most * s**4:.6g} {most * s**4:.6g}"/>'
        )

    def link(body: str, place: tuple[float, float, float], inside: str, mass: float, half: tuple[float, ...]) -> str:
        at = " ".join(f"{s * x:.6g}" for x in place)
        box = " ".join(f"{s * x:.6g}" for x in half)
        middle = f"0 0 {-s * half[2]:.6g}"
        return (
            f'<body name="{body}" pos="{at}"><geom type="box" size="{box}" pos="{middle}" mass="{mass * s**3:.6g}" '
            f"{quiet}/>{inside}</body>"
        )

    x, z = ahead * np.cos(tilt) - 0.05 * np.sin(tilt), -ahead * np.sin(tilt) - 0.05 * np.cos(tilt)

    def leg(side: str, y: float) -> str:
        sole = (
            f'<geom name="{side}_s" type="box" size="{0.1 * s:.6g} {0.045 * s:.6g} {0.01 * s:.6g}" '
            f'pos="{x * s:.6g} 0 {z * s:.6g}" axisangle="0 1 0 {tilt:.12g}" mass="{0.8 * s**3:.6g}" {touch}/>'
        )
        if rods:
            back_end, toe, low = s * (ahead - 0.1), s * (ahead + 0.1), s * (-0.06 + rods)
            sole = "".join(
                f'<geom name="{side}_s{k}" type="cylinder" size="{rods * s:.6g}" mass="{0.4 * s**3:.6g}" '
                f'fromto="{back_end:.6g} {y * s:.6g} {low:.6g} {toe:.6g} {y * s:.6g} {low:.6g}"/>'
                for k, y in enumerate((-0.025, 0.025))
            )
        inside = "".join(hinge(f"{side}_a_{axis}", axis, 80.0) for axis in ankles) + sole
        foot = f'<body name="{side}_f" pos="0 0 {-0.35 * s:.6g}">{inside}</body>'
        shank = link(
            f"{side}_k",
            (0.0, 0.0, -0.35),
            hinge(f"{side}_k", "pitch", 150.0, f"{-back:.6g} 2.4") + foot,
            2.0,
            (0.03, 0.03, 0.17),
        )
        most = {"yaw": 150.0, "roll": hips, "pitch": 150.0}
        hip = "".join(hinge(f"{side}_h_{axis}", axis, limit) for axis, limit in most.items())
        return link(f"{side}_t", (0.0, y, 0.0), hip + shank, 4.0, (0.04, 0.04, 0.17))

    legs = [leg("u", 0.09), leg("w", -0.09)]
    trunk = (
        f'<freejoint/><geom type="box" size="{0.09 * s:.6g} {0.12 * s:.6g} {0.2 * s:.6g}" pos="0 0 {0.2 * s:.6g}" '
        f'mass="{22.0 * s**3:.6g}" {quiet}/>'
    )
    bent = [0.0, 0.0, -0.5 * bend, bend, -0.5 * bend - heel - tilt, 0.0][: 4 + len(ankles)]
    key = [0.0, 0.0, 0.76 * s, 1.0, 0.0, 0.0, 0.0, *(0.0 for _ in waist), *bent, *bent]
    names = [f"waist_{axis}" for axis in waist]
    names += [f"{side}_{j}" for side in "uw" for j in ("h_yaw", "h_roll", "h_pitch", "k", *(f"a_{a}" for a in ankles))]
    carried = "".join(legs[::-1] if right_first else legs)
    if waist:
        joints = "".join(hinge(f"waist_{axis}", axis, 150.0) for axis in waist)
        carried = link("pelvis", (0.0, 0.0, 0.0), joints + carried, 2.0, (0.05, 0.1, 0.02))
    motors = "".join(f'<motor name="{joint}" joint="{joint}"/>' for joint in names)
    contact = "".join(f'<pair geom1="{side}_s" geom2="floor" condim="3"/>' for side in "uw") if pairs else ""
    floor = '<geom name="floor" type="plane" size="5 5 1"/>' if pairs else ""
    path = folder / f"{name}.xml"
    path.write_text(
        f'<mujoco model="{name}"><compiler angle="radian" autolimits="true"/><worldbody>{floor}'
        f'<body name="trunk" pos="0 0 {0.76 * s:.6g}">{trunk}{carried}</body>'
        f'</worldbody><contact>{contact}</contact><actuator>{motors}</actuator><keyframe><key name="home" qpos="'
        f'{" ".join(f"{number:.12g}" for number in key)}"/></keyframe></mujoco>'
    )
    return path
