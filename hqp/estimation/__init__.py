"""Estimation from a robot's own sensors: pose of its base, rates of its joints, external forces."""

from hqp.estimation.feet import FeetEstimator
from hqp.estimation.momentum import MomentumObserver
from hqp.estimation.rates import RateObserver

__all__ = ["FeetEstimator", "MomentumObserver", "RateObserver"]
