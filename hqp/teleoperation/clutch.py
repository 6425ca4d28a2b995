"""From the operator's hand to the robot's: frame, scale, and where the clutch joined the two."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hqp.arrays import Mat, Vec
from hqp.declare.element import Task
from hqp.errors import DeclarationError

from .spaces import Space

ALLOWED = "a rotation (3, 3), or a pose (4, 4), of the operator's axes in those of the task"


class Clutch:
    """The value that belongs to an operator's: anchor ⊕ D (value ⊖ origin), D = diag(scale F, det(F) F).

    F: the operator's axes in those of the task.  Before the first ``engage`` origin is that of the operator's axes, and
    anchor where these are.  Raises DeclarationError if the task has no axes that the frame could turn.
    """

    def __init__(self, space: Space, element: Task, k: int, scale: float, frame: Mat | None) -> None:
        self._space = space
        pose = np.eye(4) if frame is None else frame
        self._F = F = pose[:3, :3]
        self._scale = scale
        turns = space.turns(k)
        self._D: Mat = np.diag(np.where(turns, 1.0, scale))
        if k in (3, 6) and not space.wraps:
            blocks = [slice(i, i + 3) for i in range(0, k, 3)]
            for block in blocks:
                self._D[block, block] = (np.linalg.det(F) if turns[block][0] else scale) * F
        elif frame is not None:
            raise DeclarationError("Follow", f"{element.name} has no axes to turn by a frame", value=frame)
        self.engage(space.neutral(k), space.placed(pose, k))

    def engage(self, value: Any, anchor: Any) -> None:
        """Join an operator's value and one of the task."""
        self._origin, self._anchor = value, anchor
        if self._space.first is not None:
            F = self._F
            self._right: Mat = value[:3, :3].T @ F.T @ anchor[:3, :3]  # exp(det(F) F w) = F exp(w) F^T
            self._place = anchor[:3, 3] - self._scale * F @ value[:3, 3] if self._space.first else np.zeros(3)

    def value(self, operators: Any) -> Any:
        """The task's value for an operator's."""
        if self._space.first is None:
            return self._space.plus(self._anchor, self._D @ self._space.minus(operators, self._origin))
        R = self._F @ operators[:3, :3] @ self._right
        if self._space.first == 0:
            return R
        found = operators.copy()
        found[:3, :3], found[:3, 3] = R, self._place + self._scale * self._F @ operators[:3, 3]
        return found

    def rate(self, operators: Vec) -> Vec:
        """The task's velocity or acceleration for an operator's ``(k,)``."""
        return self._D @ operators


def operator_axes(frame: ArrayLike, apart: bool) -> Mat:
    """The pose ``(4, 4)`` of the operator's axes in those of the task; apart: true with a clutch, for mirrored ones.

    Raises DeclarationError.
    """
    found = np.eye(4)
    try:
        given = np.array(frame, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DeclarationError("Follow", "bad frame", value=frame, allowed=ALLOWED) from error
    if given.shape not in ((3, 3), (4, 4)):
        raise DeclarationError("Follow", "bad frame", value=frame, allowed=ALLOWED)
    n = len(given)
    found[:n, :n] = given
    F = found[:3, :3]
    if not np.isfinite(found).all() or np.abs(F @ F.T - np.eye(3)).max() > 1e-5 or found[3].tolist() != [0, 0, 0, 1]:
        raise DeclarationError("Follow", "bad frame", value=frame, allowed=ALLOWED)
    if float(np.linalg.det(F)) < 0.0 and not apart:
        raise DeclarationError("Follow", "a left-handed frame needs clutch=True", value=frame, allowed=ALLOWED)
    return found
