"""A and b + g of the equation of motion, written with the rows of a tick."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.arrays import Mat
from hqp.declare.robot import Robot, State
from hqp.programs.loads import Loads

if TYPE_CHECKING:
    from hqp._assembly import Assembly as NativeAssembly


class Terms:
    """A ``(nv, nv)``, its upper triangle, and bias = b + g ``(nv,)`` of the state whose rows were written last.

    rows: the native operations that write them ahead of the rows of each tick, loads with a plan included; without
    any, they are those of the state.
    """

    def __init__(self, robot: Robot, rows: NativeAssembly | None, loads: Loads) -> None:
        self.native = rows is not None
        self.A: Mat = np.zeros((robot.nv, robot.nv), order="F")
        self.bias = np.zeros(robot.nv)
        self._loads = loads
        self.parts: dict[str, Any] = {
            "inertias": robot.inertias,
            "rotors": robot.rotors.tolist(),
            "gravity": robot.gravity,
            "A": self.A,
            "bias": self.bias,
        }
        if rows is not None:
            rows.dynamics(self.parts)

    def prepare(self, state: State) -> None:
        """Compute the quantities of a state for the rows and these terms."""
        if self.native:
            state.kinematics()
        else:
            state.dynamics()

    def take(self, state: State) -> None:
        """Make A and bias those of the state, once after its rows."""
        if self.native:
            self._loads.add(state, self.A, self.bias)
        else:
            A, bias = self._loads.dynamics(state)
            np.copyto(self.A, A)
            np.copyto(self.bias, bias)
