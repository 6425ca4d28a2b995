"""Reference elimination of constraint forces by dense factorisations of LAPACK, to compare the native one with."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import get_lapack_funcs

from hqp.arrays import Mat, Vec
from hqp.tolerances import RANK_TOLERANCE

potrf, potrs, trtrs, geqrf, geqp3, ormqr = get_lapack_funcs(
    ("potrf", "potrs", "trtrs", "geqrf", "geqp3", "ormqr"), (np.zeros(1),)
)


class DenseDynamics:
    """Dense ConstrainedDynamics: A = L' L, L^-T J^T S = Q_1 T, S the independent combinations of the constraints."""

    def __init__(self, rows: int, U: Mat) -> None:
        self.m, self.n, self.U = rows, len(U), U

    def update(self, A: Mat, bias: Vec, J: Mat, gamma: Vec) -> None:
        self.A, self.J, n, m = A, J, self.n, self.m
        L, info = potrf(A, lower=0, clean=0)
        assert not info
        columns: Mat = np.zeros((A.shape[0], n + 1), order="F")
        columns[:, :n] = self.U.T
        columns[:, n] = -bias
        image = trtrs(L, columns, trans=1)[0]
        qr, order, tau, _, _ = geqp3(trtrs(L, np.asfortranarray(J.T), trans=1)[0]) if m else (None, None, None, 0, 0)
        pivots = np.abs(qr.diagonal()) if m else np.zeros(0)
        self.rank = r = int(np.count_nonzero(pivots > RANK_TOLERANCE * pivots.max(initial=0.0)))
        if r:
            S, T = np.linalg.qr(np.triu(qr[:r]).T)  # R = T' S'
            self.S: Mat = np.empty((m, r))
            self.S[order - 1], self.T = S, T.T
            Q: Any = (np.asfortranarray(qr[:, :r]), tau[:r])
            image = ormqr("L", "T", *Q, image, 4096)[0]
        self.top = image[:r].copy()
        V = image[r:, :n]
        self.phi = V.T @ V
        if r:
            y = trtrs(self.T, self.S.T @ gamma, lower=1, trans=1)[0]
            self.top[:, n] -= y
            image[:r, :n], image[:r, n] = 0.0, y
            image = ormqr("L", "N", *Q, image, 4096)[0]
        self.map = trtrs(L, image, trans=0)[0]
        self.X, self.c = self.map[:, :n], self.map[:, n]

    def _expand(self, right: Mat) -> Mat:
        if not self.rank:
            return np.zeros((self.m, right.shape[1]))
        return np.asarray(self.S @ trtrs(self.T, right, lower=1)[0])

    def force_map(self) -> tuple[Mat, Vec]:
        both = self._expand(self.top)
        return both[:, : self.n], both[:, self.n]

    def forces(self, tau: Vec) -> Vec:
        F, f = self.force_map()
        return F @ tau + f

    def acceleration(self, tau: Vec) -> Vec:
        return self.X @ tau + self.c

    @property
    def Lambda_constr(self) -> Mat:
        root = self._expand(np.eye(self.rank))
        return root @ root.T

    @property
    def Jbar_constr(self) -> Mat:
        return np.asarray(potrs(potrf(self.A, lower=0)[0], self.J.T, lower=0)[0]) @ self.Lambda_constr

    @property
    def N_constr(self) -> Mat:
        return np.eye(self.A.shape[0]) - self.Jbar_constr @ self.J
