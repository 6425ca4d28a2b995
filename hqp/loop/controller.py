"""A user's declaration of a controller, without the robot."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from hqp.declare.price import Price, Priced, as_price, is_exact
from hqp.declare.robot import Robot
from hqp.declare.safety import Braking, RateLimits, StateBounds
from hqp.declare.stack import Stack, require_stack
from hqp.errors import DeclarationError, ModelWarning
from hqp.numbers import plain, set_numbers
from hqp.programs.formulation import Formulation, Velocity
from hqp.solvers import ALLOWED, load
from hqp.solvers.base import Solver

if TYPE_CHECKING:
    from hqp.loop.session import Session

DEADLINE = 0.8
"""Share of the control period that a tick may take before its solver returns the best point so far."""
SLOWEST = 0.1
"""The longest control period [s]: a longer one is a rate or milliseconds, or too slow to control a robot."""


@dataclass(frozen=True)
class Controller:
    """A stack, a formulation and a solver: everything of a controller but the robot.

    solver: a name for ``hqp.solvers.load`` or a Solver, ``hqp.solvers.default()`` for "". deadline [s]: time after the
    start of a tick at which its solver returns the best point so far; 0.8 dt for None, ``math.inf`` for none; until the
    first answer of a session it counts from the rows on. Only ``lexicographic`` uses it.  rates: limits on the change
    of a command, None for no limit. bounds: bounds on accepted states. braking: deceleration of a command to rest.
    price: price of levels that declare none, a Price, None for the default (docs/calm.md); 0 makes every level exact,
    also levels that declare a price. calm: False switches off every default that slows commands: the check of commands
    against speed and torque limits of the model after the solver; as ``price=0`` (with it the torque net and holding
    torques of ``Torque``) and ``JointLimits(acceleration=0, braking=0)`` do together; other numbers that an element
    declares for these two stay.
    """

    stack: Stack
    formulation: Formulation = field(default_factory=Velocity)
    solver: str | Solver = ""
    deadline: float | None = None
    rates: RateLimits | None = None
    bounds: StateBounds = field(default_factory=StateBounds)
    braking: Braking = field(default_factory=Braking)
    price: Priced = None
    calm: bool = True

    def __post_init__(self) -> None:
        require_stack("controller", self.stack)
        if not isinstance(self.formulation, Formulation):
            raise DeclarationError("controller", "formulation", value=self.formulation, allowed="Velocity(), ...")
        if not isinstance(self.calm, bool):
            raise DeclarationError("controller", "calm", value=self.calm, allowed="True or False")
        price = as_price("controller", self.price)
        if not self.calm and price is not None and not is_exact(price):
            raise DeclarationError("controller", "price with calm=False", value=price, allowed="0 or None")
        object.__setattr__(self, "price", price if self.calm else Price(0.0))
        if isinstance(self.solver, str):
            object.__setattr__(self, "solver", load(self.solver))
        elif not isinstance(self.solver, Solver):
            raise DeclarationError("controller", "solver", value=self.solver, allowed=ALLOWED)
        if self.deadline is not None:
            set_numbers(self, "controller", ("deadline",), 0.0, strict=True, infinite=True)
        for name, kind in (("rates", RateLimits), ("bounds", StateBounds), ("braking", Braking)):
            value = getattr(self, name)
            if not isinstance(value, kind) and not (name == "rates" and value is None):
                raise DeclarationError("controller", name, value=value, allowed=f"{kind.__name__}(...)")

    def session(self, robot: Robot, dt: float, *, max_age: float | None = None, stuck: bool = True) -> Session:
        """Compile for a robot at a control period dt [s]; states older than max_age [s] are refused.

        stuck: let a thread search for a way out of a task that is off and at rest, see ``Tick.way_out``; false for
        ticks that are no closed loop.

        Raises DeclarationError, ModelError or UnsupportedProblem for arguments that do not fit, before the loop.
        """
        from hqp.loop.session import Session

        period = plain(dt)
        if period is None or not 0.0 < period <= SLOWEST:
            likely = f"; {_likely(period)}" if period is not None and SLOWEST < period < math.inf else ""
            allowed = f"0 < dt <= {SLOWEST:g}"
            raise DeclarationError("session", f"control period dt{likely}", value=dt, unit="s", allowed=allowed)
        made = Session(self, robot, period, max_age=max_age, stuck=stuck)
        for note in made.remarks:
            warnings.warn(note.detail, ModelWarning, stacklevel=2)
        return made


def _likely(dt: float) -> str:
    """Name the periods that a number above ``SLOWEST`` may have meant."""
    meant = [f"{dt:g} ms are dt={1e-3 * dt:g}"] if 1e-3 * dt <= SLOWEST else []
    if 1.0 / dt <= SLOWEST:
        meant.insert(0, f"a rate of {dt:g} Hz is dt={1.0 / dt:g}")
    return ", ".join(meant)
