"""Targets within reach must be reached: randomly drawn poses, priced levels next to exact ones."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

import hqp
from hqp import Level, P, Stack, markdown
from hqp.arrays import Mat, Vec
from hqp.declare.reference import Reference
from hqp.robots import Robot
from hqp.tasks import Com, FixedContact, JointLimits, Pose, Posture
from tests.scenes.calm.variants import EXACT_LIMITED, Variant

FRAMES = {
    "ur5": "tool0", "panda": "panda_hand_tcp", "xarm7": "link_eef", "kinova": "j2s6s200_end_effector",
    "g1": "right_wrist_yaw_link", "talos": "gripper_right_base_link",
}  # fmt: skip
"""Robots and the frames of their hands."""

STRAIGHT = {"kinova": math.pi}
"""Angles of a straight arm, 0 for the others."""

PERIODS = (0.002, 0.005, 0.01)
GAINS = (5.0, 20.0, 100.0, math.inf)
"""[1/s], drawn from; inf: one over the period."""

SPEED = 1.0
"""Speed limit of the hand [m/s, rad/s] of every second loop."""

WITHIN = 1e-3
"""Tolerance on the pose [m], [rad]."""

LONGEST = 10.0
"""[s] priced levels have SLACK[0] times the time of exact ones and SLACK[1] more, both at most this."""
SLACK = 1.5, 0.2

NUDGE, NUDGES = 1e-6, 8
"""Displacement of the joints [rad, m] from rest and number of trials, to distinguish a saddle from a minimum."""

FATES = ("later", "saddle", "rest")
"""Outcomes of goals that exact levels alone reach in time."""

STEPS, STRIDE = 24, 0.5
"""Parts of a straight path, and the largest displacement of a joint in a part [rad, m]."""

LEAST = 0.995
"""Share of the goals on a straight path that must be reached."""

Record = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Case:
    """One goal: pose ``(4, 4)`` of a frame, start ``(nq,)``, laws and period [s]."""

    robot: Robot
    goal: Mat
    start: Vec
    hand: Pose
    posture: float
    dt: float
    singular: bool

    @property
    def stack(self) -> Stack:
        """[CoM >] hand > posture, s.t. feet and joint limits."""
        soles = self.robot.landmarks.get("soles", ()) if self.robot.floating else ()
        balance = [Level(Com(axes="xy", law=P(5.0), name="com"))] if soles else []
        hard = [*(FixedContact(frame=sole) for sole in soles), JointLimits()]
        return Stack(*balance, Level(self.hand), Level(Posture(law=P(self.posture))), subject_to=hard)

    def off(self, q: Vec) -> float:
        """The larger of the distances in m and rad."""
        error = self.hand.error(self.robot.state(q), self.goal)
        return max(float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:])))

    @property
    def text(self) -> str:
        """Period, gains, speed limit and start as text."""
        law = self.hand.law
        assert isinstance(law, P)
        limit = f", at most {law.max_velocity:g} m/s" if law.max_velocity < math.inf else ""
        kind = "singular" if self.singular else "random"
        return f"{1e3 * self.dt:g} ms, gain {law.gain:g}{limit}, posture {self.posture:g}, {kind} start"


def case(name: str, seed: int) -> Case:
    """Case of a seed: gain, period, speed limit, posture and kind of start cover all combinations."""
    rng = np.random.default_rng([seed, sum(name.encode())])
    robot, joints = _chain(name)
    at, singular = seed, seed % 2 == 1
    at //= 2
    gain, at = GAINS[at % len(GAINS)], at // len(GAINS)
    limited, at = at % 2 == 1, at // 2
    posture, at = (1.0, 10.0)[at % 2], at // 2
    dt = PERIODS[int(rng.integers(len(PERIODS)))]
    law = P(min(gain, 1.0 / dt), **({"max_velocity": SPEED} if limited else {}))
    hand = Pose(frame=FRAMES[name], law=law, name="hand")

    def somewhere() -> Vec:
        lower, upper = robot.lower[joints], robot.upper[joints]
        bounded = np.isfinite(upper - lower)
        middle = np.where(bounded, 0.5 * (np.where(bounded, lower, 0.0) + upper), 0.0)
        half = np.minimum(0.5 * (upper - lower), math.pi)
        return np.asarray(middle + 0.98 * rng.uniform(-half, half))

    goal = np.array(hand.value(robot.state(_placed(robot, joints, somewhere()))))
    start = somewhere()
    if singular:  # the arm straight, turned about its first joint
        start[1:] = np.clip(STRAIGHT.get(name, 0.0), robot.lower[joints][1:] + 1e-3, robot.upper[joints][1:] - 1e-3)
    return Case(robot, goal, _placed(robot, joints, start), hand, posture, dt, singular)


@cache
def _chain(name: str) -> tuple[Robot, Any]:
    """The robot, and the joints of its hand's arm ``(k,)``."""
    robot = hqp.robots.load(name)
    state = robot.state()
    column = np.abs(state.jacobian(FRAMES[name])).max(axis=0)
    moving = [j for j in robot.actuated if column[j] > 0.0]
    torso = np.abs(state.jacobian(robot.landmarks["palms"][0])).max(axis=0) if robot.floating else np.zeros(robot.nv)
    return robot, np.array([j for j in moving if torso[j] == 0.0])


def _placed(robot: Robot, joints: Any, angles: Vec) -> Vec:
    step = np.zeros(robot.nv)
    step[joints] = angles - robot.state(robot.home).angles[joints]
    return robot.integrate(robot.home, step, 1.0)


def arrival(one: Case, variant: Variant, longest: float = LONGEST) -> float:
    """Time of arrival at the goal [s], inf if it was not reached."""
    return _carried_out(one, variant, one.start, longest)[1]


def fate(one: Case, variant: Variant) -> str:
    """Outcome of a goal missed in time: reached ``later``, or the hand comes to rest.

    At a ``saddle`` of its distance the hand rests for long, and reaches the goal after a displacement of the joints by
    NUDGE.
    """
    q, seconds = _carried_out(one, variant, one.start, LONGEST)
    if seconds < math.inf:
        return "later"
    robot, rng = one.robot, np.random.default_rng(0)
    joints = robot.actuated
    angles = robot.state(q).angles[joints]
    for _ in range(NUDGES):
        step = np.zeros(robot.nv)
        nudged = angles + rng.uniform(-NUDGE, NUDGE, joints.size)
        step[joints] = np.clip(nudged, robot.lower[joints], robot.upper[joints]) - angles
        if _carried_out(one, variant, robot.integrate(q, step, 1.0), LONGEST)[1] < math.inf:
            return "saddle"
    return "rest"


def _carried_out(one: Case, variant: Variant, start: Vec, longest: float) -> tuple[Vec, float]:
    """Final configuration, and time of arrival at the goal [s], inf if it was not reached."""
    session = variant.of(one.stack, hqp.Velocity()).session(one.robot, one.dt)
    q, v, goals = start.copy(), np.zeros(one.robot.nv), _references(one)
    for k in range(math.ceil(longest / one.dt)):
        if one.off(q) < WITHIN:
            return q, k * one.dt
        q, v = session.step(one.robot.state(q, v), *goals).advance()
        if not np.abs(v).max() > 1e-9:  # permanently at rest
            break
    return q, k * one.dt if one.off(q) < WITHIN else math.inf


def _references(one: Case) -> list[Reference]:
    com = one.stack.find("com", Com) if one.robot.floating else None
    return [one.hand.at(one.goal), *([com.at(one.robot.state(one.start).com()[:2])] if com is not None else [])]


def joined(one: Case) -> bool:
    """Return true if ``hqp.reach`` follows the straight path to the goal without a leap of a joint."""
    robot = one.robot
    first = one.hand.value(robot.state(one.start))
    way, turn = one.goal[:3, 3] - first[:3, 3], robot.log3(one.goal[:3, :3] @ first[:3, :3].T)
    q = one.start
    for k in range(1, STEPS + 1):
        place = np.eye(4)
        place[:3, 3] = first[:3, 3] + k / STEPS * way
        place[:3, :3] = _exp3(k / STEPS * turn) @ first[:3, :3]
        goals = [one.hand.at(place), *_references(one)[1:]]
        found = hqp.reach(one.stack, robot, *goals, q0=q, restarts=0, tolerance=1e-4)
        if not found.success or np.abs(robot.difference(q, found.q)).max() > STRIDE:
            return False
        q = found.q
    return True


def _exp3(turn: Vec) -> Mat:
    angle = float(np.linalg.norm(turn))
    x, y, z = turn / (angle or 1.0)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K)


def measure(name: str, seeds: Sequence[int], variant: Variant) -> Iterator[Record]:
    """Arrival times of exact and priced levels for each seed, and whether a straight path exists."""
    for seed in seeds:
        one = case(name, seed)
        exact = arrival(one, EXACT_LIMITED)
        allowed = min(SLACK[0] * exact + SLACK[1], LONGEST)
        priced = arrival(one, variant, allowed)
        yield {
            "robot": name, "seed": seed, "case": one.text, "exact": exact, "allowed": allowed,
            "priced": priced, "joined": joined(one), "limited": one.hand.law.max_velocity < math.inf,
            "fate": fate(one, variant) if exact < math.inf <= priced else "",
        }  # fmt: skip


def misses(records: Sequence[Record]) -> Iterator[str]:
    """Shortfalls: fewer goals than with exact levels, or too few goals on a straight path."""
    for name in dict.fromkeys(r["robot"] for r in records):
        own = [r for r in records if r["robot"] == name]
        priced, exact = (sum(r[kind] < math.inf for r in own) for kind in ("priced", "exact"))
        if priced < exact:
            yield f"{name}: {priced} of {len(own)} goals reached, {exact} with exact levels"
        straight = [r["priced"] < math.inf for r in own if r["joined"]]
        if sum(straight) < LEAST * len(straight):
            yield f"{name}: {sum(straight)} of {len(straight)} goals on a straight way reached"


def table(records: Sequence[Record]) -> str:
    """A row for each robot; goals on a straight path with and without a speed limit in the law."""

    def count(own: Sequence[Record]) -> str:
        reached = [sum(r[kind] < math.inf for r in own) for kind in ("priced", "exact")]
        return f"{reached[0]}, {reached[1]} of {len(own)}"

    rows = []
    for name in dict.fromkeys(r["robot"] for r in records):
        own = [r for r in records if r["robot"] == name]
        both = [r["priced"] / r["exact"] for r in own if max(r["priced"], r["exact"]) < math.inf and r["exact"] > 0.0]
        straight = [[r for r in own if r["joined"] and r["limited"] is limited] for limited in (True, False)]
        ends = ", ".join(str(sum(r["fate"] == end for r in own)) for end in FATES)
        rows.append((name, count(own), ends, *map(count, straight), f"{np.median(both):.3f}" if both else ""))
    head = (
        "robot", "reached: priced, exact", f"exact alone: {', '.join(FATES)}",
        "on a straight way, speed limit in the law", "without one", "time over exact, median",
    )  # fmt: skip
    return markdown.table(head, rows) + "\n"
