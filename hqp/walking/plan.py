"""A walk as a reference motion: the motion of the robot's own model under the walker's torques, written as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.errors import DeclarationError
from hqp.numbers import number

if TYPE_CHECKING:
    from hqp.declare.robot import State
    from hqp.loop.tick import Tick
    from hqp.walking.walker import Walker


@dataclass(frozen=True)
class Walk:
    """Configurations ``(T, nq)``, velocities ``(T, nv)`` and contacts ``(T, 2)``, frame by frame.

    q: base position [m], its quaternion xyzw, joints [rad].  v: velocity of the base in its own axes [m/s, rad/s],
    joints [rad/s].  contacts: true while the foot of that name stands.  fps [1/s].  joint_names: order of the entries
    behind the base, along each limb before the next.  phases: ``(T,)``, of the walker.  remarks: ``walker.why``, and
    the reason if no foot is lifted.
    """

    robot: str
    q: Mat
    v: Mat
    contacts: Any
    phases: tuple[str, ...]
    joint_names: tuple[str, ...]
    contact_names: tuple[str, ...]
    fps: float
    remarks: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Duration, number of landings of each foot, and remarks."""
        lands = np.sum(np.diff(np.asarray(self.contacts, dtype=int), axis=0) > 0, axis=0)
        feet = ", ".join(f"{name} foot {count}" for name, count in zip(self.contact_names, lands, strict=True))
        text = f"{self.robot}: {len(self.q)} frames, {len(self.q) / self.fps:.1f} s; landings: {feet}"
        return "; ".join((text, *self.remarks))

    def save(self, path: str | Path) -> None:
        """Write q, v, contacts, fps, names and orders as .npz; raises DeclarationError for another suffix."""
        if Path(path).suffix != ".npz":
            raise DeclarationError(
                "motion", "not a file of arrays", value=str(path), allowed="a path that ends in .npz"
            )
        np.savez_compressed(
            path, q=self.q, v=self.v, contacts=self.contacts, fps=self.fps, phases=np.array(self.phases),
            joint_names=np.array(self.joint_names), contact_names=np.array(self.contact_names),
            quaternion_order="xyzw", joint_order="depth first", robot=self.robot,
        )  # fmt: skip


def predict(walker: Walker, seconds: float, fps: float, remarks: tuple[str, ...] = ()) -> Walk:
    """Integrate the walker's model from its start: contacts hold, feet land at the ground.

    The last step, back to standing, begins as late as it may.  Raises DeclarationError for times.
    """
    seconds = number("plan", "seconds", seconds, 0.0, strict=True, unit="s")
    fps = number("plan", "fps", fps, 0.0, strict=True, most=1e5, unit="1/s")
    robot, dt = walker.robot, walker.dt
    q, v = walker.start, np.zeros(robot.nv)
    frames: list[tuple[Any, Any, tuple[bool, ...], str]] = []
    count, walks, stopping = round(seconds * fps) + 1, walker.walking, walker.stopping_time
    for k in range(round(seconds / dt) + 1):
        if walker.walking and walker.time > seconds - walker.stopping_time:
            walker.stop()
        phase, stance = walker.phase, walker.stance
        standing = tuple(not (phase == "swing" and side != stance) for side in (0, 1))
        before, rate = q, v
        q, v, _ = advance(walker, q, v)
        while len(frames) < count and (share := len(frames) / fps / dt - k) < 1.0 - 1e-6:
            if abs(share) < 1e-6:
                frames.append((before, rate, standing, phase))
            else:  # between two ticks
                there = robot.integrate(before, robot.difference(before, q), share)
                frames.append((there, rate + share * (v - rate), standing, phase))
    where, rates, contacts, phases = zip(*frames, strict=True)
    names = robot.joint_names
    contact_names = tuple(foot.name for foot in walker.feet)
    if walks and "swing" not in phases:
        least = stopping + walker.gait.first
        remarks += (f"no step in {seconds:.4g} s: a stop takes up to {stopping:.2g} s, so that steps need {least:.2g}",)
    arrays = np.array(where), np.array(rates), np.array(contacts)
    return Walk(robot.name, *arrays, phases, names, contact_names, fps, remarks)


def advance(walker: Walker, q: Vec, v: Vec) -> tuple[Vec, Vec, Tick]:
    """One tick of a walker and its own model under it: (q, v) after it, and the tick."""
    state, first = walker.robot.state(q, v), walker.time == 0.0
    tick = walker.step(state, _loads(walker, state))
    v = v + walker.dt * walker.session.acceleration(tick.x)
    q = walker.robot.integrate(q, v, walker.dt)
    if walker.event in ("shift", "stand") and not first:
        v = _stopped(walker, tick.state, v)
    return q, v, tick


def _stopped(walker: Walker, state: State, v: Vec) -> Vec:
    """Velocities after both feet met the ground without bouncing, v - A^-1 J' (J A^-1 J')^-1 J v."""
    J = np.vstack([state.jacobian(foot.frame) for foot in walker.feet])
    X = np.linalg.solve(state.mass_matrix(), J.T)
    stopped: Vec = v - X @ np.linalg.lstsq(J @ X, J @ v, rcond=1e-9)[0]
    return stopped


def _loads(walker: Walker, state: State) -> tuple[float, float]:
    """The weight on the feet that stand; a swing foot that reaches the ground takes a tenth of it [N]."""
    weight = walker.weight
    if walker.phase != "swing":
        return 0.5 * weight, 0.5 * weight
    side = 1 - walker.stance
    down = state.position(walker.feet[side].frame)[2] <= walker.holds[walker.stance].z
    share = 0.1 if down else 0.0
    return (share * weight, (1.0 - share) * weight) if side == 0 else ((1.0 - share) * weight, share * weight)
