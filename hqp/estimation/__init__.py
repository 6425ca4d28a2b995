"""What a robot can tell of itself from its own sensors: where its base is, and what pulls at it."""

from hqp.estimation.feet import FeetEstimator
from hqp.estimation.momentum import MomentumObserver

__all__ = ["FeetEstimator", "MomentumObserver"]
