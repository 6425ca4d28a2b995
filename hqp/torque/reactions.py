"""Interpretation of a stack at torque level: elements that act by a force, elements with rows, and the rank condition
on the motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from hqp.arrays import Mat
from hqp.declare.element import Constraint, Element
from hqp.declare.law import Law
from hqp.declare.robot import Robot
from hqp.declare.stack import Stack
from hqp.errors import DeclarationError, ModelError
from hqp.programs.assembly import Assembly
from hqp.tolerances import INERTIA_TOLERANCE, RANK_TOLERANCE
from hqp.torque.motor_axes import passive_motions


def reactions(stack: Stack) -> tuple[Element, ...]:
    """The constraints that act by a reaction force: contacts and couplings in ``subject_to``."""
    return tuple(e for e in stack.subject_to if isinstance(e, Constraint) and e.equality and e.quantity == "motion")


@dataclass(frozen=True, slots=True)
class Actuation:
    """Rank condition of constraints and actuators on the motion: rank [J_constr; U] = nv (after eq. 12).

    rank: of J.  smallest: its least non-zero singular value over the largest.  full_rank: of [J; U].
    full_smallest: least singular value of [J; U], zero where the rank is short.
    """

    rows: int
    rank: int
    smallest: float
    full_rank: int
    full_smallest: float
    nv: int

    @property
    def complete(self) -> bool:
        """True if the rank of [J; U] is full, so that qd follows from the actuated velocities alone (eq. 13)."""
        return self.full_rank == self.nv

    def __str__(self) -> str:
        return (
            f"rank J_constr = {self.rank} of {self.rows} rows (least singular value {self.smallest:.2g} of the "
            f"largest), rank [J_constr; U] = {self.full_rank} of {self.nv} (least {self.full_smallest:.2g})"
        )


def actuation(J: Mat, U: Mat, tolerance: float = RANK_TOLERANCE) -> Actuation:
    """Ranks and conditioning of J ``(m, nv)`` and [J; U]; at least as many rows as unactuated coordinates do not
    suffice."""
    m, nv = J.shape
    own = np.linalg.svd(J, compute_uv=False) if m else np.zeros(0)
    both = np.linalg.svd(np.vstack((J, U)), compute_uv=False)
    rank = int(np.count_nonzero(own > tolerance * own.max(initial=0.0)))
    full = int(np.count_nonzero(both > tolerance * both.max(initial=0.0)))
    least = float(own[rank - 1] / own[0]) if rank else 0.0
    return Actuation(m, rank, least, full, float(both[-1]) if full == nv and both.size >= nv else 0.0, nv)


_KNOWN: WeakKeyDictionary[Robot, dict[tuple[tuple[Element, ...], bool], Actuation]] = WeakKeyDictionary()
"""Cache of complete sets: a change of stack within the loop need not find it again."""

AROUND = 0.3
"""Distance of joints from home for sampled rows: home may be a pose where they depend [m, rad]."""


class Supports:
    """Sets of constraints that determine the motion, by their rows at home and around it."""

    def __init__(self, held: Sequence[Element], robot: Robot, dt: float, laws: Mapping[str, Law]) -> None:
        self._owners = [e.name for e in held for _ in range(e.rows(robot))]
        passive = passive_motions(robot.actuation)
        self._rows = [J @ passive for J in _around_home(held, robot, dt, laws)]
        self._known: dict[frozenset[str], bool] = {}

    def determined(self, out: frozenset[str]) -> bool:
        """Return true if rank [J_constr; U] is full without these: equivalently that of the rest on passive motions."""
        if out not in self._known:
            kept = [i for i, name in enumerate(self._owners) if name not in out]
            self._known[out] = any(_rank(J[kept]) == J.shape[1] for J in self._rows)
        return self._known[out]


def _rank(J: Mat) -> int:
    sizes = np.linalg.svd(J, compute_uv=False) if J.size else np.zeros(0)
    return int(np.count_nonzero(sizes > RANK_TOLERANCE * sizes.max(initial=0.0)))


def require_actuation(
    held: Sequence[Element], robot: Robot, dt: float, laws: Mapping[str, Law], free: bool = False
) -> Actuation:
    """Rank and conditioning of [J_constr; U]; raises DeclarationError where it is short at home and around it.

    free: the base moves under a known wrench, which counts as its motor.
    """
    known = _KNOWN.setdefault(robot, {})
    key = tuple(held), free
    if key not in known:
        base = np.eye(6 if free and robot.floating else 0, robot.nv)
        known[key] = _find_actuation(held, robot, dt, laws, np.vstack((base, robot.actuation)))
    return known[key]


def require_inertia(robot: Robot) -> None:
    """Raise ModelError, naming the joint, where the inertia at home is not positive definite: a chain without mass."""
    M = robot.state().mass_matrix()
    size = np.diagonal(M).copy()
    i, least = int(np.argmin(size)), 0.0
    if np.isfinite(M).all() and size[i] > 0.0:
        root = np.sqrt(size)
        values, vectors = np.linalg.eigh(M / np.outer(root, root))
        i, least = int(np.argmax(np.abs(vectors[:, 0]))), float(values[0])
    if least < INERTIA_TOLERANCE:
        raise ModelError(
            f"{robot.name}, joint {robot.joint_name(i)}: the joint-space inertia at home is not positive definite; "
            "give the links it moves a mass, or the joint a rotor inertia"
        )


def _around_home(held: Sequence[Element], robot: Robot, dt: float, laws: Mapping[str, Law]) -> Iterator[Mat]:
    """Rows of the constraints at home and at two poses around it."""
    twin, rng = robot.copy(), np.random.default_rng(0)
    for step in (np.zeros(robot.nv), *(rng.uniform(-AROUND, AROUND, robot.nv) for _ in range(2))):
        state = twin.state(twin.integrate(twin.home, step, 1.0))
        rows = Assembly(held, (), twin, dt, laws)
        rows.fill(state, {e.name: e.hold(state) for e in held}, ())
        yield rows.J


def _find_actuation(
    held: Sequence[Element], robot: Robot, dt: float, laws: Mapping[str, Law], actuated: Mat
) -> Actuation:
    twin = robot.copy()
    require_inertia(twin)
    found = []
    for J in _around_home(held, twin, dt, laws):
        found.append(actuation(J, actuated))
        if found[-1].complete:
            return found[-1]
    names = ", ".join(e.name for e in held) or "no contacts or couplings"
    loose = ", ".join(_undetermined(next(_around_home(held, twin, dt, laws)), actuated, robot))
    raise DeclarationError(
        "subject_to",
        f"constraints and actuators do not determine the motion of {robot.name}: {found[0]}; given {names}"
        f"; no motor and no constraint determines {loose}",
        allowed="rank [J_constr; U] = nv: add contacts, a closure or a JointCoupling of these joints, or motors; "
        "a JointCoupling of a single joint holds it at its offset",
    )


def _undetermined(J: Mat, actuated: Mat, robot: Robot) -> list[str]:
    """Joints that move while constraints hold and motors stand, each once."""
    _, sizes, V = np.linalg.svd(np.vstack((J, actuated)))
    rank = int(np.count_nonzero(sizes > RANK_TOLERANCE * sizes.max(initial=0.0)))
    moved = np.flatnonzero(np.abs(V[rank:]).max(axis=0, initial=0.0) > RANK_TOLERANCE)
    return list(dict.fromkeys(robot.joint_name(int(i)).split("[")[0] for i in moved))
