"""Pushes on standing robots from eight sides: the walker's largest beside an upper bound for any controller."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from benchmarks.lab.outcome import Figure, Outcome, table
from benchmarks.lab.setting import Setting
from benchmarks.walking.course import SETTLE, Course
from hqp.walking.bound import largest_push
from hqp.walking.pendulum import natural_frequency

PUSHED, AFTER = 0.1, 2.0
"""Duration of a push, and of the stand that must follow [s]."""

STAYS = 0.02
"""Largest motion of the soles [m]: the bound assumes that feet stay."""

ASKED = {"talos": 0.75, "cbi": 0.75, "g1": 0.65}
"""Goals of the median share of the bound over directions."""

SIDES = ("ahead", "ahead left", "left", "back left", "back", "back right", "right", "ahead right")
MOST, HALVINGS = 1.4, 5
"""Largest share of the bound in the bisection, and its number of steps."""


class Standing:
    """Robot that stands under pushes."""

    def __init__(self, name: str, seed: int) -> None:
        self.course = Course(name, seed)
        self.course.run(SETTLE)

    def soles(self) -> Any:
        """Places of the soles ``(2, 3)`` [m]."""
        return np.array([self.course.plant.place(foot.frame)[0] for foot in self.course.walker.feet])

    def bound(self, direction: Any) -> float:
        """The largest impulse over mass in that direction [m/s]."""
        plant, corners = self.course.plant, []
        for foot in self.course.walker.feet:
            place, turn = plant.place(foot.frame)
            corners += [(place + turn @ [*corner, 0.0])[:2] for corner in foot.corners]
        com = plant.com()
        omega = natural_frequency(com[2] - self.soles()[:, 2].mean(), -self.course.robot.gravity[2])
        return largest_push(corners, com[:2], direction, PUSHED, omega)

    def survives(self, direction: Any, impulse: float) -> bool:
        """Return true if the robot stands, with its soles in place, after an impulse over mass [m/s]."""
        course, before = self.course, self.soles()
        course.run(PUSHED, push=[*(impulse * course.mass / PUSHED * direction), 0.0])
        return course.run(AFTER) and bool(np.abs(self.soles() - before).max() < STAYS)


def share(name: str, side: int, seed: int) -> tuple[float, float]:
    """Largest share of the bound without a fall, from one of the sides, and the bound [m/s]."""
    direction = np.array([math.cos(side * math.pi / 4), math.sin(side * math.pi / 4)])
    bound, low, high = 0.0, 0.0, MOST
    for _ in range(HALVINGS):
        standing = Standing(name, seed)
        bound = standing.bound(direction)
        middle = 0.5 * (low + high)
        low, high = (middle, high) if standing.survives(direction, middle * bound) else (low, middle)
    return low, bound


def experiment(setting: Setting) -> Outcome:
    """All robots from all sides."""
    outcome = Outcome("standing-pushes")
    outcome.parameters = {"push [s]": PUSHED, "seed": 0, "masses": "+10 %", "delay [s]": 0.004, "mu": 0.5}
    rows = []
    for name in ASKED:
        found = [share(name, side, 0) for side in range(8)]
        setting.advance()
        median = float(np.median([part for part, _ in found]))
        outcome.figures.append(Figure(f"{name}: share of the bound, median of sides", median, low=ASKED[name]))
        rows.append((name, *(f"{part:.2f} of {bound:.2f}" for part, bound in found)))
    header = ("robot", *SIDES)
    outcome.tables.append(
        table("Survived, as a share of the largest impulse over mass [m/s] that could be", header, rows)
    )
    return outcome
