"""Elements as a user writes them, with rows in Python."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import hqp.tasks as t


@dataclass(frozen=True, kw_only=True)
class ArmOnly(t.Position):
    """A position task that does not move the base."""

    def jacobian(self, state: Any) -> Any:
        J = super().jacobian(state).copy()
        J[:, :6] = 0.0
        return J
