"""The constraint forces eliminated, and gravity compensation (built from cpp/torque)."""

from collections.abc import Sequence

from hqp.arrays import Mat, Signs, Vec

class Elimination:
    """The sparse and small parts of ``hqp.torque.dynamics.ConstrainedDynamics.update``.

    parents: the tangent coordinate before each on its way to the world, -1 for none.  out: of the m constraints, live,
    1 where one is not there: zeros in Q and top, a row of the identity in T.
    """

    def __init__(self, parents: Sequence[int], actuated: Sequence[int], out: Signs) -> None: ...
    def eliminate(
        self, A: Mat, bias: Vec, J: Mat, gamma: Vec, tolerance: float, map: Mat, phi: Mat, Q: Mat, T: Mat, top: Mat
    ) -> int:
        """A = H^T H, Y = H^-T [U^T, -bias], H^-T J^T = Q T, top = Q^T Y - [0, T^-T gamma], P = Y - Q top.

        map = [X, c] = H^-1 P ``(nv, n + 1)`` and phi, the products of P's first n columns.

        A by columns, the rest by rows.
        The rank of the constraints, -1 for an A that is not positive definite; of dependent ones T is the identity.
        """

    def reactions(self) -> object:
        """A capsule of A^-1 J^T (J A^-1 J^T)^+ of the latest elimination."""

class TorqueRows:
    """As ``hqp.torque.rows.TorqueRows``, whose arrays it reads and writes in place."""

    def __init__(self, map: Mat) -> None: ...
    def product(self, J: Mat, A: Mat, asked_lower: Vec, asked_upper: Vec, lower: Vec, upper: Vec) -> None:
        """A = J X, bounds = asked - J c."""

    def pick(
        self,
        index: Sequence[int],
        weight: Sequence[float],
        A: Mat,
        asked_lower: Vec,
        asked_upper: Vec,
        lower: Vec,
        upper: Vec,
    ) -> None:
        """Rows of X, times a weight each or none, and bounds = asked - c of the same."""

    def motion(self, scale: Sequence[float], rest: float, F: Mat, f: Vec) -> None:
        """F = S X, f = -S (c + rest v)."""

    def run(self, v: Vec, c: Vec | None) -> None:
        """All of it from the latest map; c for rows in the place of the map's own."""

class ForceRows:
    """As ``hqp.torque.forces.Forces.fill`` after an elimination, whose T and top it reads."""

    def __init__(self, T: Mat, top: Mat) -> None: ...
    def turn(self, first: int, rotation: Mat) -> None:
        """The three rows of the constraints from ``first`` on are in world axes, to be turned into the rotation's."""

    def add(self, C: Mat, A: Mat, asked_lower: Vec, asked_upper: Vec, lower: Vec, upper: Vec) -> None:
        """A = C F, bounds = asked - C f."""

    def share(
        self,
        C: Mat,
        first: Sequence[int],
        one: Mat,
        other: Mat,
        middles: Sequence[float],
        factors: Sequence[float],
        arm: float,
        share: Vec,
    ) -> None:
        """Write C ``(6, m)`` anew each time, how two contacts share a wrench; share: live ``(1,)``."""

    def run(self, shift: Vec | None) -> None:
        """All of it; shift: part of tau that the model of the forces does not know."""

class Chain:
    """Elimination of live arrays, and rows and force rows after it; factor: where a copy of A goes.

    limits: a capsule of ``_assembly.Assembly.limits``.
    """

    def __init__(
        self,
        elimination: Elimination,
        rows: object,
        forces: object,
        A: Mat,
        bias: Vec,
        factor: Mat,
        J: Mat,
        gamma: Vec,
        tolerance: float,
        map: Mat,
        phi: Mat,
        Q: Mat,
        T: Mat,
        top: Mat,
        limits: object,
    ) -> None: ...
    def before(self, next: object | None) -> object:
        """A capsule of all that and then the solve whose capsule is given."""

class Holding:
    """``hqp.torque.gravity.holding_torque`` for no fewer constraints than ``others``, coordinates without a motor."""

    def __init__(self, actuated: Sequence[int], others: Sequence[int], constraints: int) -> None: ...
    def torque(self, J: Mat, g: Vec, tau: Vec) -> bool:
        """tau = g - J^T f on the actuated coordinates, f zeroing it on the others; of several f that of least norm.

        False where no f does.
        """
