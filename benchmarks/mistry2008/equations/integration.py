"""Eq. (19) over time: drift of the feet, and the paper's experiments in the loop with their figures' numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from benchmarks.mistry2008 import loop
from benchmarks.mistry2008.loop import Trace
from benchmarks.reports.checks import Check, at_most, seen_to_fail
from hqp.robots import Robot
from tests.scenes.mistry2008 import GAINS, Gains, near_home, paper_stack, roles

GAIN = 2.0
"""Gain of the hand in the figure-8 [1/s]; the paper gives none."""

HAND_RMS, COG_ERROR, FOOT_ERROR = 0.2e-3, 0.02e-3, 0.01e-3
"""Limits of the loops with the recursive projector [m]."""

PERIODS = (0.008, 0.004, 0.002, 0.001)
"""Control periods of the drift [s]."""


@dataclass(frozen=True)
class Experiments:
    """The traces behind the figures: recursive projector, eq. (16), CoG with and without feedforward."""

    recursive: Trace
    printed: Trace
    cog: Trace
    cog_lagging: Trace


def experiments(robot: Robot) -> Experiments:
    """Run the paper's two experiments on one robot, 500 Hz, 10 s each."""
    stack = paper_stack(roles(robot), Gains(hand=GAIN))
    return Experiments(
        loop.run(robot, "nullspace", 10.0, stack=stack),
        loop.run(robot, "chiaverini", 10.0, stack=stack),
        loop.run(robot, "nullspace", 10.0, hand=loop.rest, com=loop.side_to_side),
        loop.run(robot, "nullspace", 10.0, hand=loop.rest, com=loop.side_to_side, feedforward=False),
    )


def checks(robot: Robot, runs: Experiments, periods: Sequence[float] = PERIODS) -> Iterator[Check]:
    """Every row on one robot."""
    yield from _drift(robot, periods)
    yield from _figure_eight(robot, runs)
    yield from _side_to_side(robot, runs)
    yield from _regulation(robot)


def _drift(robot: Robot, periods: Sequence[float]) -> Iterator[Check]:
    """(19) alone lets the feet drift in proportion to dt; position feedback holds them."""
    q = near_home(robot, np.random.default_rng(3))
    slips = [
        loop.run(robot, "nullspace", 3.0, com=loop.side_to_side, contact_gain=0.0, dt=dt, q=q).slip for dt in periods
    ]
    held = loop.run(robot, "nullspace", 3.0, com=loop.side_to_side, q=q).slip
    note = (
        "drift " + ", ".join(f"{slip:.1e}" for slip in slips) + " m at " + ", ".join(f"{1e3 * dt:g}" for dt in periods)
    )
    text = "feet drift halves with dt, asymmetric stance, 3 s: |ratio - 2|"
    ratios = [abs(coarse / fine - 2.0) for coarse, fine in pairwise(slips)]
    yield at_most("M(19)", text, robot.name, 0.3, ratios, note)
    anchored = [
        loop.run(robot, "nullspace", 3.0, com=loop.side_to_side, contact_gain=0.0, dt=dt, q=q, anchored=True).slip
        for dt in periods
    ]
    ratios = [abs(coarse / fine - 2.0) for coarse, fine in pairwise(anchored)]
    note = "drift " + ", ".join(f"{slip:.1e}" for slip in anchored) + " m, all of it the right sole's"
    text = "joints alone integrated, base from the left sole: drift halves with dt, |ratio - 2|"
    yield at_most("M(19)", text, robot.name, 0.3, ratios, note)
    yield at_most("M(19)", "with position feedback at 500 Hz: drift [m]", robot.name, 1e-6, [held])
    yield seen_to_fail("M(19)", "without feedback at 125 Hz: drift [m]", robot.name, 1e-7, slips[:1])


def _figure_eight(robot: Robot, runs: Experiments) -> Iterator[Check]:
    recursive, printed, name = runs.recursive, runs.printed, robot.name
    yield at_most("M Fig. 8", "figure-8, recursive projector: hand RMS [m]", name, HAND_RMS, [recursive.hand_rms])
    note = f"eq. (16) as printed, gain {GAIN:g}/s, feedforward: {1e3 * printed.hand_rms:.0f} mm"
    yield seen_to_fail("M Fig. 8", "figure-8, eq. (16): hand RMS [m]", name, HAND_RMS, [printed.hand_rms], note)
    for which, trace in (("recursive projector", recursive), ("eq. (16)", printed)):
        yield at_most("M Fig. 9", f"figure-8, {which}: CoG error [m]", name, COG_ERROR, [trace.com_error])
        yield at_most("M(9)", f"figure-8, {which}: feet [m]", name, FOOT_ERROR, [trace.slip])


def _side_to_side(robot: Robot, runs: Experiments) -> Iterator[Check]:
    """Fig. 6; without feedforward the CoG is a first-order lag: gain k / sqrt(k^2 + w^2), delay atan(w / k) / w."""
    name = robot.name
    yield at_most("M Fig. 6", "CoG side to side, feedforward: CoG error [m]", name, COG_ERROR, [runs.cog.com_error])
    yield at_most("M Fig. 6", "CoG side to side: feet [m]", name, FOOT_ERROR, [runs.cog.slip, runs.cog_lagging.slip])
    gain, delay = loop.response(runs.cog_lagging)
    w = 2.0 * np.pi / loop.COG_PERIOD
    errors = [abs(gain - GAINS.cog / np.hypot(GAINS.cog, w)), abs(delay - np.arctan2(w, GAINS.cog) / w)]
    note = f"gain {gain:.3f}, lag {delay:.3f} s at k = {GAINS.cog:g}/s"
    yield at_most(
        "M Fig. 6", "without feedforward the lag of the paper's figure: first order", name, 2e-3, errors, note
    )


def _regulation(robot: Robot) -> Iterator[Check]:
    """Statement 6 of the equivalences: both methods reach a reachable target, (16) more slowly."""
    stack = paper_stack(roles(robot), Gains(hand=GAIN))
    aside = np.array([-0.02, 0.03, 0.04])
    errors = {}
    for solver in ("nullspace", "chiaverini"):
        trace = loop.run(robot, solver, 20.0, stack=stack, hand=lambda t: aside, feedforward=False, dt=0.01)
        errors[solver] = np.linalg.norm(trace.hand - trace.hand_target, axis=1)
    text = "2.1.6: regulation, 20 s: hand error, recursive projector [m]"
    yield at_most("M equiv", text, robot.name, 1e-9, [errors["nullspace"][-1]])
    slow = errors["chiaverini"]
    note = f"eq. (16): {1e3 * slow[len(slow) // 2]:.2f} mm after 10 s, {1e3 * slow[-1]:.2f} mm after 20 s"
    text = "2.1.6: regulation: growth of the hand error under (16) [m]"
    yield at_most("M equiv", text, robot.name, 1e-9, [float(np.max(np.diff(slow)))], note)
