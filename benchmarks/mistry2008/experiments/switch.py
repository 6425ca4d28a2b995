"""CBi switches contacts: shift onto the left foot, lift the right one, hold it, put it down, shift back."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.lab.curves import largest, smooth
from benchmarks.lab.outcome import Figure, Outcome, holds
from benchmarks.lab.setting import Setting
from benchmarks.mistry2008.experiments.balance import (
    GAINS,
    PERIOD,
    Balance,
    base_figures,
    joint_margin,
    torque_share,
)
from hqp import Level, P, Stack
from hqp.arrays import Vec
from hqp.tasks import Com, FixedContact, Pose
from tests.scenes.mistry2008 import CBI, Gains, paper_stack

LIFT = 0.04
"""Height of the lifted foot [m]."""


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """Durations [s]: shift the CoG, lift the foot, hold it, put it down, shift back."""

    shift: float = 4.0
    lift: float = 2.0
    hold: float = 5.0
    settle: float = 1.0

    @property
    def ends(self) -> tuple[float, ...]:
        """Ends of: shift, pause, lift, hold, lowering, pause, shift back, pause."""
        spans = (self.shift, self.settle, self.lift, self.hold, self.lift, self.settle, self.shift, self.settle)
        return tuple(np.cumsum(spans).tolist())


def stepping(gains: Gains) -> Stack:
    """Feet and CoG, the right foot while both stand > its pose while it is aloft > pelvis and CoG height > posture."""
    both = paper_stack(CBI, gains, hand=False)
    both = both.replace(replace(both.find("r_sole", FixedContact), when="both"))
    swing = Pose(frame="r_sole", law=P(gains.cog), name="swing")
    return Stack(both.levels[0], Level(swing, name="functional", when="aloft"), *both.levels[1:])


QUICK = Schedule(shift=2.5, lift=1.2, hold=5.0, settle=0.6)


def switch(
    setting: Setting, schedule: Schedule, *, friction: float = 0.8, seed: int = 0
) -> tuple[Balance, list[float]]:
    """One run; the log holds ``com_goal`` and ``lift`` [m].  Also the jumps of the commanded joint velocity [rad/s]."""
    stack = stepping(GAINS)
    run = Balance(stack, setting.solver, friction=friction, seed=seed, seen=setting.show, phase="both")
    shift, ready, lifted, held, lowered, rested, back, end = schedule.ends
    run.instants = [("both feet", 0.1), ("shifted", ready), ("lifted", 0.5 * (lifted + held)), ("down again", rested)]
    run.settle()
    lift_off, touch_down = ready, lowered
    onto = run.soles[0][:2] + [run.goal[0] - run.soles[:, 0].mean(), 0.0] - run.goal
    stance = run.plant.place("r_sole")

    def com_path(t: float) -> Vec:
        there = smooth(t / shift) - smooth((t - rested) / (back - rested))
        return np.asarray(run.goal + there * onto)

    def height(t: float) -> float:
        return LIFT * (smooth((t - lift_off) / (lifted - lift_off)) - smooth((t - held) / (lowered - held)))

    com, swing = stack.find("com_xy", Com), stack.find("swing", Pose)
    jumps: list[float] = []
    before: Vec | None = None
    while run.t < end - 0.5 * PERIOD and not run.fallen:
        t = run.t
        aloft = lift_off - 0.5 * PERIOD < t < touch_down - 0.5 * PERIOD
        wanted = "aloft" if aloft else "both"
        switched, run.phase = run.phase != wanted, wanted
        rate = (com_path(t + PERIOD) - com_path(t)) / PERIOD
        references = [com.at(com_path(t), velocity=rate)]
        if aloft:
            place = stance[0] + [0.0, 0.0, height(t)]
            velocity = np.zeros(6)
            velocity[2] = (height(t + PERIOD) - height(t)) / PERIOD
            references.append(swing.at((place, stance[1]), velocity=velocity))
        tick = run.step(
            *references,
            com_goal=com_path(t + PERIOD),
            lift_goal=height(t + PERIOD),
            aloft=float(aloft),
        )
        run.log.add_to_last(lift=run.plant.place("r_sole")[0][2] - stance[0][2], load=run.plant.contacts().load)
        if switched and before is not None:
            jumps.append(float(np.abs(tick.command - before).max()))
        before = tick.command
    return run, jumps


def experiment(setting: Setting) -> Outcome:
    """The paper leaves this to future work; the phases are those of one stack."""
    schedule = Schedule() if setting.full else QUICK
    outcome = Outcome("cbi-switch")
    run, jumps = switch(setting, schedule)
    log = run.log
    e = 1e3 * (log["com"][:, :2] - log["com_goal"])
    aloft = log["aloft"] > 0.5
    share, joint = torque_share(log, run.robot)
    high = PERIOD * np.count_nonzero(log["lift"] > 0.9 * LIFT)
    stance = 1e3 * largest(log["soles"][:, 0])
    landed = 1e3 * float(log["soles"][-1, 1])
    outcome.figures += [
        holds("stands to the end", not run.fallen),
        Figure("foot lifted, max", 1e3 * float(log["lift"].max()), "mm", low=40.0, high=43.0, before="40 to 42"),
        Figure("foot above 36 mm for", high, "s", low=5.0, before="5.8 above 35 mm"),
        Figure("CoG over the ground, max", largest(e), "mm", high=12.0, before="7 to 10"),
        Figure("CoG over the ground while the foot is aloft, max", largest(e[aloft]), "mm", before="2 to 8 (hold)"),
        Figure("largest jump of a joint's velocity at a switch", max(jumps, default=np.nan), "rad/s", before="0.005"),
        Figure("stance foot, max", stance, "mm"),
        Figure("lifted foot from where it stood, at the end", landed, "mm"),
        Figure("load on the lifted foot, min", float(log["load"][aloft, 1].min()), "N"),
        Figure(f"motor torque of its limit, max ({joint})", 100.0 * share, "%", high=100.0, before="82 to 84 (L_HAA)"),
        Figure("distance of a joint from its limit, min", joint_margin(log, run.robot), "rad", before="0.087"),
        *base_figures(log),
        *setting.speed(run.real_time, 5.0),
    ]
    outcome.parameters = {"lift [m]": LIFT, "schedule [s]": schedule, "switches": len(jumps)}
    setting.log(outcome, "run", log)
    setting.plot(outcome, "switch", run)
    return outcome
