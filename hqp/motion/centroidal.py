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

GRIP = 0.5
"""Largest horizontal force of a sole along two directions, as a share of its load."""

TOGETHER = 0.1
"""Weight of the squared difference between a sole's part of the acceleration and its share of the load [s^4]."""

SINKING = 0.6
"""Largest downward acceleration of the CoM while a sole stands, as a share of g."""

SOLVERS = ("clarabel", "piqp", "proxqp", "osqp")
"""Solvers of sparse quadratic programs, in the order in which qpsolvers is searched for them."""


class Support(NamedTuple):
    """A sole that stands: its convex outline from above, counter-clockwise ``(m, 2)``, and its height [m].

    Two corners are an edge, of a foot on its toe.

    strength: largest load of its leg over the robot's mass [m/s^2].
    """

    corners: Mat
    height: float
    strength: float = np.inf

    @property
    def edges(self) -> tuple[Mat, Vec]:
        """Normals ``(m, 2)`` and offsets ``(m,)`` [m] of the outline {p: normals p <= offsets}."""
        along = np.roll(self.corners, -1, axis=0) - self.corners
        normals = np.column_stack((along[:, 1], -along[:, 0]))
        if len(along) == 2:
            normals = np.vstack((normals, along))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return normals, (normals @ self.corners.T).max(axis=1)


Soles = tuple[Support, ...]
"""The soles that stand, none in flight."""


def outside(soles: Soles, com: Vec, force: Vec, turning: Vec) -> float:
    """Distance by which the ground's force leaves the hull of the soles, below 0 inside [m].

    com ``(3,)`` [m].  force ``(3,)``: its direction.  turning ``(2,)``: shift of its line by the angular momentum [m].
    At a share l of the way from one sole to the other the hull is (1 - l) P + l Q: least over l.
    """
    ends = [com[:2] - (com[2] - sole.height) / force[2] * force[:2] + turning for sole in (soles[0], soles[-1])]
    normals = np.vstack([sole.edges[0] for sole in soles])
    off, other = (
        normals @ p - (sole.corners @ normals.T).max(axis=0)
        for p, sole in zip(ends, (soles[0], soles[-1]), strict=True)
    )
    slope = other - off
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.nan_to_num((off[:, None] - off) / (slope - slope[:, None])).ravel()
    shares = np.clip(np.concatenate((shares, [0.0, 1.0])), 0.0, 1.0)
    return float((off + np.outer(shares, slope)).max(axis=1).min())


@dataclass(frozen=True)
class CentroidalPlan:
    """com, velocity, acceleration ``(n, 3)`` [m, m/s, m/s^2] and zmp ``(n, 2)`` [m], NaN in flight.

    outside: distance by which a sole's forces leave it ``(n,)`` [m], above 0 only if no plan keeps them inside.
    shares: for each node the load of its soles but the first, as shares.
    """

    com: Mat
    velocity: Mat
    acceleration: Mat
    zmp: Mat
    outside: Vec
    shares: list[Vec]

    def at(self, times: Vec, dt: float) -> tuple[Mat, Mat, Mat]:
        """com, velocity and acceleration ``(t, 3)`` at times [s], with constant jerk between nodes dt [s] apart."""
        k = np.minimum((times / dt).astype(int), len(self.com) - 2)
        s = (times - k * dt)[:, None]
        p, v, a = self.com[k], self.velocity[k], self.acceleration[k]
        jerk = (self.acceleration[k + 1] - a) / dt
        rate = v + s * a + s**2 / 2.0 * jerk
        return p + s * v + s**2 / 2.0 * a + s**3 / 6.0 * jerk, rate, a + s * jerk


def centroidal_plan(
    com: Mat, supports: Sequence[Soles], dt: float, *, gravity: float, highest: Vec, spin: Mat | None = None,
    ends: Soles | None = None, shares: Sequence[Vec] | None = None,
) -> CentroidalPlan:  # fmt: skip
    """Plan the CoM c of n nodes, dt [s] apart, by two convex quadratic programs with the jerk as input.

    First the height z, free fall without a sole, at most ``highest`` ``(n,)`` [m] where the legs reach, and rising no
    faster than the legs together push; then, with that height, x and y, and for each sole j its share l_j of the load,
    at most that of its leg, r_j = l_j p_j with the centre of pressure p_j, and its part a_j of the acceleration:

        min sum |c - com|^2 + ``JERK`` |dddc/dt|^2 dt + ``STEADY`` |p_k+1 - p_k|^2 + ``OUT`` s
                + ``TOGETHER`` |a_j - shares_j ddc/dt|^2
        s.t. N_j r_j <= l_j b_j + s,  |a_j| <= ``GRIP`` l_j (ddz/dt + g),  l_j (ddz/dt + g) <= strength_j,
             sum l_j = 1,  sum a_j = ddc/dt,
             p = sum r_j = c - sum (z - z_j) a_j / (ddz/dt + g) + (-dL_y/dt, dL_x/dt) / (m (ddz/dt + g))

    and the DCM of the last node between ``ends``, on which the robot can stop: the soles of that node for None.  com
    ``(n, 3)`` [m], supports: the soles of each node.  gravity [m/s^2].  spin ``(n, 2)``: dL/dt / m about x and y, the
    angular momentum's rate over the mass [m^2/s^2], 0 for None.  shares: loads of a plan before, in proportion to which
    soles push, for soles at two heights that push against each other turn the body; equal ones for None.  The plan
    turns with the motion.  Raises HqpError without a solver (Kajita et al. 2003, there with the
    ZMP tracked; Winkler et al. 2017, vertical motion first).
    """
    n = len(com) - 1
    z = _height(com[:, 2], supports, dt, gravity, highest)
    spin = np.zeros((n + 1, 2)) if spin is None else spin
    push = np.maximum(z[:, 2] + gravity, 1e-3)
    size, nodes = 4 * n + 3, 3 * np.arange(n + 1)  # variables of an axis: p, v, a of each node, then n jerks
    slack = 2 * size + np.arange(n + 2)  # a distance for each node, and one for the last DCM
    last = supports[-1] if ends is None else ends
    more = [max(len(soles) - 1, 0) for soles in (*supports, last)]
    begins = slack[-1] + 1 + 5 * np.concatenate(([0], np.cumsum(more)))  # l, r and a of each sole beyond the first
    total = int(begins[-1])
    weight, linear = np.zeros(total), np.zeros(total)
    weight[slack], linear[slack] = OUT_SQUARED, OUT
    for k in (0, 1):
        weight[k * size + nodes], linear[k * size + nodes] = 1.0, -com[:, k]
        weight[k * size + 3 * (n + 1) : (k + 1) * size] = JERK * dt
    at = np.array([0, size])
    rows, lower, upper = _Rows(total), [], []
    zmp, apart, shifts = _Rows(total), _Rows(total), np.zeros((n + 1, 2))

    def bound(columns: Sequence[int], values: Sequence[float], most: float, least: float = -np.inf) -> None:
        rows.add(columns, values)
        lower.append(least)
        upper.append(most)

    def inside(
        soles: Soles, first: int, point: list[tuple[list[int], list[float]]], shift: Vec, free: int, load: float
    ) -> None:
        """Bound a point, the sum of terms by axis, and the shares of the soles in a load."""
        begin = [first + 5 * j for j in range(len(soles) - 1)]
        normals, offsets = soles[0].edges
        for normal, offset in zip(normals, offsets, strict=True):
            columns, values = [*begin, free], [*[offset] * len(begin), -1.0]
            for k, (own, factors) in enumerate(point):
                columns += [*own, *(b + 1 + k for b in begin)]
                values += [*(normal[k] * f for f in factors), *[-normal[k]] * len(begin)]
            bound(columns, values, offset - normal @ shift)
        most = _shares(soles, load)
        for b, sole, share in zip(begin, soles[1:], most[1:], strict=True):
            bound([b], [1.0], share, 0.0)
            for normal, offset in zip(*sole.edges, strict=True):
                bound([b + 1, b + 2, b, free], [*normal, -offset, -1.0], 0.0)
        if len(begin) > 1 or (begin and most[0] < 1.0):
            bound(begin, [1.0] * len(begin), 1.0, 1.0 - most[0])

    for i, soles in enumerate(supports):
        place, force, begin = at + nodes[i], at + nodes[i] + 2, [*range(begins[i], begins[i + 1], 5)]
        if not soles:
            for k in (0, 1):
                bound([force[k]], [1.0], 0.0, 0.0)
                zmp.add([place[k]], [1.0])
            continue
        lever = (z[i, 0] - soles[0].height) / push[i]
        above = [(sole.height - soles[0].height) / push[i] for sole in soles[1:]]
        shifts[i] = np.array([-spin[i, 1], spin[i, 0]]) / push[i]
        point = [([place[k], force[k], *(b + 3 + k for b in begin)], [1.0, -lever, *above]) for k in (0, 1)]
        for columns, values in point:
            zmp.add(columns, values)
        inside(soles, begins[i], point, shifts[i], slack[i], push[i])
        for b, share in zip(begin, [1.0 / len(soles)] * len(begin) if shares is None else shares[i], strict=True):
            for k in (0, 1):
                apart.add([b + 3 + k, force[k]], [1.0, -share])
        grip = GRIP * push[i]
        for way in _ways(soles):
            for b in begin:
                bound([b + 3, b + 4, b], [*way, -grip], 0.0)
            others = [b + 3 + k for b in begin for k in (0, 1)]
            bound([*force, *others, *begin], [*way, *[-x for _ in begin for x in way], *[grip] * len(begin)], grip)
    if last:
        level = float(np.mean([sole.height for sole in last]))
        time, end = np.sqrt(max(z[-1, 0] - level, 1e-3) / gravity), at + nodes[-1]
        inside(last, begins[-2], [([end[k], end[k] + 1], [1.0, time]) for k in (0, 1)], np.zeros(2), slack[-1], gravity)
    sparse = _sparse()
    chain = _chain(n, dt)
    dynamics = sparse.hstack(
        [sparse.block_diag([chain, chain]), sparse.csc_matrix((2 * chain.shape[0], total - 2 * size))]
    )
    Z, D = zmp.matrix(), apart.matrix()
    steps = sparse.diags([-1.0, 1.0], [0, 2], shape=(2 * n, 2 * (n + 1))) @ Z
    least = np.full(total, -np.inf)
    least[slack] = 0.0
    x = _solve(
        sparse.diags(weight) + STEADY * (steps.T @ steps) + TOGETHER * (D.T @ D),
        linear + STEADY * (steps.T @ np.diff(shifts, axis=0).ravel()),
        sparse.vstack([dynamics, rows.matrix()]),
        np.concatenate((np.zeros(dynamics.shape[0]), lower)),
        np.concatenate((np.zeros(dynamics.shape[0]), upper)),
        least,
    )
    both = [x[k * size : k * size + 3 * (n + 1)].reshape(-1, 3) for k in (0, 1)]
    p, v, a = np.moveaxis(np.stack([*both, z], axis=2), 1, 0)
    reached = (Z @ x).reshape(-1, 2) + shifts
    reached[[not soles for soles in supports]] = np.nan
    loads = [x[begins[i] : begins[i + 1] : 5] for i in range(n + 1)]
    return CentroidalPlan(p, v, a, reached, np.maximum(x[slack[:-1]], 0.0), loads)


def _ways(soles: Soles) -> Mat:
    """Directions in which friction is bounded ``(4, 2)``: along the line between the soles, or an edge, and across."""
    first, last = soles[0], soles[-1]
    x, y = first.edges[0][0] if first is last else last.corners.mean(axis=0) - first.corners.mean(axis=0)
    one, two = np.array([x, y]) / np.hypot(x, y), np.array([-y, x]) / np.hypot(x, y)
    return np.array([one, two, -one, -two])


def _shares(soles: Soles, load: float) -> list[float]:
    """Largest share of a load over the mass [m/s^2] on each sole; together the soles carry it."""
    most = [min(1.0, sole.strength / load) for sole in soles]
    return [share / min(1.0, sum(most)) for share in most]


def _height(z: Vec, supports: Sequence[Soles], dt: float, gravity: float, highest: Vec) -> Mat:
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
    least = np.where([not soles for soles in supports], -gravity, -SINKING * gravity)
    most = np.maximum(least, [sum(sole.strength for sole in soles) - gravity for soles in supports])
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
