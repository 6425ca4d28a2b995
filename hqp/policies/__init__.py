"""Sessions beside a policy: arms above the legs of another controller, and a filter behind joint targets."""

from hqp.policies.policy_filter import FilteredTick, PolicyFilter, PolicyFilterSession
from hqp.policies.policy_filters import PolicyFilters
from hqp.policies.servo import Servos
from hqp.policies.upper_body import UpperBody, UpperBodySession, UpperBodyTick

__all__ = [
    "FilteredTick",
    "PolicyFilter",
    "PolicyFilterSession",
    "PolicyFilters",
    "Servos",
    "UpperBody",
    "UpperBodySession",
    "UpperBodyTick",
]
