"""Changes of stack in a closed loop: how far a command jumps, and what a tick of a transition takes.

Add a hand, swap two levels, remove the hand; shift the CoM over a foot, release the other one, take it up again: on
every robot at every level, transitions of 0.25 s at 2 ms, on the exact integrator.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import thread_time

import numpy as np

import hqp
from benchmarks.reports import report
from hqp import Level, Stack
from hqp.commands.arguments import formulation
from hqp.declare.reference import Reference
from hqp.loop.outgoing import largest_change
from hqp.loop.transition.blend import smooth
from hqp.robots import Robot
from hqp.tasks import Com, FixedContact, FrictionCone, JointLimits, Orientation, Position, Posture, TorqueLimits

ROBOTS = ("talos", "cbi", "icub", "g1")
LEVELS = ("velocity", "acceleration", "torque")
EVENTS = ("add", "swap", "remove", "release", "take up")
UNITS = {"velocity": "rad/s", "acceleration": "rad/s^2", "torque": "N m"}
DT, OVER = 0.002, 0.25
SECOND = int(1.0 / DT)
LONGEST = 1500
"""Ticks that a transition may take."""

MARK = "<!-- tables: python -m benchmarks changes --page docs/results/safety.md -->"
END = "<!-- end of tables -->"


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
    """A closed loop on the exact integrator, every command and the time of every tick kept."""

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
        """Ticks with those references."""
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
        """Of the CoM, that share of the way from between the feet to over the left one, and of the hand if there."""
        found = [Com(name="com").at((1.0 - over) * self.com + over * self.above)]
        palm = self.robot.landmarks["palms"][1]
        return [*found, Position(frame=palm, name="hand").at(self.hand)] if "hand" in self.run else found

    def shift(self, ticks: int = SECOND) -> None:
        """Take the CoM over the left foot, and wait half a second."""
        for k in range(ticks):
            self.go(1, self.goals(smooth(k / ticks)))
        self.go(SECOND // 2, self.goals(1.0))


@dataclass
class Change:
    """What a change did: largest changes of the command in a tick, before it (a second), in it and after it (0.1 s,
    when the new stack does what it does).

    abrupt: the same without easing, in its first tick.  ticks: of the transition.  own: median CPU time of a tick in
    the transition [s].  old, new: of the quarter of a second before it, and of the ticks that follow the abrupt change,
    as many as the transition takes.  notes: that a contact cannot be released.
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
        """Whether no tick of it, nor the one after it, changes the command by more than allowed."""
        return self.during <= self.allowed * (1.0 + 1e-9)

    def __str__(self) -> str:
        jumps = f"before {self.before:.3g}, after {self.after:.3g}, at once {self.abrupt:.3g}"
        plain = f"{1e6 * self.old:.0f} us before and {1e6 * self.new:.0f} us after"
        times = f"{self.ticks} ticks of {1e6 * self.own:.0f} us, {self.ratio:.2f} of {plain}"
        told = "; ".join(("" if self.calm else "NOT CALM", *self.notes))
        return f"{self.event}: {self.during:.3g} ({jumps}), {times} {told}"

    @property
    def ratio(self) -> float:
        """A tick of the transition in plain ticks, the mean of those of the two stacks."""
        return 2.0 * self.own / (self.old + self.new)


def change(loop: Loop, twin: Loop, level: str, event: str, stack: Stack) -> Change:
    """Ease into a stack, its twin at once, and half a second more."""
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
    """The events in turn, each from where the one before has led."""
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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this part."""
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS), metavar="ROBOT")
    parser.add_argument("--levels", nargs="+", choices=LEVELS, default=list(LEVELS))
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the tables into this page")


def run(arguments: argparse.Namespace) -> int:
    """Run, show, write; returns 1 if a change is not calm."""
    found = []
    for name in arguments.robots[:1] if arguments.quick else arguments.robots:
        robot = hqp.robots.load(name)
        for level in arguments.levels:
            for each in measure(robot, level):
                found.append(each)
                print(f"{name} {level} {each}", flush=True)
    text = tables(found)
    report.section(arguments.output, "changes", text)
    if arguments.page is not None:
        report.into_page(arguments.page, MARK, text, END)
    return 0 if all(each.calm for each in found) else 1


def tables(found: Sequence[Change]) -> str:
    """Jumps, and ticks of a transition in plain ticks, as Markdown."""
    head = f"| | {' | '.join(EVENTS)} |\n|---{'|---' * len(EVENTS)}|\n"

    def rows(cell: Callable[[Change], str]) -> str:
        lines = []
        for level in LEVELS:
            for name in dict.fromkeys(c.robot for c in found):
                mine = {c.event: cell(c) for c in found if (c.level, c.robot) == (level, name)}
                if mine:
                    cells = " | ".join(mine.get(event, "") for event in EVENTS)
                    lines.append(f"| {name}, {level} [{UNITS[level]}] | {cells} |")
        return "\n".join(lines)

    def jump(c: Change) -> str:
        worst = number(c.during)
        return f"{worst if c.calm else f'**{worst}**'} ({number(c.before)}; {number(c.abrupt)})"

    return (
        "Largest change of a command in one tick; in brackets that of the second before, and of the same change at"
        f" once:\n\n{head}{rows(jump)}\n\n"
        "CPU time of a tick of the transition in plain ticks, the mean of those of the old stack before it and of those"
        " that follow\nthe same change at once (medians):\n\n"
        f"{head}{rows(lambda c: f'{c.ratio:.1f}')}\n"
    )


def number(value: float) -> str:
    """Two digits, and 0 for rounding."""
    return "0" if value < 1e-6 else f"{value:.2g}" if value < 10.0 else f"{value:.0f}"
