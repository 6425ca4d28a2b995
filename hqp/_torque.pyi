"""The constraint forces eliminated, and gravity compensation (built from cpp/torque)."""

from collections.abc import Mapping
from typing import Any

from hqp.arrays import Mat, Signs, Vec

class Parts:
    """What stands between rows on the acceleration and the solver, over the live arrays of a plan.

    plan: as ``hqp.torque.program.TorqueProgram.parts`` has it.
    """

    def __init__(self, plan: Mapping[str, Any]) -> None: ...
    def eliminate(self) -> int:
        """A = H^T H, Y = H^-T [U^T, -bias], H^-T J^T = Q T, top = Q^T Y - [0, T^-T gamma], P = Y - Q top.

        map = [X, c] = H^-1 P ``(nv, n + 1)`` and phi, the products of P's first n columns.

        The rank of the constraints, -1 for an A that is not positive definite; of dependent ones T is the identity.
        """

    def write(self, v: Vec, c: Vec | None) -> None:
        """Rows from the latest map: A = J X, bounds = asked - J c, or picks of both; F = S X, f = -S (c + rest v).

        c: for rows in the place of the map's own.
        """

    def force(self, shift: Vec | None) -> None:
        """Rows on forces: A = C F, bounds = asked - C f; shift: part of tau that the model of the forces ignores."""

    def hold(self, J: Mat, g: Vec, tau: Vec) -> bool:
        """tau = g - J^T f on the actuated coordinates, f zeroing it on the others; of several f that of least norm.

        False where no f does, or there are fewer constraints than other coordinates.
        """

    @property
    def out(self) -> Signs:
        """Of the m constraints, live, to be written: 1 where one is not there.

        It has zeros in Q and top and a row of the identity in T.
        """

    def reactions(self) -> object:
        """A capsule of A^-1 J^T (J A^-1 J^T)^+ of the latest elimination."""

    def core(self) -> object:
        """A capsule of these parts themselves, for ``_session``."""
