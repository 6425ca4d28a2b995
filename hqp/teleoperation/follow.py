"""References from targets that come over a network: late, missing, repeated, out of order, wrong, or far away."""

from __future__ import annotations

import math
from time import monotonic
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hqp.declare.element import Task
from hqp.declare.reference import Reference
from hqp.declare.robot import State
from hqp.numbers import number

from .clutch import Clutch, operator_axes
from .packets import Clock, Inbox, Packet, as_float, packet
from .pursuit import Pursuit
from .spaces import Space
from .track import Sample, Track

LONGEST = 0.1
"""A loop that pauses for longer goes on as if it had paused for so long [s]."""

BEHIND = 0.01
"""Note a reference farther than this from the operator's hand [m, rad]."""


class Follow:
    """A source of references for one task, from the poses of an operator's hand.

    ``receive`` takes packets, from any thread; ``reference`` gives the reference of a tick.  Between packets the hand
    is predicted, over the age of the latest one, by a cubic through the last 0.3 s; without packets it comes to rest by
    ``max_age`` [s].  Poses that the hand cannot have reached are discarded: a pose that is not finite or no rotation,
    older than one before it or the same again, or farther away than a hand can get; if such poses agree for as long as
    the reference would take to get there, they are accepted.  The reference goes after the prediction without lag, at
    most at ``largest_speed`` [m/s], ``largest_turn`` [rad/s] and ``largest_acceleration`` [m/s^2], and for turns in
    proportion.  The notes of the tick report this.

    element: a Pose, Position or Orientation, or another task whose value is a vector.  clutch: motion of the hand
    counts only while it is ``engaged``, from where the robot's hand is when that begins; otherwise poses are absolute.
    Silence of more than ``max_age`` opens it until a packet with an open and one with a closed clutch have come.
    scale: of lengths.  frame: operator's axes in those of the task, ``(3, 3)`` or ``(4, 4)``; one that mirrors needs
    the clutch.  latency [s]: least transmission time of a packet, if the sender's clock is unknown.  Raises
    DeclarationError for values out of range.
    """

    def __init__(
        self,
        element: Task,
        *,
        max_age: float = 0.1,
        largest_speed: float = 2.0,
        largest_turn: float = 2.0 * math.pi,
        largest_acceleration: float = 10.0,
        clutch: bool = False,
        scale: float = 1.0,
        frame: ArrayLike | None = None,
        latency: float = 0.0,
    ) -> None:
        self._space, self.element = Space(element), element
        self.max_age = number("Follow", "max_age", max_age, 0.0, strict=True)
        speed = number("Follow", "largest_speed", largest_speed, 0.0, strict=True)
        self._speeds = speed, number("Follow", "largest_turn", largest_turn, 0.0, strict=True)
        most = number("Follow", "largest_acceleration", largest_acceleration, 0.0, strict=True)
        self._accelerations = most, most * self._speeds[1] / self._speeds[0]
        self._latency, self._clutched = number("Follow", "latency", latency, 0.0), bool(clutch)
        self._scale = number("Follow", "scale", scale, 0.0, strict=True)
        self._frame = None if frame is None else operator_axes(frame, self._clutched)
        self._clutch: Clutch | None = None
        self._inbox, self._clock = Inbox(), Clock()
        self._track = Track(self._space, (self._speeds[0] / self._scale, self._speeds[1]))
        self._pursuit: Pursuit | None = None
        self._engaged, self._joined, self._opened = not clutch, not clutch, True
        self._latest, self._stale, self._now = -math.inf, math.inf, -math.inf

    def receive(
        self,
        value: Any,
        *,
        sent: float | None = None,
        age: float | None = None,
        engaged: bool = False,
        received: float | None = None,
    ) -> None:
        """Take a packet, from any thread; never raises for its content.

        value: argument of ``element.at``.  sent [s]: when, on any clock of the sender's; or age [s]: its age.  engaged:
        True while the operator holds the clutch; any other value opens it.  received [s]: on the clock of
        ``reference``, that of ``time.monotonic`` for None.
        """
        when = monotonic() if received is None else received
        self._inbox.put(packet(self.element, value, sent, age, when, engaged))

    def disengage(self, reason: str) -> None:
        """Open the clutch after the packets received so far, from any thread; a new squeeze closes it."""
        self._inbox.put(Packet(None, -math.inf, -math.inf, False, False, reason, releases=True))

    def reference(self, state: State, now: float | None = None) -> Reference:
        """The reference of a tick.

        state: state of the tick.  now [s]: on the clock of ``receive``, that of ``time.monotonic`` for None.  A ``now``
        that is not a finite number counts as that of the tick before, with a remark; an invalid state before the first
        valid one keeps the hold value.
        """
        at, remarks = monotonic() if now is None else as_float(now), []
        if not math.isfinite(at):
            remarks.append(f"now={now!r:.40} is not a finite time [s]: counted as that of the tick before")
            at = self._now
        dt = min(max(at - self._now, 0.0), LONGEST) if self._now > -math.inf else 0.0
        # a clock that was set back by more than a pause of the loop goes on from there
        self._now = now = at if at < self._now - LONGEST else max(at, self._now)
        pursuit = self._pursuit or (self._begin(state) if state.valid else None)
        if pursuit is None:
            return Reference(self.element.name, remarks=tuple(remarks))
        remarks += [self._take(one, pursuit) for one in self._inbox.take(now)]
        remarks.append(self._pursue(pursuit, state, now, dt))
        return Reference(
            self.element.name, np.copy(pursuit.value), pursuit.v, pursuit.a, remarks=tuple(filter(None, remarks))
        )

    @property
    def takes(self) -> str:
        """Type of the task's value: "pose", "rotation" or "vector"."""
        return {None: "vector", 0: "rotation"}.get(self._space.first, "pose")

    def release(self) -> None:
        """Open the clutch until a packet sets ``engaged``, and forget the track of the hand."""
        self._track.forget()
        self._latest, self._stale = -math.inf, math.inf
        self._engaged, self._joined, self._opened = not self._clutched, not self._clutched, True

    def restart(self) -> None:
        """Release, and begin where the robot's hand is at the next tick: for a robot that was put elsewhere."""
        self.release()
        self._pursuit = None

    def _begin(self, state: State) -> Pursuit:
        start = self._value(state)
        self._pursuit = made = Pursuit(self._space, start, self._speeds, self._accelerations)
        self._clutch = self._joint(made.v.size)
        return made

    def _joint(self, k: int) -> Clutch:
        return Clutch(self._space, self.element, k, self._scale, self._frame)

    def _value(self, state: State) -> Any:
        """Pose of the robot's hand, or the reference's pose if the state is invalid."""
        if self._pursuit is not None and not state.valid:
            return self._pursuit.value
        return np.array(self.element.value(state))

    def _take(self, one: Packet, pursuit: Pursuit) -> str:
        """Take a packet; return its fault, if any."""
        if one.releases:
            self.release()
            self._opened = False
            return one.fault
        late = one.sent < self._latest
        if self._clutched and not one.engaged and not late:
            self._engaged = False
        if one.value is None:
            return f"packet discarded: {one.fault}"
        if one.value.shape != pursuit.value.shape:
            return f"packet discarded: value of shape {one.value.shape}, allowed {pursuit.value.shape}"
        self._clock.take(one)
        if late:
            return self._refuse(one)
        if one.sent == self._latest:
            return "packet discarded: duplicate"
        self._latest, self._stale = one.sent, math.inf
        self._opened = self._opened or not one.engaged
        if off := self._track.take(Sample(one.sent, one.value)):
            return f"packet discarded: {off:.3g} outside the reachable motion"
        if self._clutched:
            self._engaged = one.engaged and self._opened
        return ""

    def _refuse(self, one: Packet) -> str:
        """A packet that is older than one before it; a clock that stays behind for max_age is another one."""
        self._stale = min(self._stale, one.received)
        if one.received - self._stale <= self.max_age:
            return "packet discarded: older than the one before"
        self._clock.restart()
        self._track.forget()
        self._latest, self._stale = -math.inf, math.inf
        return "the sender's clock restarted"

    def _pursue(self, pursuit: Pursuit, state: State, now: float, dt: float) -> str:
        """Go after the operator's hand for dt [s]; return a remark on it."""
        motion, clutch = self._track.motion, self._clutch
        assert clutch is not None
        if motion is None or not self._engaged:
            self._joined = self._joined and not self._clutched
            pursuit.stop(dt)
            if motion is None:
                return "fewer than three consistent packets: held"
            return "the clutch is open: held" if self._opened else "the clutch is open until a new squeeze: held"
        age = max(now - self._clock.behind - motion.time, 0.0) + self._latency
        if age > self.max_age and self._clutched:
            self._engaged = self._joined = self._opened = False
            pursuit.stop(dt)
            return f"no packet for {age:.2g} s: the clutch is open until a new squeeze"
        x, v, a = motion.at(age, self.max_age)
        here = self._space.plus(motion.value, x)
        if not self._joined:
            self._joined = True
            clutch.engage(here, self._value(state))
        target = clutch.value(here)
        pursuit.step(dt, target, clutch.rate(v), clutch.rate(a))
        if age > self.max_age:
            return f"no packet for {age:.2g} s: held"
        if not pursuit.held_under:
            return ""
        behind = float(np.abs(self._space.minus(pursuit.value, target)).max())
        return f"the hand is faster than the reference may be: {behind:.2g} behind" if behind > BEHIND else ""
