"""Beside a policy: the arms above somebody else's legs, and a filter behind joint targets."""

from hqp.policies.policy_filter import FilteredTick, PolicyFilter, PolicyFilterSession, Prediction
from hqp.policies.servo import Servos
from hqp.policies.upper_body import UpperBody, UpperBodySession, UpperBodyTick

__all__ = [
    "FilteredTick",
    "PolicyFilter",
    "PolicyFilterSession",
    "Prediction",
    "Servos",
    "UpperBody",
    "UpperBodySession",
    "UpperBodyTick",
]
