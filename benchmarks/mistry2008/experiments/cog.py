"""CBi, the paper's first experiment (Fig. 6): CoG from side to side, fixed from front to back."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.lab.curves import largest, response, rms, side
from benchmarks.lab.outcome import Figure, Outcome, Table, holds, number, table
from benchmarks.lab.setting import Setting
from benchmarks.mistry2008.experiments.balance import (
    GAINS,
    SENSES,
    Balance,
    Feedback,
    Knows,
    base_errors,
    base_figures,
    follow,
    joint_margin,
    torque_share,
)
from hqp.robots.on_mujoco import Noise, Sensors
from tests.scenes.mistry2008 import CBI, paper_stack

AMPLITUDE, FREQUENCY = 0.04, 0.2
"""Side to side [m], [Hz]; the paper's Fig. 6 shows only the shape."""

LARGER = ((0.10, 0.1, "stands"), (0.12, 0.1, "falls"), (0.04, 0.6, "stands"), (0.04, 0.8, "falls"))
"""Amplitude [m], frequency [Hz], and the result of earlier studies."""


@dataclass(frozen=True, kw_only=True)
class Swing:
    """One run from side to side."""

    seconds: float
    amplitude: float = AMPLITUDE
    frequency: float = FREQUENCY
    gain: float = 2.0
    feedforward: bool = True
    feedback: Feedback = "task"
    knows: Knows = "senses"
    sensors: Sensors = SENSES
    friction: float = 0.8
    seed: int = 0


def swing(plan: Swing, setting: Setting) -> Balance:
    """Run the swing; the log holds ``com`` and ``com_goal``."""
    stack = paper_stack(CBI, replace(GAINS, cog=plan.gain), hand=False)
    run = Balance(
        stack,
        setting.solver,
        feedback=plan.feedback,
        knows=plan.knows,
        sensors=plan.sensors,
        friction=plan.friction,
        seed=plan.seed,
        seen=setting.show,
    )
    run.settle()
    follow(run, plan.seconds, lambda t: side(t, plan.amplitude, plan.frequency), feedforward=plan.feedforward)
    return run


def errors(run: Balance) -> np.ndarray:
    """CoG minus goal over the ground ``(ticks, 2)`` [mm]."""
    return np.asarray(1e3 * (run.log["com"][:, :2] - run.log["com_goal"]))


def lag(run: Balance, frequency: float) -> tuple[float, float]:
    """(gain, lag [s]) of the CoG's side to side motion."""
    log, middle = run.log, run.goal[1]
    return response(log["t"], log["com_goal"][:, 1] - middle, log["com"][:, 1] - middle, frequency)


def experiment(setting: Setting) -> Outcome:
    """Fig. 6 with and without feedforward; in full, also other gains, amplitudes, frequencies, and the plain reset."""
    seconds = 60.0 if setting.full else 15.0
    outcome = Outcome("cbi-cog")
    steady = swing(Swing(seconds=seconds), setting)
    lagging = swing(Swing(seconds=seconds, feedforward=False), setting)
    e, foot = errors(steady), 1e3 * largest(steady.log["soles"].max(axis=1))
    gain, delay = lag(lagging, FREQUENCY)
    share, joint = torque_share(steady.log, steady.robot)
    outcome.figures += [
        holds(f"stands for {seconds:g} s", not steady.fallen),
        Figure("CoG left-right, RMS", rms(e[:, 1]), "mm", high=2.0, before="0.85"),
        Figure("CoG left-right, max", largest(e[:, 1]), "mm", before="1.2"),
        Figure("CoG front-back, RMS", rms(e[:, 0]), "mm", high=2.0, before="0.25"),
        Figure("feet, max", foot, "mm", high=1.0, before="0.29"),
        Figure("lag without feedforward", delay, "s", low=0.39, high=0.45, before="0.433"),
        Figure("gain without feedforward", gain, "", low=0.84, high=0.90, before="0.868"),
        Figure(f"motor torque of its limit, max ({joint})", 100.0 * share, "%", before="14"),
        Figure("distance of a joint from its limit, min", joint_margin(steady.log, steady.robot), "rad"),
        *base_figures(steady.log),
        *setting.speed(steady.real_time, 5.0),
    ]
    outcome.parameters = {"amplitude [m]": AMPLITUDE, "frequency [Hz]": FREQUENCY, "seconds": seconds, "k_cog [1/s]": 2}
    outcome.parameters["sensors"] = SENSES
    setting.log(outcome, "steady", steady.log)
    setting.log(outcome, "no_feedforward", lagging.log)
    if setting.full:
        outcome.tables += [_larger(setting), _gains(setting), _feedback(setting), _knowing(setting)]
    setting.plot(outcome, "cog_in_time", steady, lagging)
    return outcome


def _larger(setting: Setting) -> Table:
    rows = []
    for amplitude, frequency, found in LARGER:
        run = swing(Swing(seconds=max(20.0, 3.0 / frequency), amplitude=amplitude, frequency=frequency), setting)
        e, (share, joint) = errors(run), torque_share(run.log, run.robot)
        rows.append(
            (
                f"+-{100 * amplitude:g} cm, {frequency:g} Hz",
                f"falls at {run.t:.1f} s" if run.fallen else "stands",
                number(rms(e[:, 1])),
                number(1e3 * largest(run.log["soles"].max(axis=1))),
                f"{100 * share:.0f} % ({joint})",
                found,
            )
        )
    header = ("motion", "outcome", "CoG left-right RMS [mm]", "feet max [mm]", "motor torque of its limit", "earlier")
    return table("How far and how fast", header, rows)


def _gains(setting: Setting) -> Table:
    rows = []
    for k, before in ((1.0, "0.70"), (2.0, "0.433"), (4.0, "0.23")):
        run = swing(Swing(seconds=25.0, gain=k, feedforward=False), setting)
        gain, delay = lag(run, FREQUENCY)
        rows.append((f"{k:g}", number(delay), number(gain), before))
    return table("Lag without feedforward", ("k_cog [1/s]", "lag [s]", "gain", "lag, earlier [s]"), rows)


def _feedback(setting: Setting) -> Table:
    rows = []
    for feedback, text in (
        ("task", "commands integrated on their own, tasks see the measured state"),
        ("none", "commands integrated on their own, tasks see the commanded state"),
        ("reset", "every command starts from the measured joints (eq. 19 read literally)"),
    ):
        run = swing(Swing(seconds=15.0, feedback=feedback), setting)  # type: ignore[arg-type]
        fell = f"falls at {run.t:.1f} s" if run.fallen else "stands"
        rows.append((text, fell, number(rms(errors(run)[:, 1]))))
    return table("What the servos are told", ("loop", "outcome", "CoG left-right RMS [mm]"), rows)


def _knowing(setting: Setting) -> Table:
    rows = []
    tilted = replace(SENSES, orientation=Noise(1e-3, (0.0, math.radians(0.25), 0.0)))
    for text, knows, sensors in (
        ("the simulator's base: privileged", "truth", Sensors()),
        ("IMU, encoders and feet, without noise", "senses", Sensors()),
        ("IMU, encoders and feet, with noise", "senses", SENSES),
        ("the same, IMU pitched by 0.25 deg", "senses", tilted),
    ):
        run = swing(Swing(seconds=15.0, knows=knows, sensors=sensors), setting)  # type: ignore[arg-type]
        e, (place, angle) = errors(run), base_errors(run.log)
        fell = f"falls at {run.t:.1f} s" if run.fallen else "stands"
        rows.append((text, fell, number(place), number(angle), number(rms(e[:, 1])), number(largest(e))))
    header = (
        "what it knows of its base",
        "outcome",
        "base off by [mm]",
        "and by [deg]",
        "CoG left-right RMS [mm]",
        "CoG max [mm]",
    )
    return table("What the controller knows", header, rows)
