"""Centroidal plan of a motion: the CoM nearest to it whose ground forces the soles can give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.errors import HqpError

JERK = 1e-6
"""Weight of the squared jerk [s^6], beside 1 of the squared distance from the motion."""

STEADY = 0.02
"""Weight of the squared change of the ZMP from node to node."""

OUT, OUT_SQUARED = 10.0, 1e-3
"""Weights of the distance by which a ZMP leaves its polygon, and of its square: it leaves only if it has to."""

SINKING, RISING = 0.6, 1.5
"""Largest downward and upward acceleration of the CoM while a sole stands, as shares of g."""

SOLVERS = ("clarabel", "piqp", "proxqp", "osqp")
"""Solvers of sparse quadratic programs, in the order in which qpsolvers is searched for them."""


class Support(NamedTuple):
    """Convex polygon {p: normals p <= offsets} of the soles that stand, ``(m, 2)``, ``(m,)``, and its height [m]."""

    normals: Mat
    offsets: Vec
    height: float

    def outside(self, p: Vec) -> float:
        """Largest distance of a point ``(2,)`` beyond an edge, below 0 inside [m]."""
        return float((self.normals @ p - self.offsets).max())


@dataclass(frozen=True)
class CentroidalPlan:
    """com, velocity, acceleration ``(n, 3)`` [m, m/s, m/s^2] and zmp ``(n, 2)`` [m], NaN in flight.

    outside: distance by which the ZMP leaves its polygon ``(n,)`` [m], above 0 only if no plan keeps it inside.
    """

    com: Mat
    velocity: Mat
    acceleration: Mat
    zmp: Mat
    outside: Vec

    def at(self, times: Vec, dt: float) -> tuple[Mat, Mat, Mat]:
        """com, velocity and acceleration ``(t, 3)`` at times [s], with constant jerk between nodes dt [s] apart."""
        k = np.minimum((times / dt).astype(int), len(self.com) - 2)
        s = (times - k * dt)[:, None]
        p, v, a = self.com[k], self.velocity[k], self.acceleration[k]
        jerk = (self.acceleration[k + 1] - a) / dt
        rate = v + s * a + s**2 / 2.0 * jerk
        return p + s * v + s**2 / 2.0 * a + s**3 / 6.0 * jerk, rate, a + s * jerk


def centroidal_plan(
    com: Mat, supports: Sequence[Support | None], dt: float, *, gravity: float, highest: Vec, spin: Mat | None = None
) -> CentroidalPlan:
    """Plan the CoM c of n nodes, dt [s] apart, by two convex quadratic programs with the jerk as input.

    First the height z, free fall without a support, at most ``highest`` ``(n,)`` [m] where the legs reach; then, with
    that height, x and y:

        min sum |c - com|^2 + ``JERK`` |dddc/dt|^2 dt + ``STEADY`` |p_k+1 - p_k|^2 + ``OUT`` s
        s.t. N p_k <= b + s,  p = c - (z - z_ground) ddc/dt / (ddz/dt + g) + (-dL_y/dt, dL_x/dt) / (m (ddz/dt + g))

    and the DCM of the last node in its polygon, so that the robot can stop.  com ``(n, 3)`` [m], supports: a polygon
    for each node, None in flight.  gravity [m/s^2].  spin ``(n, 2)``: dL/dt / m about x and y, the angular momentum's
    rate over the mass [m^2/s^2], 0 for None.  Strictly convex: the plan turns with the motion.  Raises HqpError without
    a solver (Kajita et al. 2003, there with the ZMP tracked; Winkler et al. 2017, vertical motion first).
    """
    n = len(com) - 1
    z = _height(com[:, 2], np.array([s is None for s in supports]), dt, gravity, highest)
    spin = np.zeros((n + 1, 2)) if spin is None else spin
    push = np.maximum(z[:, 2] + gravity, 1e-3)
    size, nodes = 4 * n + 3, 3 * np.arange(n + 1)  # variables of an axis: p, v, a of each node, then n jerks
    total = 2 * size + n + 1  # x, y and the distance s of each node
    weight, linear = np.zeros(total), np.zeros(total)
    weight[2 * size :], linear[2 * size :] = OUT_SQUARED, OUT
    for k in (0, 1):
        weight[k * size + nodes], linear[k * size + nodes] = 1.0, -com[:, k]
        weight[k * size + 3 * (n + 1) : (k + 1) * size] = JERK * dt
    at = np.array([0, size])
    rows, lower, upper = _Rows(total), [], []
    zmp, shifts = _Rows(total), np.zeros((n + 1, 2))
    for i, support in enumerate(supports):
        place, force = at + nodes[i], at + nodes[i] + 2
        if support is None:
            for column in force:
                rows.add([column], [1.0])
                lower.append(0.0)
                upper.append(0.0)
            for k in (0, 1):
                zmp.add([place[k]], [1.0])
            continue
        lever = (z[i, 0] - support.height) / push[i]
        shifts[i] = np.array([-spin[i, 1], spin[i, 0]]) / push[i]
        for k in (0, 1):
            zmp.add([place[k], force[k]], [1.0, -lever])
        for normal, offset in zip(support.normals, support.offsets, strict=True):
            rows.add([*place, *force, 2 * size + i], [*normal, *(-lever * normal), -1.0])
            lower.append(-np.inf)
            upper.append(offset - normal @ shifts[i])
    if (last := supports[-1]) is not None:
        time = np.sqrt(max(z[-1, 0] - last.height, 1e-3) / gravity)
        for normal, offset in zip(last.normals, last.offsets, strict=True):
            end = at + nodes[-1]
            rows.add([*end, *(end + 1), total - 1], [*normal, *(time * normal), -1.0])
            lower.append(-np.inf)
            upper.append(offset)
    sparse = _sparse()
    chain = _chain(n, dt)
    dynamics = sparse.hstack([sparse.block_diag([chain, chain]), sparse.csc_matrix((2 * chain.shape[0], n + 1))])
    Z = zmp.matrix()
    steps = sparse.diags([-1.0, 1.0], [0, 2], shape=(2 * n, 2 * (n + 1))) @ Z
    x = _solve(
        sparse.diags(weight) + STEADY * (steps.T @ steps),
        linear + STEADY * (steps.T @ np.diff(shifts, axis=0).ravel()),
        sparse.vstack([dynamics, rows.matrix()]),
        np.concatenate((np.zeros(dynamics.shape[0]), lower)),
        np.concatenate((np.zeros(dynamics.shape[0]), upper)),
        np.concatenate((np.full(2 * size, -np.inf), np.zeros(n + 1))),
    )
    both = [x[k * size : k * size + 3 * (n + 1)].reshape(-1, 3) for k in (0, 1)]
    p, v, a = np.moveaxis(np.stack([*both, z], axis=2), 1, 0)
    reached = (Z @ x).reshape(-1, 2) + shifts
    out = np.array([0.0 if s is None else max(0.0, s.outside(r)) for s, r in zip(supports, reached, strict=True)])
    reached[[s is None for s in supports]] = np.nan
    return CentroidalPlan(p, v, a, reached, out)


def _height(z: Vec, flight: Any, dt: float, gravity: float, highest: Vec) -> Mat:
    """Height, its rate and its acceleration ``(n, 3)``, at most ``highest`` if free fall allows it."""
    sparse = _sparse()
    n = len(z) - 1
    states, size = 3 * (n + 1), 4 * n + 3
    weight, linear = np.zeros(size + n + 1), np.zeros(size + n + 1)
    weight[0:states:3], linear[0:states:3] = 1.0, -z
    weight[states:size], weight[size:], linear[size:] = JERK * dt, OUT_SQUARED, OUT
    every = sparse.eye(size + n + 1, format="csc")
    chain = sparse.hstack([_chain(n, dt), sparse.csc_matrix((3 * n, n + 1))])
    rows = sparse.vstack([chain, every[2:states:3], every[0:states:3] - every[size:]])
    least, most = np.where(flight, -gravity, -SINKING * gravity), np.where(flight, -gravity, RISING * gravity)
    zero = np.zeros(3 * n)
    x = _solve(
        sparse.diags(weight), linear, rows,
        np.concatenate((zero, least, np.full(n + 1, -np.inf))), np.concatenate((zero, most, highest)),
        np.concatenate((np.full(size, -np.inf), np.zeros(n + 1))),
    )  # fmt: skip
    return np.asarray(x[:states].reshape(-1, 3))


def _chain(n: int, dt: float) -> Any:
    """Rows x_k+1 - F x_k - g u_k of a triple integrator, columns [p v a] of n + 1 nodes, then n inputs."""
    sparse = _sparse()
    F = np.array([[1.0, dt, dt * dt / 2.0], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
    g = np.array([[dt**3 / 6.0], [dt * dt / 2.0], [dt]])
    states = sparse.kron(sparse.eye(n, n + 1, k=1), np.eye(3)) - sparse.kron(sparse.eye(n, n + 1), F)
    return sparse.hstack([states, -sparse.kron(sparse.eye(n), g)]).tocsc()


def _sparse() -> Any:
    """SciPy's sparse matrices, imported when they are needed."""
    from scipy import sparse

    return sparse


class _Rows:
    """Rows of a sparse matrix with so many columns."""

    def __init__(self, columns: int) -> None:
        self._columns, self._count = columns, 0
        self._where: tuple[list[int], list[int]] = [], []
        self._values: list[float] = []

    def add(self, columns: Sequence[int], values: Sequence[float]) -> None:
        """Append a row."""
        self._where[0].extend([self._count] * len(columns))
        self._where[1].extend(int(c) for c in columns)
        self._values.extend(float(v) for v in values)
        self._count += 1

    def matrix(self) -> Any:
        """The rows, sparse."""
        sparse = _sparse()
        return sparse.coo_matrix((self._values, self._where), shape=(self._count, self._columns)).tocsc()


def _solve(P: Any, q: Vec, C: Any, lower: Vec, upper: Vec, least: Vec) -> Vec:
    """Minimise 1/2 x'P x + q'x subject to lower <= C x <= upper and least <= x; raises HqpError."""
    sparse = _sparse()
    try:
        import qpsolvers
    except ImportError as error:
        raise HqpError("a plan of the CoM needs qpsolvers and a sparse solver: pip install 'hqp[motion]'") from error
    solver = next((name for name in SOLVERS if name in qpsolvers.sparse_solvers), None)
    if solver is None:
        raise HqpError(f"qpsolvers finds none of {', '.join(SOLVERS)}: pip install 'hqp[motion]'")
    C, equal = C.tocsr(), lower == upper
    above, below, bounded = ~equal & np.isfinite(upper), ~equal & np.isfinite(lower), np.isfinite(least)
    G = sparse.vstack([C[above], -C[below], -sparse.eye(len(q), format="csr")[bounded]])
    h = np.concatenate((upper[above], -lower[below], -least[bounded]))
    problem: Any = qpsolvers.Problem
    found = qpsolvers.solve_problem(problem(P.tocsc(), q, G.tocsc(), h, C[equal].tocsc(), upper[equal]), solver)
    if found.x is None or not np.isfinite(found.x).all():
        raise HqpError(f"{solver} found no plan of the CoM")
    return np.asarray(found.x)
