"""Changes of stack in a closed loop: add a hand, swap two levels, release and reattach a foot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import thread_time

import numpy as np

import hqp
from hqp import Level, Stack
from hqp.commands.arguments import formulation
from hqp.declare.reference import Reference
from hqp.loop.guards import largest_change
from hqp.robots import Robot
from hqp.tasks import Com, FixedContact, FrictionCone, JointLimits, Orientation, Position, Posture, TorqueLimits

ROBOTS = ("talos", "cbi", "icub", "g1")
LEVELS = ("velocity", "acceleration", "torque")
EVENTS = ("add", "swap", "remove", "release", "take up")
DT, OVER = 0.002, 0.25
SECOND = int(1.0 / DT)
LONGEST = 1500
"""Largest number of ticks of a transition."""


def smooth(s: float) -> float:
    """3 s^2 - 2 s^3."""
    return s * s * (3.0 - 2.0 * s)


def stack(robot: Robot, level: str) -> Stack:
    """CoM > hand > trunk > posture on two feet, inside all limits."""
    left, right = robot.landmarks["soles"]
    forces = [FrictionCone(contact=frame, mu=0.6) for frame in (left, right)] + [TorqueLimits()]
    return Stack(
        Level(Com(name="com")),
        Level(Position(frame=robot.landmarks["palms"][1], name="hand")),
        Level(Orientation(frame=robot.landmarks["base"][0], name="trunk")),
        Level(Posture()),
        subject_to=[
            FixedContact(frame=left),
            FixedContact(frame=right),
            *(forces if level == "torque" else ()),
            JointLimits(),
        ],
    )


def lifted(whole: Stack, robot: Robot) -> Stack:
    """The stack without the right foot."""
    right = robot.landmarks["soles"][1]
    return whole.without(*(e.name for e in whole.subject_to if right in (e.name, getattr(e, "contact", ""))))


class Loop:
    """Closed loop on the exact integrator; keeps every command and the time of every tick."""

    def __init__(self, robot: Robot, declared: Stack, level: str, deadline: float | None = np.inf) -> None:
        controller = hqp.Controller(declared, formulation(level), deadline=deadline)
        self.robot, self.run = robot, controller.session(robot, DT)
        self.q, self.v = robot.home.copy(), np.zeros(robot.nv)
        start = robot.state()
        self.hand = start.position(robot.landmarks["palms"][1]) + [0.05, 0.02, 0.05]
        self.com = start.com()
        self.above = np.array([*start.position(robot.landmarks["soles"][0])[:2], 0.97 * self.com[2]])
        self.ticks: list[hqp.Tick] = []
        self.times: list[float] = []

    def go(self, ticks: int, goals: Sequence[Reference]) -> list[hqp.Tick]:
        """Run ticks with the given references."""
        for _ in range(ticks):
            state = self.robot.state(self.q, self.v)
            begin = thread_time()
            tick = self.run.step(state, *goals)
            self.times.append(thread_time() - begin)
            self.ticks.append(tick)
            self.q, self.v = tick.advance()
        return self.ticks[len(self.ticks) - ticks :]

    @property
    def changes(self) -> np.ndarray:
        """Largest change of the command in each tick but the first."""
        sent = [tick.command for tick in self.ticks]
        return np.asarray(np.abs(np.diff(sent, axis=0)).max(axis=1))

    def goals(self, over: float) -> list[Reference]:
        """References of the CoM, a share of the way from between the feet to above the left one, and of the hand."""
        found = [Com(name="com").at((1.0 - over) * self.com + over * self.above)]
        palm = self.robot.landmarks["palms"][1]
        return [*found, Position(frame=palm, name="hand").at(self.hand)] if "hand" in self.run else found

    def shift(self, ticks: int = SECOND) -> None:
        """Move the CoM above the left foot, and wait half a second."""
        for k in range(ticks):
            self.go(1, self.goals(smooth(k / ticks)))
        self.go(SECOND // 2, self.goals(1.0))


@dataclass
class Change:
    """Effect of a change: largest changes of the command in a tick, before it (a second), in it and after it (0.1 s,
    with the new stack at work).

    abrupt: largest change in the first tick without easing.  ticks: length of the transition.  own: median CPU time of
    a tick in the transition [s].  old, new: median CPU times in the quarter of a second before it, and in as many ticks
    after the abrupt change as the transition takes.  notes: contacts that cannot be released.
    """

    robot: str
    level: str
    event: str
    before: float
    during: float
    after: float
    abrupt: float
    ticks: int
    own: float
    old: float
    new: float
    notes: tuple[str, ...]

    @property
    def allowed(self) -> float:
        """0.02 rad/s, 1 rad/s^2 or 1 N m."""
        return largest_change(self.level, DT)

    @property
    def calm(self) -> bool:
        """True if no tick of it, nor the one after it, changes the command by more than allowed."""
        return self.during <= self.allowed * (1.0 + 1e-9)

    def __str__(self) -> str:
        jumps = f"before {self.before:.3g}, after {self.after:.3g}, at once {self.abrupt:.3g}"
        plain = f"{1e6 * self.old:.0f} us before and {1e6 * self.new:.0f} us after"
        times = f"{self.ticks} ticks of {1e6 * self.own:.0f} us, {self.ratio:.2f} of {plain}"
        told = "; ".join(("" if self.calm else "NOT CALM", *self.notes))
        return f"{self.event}: {self.during:.3g} ({jumps}), {times} {told}"

    @property
    def ratio(self) -> float:
        """Time of a transition tick relative to plain ticks, the mean of both stacks."""
        return 2.0 * self.own / (self.old + self.new)


def change(loop: Loop, twin: Loop, level: str, event: str, stack: Stack) -> Change:
    """Ease into a stack, switch its twin at once, and run half a second more."""
    over = 1.0 if event in ("release", "take up") else 0.0
    start, goals = len(loop.ticks), loop.goals(over)
    loop.run.change(stack, OVER)
    twin.run.change(stack)
    if event == "add":
        goals = loop.goals(over)
    while loop.go(1, goals)[0].transition < 1.0 and len(loop.ticks) < start + LONGEST:
        pass
    end = len(loop.ticks)
    loop.go(SECOND // 2, loop.goals(over))
    twin.go(len(loop.ticks) - start, twin.goals(over))
    changes = loop.changes
    return Change(
        loop.robot.name,
        level,
        event,
        before=float(changes[max(0, start - SECOND) : start - 1].max()),
        during=float(changes[start - 1 : end].max()),
        after=float(changes[end : end + 50].max()),
        abrupt=float(twin.changes[start - 1]),
        ticks=end - start,
        own=float(np.median(loop.times[start:end])),
        old=float(np.median(loop.times[start - SECOND // 4 : start])),
        new=float(np.median(twin.times[start:end])),
        notes=tuple({str(n) for t in loop.ticks[start:end] for n in t.notes if "released" in n.detail}),
    )


def measure(robot: Robot, level: str, events: Sequence[str] = EVENTS) -> list[Change]:
    """Run the events in turn, each from the end of the previous one."""
    whole, found = stack(robot, level), []
    com, hand, trunk, posture = whole.levels
    bare = whole.without("hand")
    swapped = Stack(com, trunk, hand, posture, subject_to=whole.subject_to)
    on_two = {"add": whole, "swap": swapped, "remove": bare}
    on_one = {"release": lifted(whole, robot), "take up": whole}
    for first, rest in ((bare, on_two), (whole, on_one)):
        if not set(rest) & set(events):
            continue
        loop, twin = Loop(robot, first, level), Loop(robot, first, level)
        for each in (loop, twin):
            if rest is on_one:
                each.shift()
            else:
                each.go(SECOND // 4, each.goals(0.0))
        found += [change(loop, twin, level, event, target) for event, target in rest.items() if event in events]
    return found
