"""Dynamics of a constrained, underactuated robot with the constraint forces eliminated (Sentis 2012, section II).

    A qdd + b + g + J^T lambda = U^T tau,      J qdd = gamma      (eq. 2; gamma = -dJ/dt qd)

A ``(nv, nv)`` inertia, b + g ``(nv,)``, J ``(m, nv)`` constraints, U ``(n, nv)`` the actuation: it picks the actuated
coordinates, with further joints of the motors that pull tendons.
Everything rests on one orthogonal factorisation, so that no inverse and no normal equation of J is ever formed:

    A = L L^T,   L^-1 J^T S = Q T,   L as sparse as the tree, Q orthonormal, T triangular,

S ``(m, r)`` an orthonormal basis of the independent constraints (the identity if they all are).  The accelerations
that the constraints allow are L^-T V tau with V = (1 - Q Q^T) L^-1 U^T, and the reduced inverse inertia is
phi* = V^T V (hqp/cpp/torque/sparse_elimination.hpp).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.linalg import get_lapack_funcs

from hqp.arrays import Index, Mat, Signs, Vec
from hqp.declare.robot import Robot
from hqp.errors import DynamicsFailed
from hqp.tolerances import RANK_TOLERANCE
from hqp.torque.motor_axes import motor_parts

try:
    from hqp import _torque as native
except ImportError:  # no compiler was there
    native = None  # type: ignore[assignment]

potrf, potrs, trtrs = get_lapack_funcs(("potrf", "potrs", "trtrs"), (np.zeros(1),))


class ConstrainedDynamics:
    """qdd, tau and lambda of eq. (2) as maps of each other, refilled by ``update`` in preallocated arrays.

    nv: tangent coordinates.  rows: m constraint rows.  U: actuation of n motors, of full row rank.
    parents: parents of the coordinates, see ``coordinate_parents``; A is zero between branches.  A full A without them.
    After ``update``:  map ``(nv, n + 1)`` = [X, c]: qdd = X tau + c.  phi ``(n, n)``: phi* (eq. 15), symmetric, to the
    bit U X of motors of one joint; singular where constraints take a direction from the actuators.  rank: number r
    of independent constraints.  out: mask of the constraints ``(m,)``, writable, 1 for an absent one: it has no force
    then.  terms: A, bias, J and gamma where they are arrays that are refilled in place.  The live arrays are
    overwritten by the next update; the properties are computed anew at every access.
    """

    def __init__(
        self,
        nv: int,
        rows: int,
        U: Mat,
        parents: Sequence[int] | None = None,
        terms: tuple[Mat, Vec, Mat, Vec] | None = None,
    ) -> None:
        self.nv, self.m, self.n = nv, rows, len(U)
        self.U = U
        self.rank = rows
        self._terms = terms or (np.zeros((nv, nv), order="F"), np.zeros(nv), np.zeros((rows, nv)), np.zeros(rows))
        self._factor: Mat = np.zeros((nv, nv), order="F")
        self.map: Mat = np.zeros((nv, self.n + 1))
        self._top: Mat = np.zeros((rows, self.n + 1))
        self._T: Mat = np.zeros((rows, rows))
        self._root: Mat | None = None
        self.X: Mat = self.map[:, : self.n]
        self.c: Vec = self.map[:, self.n]
        self.phi: Mat = np.zeros((self.n, self.n))
        self.parts: dict[str, Any] = {
            **dict(zip(("A", "bias", "J", "gamma"), self._terms, strict=True)),
            "parents": list(range(-1, nv - 1) if parents is None else parents),
            **motor_parts(U),
            "tolerance": RANK_TOLERANCE,
            "factor": self._factor,
            "map": self.map,
            "phi": self.phi,
            "Q": np.zeros((nv, rows)),
            "T": self._T,
            "top": self._top,
        }
        """Data of the native elimination and of the rows that follow it; a file as well."""
        self.follow({"products": (), "picks": (), "motion": None}, None)

    def follow(self, rows: dict[str, Any], forces: dict[str, Any] | None) -> None:
        """These rows, and these on forces, are written with ``native`` after eliminations from now on."""
        self.parts |= {**rows, "forces": forces}
        if native is not None:
            self.native = native.Parts(self.parts)
            self.out: Signs = self.native.out

    def update(self, A: Mat, bias: Vec, J: Mat, gamma: Vec) -> None:
        """Take the inertia A (its upper triangle is read), bias = b + g, J and gamma of a state.

        Raises DynamicsFailed where A is not positive definite.
        """
        for own, given in zip(self._terms, (A, bias, J, gamma), strict=True):
            np.copyto(own, given)
        self.refresh()

    def refresh(self) -> None:
        """Update if the terms have been refilled in place."""
        self.forget()
        self.rank = self.native.eliminate()
        if self.rank < 0:
            raise DynamicsFailed("the joint-space inertia is not positive definite")

    @property
    def columns(self) -> Index | None:
        """The coordinate of each motor ``(n,)``, whose rows of X are those of phi; None if a motor pulls several."""
        return None if self.parts["axes"] else np.array(self.parts["actuated"], dtype=np.intp)

    @property
    def reactions(self) -> object:
        """``Jbar_constr`` of the latest update, for native rows."""
        return self.native.reactions()

    @property
    def J(self) -> Mat:
        """The constraints ``(m, nv)``, zeros for those that are out; the given array if none is out."""
        return np.where(self.out[:, None], 0.0, self._terms[2]) if self.out.any() else self._terms[2]

    def forget(self) -> None:
        """Native code is to refill the arrays: results derived from the old arrays are invalid."""
        self._root = None

    def force_map(self) -> tuple[Mat, Vec]:
        """(F ``(m, n)``, f ``(m,)``) with lambda = F tau + f (eq. 3), least norm if constraints are dependent."""
        both = self._expand(self._top)
        return both[:, : self.n], both[:, self.n]

    def forces(self, tau: Vec) -> Vec:
        """lambda ``(m,)`` of a torque (eq. 3): Jbar^T (U^T tau - b - g) + Lambda dJ/dt qd."""
        return self._expand(self._top[:, : self.n] @ tau + self._top[:, self.n])

    def _expand(self, right: Mat | Vec) -> Mat:
        """T^-1 right."""
        return np.asarray(trtrs(self._T, right)[0]) if self.m else np.zeros(right.shape)

    def acceleration(self, tau: Vec) -> Vec:
        """qdd ``(nv,)`` of a torque (eq. 4)."""
        return self.X @ tau + self.c

    @property
    def Lambda_constr(self) -> Mat:
        """(J A^-1 J^T)^+ ``(m, m)``: inertia in the manifold of the constraints (below eq. 3)."""
        if self.rank < self.m - int(np.count_nonzero(self.out)):
            values, vectors = np.linalg.eigh(self.J @ self._solve(self.J.T))
            kept = slice(self.m - self.rank, self.m)
            return np.asarray((vectors[:, kept] / values[kept]) @ vectors[:, kept].T)
        root = self._expand(np.eye(self.m))
        root[self.out != 0] = 0.0
        return root @ root.T

    @property
    def Jbar_constr(self) -> Mat:
        """A^-1 J^T Lambda ``(nv, m)``: the dynamically consistent inverse of J (below eq. 3)."""
        return self._solve(self.J.T) @ self.Lambda_constr

    @property
    def N_constr(self) -> Mat:
        """I - Jbar J ``(nv, nv)``: the dynamically consistent null space of the constraints (below eq. 4)."""
        return np.eye(self.nv) - self.Jbar_constr @ self.J

    @property
    def UN(self) -> Mat:
        """U N_constr ``(n, nv)``."""
        return self.U @ self.N_constr

    @property
    def UNbar(self) -> Mat:
        """A^-1 (U N_constr)^T phi*^+ ``(nv, n)``: qd = UNbar q_act on the constraints (eqs. 13 and 14).

        Does not depend on A where rank [J; U] = nv: it then is the second block column of [J; U]^+.
        """
        return self.X @ symmetric_pinv(self.phi)

    @property
    def h(self) -> Vec:
        """b* + g* ``(n,)``: phi* (b* + g*) = U A^-1 (N^T (b + g) + J^T Lambda dJ/dt qd) (eq. 22).

        qdd_act = phi* (tau - h) (eq. 21).
        """
        return symmetric_pinv(self.phi) @ -(self.U @ self.c)

    def _solve(self, right: Mat) -> Mat:
        if self._root is None:
            self._root = potrf(self._factor, lower=0, clean=0)[0]
        return potrs(self._root, right, lower=0)[0]  # type: ignore[no-any-return]


def coordinate_parents(robot: Robot) -> list[int]:
    """For each tangent coordinate the one before it on its way to the world, -1 for none, ``(nv,)``."""
    last: list[int] = []
    parents = [-1] * robot.nv
    for i, (parent, first, count, *_) in enumerate(robot.bodies):
        carrier = last[parent] if i else -1
        for coordinate in range(first, first + count):
            parents[coordinate] = carrier
            carrier = coordinate
        last.append(carrier)
    return parents


def symmetric_pinv(M: Mat, tolerance: float = RANK_TOLERANCE) -> Mat:
    """M^+ of a symmetric positive semidefinite matrix; eigenvalues below tolerance times the largest count as zero."""
    values, vectors = np.linalg.eigh(0.5 * (M + M.T))
    kept = values > tolerance * values.max(initial=0.0)
    return np.asarray((vectors[:, kept] / values[kept]) @ vectors[:, kept].T)
