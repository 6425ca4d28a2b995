"""The price of motion: declared in seconds on a level, turned into c_k by the robot's size and the laws' gains."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np

from hqp.arrays import Vec
from hqp.element import Element, selection_of
from hqp.errors import DeclarationError, UnsupportedProblem
from hqp.law import PD, Law, P, SelfMotion
from hqp.problem import SHARE
from hqp.robot import Robot

if TYPE_CHECKING:
    from hqp.solvers.base import Solver
    from hqp.stack import Stack

LONGEST_TAU = {1: 0.05, 2: 0.1}
"""tau [s] of a level by the order of its laws, where no gain asks for less."""

PARTIAL_POSTURE_TAU = 0.2
"""tau [s] of a level that selects single joints above levels that do more."""

GUARD_FLOOR = 2e-3
"""At order 2: fraction of an unmet level's band that its guard leaves to levels below where the level makes no motion.

An arm pulled straight by a target at the edge of its reach then rests a little bent; with none, the posture below would
alternate about the straight arm."""

REST_TIME = math.sqrt(2.0)
"""At order 2 the motion that costs nothing comes to rest at the rate 1 / (REST_TIME tau).

A limb of two equal links that a target beyond its reach pulls straight is an oscillator of at most 1 / (2 tau) [rad/s],
and this damps it to 0.7 of critical."""

TURNING = {1: 0.02, 2: 0.1}
"""[rad/s, rad/s^2] postures below an unmet level move at most at the pace p with p^2 dt^order = share TURNING.

At 500 Hz that is 0.1 rad/s and 5 rad/s^2.  In one tick the motion of the posture then turns the rows of the level by no
more than the band that it leaves; a faster one jumps between the corners of the band (hqp/pace.py)."""

LONGEST_TICK = 0.5
"""[s] longer steps are those of a search for a pose (hqp.reach), not ticks: postures have no pace there."""

TICKS, LONGEST_BY_TICKS = 10.0, 0.1
"""At order 1 tau is at least this many ticks, up to LONGEST_BY_TICKS [s].

The rows of an unmet level turn with each tick, and an eager level below it (a base without speed limit) then jumps
within its band: at 100 Hz with tau = 0.05 s for ever, with 0.1 s not.  A longer one slows what speed limits cut."""

GAIN_TIME = 0.25
"""At order 1, tau is at most this over the gain: a demand that speed limits cut would slow all rows of its level."""


@dataclass(frozen=True)
class Price:
    """What motion costs a level: min ||w|| + c E(x), c = tau^order L, instead of min ||w|| (docs/calm.md).

    tau: [s] a direction in which the level is nearly lost closes no faster than 1/tau; None follows from the laws and
    the tick: max(min(0.05, 0.25 / gain), min(0.1, 10 dt)) at order 1, min(0.1, 1 / sqrt(kp)) at order 2, at least dt.
    A level that can be met for its price is exact; the price shows where it is out of reach.  share: where the level
    is not met, levels below may move its rows by this fraction of its residual; 0 locks them.  Raises DeclarationError
    for numbers out of range.
    """

    tau: float | None = None
    share: float = SHARE

    def __post_init__(self) -> None:
        for name, value, most in (("tau", self.tau, math.inf), ("share", self.share, 1.0)):
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not (name == "tau" and value is None) and not (number and 0.0 <= value < most):  # type: ignore[operator]
                raise DeclarationError(f"Price.{name}", "out of range", value=value, allowed=f"from 0, below {most:g}")


Priced: TypeAlias = "Price | float | None"
"""A Price, 0 for the exact problem, None for the default."""


def as_price(owner: str, value: object) -> Price | None:
    """A declared price: None for the default, Price(0) for 0; raises DeclarationError for anything else."""
    if value is None or isinstance(value, Price):
        return value
    if isinstance(value, (int, float)) and not isinstance(value, bool) and value == 0:
        return Price(0.0, 0.0)
    raise DeclarationError(owner, "not a price", value=value, allowed="Price(tau=..., share=...), or 0 for exact")


def is_exact(price: Price | None) -> bool:
    """Whether levels with that price are the exact problem."""
    return price is not None and price.tau == 0.0


@dataclass(frozen=True)
class LevelPrices:
    """What the motion of a hierarchy costs: c_k and share of every level, E(x) = 1/2 ||S (xdot - f)||^2.

    values, shares: one a level.  scale: diagonal of S, ``(nv,)``.  rest: f = -rest v for accelerations, the rate [1/s]
    at which the motion that costs nothing comes to rest; 0 for velocities.  pace: of postures below an unmet level
    [rad/s, rad/s^2].  postures: whether every level after the last price selects single joints.
    """

    values: Vec
    shares: Vec
    scale: Vec
    rest: float
    pace: float
    postures: bool


class Group(Protocol):
    """Elements that become one level of the hierarchy; tasks: whether they may have a price."""

    @property
    def elements(self) -> tuple[Element, ...]: ...
    @property
    def tasks(self) -> bool: ...
    @property
    def price(self) -> Price | None: ...


@dataclass(frozen=True)
class Sizes:
    """The scales of a robot: length [m], mass [kg], and what one unit of each tangent coordinate counts as motion.

    length: the longest lever of any turning joint on any frame at home, 1 where there is none.  units: 1 for angles,
    1/length for lengths, radius/length for the turn of a wheel, which counts by the way it rolls.
    """

    length: float
    mass: float
    units: tuple[float, ...]

    @staticmethod
    def of(robot: Robot) -> Sizes:
        """Measured at home on a copy of the robot, once."""
        if robot not in _SIZES:
            _SIZES[robot] = Sizes._measured(robot)
        return _SIZES[robot]

    @staticmethod
    def _measured(robot: Robot) -> Sizes:
        twin = robot.copy()
        state = twin.state()
        state.kinematics()
        twists = twin.joint_twists
        moving = np.linalg.norm(twists[3:], axis=0) > 1e-9
        turning = moving & np.isin(np.arange(twin.nv), twin.actuated)
        frames = [twin.frame(name) for name in twin.frame_names]
        carried = {body: twin.support(frame) != 0.0 for frame in frames for body in [twin.body(frame)]}
        moves = turning & np.array([carried[twin.body(frame)] for frame in frames])  # (frames, nv)
        positions = np.array([twin.placement(frame)[0] for frame in frames])
        levers = twists[:3].T + np.cross(twists[3:].T, positions[:, None, :])  # (frames, nv, 3)
        length = float(np.sqrt(np.square(levers).sum(axis=2).max(where=moves, initial=0.0)))
        length = length or 1.0
        mass = sum(body[3] for body in twin.bodies)
        units = np.where(moving, 1.0, 1.0 / length)
        for name, wheel in twin.wheels.items():
            _, first, count, *_ = twin.bodies[twin.body(twin.frame(name))]
            if count == 1:
                units[first] = wheel.radius / length
        return Sizes(length, mass or 1.0, tuple(units.tolist()))

    @property
    def scale(self) -> Vec:
        """Diagonal of F and S, ``(nv,)``."""
        return np.array(self.units)


_SIZES: WeakKeyDictionary[Robot, Sizes] = WeakKeyDictionary()


def row_scales(element: Element, robot: Robot, sizes: Sizes) -> Iterator[float]:
    """L_b of each block of rows of one unit, weight included: the size of its rows where a joint turns by one.

    A constant of the kind of row: the robot's length for positions, 1 for angles; for rows of an unknown kind the
    longest column of the Jacobian at home.
    """
    if element.quantity == "effort":
        yield element.weight * sizes.mass * sizes.length**2
    elif element.quantity == "force":
        yield element.weight * sizes.mass * sizes.length
    elif element.units:
        for unit in element.units:
            yield element.weight * (sizes.length if unit == "m" else 1.0)
    else:
        yield element.weight * (longest_column(element, robot, sizes) or 1.0)


def longest_column(element: Element, robot: Robot, sizes: Sizes) -> float:
    """Of the Jacobian at home; raises DeclarationError, which names the element, where it has none that is usable."""
    jacobian = getattr(element, "jacobian", None)
    if jacobian is None:
        return 0.0
    try:
        J = np.asarray(jacobian(robot.copy().state()), dtype=np.float64)
        found = float((np.sqrt(np.square(J).sum(axis=0)) / sizes.scale).max(initial=0.0))
    except Exception as error:  # whatever an element of the user's does
        why = f"no Jacobian at home: {type(error).__name__}: {error}"
        raise DeclarationError(element.name, why) from error
    if not found < math.inf:
        raise DeclarationError(element.name, "its Jacobian at home is not finite")
    return found


def tau_of(laws: Sequence[Law], order: int, dt: float) -> float:
    """The default tau [s] of a level with these laws, from the largest gain."""
    gains = [g for law in laws for g in _gains(law)]
    gain = max(gains, default=0.0)
    if gain <= 0.0:
        return LONGEST_TAU[order]
    if order == 2:
        return max(dt, min(LONGEST_TAU[2], 1.0 / math.sqrt(gain)))
    return max(dt, min(TICKS * dt, LONGEST_BY_TICKS), min(LONGEST_TAU[1], GAIN_TIME / gain))


def level_prices(
    groups: Sequence[Group], robot: Robot, laws: Mapping[str, Law], order: int, dt: float, given: Price | None
) -> LevelPrices | None:
    """The prices of every level of a hierarchy; None where no level has one.

    given: the controller's price, for levels that declare none; one with tau = 0 makes every level exact.  By default
    a level has a price unless it and all levels below it select single joints; hard levels never have one.
    """
    if is_exact(given):
        return None
    sizes: Sizes | None = None
    prices, shares = np.zeros(len(groups)), np.full(len(groups), SHARE)
    trailing, longest, postures = True, 0.0, True
    for k in range(len(groups) - 1, -1, -1):
        group = groups[k]
        picks = [selection_of(e, robot) if e.quantity == "motion" else None for e in group.elements]
        single = all(p is not None for p in picks)
        trailing = trailing and single
        declared = group.price if group.price is not None else given
        if not group.tasks or (trailing and group.price is None) or is_exact(declared):
            postures = postures and (single or sizes is not None)
            continue
        sizes = sizes or Sizes.of(robot)
        shares[k] = SHARE if declared is None else declared.share
        tau = None if declared is None else declared.tau
        if tau is None:
            joints = {int(c) for p in picks if p is not None for c in p}
            partial = single and len(joints) < robot.joints(None).size
            tau = PARTIAL_POSTURE_TAU if partial else tau_of([laws[e.name] for e in group.elements], order, dt)
        if not single:
            longest = max(longest, tau)
        prices[k] = tau**order * min(scale for e in group.elements for scale in row_scales(e, robot, sizes))
    if sizes is None:
        return None
    rest = 1.0 / (REST_TIME * (longest or LONGEST_TAU[order])) if order == 2 else 0.0
    least = float(min((eta for eta, c in zip(shares, prices, strict=True) if c > 0.0 < eta), default=SHARE))
    pace = math.sqrt(least * TURNING[order] / dt**order) if dt <= LONGEST_TICK else math.inf
    return LevelPrices(prices, shares, sizes.scale, rest, pace, postures)


def affordable(stack: Stack, given: Price | None, solver: Solver) -> tuple[Price | None, str]:
    """The price to compile a stack with for a solver, and what had to be dropped, in words.

    Raises UnsupportedProblem where a declared price, or a declared share, is beyond the solver.
    """
    declared = [level.price for level in stack.levels if level.price is not None]
    declared += [given] if given is not None else []
    wanted = [price for price in declared if price.tau != 0.0]
    if is_exact(given):
        return given, ""
    if not solver.priced:
        if wanted:
            raise UnsupportedProblem(f"{solver.name} solves no priced levels; take 'lexicographic', or price=0")
        return Price(0.0, 0.0), f"{solver.name} solves no priced levels: every level is exact"
    if not solver.shares:
        if any(price.share > 0.0 for price in wanted):
            raise UnsupportedProblem(f"{solver.name} hands down no shares; declare Price(share=0), or price=0")
        return given or Price(None, 0.0), f"{solver.name} hands down no shares: unmet levels are locked"
    return given, ""


def _gains(law: Law) -> tuple[float, ...]:
    if isinstance(law, P):
        return law.gain if isinstance(law.gain, tuple) else (law.gain,)
    if isinstance(law, (PD, SelfMotion)):
        return law.kp if isinstance(law.kp, tuple) else (law.kp,)
    return ()
