"""The price of motion: declared in seconds on a level, turned into c_k by the robot's size and the laws' gains."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np

from hqp.arrays import Vec
from hqp.declare.element import Element, selection_of
from hqp.declare.law import PD, Law, P, SelfMotion
from hqp.declare.robot import Robot
from hqp.errors import DeclarationError, UnsupportedProblem
from hqp.numbers import plain, set_numbers
from hqp.problem import ETA

if TYPE_CHECKING:
    from hqp.declare.stack import Stack
    from hqp.solvers.base import Solver

LONGEST_TAU = {1: 0.05, 2: 0.1}
"""Default tau [s] of a level by the order of its laws; a gain may lower it."""

REST_TIME = math.sqrt(2.0)
"""At order 2 the motion that costs nothing comes to rest at the rate 1 / (REST_TIME tau).

A limb of two equal links that a target beyond its reach pulls straight is an oscillator of at most 1 / (2 tau) [rad/s],
and this damps it to 0.7 of critical."""

TURNING = {1: 350.0, 2: 2.5e8}
"""[rad^4/s^4, rad^4/s^8 by the order of the laws] price of speed below an unmet level, t_k = 1 / (TURNING eta c_k^2
L_k^2).  It has no dt: a loop at half the period carries out the same motion.

The motion of a posture turns the rows of the level above it: the more that level misses, the slower the posture has to
be.  In proportion to omega^2, so that a level that comes to be unmet by next to nothing stops nobody at once."""

LONGEST_TICK = 0.5
"""[s] longer steps are those of a search for a pose (hqp.reach), not ticks: t_k = 0 there."""

GAIN_TIME = 0.1
"""At order 1, tau is at most this over the gain: a demand that speed limits cut would slow all rows of its level."""


@dataclass(frozen=True)
class Price:
    """Price of motion of a level: min ||w|| + c E(x), c = tau^order L, instead of min ||w|| (docs/calm.md).

    tau: [s] a direction in which the level is nearly lost closes no faster than 1/tau; None follows from the laws and
    the tick: min(0.05, 0.1 / gain) at order 1, min(0.1, 1 / sqrt(kp)) at order 2, at least dt.
    A level that can be met for its price is exact; the price shows where it is out of reach.  turning: true if levels
    below an unmet one slow down as omega^2, since their motion turns its rows (t_k = 0 if false): a level that misses
    next to nothing again and again would stop and release them each time.  Raises DeclarationError for numbers out of
    range and a turning that is no bool.
    """

    tau: float | None = None
    turning: bool = True

    def __post_init__(self) -> None:
        if not isinstance(self.turning, bool):
            raise DeclarationError("Price.turning", "not a bool", value=self.turning, allowed="true or false")
        if self.tau is not None:
            set_numbers(self, "Price", ("tau",), 0.0, unit="s")


Priced: TypeAlias = "Price | float | None"
"""A Price, 0 for the exact problem, None for the default."""


def as_price(owner: str, value: object) -> Price | None:
    """A declared price: None for the default, Price(0) for 0; raises DeclarationError for anything else."""
    if value is None or isinstance(value, Price):
        return value
    if plain(value) == 0:
        return Price(0.0)
    raise DeclarationError(owner, "not a price", value=value, allowed="Price(tau=...), or 0 for exact")


def is_exact(price: Price | None) -> bool:
    """Return true if levels with that price are exact."""
    return price is not None and price.tau == 0.0


@dataclass(frozen=True)
class LevelPrices:
    """Prices of motion of a hierarchy: c_k and t_k of every level, E(x) = 1/2 ||S (xdot - f)||^2.

    values, turning: one a level.  scale: diagonal of S, ``(nv,)``.  rest: f = -rest v for accelerations, the rate [1/s]
    at which the motion that costs nothing comes to rest; 0 for velocities.
    """

    values: Vec
    turning: Vec
    scale: Vec
    rest: float


class Group(Protocol):
    """Elements that become one level of the hierarchy; tasks: true if they may have a price."""

    @property
    def elements(self) -> tuple[Element, ...]: ...
    @property
    def tasks(self) -> bool: ...
    @property
    def price(self) -> Price | None: ...


@dataclass(frozen=True)
class Sizes:
    """The scales of a robot: length [m], mass [kg], and motion per unit of each tangent coordinate.

    length: the longest lever of any revolute joint on any frame at home, 1 without one.  units: 1 for angles, 1/length
    for lengths, radius/length for the turn of a wheel, which counts by the way it rolls.
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
    """Longest column of the Jacobian at home; raises DeclarationError, which names the element, where it has none that
    is usable."""
    jacobian = getattr(element, "jacobian", None)
    if jacobian is None:
        return 0.0
    try:
        J = np.asarray(jacobian(robot.copy().state()), dtype=np.float64)
        found = float((np.sqrt(np.square(J).sum(axis=0)) / sizes.scale).max(initial=0.0))
    except Exception as error:  # errors of a user's element
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
    return max(dt, min(LONGEST_TAU[1], GAIN_TIME / gain))


def level_prices(
    groups: Sequence[Group], robot: Robot, laws: Mapping[str, Law], order: int, dt: float, given: Price | None
) -> LevelPrices | None:
    """The prices of every level of a hierarchy; None where no level has one.

    given: the controller's price, for levels that declare none; one with tau = 0 makes every level exact.  By default
    a level has a price unless it and all levels below it that move anything select single joints; hard levels never
    have one.
    """
    if is_exact(given):
        return None
    sizes: Sizes | None = None
    prices, turning = np.zeros(len(groups)), np.zeros(len(groups))
    gamma = 1.0 / (TURNING[order] * ETA) if dt <= LONGEST_TICK else 0.0
    trailing, longest = True, 0.0
    for k in range(len(groups) - 1, -1, -1):
        group = groups[k]
        single = all(e.quantity == "motion" and selection_of(e, robot) is not None for e in group.elements)
        trailing = trailing and (single or all(e.quantity == "force" for e in group.elements))
        declared = group.price if group.price is not None else given
        if not group.tasks or (trailing and single and group.price is None) or is_exact(declared):
            continue
        sizes = sizes or Sizes.of(robot)
        tau = None if declared is None else declared.tau
        if tau is None:
            tau = tau_of([laws[e.name] for e in group.elements], order, dt)
        if not single:
            longest = max(longest, tau)
        length = min(scale for e in group.elements for scale in row_scales(e, robot, sizes))
        prices[k] = tau**order * length
        if declared is None or declared.turning:
            turning[k] = gamma / (prices[k] * length) ** 2
    if sizes is None:
        return None
    rest = 1.0 / (REST_TIME * (longest or LONGEST_TAU[order])) if order == 2 else 0.0
    return LevelPrices(prices, turning, sizes.scale, rest)


def affordable(stack: Stack, given: Price | None, solver: Solver) -> tuple[Price | None, str]:
    """Price to compile a stack with for a solver, and a note on dropped prices.

    Only lexicographic and reference solve priced levels; for the others every level is exact.  Raises
    UnsupportedProblem where a declared price is beyond the solver.
    """
    if is_exact(given) or solver.priced:
        return given, ""
    declared = [given, *(level.price for level in stack.levels)]
    if any(price is not None and not is_exact(price) for price in declared):
        raise UnsupportedProblem(f"{solver.name} cannot solve priced levels; use 'lexicographic', or price=0")
    return Price(0.0), f"{solver.name} cannot solve priced levels: every level is exact"


def _gains(law: Law) -> tuple[float, ...]:
    if isinstance(law, P):
        return law.gain if isinstance(law.gain, tuple) else (law.gain,)
    if isinstance(law, (PD, SelfMotion)):
        return law.kp if isinstance(law.kp, tuple) else (law.kp,)
    return ()
