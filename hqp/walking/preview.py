"""Limits between a velocity command and the next steps: feasible velocities, their rate of change, step times."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from functools import cached_property

from hqp import _session
from hqp.kinds import require
from hqp.numbers import set_numbers, whole
from hqp.walking.footsteps import COMMAND, Command
from hqp.walking.gait import GAIT, REACH, Gait, Reach

QUICK, COMFORT, TURNS = _session.QUICK, _session.COMFORT, _session.TURNS
"""Shortest step time as a share of the gait's (a swing foot of G1 still follows its path to 1 mm); share of the reach
above which steps become quicker instead of longer; largest change of the turning rate from step to step [rad/s]."""


@dataclass(frozen=True, kw_only=True)
class Ability:
    """Limits of a walk on a robot.

    gait, reach: times and reach of steps.  width: distance of the feet side by side [m].  height: of the CoM above the
    ground [m].  gravity [m/s^2].  Raises DeclarationError for fields, and for anything but commands.
    """

    gait: Gait
    reach: Reach
    width: float
    height: float
    gravity: float

    def __post_init__(self) -> None:
        require("ability", "gait", self.gait, Gait, GAIT)
        require("ability", "reach", self.reach, Reach, REACH)
        set_numbers(self, "ability", ("width", "height", "gravity"), 0.0, strict=True)

    @cached_property
    def _native(self) -> _session.Ability:
        return _session.Ability(self.gait.numbers, astuple(self.reach), self.width, self.height, self.gravity)

    @property
    def change(self) -> float:
        """Largest change of velocity from step to step, 0.04 sqrt(g h) [m/s]: 0.1 for G1."""
        return self._native.change

    def allowed(self, requested: Command) -> tuple[Command, tuple[str, ...]]:
        """The nearest command that steps within reach follow, and the reason for each change in words."""
        found, why = self._native.allowed(_velocity(requested))
        return Command(*found), tuple(why)

    def paced(self, now: Command, requested: Command) -> Command:
        """Velocity of the next step: a bounded change towards the command."""
        return Command(*self._native.paced(_velocity(now), _velocity(requested)))

    def paces(self, now: Command, requested: Command, most: int = 24) -> list[Command]:
        """Velocities of the steps until the command is met."""
        most = whole("ability", "most", most, 1, 1000)
        return [Command(*found) for found in self._native.paces(_velocity(now), _velocity(requested), most)]

    def haste(self, pace: Command) -> float:
        """Time of a step at a velocity, a share of that of the gait."""
        return self._native.haste(_velocity(pace))


def _velocity(command: Command) -> tuple[float, float, float]:
    """Return the numbers of a command; raises DeclarationError for anything else."""
    require("ability", "command", command, Command, COMMAND)
    return command.forward, command.left, command.turn
