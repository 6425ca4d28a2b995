"""CBi, the paper's second experiment (Figs. 7 to 9): right hand on a figure-8, CoG fixed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.lab.curves import figure_eight, largest, rms
from benchmarks.lab.outcome import Figure, Outcome, Table, holds, number, table
from benchmarks.lab.setting import Setting
from benchmarks.mistry2008.experiments.balance import GAINS, Balance, base_figures, follow, joint_margin, still
from hqp.solvers.base import Solver
from tests.scenes.mistry2008 import CBI, paper_stack

ACROSS, UP, FREQUENCY = 0.10, 0.06, 0.1
"""Half width [m], half height [m] and frequency [Hz] of the figure-8 in the frontal plane; not given in the paper."""

PRINTED = "chiaverini"
"""Solver of eqs. (16), (17) as printed."""


def draw(
    setting: Setting,
    solver: str | Solver,
    seconds: float,
    *,
    gain: float = 2.0,
    feedforward: bool = True,
    friction: float = 0.8,
    seed: int = 0,
) -> Balance:
    """One run; the log holds ``hand``, ``hand_goal``, ``com``, ``com_goal``."""
    stack = paper_stack(CBI, replace(GAINS, hand=gain))
    run = Balance(stack, solver, friction=friction, seed=seed, seen=setting.show)
    run.settle()
    follow(run, seconds, still, lambda t: figure_eight(t, ACROSS, UP, FREQUENCY), feedforward=feedforward)
    return run


def hand_errors(run: Balance) -> np.ndarray:
    """Hand minus goal, from half a period on, when the figure-8 has its full size ``(ticks, 3)`` [mm]."""
    started = run.log["t"] > 0.5 / FREQUENCY
    return np.asarray(1e3 * (run.log["hand"] - run.log["hand_goal"])[started])


def com_errors(run: Balance) -> np.ndarray:
    """CoG minus goal over the ground ``(ticks, 2)`` [mm]."""
    return np.asarray(1e3 * (run.log["com"][:, :2] - run.log["com_goal"]))


def experiment(setting: Setting) -> Outcome:
    """Figs. 7 to 9: strict priority by the chosen solver, and eq. (16) as printed, which degrades as in Fig. 8."""
    seconds = 30.0 if setting.full else 10.0
    outcome = Outcome("cbi-figure8")
    strict, printed = draw(setting, setting.solver, seconds), draw(setting, PRINTED, seconds)
    e, ep = hand_errors(strict), hand_errors(printed)
    outcome.figures += [
        holds(f"stands for {seconds:g} s", not strict.fallen),
        Figure("hand, RMS", rms(e), "mm", high=1.0, before="0.10"),
        Figure("hand, max", largest(e), "mm", before="0.18"),
        Figure("CoG over the ground, max", largest(com_errors(strict)), "mm", high=0.5, before="0.40"),
        Figure("feet, max", 1e3 * largest(strict.log["soles"].max(axis=1)), "mm", high=1.0, before="0.11"),
        Figure("hand, RMS, eq. (16) as printed, k = 2/s", rms(ep), "mm", low=45.0, high=55.0, before="51"),
        Figure("CoG over the ground, max, eq. (16)", largest(com_errors(printed)), "mm"),
        Figure(
            "distance of a joint from its limit, min", joint_margin(strict.log, strict.robot), "rad", before="0.117"
        ),
        *base_figures(strict.log),
        *setting.speed(strict.real_time, 5.0),
    ]
    outcome.parameters = {"across [m]": ACROSS, "up [m]": UP, "frequency [Hz]": FREQUENCY, "k_hand [1/s]": 2.0}
    outcome.parameters["seconds"] = seconds
    setting.log(outcome, "strict", strict.log)
    setting.log(outcome, "printed", printed.log)
    if setting.full:
        outcome.tables += [_sweep(setting), _velocities(strict)]
    setting.plot(outcome, "hand_in_time", strict, printed)
    setting.plot(outcome, "hand_in_plane", strict, printed)
    setting.plot(outcome, "cog_during_hand", strict, printed)
    return outcome


def _sweep(setting: Setting) -> Table:
    cases: list[tuple[str | Solver, float, bool, str]] = [
        (PRINTED, 2.0, True, "51"),
        (PRINTED, 5.0, True, "38"),
        (PRINTED, 10.0, True, "28"),
        (PRINTED, 2.0, False, "66"),
        (PRINTED, 10.0, False, "33"),
        ("nullspace", 2.0, True, "0.10"),
        (setting.solver, 2.0, True, "-"),
        (setting.solver, 10.0, True, "-"),
    ]
    rows = []
    for solver, gain, feedforward, before in cases:
        run = draw(setting, solver, 20.0, gain=gain, feedforward=feedforward)
        name = "eq. (16) as printed" if solver == PRINTED else str(solver)
        rows.append(
            (
                name,
                f"{gain:g}",
                "yes" if feedforward else "no",
                number(rms(hand_errors(run))),
                number(largest(com_errors(run))),
                before,
            )
        )
    header = ("law", "k_hand [1/s]", "feedforward", "hand RMS [mm]", "CoG max [mm]", "hand, earlier")
    return table("Law, gain and feedforward", header, rows)


def _velocities(run: Balance) -> Table:
    """Largest commanded velocity of each joint with its bound, for the ten joints nearest to theirs."""
    commanded = np.abs(run.log["command"]).max(axis=0)
    bound = run.robot.velocity_limit[run.robot.actuated]
    share = commanded / bound
    rows = [
        (run.robot.joint_names[i], number(float(commanded[i])), number(float(bound[i])), f"{100.0 * share[i]:.1f} %")
        for i in np.argsort(-share)[:10].tolist()
    ]
    return table("Joint velocities against their bounds", ("joint", "largest [rad/s]", "bound [rad/s]", "share"), rows)
