"""python -m benchmarks.retargeting --climbs WHEEL --bvh FOLDER [--kinds] [--robots g1 talos cbi] [-o TABLE.md]
[--physics] [--carried] [--only CLIP ...]"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hqp
from benchmarks.retargeting.clips import boxes, bvh_files, climbs
from hqp.markdown import table
from hqp.motion import Motion
from hqp.motion.anchored import solved
from hqp.motion.body import Body
from hqp.motion.contacts import NAMES
from hqp.motion.joints import SIDES, parts_of
from hqp.motion.measures import measure
from hqp.motion.retargeting import solution, ticked
from hqp.motion.skeleton_map import find_map
from hqp.motion.smoothing import smoothed
from hqp.motion.stacks import Stacks
from hqp.motion.targets import Targets, targets_of
from hqp.motion.tracker import Tracker
from tests.scenes.clips import kinds

HEADER = (
    "robot", "clip", "frames", "solved by", "frames/s", "sliding %", "below floor mm", "into itself mm", "hand p50 mm",
    "hand p99 mm", "hand at end mm", "toe p99 mm", "acceleration p99", "jerk p99",
)  # fmt: skip

FATES = ("robot", "clip", "seconds", "solved by", "falls after s", "ZMP off the soles %", "usable ticks %")


CARRIED = (
    "robot", "clip", "seconds", "today falls after s", "planned falls after s", "6 drawn runs carried",
    "ZMP off the soles %", "hands p99 mm", "CoM moved mm", "links off, today mm", "links off, planned mm",
)  # fmt: skip

DRAWN = 6
"""Number of drawn runs of a clip: each push of 0.1 m/s with masses 10 % up and down."""


def main() -> int:
    """Run the clips on the robots and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--climbs", type=Path, metavar="WHEEL", help="the unpacked wheel holosoma-retargeting 0.1.0")
    parser.add_argument("--bvh", type=Path, metavar="FOLDER", help="with .bvh files")
    parser.add_argument("--robots", nargs="+", default=["g1"])
    parser.add_argument("--no-rival", action="store_true", help="hqp alone")
    parser.add_argument("--physics", action="store_true", help="how long a torque controller tracks them in MuJoCo")
    parser.add_argument("--kinds", action="store_true", help="generated clips of six kinds")
    parser.add_argument("--carried", action="store_true", help="with dynamics, tracked in MuJoCo, also disturbed")
    parser.add_argument("--only", nargs="+", metavar="CLIP", help="names of clips; default: all")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="write the table there")
    arguments = parser.parse_args()
    rows = []
    for name in arguments.robots:
        for clip, motion in _clips(arguments):
            if arguments.only and clip not in arguments.only:
                continue
            rival, physics = not arguments.no_rival, arguments.physics
            robot = hqp.robots.load(name)
            with robot.keep_shapes():
                made = (
                    _carried(robot, clip, motion) if arguments.carried else _rows(robot, clip, motion, rival, physics)
                )
                for row in made:
                    rows.append(row)
                    print(" | ".join(row), flush=True)
    if arguments.output:
        header = CARRIED if arguments.carried else FATES if arguments.physics else HEADER
        arguments.output.write_text(table(header, rows) + "\n", encoding="utf-8")
    return 0


def _clips(arguments: Any) -> Iterator[tuple[str, Motion]]:
    if arguments.climbs:
        yield from climbs(arguments.climbs)
        yield from boxes(arguments.climbs)
    if arguments.bvh:
        yield from bvh_files(arguments.bvh)
    if arguments.kinds:
        yield from kinds(0)


def _rows(robot: Any, clip: str, motion: Motion, rival: bool, physics: bool) -> Iterator[tuple[str, ...]]:
    name = robot.name
    found = find_map(None, robot)
    body = Body.of(robot, found)
    motion = ticked(motion, motion.fps)
    parts = parts_of(motion.names, found.human)
    targets = targets_of(motion, parts, body)
    tracker = Tracker(robot, Stacks(robot, found, body, 1.0 / motion.fps), targets)
    for who, q, spent in _solved(tracker, motion, parts, rival):
        yield _fate(name, clip, who, targets, q) if physics else _row(name, clip, who, tracker, q, spent)


def _solved(tracker: Tracker, motion: Motion, parts: dict[str, str], rival: bool) -> Iterator[tuple[str, Any, float]]:
    """Solve the clip: name of the method, configurations, CPU time [s]."""
    begin = time.process_time()
    q = smoothed(tracker, solved(tracker)).q
    yield "hqp", q, time.process_time() - begin
    if not rival:
        return
    from benchmarks.retargeting.rival import follow

    robot, stacks, targets = tracker.robot, tracker.stacks, tracker.targets
    hands = targets.contacts.array()
    hands[:, [NAMES.index(f"{side}_foot") for side in SIDES]] = False
    raw = targets_of(motion, parts, stacks.body, hands)
    yield "GMR's scheme", *follow(robot, stacks, raw, latched=False)
    yield "the same, feet held", *follow(robot, stacks, targets, latched=True)


def _fate(name: str, clip: str, who: str, targets: Targets, q: Any) -> tuple[str, ...]:
    from benchmarks.retargeting.physics import fate

    f = fate(hqp.robots.load(name, rotors=True), targets, q)
    return name, clip, f"{f.of:.1f}", who, f"{f.seconds:.1f}", f"{100 * f.beyond:.0f}", f"{100 * f.usable:.0f}"


def _carried(robot: Any, clip: str, motion: Motion) -> Iterator[tuple[str, ...]]:
    """Without dynamics by the controller of ``--physics``, and with them, undisturbed and drawn."""
    from benchmarks.retargeting.carried import Disturbance, carry
    from benchmarks.retargeting.physics import fate

    name = robot.name
    found = find_map(None, robot)
    body = Body.of(robot, found)
    motion = ticked(motion, motion.fps)
    targets = targets_of(motion, parts_of(motion.names, found.human), body)
    today = fate(hqp.robots.load(name, rotors=True), targets, solution(robot, found, body, targets)[1].q)
    tracker, passed, plan = solution(robot, found, body, targets, dynamics=True)
    assert plan is not None
    drawn = [Disturbance(), *(Disturbance.drawn(seed, today.of) for seed in range(1, DRAWN + 1))]
    fates = [carry(hqp.robots.load(name, rotors=True), tracker.targets, passed.q, plan, each) for each in drawn]
    whole = sum(f.seconds >= f.of for f in fates[1:])
    out, hands = (
        f"{scale * a:.0f} -> {scale * b:.0f}" for scale, (a, b) in ((1e2, plan.zmp_outside), (1e3, plan.hands_p99))
    )
    yield (
        name, clip, f"{today.of:.1f}", *("-" if f.seconds >= f.of else f"{f.seconds:.1f}" for f in (today, fates[0])),
        f"{whole} of {DRAWN}", out, hands, f"{1e3 * plan.shift.max():.0f}", f"{1e3 * today.body:.0f}",
        f"{1e3 * fates[0].body:.0f}",
    )  # fmt: skip


def _row(name: str, clip: str, who: str, tracker: Tracker, q: Any, spent: float) -> tuple[str, ...]:
    s = measure(tracker.robot, tracker.stacks, tracker.targets, q).summary()
    return (
        name, clip, str(len(q)), who, f"{len(q) / spent:.0f}", f"{100 * s['slide_share']:.2f}",
        f"{1e3 * s['penetration']:.1f}", f"{max(0.0, -1e3 * s['clearance']):.1f}", f"{1e3 * s['hand_p50']:.1f}",
        f"{1e3 * s['hand_p99']:.0f}", f"{1e3 * s['hand_end']:.0f}", f"{1e3 * s['foot_p99']:.0f}",
        f"{s['acceleration_p99']:.0f}", f"{s['jerk_p99']:.2g}",
    )  # fmt: skip


if __name__ == "__main__":
    raise SystemExit(main())
