"""Control laws: map the error of a task to a demand; gains carry units, nothing depends on dt by accident."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np

from hqp.arrays import Vec
from hqp.errors import DeclarationError
from hqp.numbers import number, set_numbers

Gain: TypeAlias = "float | tuple[float, ...]"


@dataclass(frozen=True, kw_only=True)
class Law(ABC):
    """Map from error to demand; order 1 gives velocities, order 2 accelerations.

    max_velocity [unit/s] and max_acceleration [unit/s^2] bound the norm of the feedback, never the feedforward.
    """

    order: ClassVar[int]

    max_velocity: float = math.inf
    max_acceleration: float = math.inf

    @abstractmethod
    def demand(self, error: Vec, rate: Vec, feedforward: Vec, speed: Vec, drift: Vec, *, each: bool = False) -> Vec:
        """Demand on J x ``(m,)``, from an error and the reference's velocity and acceleration ``(m,)``.

        speed: J v.  drift: dJ/dt v.  each: saturate every row by itself, not the norm over all.
        """

    def fit(self, element: str, rows: int) -> None:
        """Raise DeclarationError where a gain has neither one number nor one for each row of the element."""
        for field, gain in vars(self).items():
            if isinstance(gain, tuple) and len(gain) != rows:
                what = f"{type(self).__name__}.{field} has {len(gain)} numbers"
                raise DeclarationError(element, what, value=gain, allowed=f"one number, or {rows}: one for each row")

    def _check(self, gains: tuple[str, ...]) -> None:
        name = type(self).__name__
        for field in gains:
            value = getattr(self, field)
            if hasattr(value, "tolist"):  # a number or an array of NumPy
                value = value.tolist()
                object.__setattr__(self, field, value)
            values = tuple(value) if isinstance(value, (tuple, list)) else (value,)
            found = tuple(number(f"{name}.{field}", "gain", x, 0.0) for x in values)
            object.__setattr__(self, field, found if isinstance(value, (tuple, list)) else found[0])
        set_numbers(self, name, ("max_velocity", "max_acceleration"), 0.0, strict=True, infinite=True)


@dataclass(frozen=True)
class P(Law):
    """Proportional law of first order: v = v_ref - gain e, gain [1/s] (Mistry 2008, below eq. 16).

    The feedback speed ||gain e|| is held under max_velocity and under sqrt(2 max_acceleration ||e||), the speed
    from which the error can still be stopped.  Raises DeclarationError for a gain that is negative or not finite.
    """

    gain: Gain
    order: ClassVar[int] = 1

    def __post_init__(self) -> None:
        self._check(("gain",))

    def demand(self, error: Vec, rate: Vec, feedforward: Vec, speed: Vec, drift: Vec, *, each: bool = False) -> Vec:
        """v ``(m,)``; feedforward, speed and drift are not used."""
        feedback = held(scaled(self.gain, error), self.max_velocity, each)
        if self.max_acceleration < math.inf:
            far = np.abs(error) if each else math.sqrt(float(error @ error))
            feedback = held(feedback, np.sqrt(2.0 * self.max_acceleration * far), each)
        return rate - feedback


@dataclass(frozen=True)
class PD(Law):
    """Second-order law: a = a_ref - kp e - kd (v - v_ref), kp [1/s^2], kd [1/s], critically damped by default.

    ||kp e|| is held under kd max_velocity, so that the error closes at max_velocity at most; then the norm of the
    whole feedback under max_acceleration.  Raises DeclarationError for gains that are negative or not finite.
    """

    kp: Gain
    kd: Gain = None  # type: ignore[assignment]
    order: ClassVar[int] = 2

    def __post_init__(self) -> None:
        if self.kd is None:
            self._check(("kp",))
            kp = self.kp if isinstance(self.kp, tuple) else (self.kp,)
            kd = tuple(2.0 * math.sqrt(k) for k in kp)
            object.__setattr__(self, "kd", kd if isinstance(self.kp, tuple) else kd[0])
        self._check(("kp", "kd"))

    def demand(self, error: Vec, rate: Vec, feedforward: Vec, speed: Vec, drift: Vec, *, each: bool = False) -> Vec:
        """a - dJ/dt v ``(m,)``."""
        pull = scaled(self.kp, error)
        if self.max_velocity < math.inf:
            pull = held(pull, float(np.max(self.kd)) * self.max_velocity, each)
        feedback = pull + np.asarray(self.kd) * (speed - rate)
        return feedforward - held(feedback, self.max_acceleration, each) - drift


@dataclass(frozen=True)
class SelfMotion(Law):
    """Posture law in the null space of the levels above, with V = E^T E / 2 as Lyapunov function (Sentis 2012, eq. 40).

    y = -kp e - kv qd,  E = Phi y,  v = (ke E - kp qd + dPhi/dt y) / kv   with Phi the orthogonal projector onto the
    posture velocities that move no task above, and the sign of dPhi/dt of eq. (41) right: dV/dt = -ke E^T E.
    kp [1/s^2], kv [1/s], ke [1/s], all above zero: with ke = 0 nothing decays.  For a Posture alone in its level,
    under Torque.  Raises DeclarationError for a gain that is not positive and finite.
    """

    kp: float
    kv: float
    ke: float
    order: ClassVar[int] = 2

    def __post_init__(self) -> None:
        self._check(("kp", "kv", "ke"))
        set_numbers(self, "SelfMotion", ("kp", "kv", "ke"), 0.0, strict=True)
        if min(self.max_velocity, self.max_acceleration) < math.inf:
            raise DeclarationError("SelfMotion", "allows no saturation, which would void its Lyapunov function")

    def demand(self, error: Vec, rate: Vec, feedforward: Vec, speed: Vec, drift: Vec, *, each: bool = False) -> Vec:
        """a - dJ/dt v without v, which needs the levels above; hqp.torque adds it."""
        return feedforward - drift


@dataclass(frozen=True)
class DCM(Law):
    """Feedback of the divergent component of motion xi = c + dc/dt / omega, for a Balance.

    It requests the ZMP z_ref + (1 + k / omega) (xi - xi_ref): if the support contains it, the error of xi falls as
    exp(-k t) (Englsberger, Ott, Albu-Schaeffer 2015, eq. 16).  k [1/s].  Raises DeclarationError for a k that is
    negative or not finite.
    """

    k: float = 3.0
    order: ClassVar[int] = 2

    def __post_init__(self) -> None:
        self._check(("k",))
        if isinstance(self.k, tuple):
            raise DeclarationError("DCM.k", "bad gain", value=self.k, allowed="one number")
        if min(self.max_velocity, self.max_acceleration) < math.inf:
            raise DeclarationError("DCM", "allows no saturation: the support polygon bounds the ZMP")

    def demand(self, error: Vec, rate: Vec, feedforward: Vec, speed: Vec, drift: Vec, *, each: bool = False) -> Vec:
        """a - dJ/dt v ``(m,)``: the error of a Balance is minus its requested acceleration."""
        return feedforward - error - drift


LAWS: dict[str, type[Law]] = {"P": P, "PD": PD, "SelfMotion": SelfMotion, "DCM": DCM}
"""Laws by their names in files."""


def pace(law: Law) -> Vec:
    """Rate of a P or a PD, per row or for all rows [1/s]: gain, or max(sqrt(kp), kd/2)."""
    if isinstance(law, P):
        return np.asarray(law.gain, dtype=np.float64)
    assert isinstance(law, PD)
    return np.maximum(np.sqrt(np.asarray(law.kp, dtype=np.float64)), 0.5 * np.asarray(law.kd, dtype=np.float64))


def scaled(gain: Gain, error: Vec) -> Vec:
    """gain times error; an infinite error, a bound that is not there, stays infinite."""
    with np.errstate(invalid="ignore"):
        return np.where(np.isinf(error), error, np.asarray(gain) * error)


def held(feedback: Vec, bound: float | Vec, each: bool) -> Vec:
    """Feedback whose norm, or that of each row, is no larger than bound."""
    if each:
        return np.clip(feedback, -np.asarray(bound), bound)
    size = math.sqrt(float(feedback @ feedback))
    return feedback * (bound / size) if size > bound else feedback
