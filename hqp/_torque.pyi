"""Elimination of constraint forces, and gravity compensation (built from cpp/torque)."""

from collections.abc import Mapping
from typing import Any

from hqp.arrays import Mat, Signs, Vec

class Parts:
    """Steps between rows on the acceleration and the solver, over the live arrays of a plan.

    plan: the mapping of ``hqp.torque.program.TorqueProgram.parts``.
    """

    def __init__(self, plan: Mapping[str, Any]) -> None: ...
    def eliminate(self) -> int:
        """Eliminate: A = H^T H, Y = H^-T [U^T, -bias], H^-T J^T = Q T, top = Q^T Y - [0, T^-T gamma], P = Y - Q top.

        map = [X, c] = H^-1 P ``(nv, n + 1)`` and phi, the products of P's first n columns.

        Returns the rank of the constraints, -1 if A is not positive definite; for dependent constraints T is the
        identity.
        """

    def write(self, v: Vec, c: Vec | None) -> None:
        """Write rows from the latest map: A = J X, bounds = demand - J c, or picks of both; F = S X, f = -S (c + rest
        v).

        c: replacement of the map's c for the rows.
        """

    def force(self, shift: Vec | None) -> None:
        """Write rows on forces: A = C F, bounds = demand - C f; shift: part of tau outside the model of the forces."""

    def hold(self, J: Mat, g: Vec, tau: Vec) -> bool:
        """Write tau = g - J^T f on the actuated coordinates, with f of least norm that zeroes the others.

        Returns false if there is no such f, or fewer constraints than other coordinates.
        """

    @property
    def out(self) -> Signs:
        """Marks of absent constraints ``(m,)``, live and writeable: 1 if absent.

        An absent constraint has zeros in Q and top and a row of the identity in T.
        """

    def reactions(self) -> object:
        """Return a capsule of A^-1 J^T (J A^-1 J^T)^+ of the latest elimination."""

    def core(self) -> object:
        """Return a capsule of these parts for ``_session``."""
