"""Distance of a hand from a target out of reach, against the least possible one; and from a target within reach."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

import hqp
from hqp import Level, P, Stack, markdown
from hqp.arrays import Mat, Vec
from hqp.tasks import Com, JointLimits, Orientation, Position, Posture
from tests.scenes.calm.robots import Subject, subject
from tests.scenes.calm.variants import Variant

AHEAD = {"talos": (0.9, 0.0, 0.0), "g1": (0.7, 0.0, 0.25), "cbi": (0.7, 0.0, 0.25), "ur5": (1.0, 0.0, 0.2)}
"""Displacement of the target from the hand's start [m]."""

ALLOWED = {"talos": 5e-3, "g1": 5e-3, "cbi": 5e-3, "ur5": 1e-3}
"""Allowed excess over the least distance at the end [m]."""

DT, SECONDS = 0.002, 20.0

NEAR = 1e-6
"""Distance from a target within reach after NEAR_SECONDS, with the gain 1/dt [m]."""
NEAR_SECONDS = 3.0

Record = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Reach:
    """CoM > hand > base > posture of a robot, and the target of its hand ``(3,)``."""

    who: Subject
    hand: Position
    goal: Vec

    @property
    def stack(self) -> Stack:
        """[CoM >] hand > [base >] posture, s.t. feet and joint limits; base and posture have no speed limit."""
        who = self.who
        levels = [Level(Com(axes="xy", law=P(2.0), name="com"))] if who.contacts else []
        levels.append(Level(self.hand))
        if who.base is not None:
            levels.append(Level(Orientation(frame=who.base, law=P(2.0), name="base")))
        return Stack(*levels, Level(Posture(law=P(1.0))), subject_to=[*who.contacts, JointLimits()])

    def run(self, variant: Variant, seconds: float) -> tuple[Vec, float]:
        """Final configuration ``(nq,)`` and distance of the hand from the target [m]."""
        robot = self.who.robot
        session = variant.of(self.stack, hqp.Velocity()).session(robot, DT)
        q, v = robot.home.copy(), np.zeros(robot.nv)
        for _ in range(round(seconds / DT)):
            q, v = session.step(robot.state(q, v), self.hand.at(self.goal)).advance()
        return q, self.off(q)

    def off(self, q: Vec) -> float:
        """Distance of the hand from its target [m]."""
        return float(np.linalg.norm(self.who.robot.state(q).position(self.hand.frame) - self.goal))

    def least(self, q: Vec, rounds: int = 12) -> float:
        """Least distance near q with feet and CoM as at home, inside the joint limits [m]."""
        robot, home = self.who.robot, self.who.robot.state(self.who.robot.home)
        feet = [(foot, home.position(foot).copy(), home.rotation(foot).copy()) for foot in self.who.feet]
        com = home.com()[:2].copy()

        def held(step: Vec) -> Vec:
            state = robot.state(robot.integrate(q, step, 1.0))
            errors = [np.concatenate((state.position(f) - p, robot.log3(state.rotation(f) @ R.T))) for f, p, R in feet]
            return np.concatenate((*errors, state.com()[:2] - com))

        def held_rows(step: Vec) -> Mat:
            state = robot.state(robot.integrate(q, step, 1.0))
            return np.concatenate([*(state.jacobian(f) for f, _, _ in feet), state.com_jacobian()[:2]])

        def distance(step: Vec) -> tuple[float, Vec]:
            state = robot.state(robot.integrate(q, step, 1.0))
            e = state.position(self.hand.frame) - self.goal
            off = float(np.linalg.norm(e))
            return off, e @ state.jacobian(self.hand.frame)[:3] / off

        best = self.off(q)
        for _ in range(rounds):  # tangent coordinates at q
            angles = robot.state(q).angles
            bounds = list(zip(robot.lower - angles, robot.upper - angles, strict=True))
            constraints = [{"type": "eq", "fun": held, "jac": held_rows}] if feet else []
            found = minimize(
                distance, np.zeros(robot.nv), jac=True, bounds=bounds, constraints=constraints, method="SLSQP",
                options={"maxiter": 200, "ftol": 1e-12},
            )  # fmt: skip
            q = robot.integrate(q, found.x, 1.0)
            if np.abs(held(np.zeros(robot.nv))).max() < 1e-6 if feet else True:
                best = min(best, self.off(q))
        return best


def beyond(name: str) -> Reach:
    """Reach with a hand target out of reach."""
    who = subject(name)
    hand = Position(frame=who.hands[0], law=P(5.0, max_velocity=0.5), name="hand")
    return Reach(who, hand, who.robot.state(who.robot.home).position(hand.frame) + np.array(AHEAD[name]))


def within() -> Reach:
    """Reach of G1's hand with the gain 1/dt and a target within reach."""
    who = subject("g1")
    hand = Position(frame=who.hands[0], law=P(1.0 / DT), name="hand")
    return Reach(who, hand, who.robot.state(who.robot.home).position(hand.frame) + np.array((0.1, 0.0, 0.1)))


def measure(names: Sequence[str], variant: Variant, seconds: float = SECONDS) -> Iterator[Record]:
    """Distances at the end, and the least ones."""
    for name in names:
        asked = beyond(name)
        q, off = asked.run(variant, seconds)
        yield {"robot": name, "off": off, "least": asked.least(q), "allowed": ALLOWED[name]}
    yield {
        "robot": "g1, gain 1/dt, within reach",
        "off": within().run(variant, NEAR_SECONDS)[1],
        "least": 0.0,
        "allowed": NEAR,
    }


def misses(records: Sequence[Record]) -> Iterator[str]:
    """Hands that stay too far away."""
    for r in records:
        if r["off"] - r["least"] > r["allowed"]:
            yield f"{r['robot']}: {1e3 * (r['off'] - r['least']):.3g} mm more than the least"


def table(records: Sequence[Record]) -> str:
    """A row for each robot."""

    def row(r: Record) -> tuple[str, ...]:
        more = r["off"] - r["least"]
        text = f"{1e3 * more:.3g}"
        told = text if more <= r["allowed"] else f"**{text}**"
        return r["robot"], f"{1e3 * r['off']:.4g}", f"{1e3 * r['least']:.4g}", told, f"{1e3 * r['allowed']:g}"

    head = ("robot", "distance at the end [mm]", "least [mm]", "more [mm]", "allowed [mm]")
    return markdown.table(head, [row(r) for r in records]) + "\n"
