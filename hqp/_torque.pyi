"""The constraint forces eliminated, and gravity compensation (built from cpp/torque)."""

from collections.abc import Sequence

from hqp.arrays import Mat, Vec

class Elimination:
    """The sparse and small parts of ``hqp.torque.dynamics.ConstrainedDynamics.update``.

    parents: the tangent coordinate before each on its way to the world, -1 for none.  rows: m constraints.
    """

    def __init__(self, parents: Sequence[int], actuated: Sequence[int], rows: int) -> None: ...
    def eliminate(
        self, A: Mat, bias: Vec, J: Mat, gamma: Vec, tolerance: float, X: Mat, phi: Mat, Q: Mat, T: Mat, top: Mat
    ) -> int:
        """A = H^T H, Y = H^-T [U^T, -bias], H^-T J^T = Q T, top = Q^T Y - [0, T^-T gamma], P = Y - Q top.

        X = H^-1 P ``(nv, n + 1)`` and phi, the products of P's first n columns.  A by columns, the rest by rows.
        1; 0 with no such X, phi, Q, T, top for dependent constraints; -1 for an A that is not positive definite.
        """

class Holding:
    """``hqp.torque.gravity.holding_torque`` for as many constraints as ``others``, the coordinates without a motor."""

    def __init__(self, actuated: Sequence[int], others: Sequence[int]) -> None: ...
    def torque(self, J: Mat, g: Vec, tau: Vec) -> bool:
        """tau = g - J^T f on the actuated coordinates, f zeroing it on the others; False where no f does."""
