"""Estimation from a robot's own sensors: pose of its base, and external forces."""

from hqp.estimation.feet import FeetEstimator
from hqp.estimation.momentum import MomentumObserver

__all__ = ["FeetEstimator", "MomentumObserver"]
