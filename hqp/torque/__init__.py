"""Joint torques with the constraint forces eliminated exactly (Sentis 2012, section II)."""

from __future__ import annotations

from hqp.torque.program import Torque

__all__ = ["Torque"]
