"""Small motions of a synthetic person, z up [m]."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hqp.motion import Box, Motion
from hqp.motion.box import FIELDS

FPS = 30.0
NAMES = (
    "Hips", "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase", "RightUpLeg", "RightLeg", "RightFoot", "RightToeBase",
    "LeftArm", "LeftForeArm", "LeftHand", "RightArm", "RightForeArm", "RightHand",
)  # fmt: skip
PARENTS = (-1, 0, 1, 2, 3, 0, 5, 6, 7, 0, 9, 10, 0, 12, 13)
THIGH, SHANK, ANKLE = 0.42, 0.42, 0.09


def walk(seconds: float = 3.0, speed: float = 0.8, fps: float = FPS) -> Motion:
    """Level walking along x, half a second a step."""
    times = np.arange(0.0, seconds, 1.0 / fps)
    return Motion(NAMES, np.array([_person(t, speed) for t in times]), fps, PARENTS)


def stand(seconds: float = 1.0, heading: float = 0.0, fps: float = FPS) -> Motion:
    """Standing still, facing ``heading`` [rad]."""
    c, s = np.cos(heading), np.sin(heading)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return Motion(NAMES, np.array([_person(0.0, 0.0) @ turn.T] * int(seconds * fps)), fps, PARENTS)


def crouch(seconds: float = 1.5, fps: float = FPS) -> Motion:
    """From standing to a squat on flat feet until the hands are at the shins, knees and trunk bent."""
    motion = stand(seconds, fps=fps)
    places = motion.positions.copy()
    at = {name: i for i, name in enumerate(NAMES)}
    for joints, share in zip(places, np.clip(np.linspace(0.0, 1.5, len(places)), 0.0, 1.0), strict=True):
        lower = share * np.array([-0.05, 0.0, -0.55])
        hips = joints[at["Hips"]] + lower
        c, s = np.cos(0.3 * share), np.sin(0.3 * share)
        bent = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        for name in ("LeftArm", "LeftForeArm", "LeftHand", "RightArm", "RightForeArm", "RightHand"):
            joints[at[name]] = hips + bent @ (joints[at[name]] - joints[at["Hips"]])
        joints[at["Hips"]] = hips
        for side in ("Left", "Right"):
            hip, foot = joints[at[f"{side}UpLeg"]] + lower, joints[at[f"{side}Foot"]]
            joints[at[f"{side}UpLeg"]] = hip
            joints[at[f"{side}Leg"]] = _bend(hip, foot, THIGH, SHANK)
    return Motion(NAMES, places, fps, PARENTS)


def step_up(rise: float, fps: float = FPS) -> Motion:
    """Step on a box [m], the left foot first; the right heel leaves the floor while both feet stand."""
    people = []
    for t in np.arange(0.0, 2.8, 1.0 / fps):
        joints = _person(0.0, 0.0)
        at = {name: i for i, name in enumerate(NAMES)}
        over, back = _ease((t - 1.0) / 0.7), _ease((t - 1.7) / 0.7)
        aside = -0.08 * _ease(t / 0.4) + 0.16 * over - 0.08 * back
        move = np.array([0.3 * over, aside, (0.6 * over + 0.4 * back) * rise])
        joints[[i for name, i in at.items() if "Foot" not in name and "Toe" not in name]] += move
        for side, begin in (("Left", 0.4), ("Right", 1.7)):
            s = _ease((t - begin) / 0.6)
            swing = np.array([0.3 * s, 0.0, rise * _ease((t - begin) / 0.3) + 0.2 * s * (1.0 - s)])
            raised = 0.7 * (_ease((t - 1.2) / 0.5) - _ease((t - 1.7) / 0.4)) if side == "Right" else 0.0
            toe, foot = joints[at[f"{side}ToeBase"]] + swing, joints[at[f"{side}Foot"]] + swing
            c, s, x, z = np.cos(raised), np.sin(raised), *(foot - toe)[[0, 2]]
            joints[at[f"{side}ToeBase"]] = toe
            joints[at[f"{side}Foot"]] = foot = toe + [c * x + s * z, 0.0, c * z - s * x]
            joints[at[f"{side}Leg"]] = _bend(joints[at[f"{side}UpLeg"]], foot, THIGH, SHANK)
        people.append(joints)
    return Motion(NAMES, np.array(people), fps, PARENTS)


def stretch(rise: float, seconds: float = 1.0, fps: float = FPS) -> Motion:
    """Arms from the sides to overhead while all but the feet rises [m], and a rest there."""
    motion = stand(seconds, fps=fps)
    places = motion.positions.copy()
    at = {name: i for i, name in enumerate(NAMES)}
    for joints, share in zip(places, np.clip(np.linspace(-0.5, 1.5, len(places)), 0.0, 1.0), strict=True):
        angle = 0.9 * np.pi * share
        for side in ("Left", "Right"):
            for name, length in (("ForeArm", 0.27), ("Hand", 0.51)):
                along = length * np.array([np.sin(angle), 0.0, -np.cos(angle)])
                joints[at[f"{side}{name}"]] = joints[at[f"{side}Arm"]] + along
        joints[[i for name, i in at.items() if "Foot" not in name and "Toe" not in name], 2] += rise * share
    return Motion(NAMES, places, fps, PARENTS)


def lift(seconds: float = 4.0, turn: float = 0.0, fps: float = FPS, size: Any = (0.3, 0.26, 0.24)) -> Motion:
    """Squat to a box on a crate, take it between both hands, stand up with it, turn it by ``turn`` [rad] about z."""
    count, edges = int(seconds * fps), np.array(size)
    rest = np.array([0.42, 0.0, 0.35 + 0.5 * edges[2]])
    people, places, turns = [], [], []
    for share in np.linspace(0.0, 1.0, count):
        reach = _ease(share / 0.3)
        low = _ease(share / 0.35) - _ease((share - 0.45) / 0.4)
        up = _ease((share - 0.45) / 0.4)
        angle = turn * _ease((share - 0.6) / 0.35)
        joints = _person(0.0, 0.0)
        at = {name: i for i, name in enumerate(NAMES)}
        joints[[0, 1, 5]] += low * np.array([-0.1, 0.0, -0.3])
        for side in ("Left", "Right"):
            joints[at[f"{side}Leg"]] = _bend(joints[at[f"{side}UpLeg"]], joints[at[f"{side}Foot"]], THIGH, SHANK)
        centre = rest + up * np.array([-0.06, 0.0, 0.45])
        box = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
        for side, sign in (("Left", 1.0), ("Right", -1.0)):
            home = {part: joints[at[f"{side}{part}"]] - [0.0, 0.0, 0.86] for part in ("Arm", "ForeArm", "Hand")}
            shoulder = joints[0] + home["Arm"] + low * np.array([0.2, 0.0, -0.05])
            held = centre + box @ [0.0, sign * (0.5 * edges[1] + 0.03), 0.0]
            hand = (1.0 - reach) * (shoulder + home["Hand"] - home["Arm"]) + reach * held
            way = hand - shoulder
            length = float(np.linalg.norm(way))
            hand = shoulder + way * (min(length, 0.52) / length)
            joints[at[f"{side}Arm"]], joints[at[f"{side}Hand"]] = shoulder, hand
            joints[at[f"{side}ForeArm"]] = shoulder + 0.5 * way + np.array([-0.05, 0.08 * sign, -0.1])
        people.append(joints)
        places.append(centre)
        turns.append([0.0, 0.0, np.sin(angle / 2.0), np.cos(angle / 2.0)])
    return Motion(NAMES, np.array(people), fps, PARENTS, box=Box(places, turns, edges))


def _ease(x: float) -> float:
    """0 to 1 without a corner."""
    x = min(max(x, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


def _person(t: float, speed: float) -> Any:
    hips = np.array([speed * t, 0.0, 0.86])
    joints = [hips]
    for side, begin in ((1.0, 0.0), (-1.0, 0.5)):
        hip = hips + [0.0, 0.1 * side, 0.0]
        foot = np.array([*_foot(t, begin, speed), 0.0])[[0, 2, 1]] + [0.0, 0.1 * side, ANKLE]
        joints += [hip, _bend(hip, foot, THIGH, SHANK), foot, foot + [0.14, 0.0, 0.03 - ANKLE]]
    for side in (1.0, -1.0):
        shoulder = hips + [0.0, 0.19 * side, 0.5]
        swing = 0.15 * side * np.sin(2.0 * np.pi * t) if speed else 0.0
        elbow = shoulder + [swing, 0.03 * side, -0.27]
        joints += [shoulder, elbow, elbow + [0.1 + swing, 0.0, -0.22]]
    return np.array(joints)


def _foot(t: float, begin: float, speed: float) -> tuple[float, float]:
    """Forward position and height of a foot that swings for half a second of every second."""
    cycle, phase = divmod(t - begin, 1.0)
    stride = speed * 1.0
    first = stride * (cycle - 0.25) + speed * (begin + 0.5) if speed else 0.0
    if phase >= 0.5 or not speed:
        return first + (stride if speed else 0.0), 0.0
    x = phase / 0.5
    return first + stride * (x - np.sin(2.0 * np.pi * x) / (2.0 * np.pi)), 0.05 * (1.0 - np.cos(2.0 * np.pi * x))


def _bend(hip: Any, foot: Any, thigh: float, shank: float) -> Any:
    """A knee, forward of the line from hip to foot."""
    way = foot - hip
    length = min(float(np.linalg.norm(way)), 0.999 * (thigh + shank))
    along = (thigh**2 - shank**2 + length**2) / (2.0 * length)
    out = np.sqrt(max(thigh**2 - along**2, 0.0))
    unit = way / np.linalg.norm(way)
    forward = np.array([1.0, 0.0, 0.0]) - unit[0] * unit
    return hip + along * unit + out * forward / np.linalg.norm(forward)


def write_npz(path: Path, motion: Motion) -> Path:
    """Write a motion for ``read_motion``."""
    box = {} if motion.box is None else {f"box_{name}": getattr(motion.box, name) for name in FIELDS}
    np.savez(path, positions=motion.positions, names=np.array(motion.names), fps=motion.fps, **box)
    return path


def write_bvh(path: Path, motion: Motion, scale: float = 100.0) -> Path:
    """A BVH file, y up, with position channels and no rotation at every joint."""
    children = {i: [k for k, p in enumerate(motion.parents) if p == i] for i in range(len(motion.names))}
    order: list[int] = []

    def block(i: int, depth: int) -> list[str]:
        order.append(i)
        pad = "\t" * depth
        lines = [f"{pad}{'ROOT' if depth == 0 else 'JOINT'} {motion.names[i]}", f"{pad}{{", f"{pad}\tOFFSET 0 0 0"]
        lines.append(f"{pad}\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation")
        for child in children[i]:
            lines += block(child, depth + 1)
        if not children[i]:
            lines += [f"{pad}\tEnd Site", f"{pad}\t{{", f"{pad}\t\tOFFSET 0 0 0", f"{pad}\t}}"]
        return [*lines, f"{pad}}}"]

    head = ["HIERARCHY", *block(0, 0), "MOTION", f"Frames: {len(motion)}", f"Frame Time: {1.0 / motion.fps:.6f}"]
    turned = scale * motion.positions[..., [0, 2, 1]] * [1.0, 1.0, -1.0]
    rows = []
    for frame in turned:
        numbers = []
        for i in order:
            parent = motion.parents[i]
            numbers += [*(frame[i] - (frame[parent] if parent >= 0 else 0.0)), 0.0, 0.0, 0.0]
        rows.append(" ".join(f"{x:.6f}" for x in numbers))
    path.write_text("\n".join([*head, *rows]) + "\n")
    return path
