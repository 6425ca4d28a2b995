"""The seam between robots and solvers: a hierarchy of plain rows in, a solution out; NumPy only."""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from hqp.arrays import Index, Mask, Mat, Signs, Vec, floats, is_readable
from hqp.errors import NotSolved, ProblemError
from hqp.tolerances import VIOLATION_TOLERANCE

EQUALITY = 2
"""Mark of an equality row in ``Solution.active``."""

ETA = 1e-4
"""For an unmet priced level: fraction of ||w_a|| by which a unit of force of the levels below moves its rows."""


@dataclass(frozen=True, slots=True, eq=False)
class Selection:
    """Rows that each pick one variable: ``(A x)_i = scale_i x[index_i]``.

    index: ``(m,)`` positions in x.  scale: ``(m,)``, non-zero, 1 by default.
    Raises ProblemError for shapes that disagree, positions that are negative or no integers, a scale that is zero or
    not finite.
    """

    index: Index
    scale: Vec = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        try:
            index = np.asarray(self.index)
        except ValueError as error:
            raise ProblemError(f"selection: positions must be integers; {error}") from None
        if index.size and index.dtype.kind not in "iu":
            raise ProblemError(f"selection: positions must be integers, given {index.dtype}")
        index = index.astype(np.intp, copy=False)
        scale = np.ones(index.shape) if self.scale is None else floats("selection: scale", self.scale)
        if index.ndim != 1 or scale.shape != index.shape:
            raise ProblemError(f"selection: index {index.shape} and scale {scale.shape} must be one vector each")
        if index.size and index.min() < 0:
            raise ProblemError(f"selection: negative position {index.min()}")
        if not np.all(np.isfinite(scale)) or np.any(scale == 0.0):
            raise ProblemError("selection: every scale must be finite and not zero")
        object.__setattr__(self, "index", index)
        object.__setattr__(self, "scale", scale)

    def __matmul__(self, x: Vec) -> Vec:
        return self.scale * x[self.index]

    def dense(self, n: int) -> Mat:
        """Return the rows as a matrix ``(m, n)``."""
        A = np.zeros((self.index.size, n))
        A[np.arange(self.index.size), self.index] = self.scale
        return A


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """One level: ``lower <= A x - w <= upper`` with slack w; an equality where lower and upper agree.

    A: ``(m, n)`` or a Selection of m variables.  lower, upper: ``(m,)``, infinite where one-sided;
    a row at (-inf, +inf) is left out of this tick and ignored by every solver.  Arrays that are float64
    already are kept, not copied, so that a caller may refill them.
    Raises ProblemError for shapes that disagree, NaN, an infinite entry of A, or lower above upper.
    """

    A: Mat | Selection
    lower: Vec
    upper: Vec

    def __post_init__(self) -> None:
        A = self.A if isinstance(self.A, Selection) else _matrix("rows: A", self.A)
        m = A.index.size if isinstance(A, Selection) else A.shape[0]
        for side in ("lower", "upper"):
            bound = floats(f"rows: {side}", getattr(self, side))
            if bound.shape != (m,):
                raise ProblemError(f"rows: {side} has shape {bound.shape}, A has {m} rows")
            object.__setattr__(self, side, bound)
        object.__setattr__(self, "A", A)
        self.check()

    def check(self) -> None:
        """Raise ProblemError unless the numbers are usable as they stand now."""
        if not isinstance(self.A, Selection) and not np.isfinite(self.A).all():
            raise ProblemError(f"rows: A is not finite in row {int(np.argmin(np.isfinite(self.A).all(axis=1)))}")
        wrong = np.isnan(self.lower) | np.isnan(self.upper) | (self.lower > self.upper)
        wrong |= (self.lower == np.inf) | (self.upper == -np.inf)
        if wrong.any():
            i = int(np.argmax(wrong))
            raise ProblemError(f"rows: need lower <= upper, row {i} has lower {self.lower[i]}, upper {self.upper[i]}")

    @property
    def m(self) -> int:
        """Number of rows."""
        return int(self.lower.shape[0])

    @property
    def equality(self) -> Mask:
        """Mask of rows that are equalities now, ``(m,)``."""
        return np.asarray(self.lower == self.upper)

    def dense(self, n: int) -> Mat:
        """A as a matrix ``(m, n)``; the stored one where it is dense already."""
        return self.A.dense(n) if isinstance(self.A, Selection) else self.A

    def slack(self, x: Vec) -> Vec:
        """w = A x - clip(A x, lower, upper), ``(m,)``: positive above upper, negative below lower."""
        value = self.A @ x
        return np.asarray(value - np.minimum(np.maximum(value, self.lower), self.upper))

    def copy(self) -> Rows:
        """Return a copy with its own arrays."""
        A = Selection(self.A.index.copy(), self.A.scale.copy()) if isinstance(self.A, Selection) else self.A.copy()
        return Rows(A, self.lower.copy(), self.upper.copy())


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """E(x) = 1/2 ||F x - f||^2, the motion that priced levels pay for.

    F: ``(r, n)``, or ``(n,)`` positive numbers for a diagonal matrix.  f: ``(r,)``, zero by default.  E is flat along
    directions that F leaves free.  Arrays that are float64 already are kept, so that a caller may refill them.  Raises
    ProblemError for shapes that disagree, numbers that are not finite, a diagonal that is not positive.
    """

    F: Mat | Vec
    f: Vec | None = None

    def __post_init__(self) -> None:
        F = floats("motion: F", self.F)
        if F.ndim not in (1, 2) or not F.size or not np.isfinite(F).all() or (F.ndim == 1 and not np.all(F > 0.0)):
            allowed = "a finite matrix of at least one row, or a positive vector"
            raise ProblemError(f"motion: F must be {allowed}, given shape {F.shape}")
        object.__setattr__(self, "F", F)
        if self.f is not None:
            f = floats("motion: f", self.f)
            if f.shape != F.shape[:1] or not np.isfinite(f).all():
                raise ProblemError(f"motion: f must be finite with shape {F.shape[:1]}, given {f.shape}")
            object.__setattr__(self, "f", f)

    def __call__(self, x: Vec) -> float:
        """E(x)."""
        moved = self.offset(x)
        return 0.5 * float(moved @ moved)

    def offset(self, x: Vec) -> Vec:
        """F x - f, ``(r,)``."""
        moved = self.F * x if self.F.ndim == 1 else self.F @ x
        return np.asarray(moved if self.f is None else moved - self.f)

    def gradient(self, x: Vec) -> Vec:
        """F' (F x - f), ``(n,)``."""
        moved = self.offset(x)
        return np.asarray(self.F * moved if self.F.ndim == 1 else moved @ self.F)

    def copy(self) -> Motion:
        """Return a copy with its own arrays."""
        return Motion(self.F.copy(), None if self.f is None else self.f.copy())


@dataclass(frozen=True, slots=True)
class Shape:
    """Dimensions of a workspace: n variables, rows a level, which are selections, and the extras.

    priced: one flag per level that may have a price, empty if none has.
    """

    n: int
    rows: tuple[int, ...]
    selections: tuple[bool, ...]
    inequalities: bool = True
    metric: bool = False
    origin: bool = False
    priced: tuple[bool, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Stacked:
    """The dense levels of a hierarchy as slices of one block: A ``(sum m, n)``, lower, upper ``(sum m,)``.

    ``slices[k]`` is level k's place in the block, None for a level stored elsewhere (a Selection).
    """

    A: Mat
    lower: Vec
    upper: Vec
    slices: tuple[slice | None, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Hierarchy:
    """lexmin(||w_0||, ..., ||w_p||) over x, then min (x - origin)' metric (x - origin), ties: least ||x||.

    Directions that a singular metric, the motion and the levels below the constraints do not see have a softer minimum
    (hqp.problem.completion).

    levels: first is most important; the slack norm is the plain 2-norm of the rows as given.  constraints: number of
    leading levels that must hold exactly.  metric: ``(n, n)`` symmetric positive semidefinite, the identity by default.
    origin: ``(n,)``, zero by default.  n: number of variables, needed only if no dense level, metric or origin
    determines it.

    prices: ``(levels,)`` c_k [unit of w / unit of E], 0 for a level without a price.  None: no prices.
    motion: E, 1/2 ||x||^2 by default.  eta: above 0.  turning: ``(levels,)`` t_k, zeros by default.  With them

        x_k = argmin ||w_k|| + c_k E(x) + R_k(x)  where c_k > 0,   argmin 1/2 ||w_k||^2 + R_k(x)  elsewhere,
        R_k(x) = 1/2 sum_a ||A_a (x - x_a)||^2 / (eta ||w_a||) + t_a ||w_a||^2 sum_j d_aj^2 (F (x - x_a))_j^2,

    over the points that the levels above leave; a runs over the priced levels above that are not met, which leave no
    equalities but R (see pricing; docs/calm.md has the reasons).  If all are met, R = 0, and x is the solution without
    prices.  Raises ProblemError for shapes that disagree, n = 0, a metric that is not symmetric positive semidefinite,
    prices or turning that are negative or not finite, an eta that is not positive.
    """

    levels: tuple[Rows, ...]
    constraints: int = 0
    metric: Mat | None = None
    origin: Vec | None = None
    n: int = 0
    stacked: Stacked | None = field(default=None, repr=False)
    prices: Vec | None = None
    motion: Motion | None = None
    eta: float = ETA
    turning: Vec | None = None

    def __str__(self) -> str:
        """Number of variables, and number and kind of rows of each level."""
        lines = [f"hierarchy of {self.n} variables"]
        for k, rows in enumerate(self.levels):
            equal = int(np.sum(rows.equality))
            out = int(np.sum((rows.lower == -np.inf) & (rows.upper == np.inf)))
            counts = {"equalit": equal, "inequalit": rows.m - equal - out}
            counted = [f"{count} {kind}{'y' if count == 1 else 'ies'}" for kind, count in counts.items() if count]
            text = ", ".join([*counted, *([f"{out} left out"] if out else [])]) or "no rows"
            text += " on single variables" if isinstance(rows.A, Selection) else ""
            text += "" if self.prices is None or not self.prices[k] else f", price {self.prices[k]:.3g}"
            lines.append(f"level {k}{', to hold' if k < self.constraints else ''}: {text}")
        return "\n  ".join(lines)

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "levels", tuple(self.levels))
        except TypeError:
            raise ProblemError(f"hierarchy: levels must be a sequence of Rows, given {self.levels!r}") from None
        for name in ("constraints", "n"):
            given = getattr(self, name)
            if isinstance(given, bool) or not isinstance(given, (int, np.integer)):
                raise ProblemError(f"hierarchy: {name} must be a whole number, given {given!r}")
        for k, rows in enumerate(self.levels):
            if not isinstance(rows, Rows):
                raise ProblemError(f"hierarchy: level {k} must be Rows, given {type(rows).__name__}")
        if self.metric is not None:
            object.__setattr__(self, "metric", _matrix("hierarchy: metric", self.metric))
        if self.origin is not None:
            object.__setattr__(self, "origin", floats("hierarchy: origin", self.origin))
            if np.ndim(self.origin) != 1:
                raise ProblemError(f"hierarchy: origin must be a vector, given shape {np.shape(self.origin)}")
        widths = set(self._widths())
        if len(widths) > 1:
            raise ProblemError(f"hierarchy: the levels, metric and origin disagree on n: {sorted(widths)}")
        n = widths.pop() if widths else 0
        if n < 1:
            raise ProblemError("hierarchy: n = 0, allowed 1 and above; give n=... if every level is a Selection")
        object.__setattr__(self, "n", n)
        if self.metric is not None:
            self._check_metric(self.metric, n)
        if self.origin is not None and (self.origin.shape != (n,) or not np.isfinite(self.origin).all()):
            raise ProblemError(f"hierarchy: origin must be finite with shape ({n},)")
        for k, rows in enumerate(self.levels):
            if isinstance(rows.A, Selection) and rows.m and rows.A.index.max() >= n:
                raise ProblemError(f"hierarchy: level {k} selects variable {rows.A.index.max()} of {n}")
        if not 0 <= self.constraints <= len(self.levels):
            raise ProblemError(f"hierarchy: constraints = {self.constraints}, there are {len(self.levels)} levels")
        self._check_prices(n)

    def _check_prices(self, n: int) -> None:
        for name in ("prices", "turning"):
            given = getattr(self, name)
            if given is not None:
                values = floats(f"hierarchy: {name}", given)
                if values.shape != (len(self.levels),) or not np.all(np.isfinite(values) & (values >= 0.0)):
                    raise ProblemError(f"hierarchy: {name} needs one number >= 0 per level, given {given}")
                object.__setattr__(self, name, values)
        if not 0.0 < floats("hierarchy: eta", self.eta) < math.inf:
            raise ProblemError(f"hierarchy: eta must be positive and finite, given {self.eta}")
        if self.motion is not None and not isinstance(self.motion, Motion):
            raise ProblemError(f"hierarchy: motion must be a Motion, given {type(self.motion).__name__}")
        if self.motion is not None and self.motion.F.shape[-1] != n:
            raise ProblemError(f"hierarchy: motion.F has shape {self.motion.F.shape}, the problem has n = {n}")

    @staticmethod
    def _check_metric(metric: Mat, n: int) -> None:
        if metric.shape != (n, n) or not np.isfinite(metric).all():
            raise ProblemError(f"hierarchy: metric must be finite with shape ({n}, {n}), given {metric.shape}")
        size = float(abs(metric).max())
        if abs(metric - metric.T).max() > 1e-9 * size:
            raise ProblemError("hierarchy: metric must be symmetric")
        smallest = float(np.linalg.eigvalsh(metric)[0])
        if smallest < -1e-9 * size:
            raise ProblemError(f"hierarchy: metric must be positive semidefinite, it has the eigenvalue {smallest:.3g}")

    def _widths(self) -> Iterator[int]:
        if self.n:
            yield self.n
        yield from (rows.A.shape[1] for rows in self.levels if not isinstance(rows.A, Selection))
        if self.metric is not None:
            yield self.metric.shape[0]
        if self.origin is not None:
            yield self.origin.shape[0]

    @property
    def shape(self) -> Shape:
        """Dimensions of a workspace for this problem; ``inequalities`` as the bounds stand now."""
        return Shape(
            self.n,
            tuple(rows.m for rows in self.levels),
            tuple(isinstance(rows.A, Selection) for rows in self.levels),
            any(has_inequalities(rows) for rows in self.levels),
            self.metric is not None,
            self.origin is not None,
            self.priced,
        )

    @property
    def priced(self) -> tuple[bool, ...]:
        """Flags of levels with a price, ``()`` if none has one."""
        return () if self.prices is None or not self.prices.any() else tuple(bool(c > 0.0) for c in self.prices)

    def check_prices(self, priced: tuple[bool, ...]) -> None:
        """Raise ProblemError unless the prices, as they stand now, are prices, and of levels that may have one."""
        if self.prices is None:
            return
        for k, price in enumerate(self.prices.tolist()):
            if not 0.0 <= price < math.inf:
                raise ProblemError(f"hierarchy: the price of level {k} must be >= 0, given {price}")
            if price > 0.0 and not (priced and priced[k]):
                raise ProblemError(
                    f"this workspace was made without a price of level {k}, given {price}: make a new one"
                )

    @property
    def readable(self) -> bool:
        """Return true if native code can read every array in place; a copy is readable."""
        return all(map(is_readable, self._arrays()))

    def _arrays(self) -> Iterator[Mat]:
        for rows in self.levels:
            yield from (rows.A.index, rows.A.scale) if isinstance(rows.A, Selection) else (rows.A,)  # type: ignore[misc]
            yield from (rows.lower, rows.upper)
        motion = () if self.motion is None else (self.motion.F, self.motion.f)
        for array in (self.metric, self.origin, self.prices, self.turning, *motion):
            if array is not None:
                yield array

    def exact(self) -> Hierarchy:
        """Return the hierarchy without prices; the arrays are shared."""
        return replace(self, prices=None, motion=None, eta=ETA, turning=None)

    def slacks(self, x: Vec) -> tuple[Vec, ...]:
        """The slack of every level at x, computed in one product where the levels are stored as one block."""
        block = self.stacked
        if block is None:
            return tuple(rows.slack(x) for rows in self.levels)
        value = block.A @ x
        w = value - np.minimum(np.maximum(value, block.lower), block.upper)
        return tuple(
            rows.slack(x) if part is None else w[part] for rows, part in zip(self.levels, block.slices, strict=True)
        )

    def boxed(self, x: Vec) -> Vec:
        """x moved into the bounds of single variables that lead the hierarchy, ``(n,)``."""
        x = x.copy()
        for rows in self.levels[: self.constraints]:
            if isinstance(rows.A, Selection):
                index, scale = rows.A.index, rows.A.scale
                low, high = rows.lower / scale, rows.upper / scale
                x[index] = np.clip(x[index], np.minimum(low, high), np.maximum(low, high))
        return x

    def better(self, x: Vec, last: Vec) -> Vec:
        """Return the lexicographically better of x and ``last``, clipped into the bounds of ``boxed``; x where they
        tie.

        The first level decides whose norms differ by more than VIOLATION_TOLERANCE, relative to 1 + the smaller.
        """
        last = self.boxed(last)
        for new, old in zip(self.slacks(x), self.slacks(last), strict=True):
            now, before = float(np.sqrt(new @ new)), float(np.sqrt(old @ old))
            if not abs(now - before) <= VIOLATION_TOLERANCE * (1.0 + min(now, before)):
                return x if now < before else last
        return x

    def copy(self) -> Hierarchy:
        """Return a copy with its own arrays, free of any session's buffers."""
        return replace(
            self,
            levels=tuple(rows.copy() for rows in self.levels),
            metric=None if self.metric is None else self.metric.copy(),
            origin=None if self.origin is None else self.origin.copy(),
            stacked=None,
            prices=None if self.prices is None else self.prices.copy(),
            motion=None if self.motion is None else self.motion.copy(),
            turning=None if self.turning is None else self.turning.copy(),
        )


class Status(enum.Enum):
    """Status of a solve or a tick; each member names a likely cause and a remedy, later members are worse."""

    OPTIMAL = "solved: each level has the least violation that the levels above and its price on motion allow"
    RANK_UNCERTAIN = (
        "solved, but a pivot is near the rank tolerance, so a small change of the data may change the solution much: "
        "set a price on the level, or move the target away from singular directions"
    )
    NOT_STRICT = (
        "the solver does not separate priority levels: lower levels may move higher ones; "
        "use a strict solver, such as 'lexicographic'"
    )
    CONSTRAINTS_VIOLATED = (
        "subject_to is infeasible, this is its least violation: the notes name rows and amounts, "
        "tick.conflict() names the rows that exclude each other"
    )
    INVALID_REFERENCE = (
        "a reference was not finite: a member of subject_to used its hold value, any other element was left "
        "out of this tick; check the source of the reference that the note names"
    )
    INVALID_ELEMENT = (
        "the rows of an element were not usable (not finite, too large, crossed bounds, a wrong shape, an exception): "
        "it was left out of this tick; correct the element that the note names"
    )
    CONTACT_LOST = (
        "a contact of the stack carries no load by its measurement: the forces computed for it will not appear; "
        "change the stack"
    )
    ITERATION_LIMIT = (
        "the iteration limit is reached, this is the best point so far: raise max_iterations, or look for constraints "
        "that nearly exclude each other"
    )
    TIME_LIMIT = "the deadline is reached, this is the best point so far: raise the deadline, or use fewer rows"
    NOT_CERTIFIED = (
        "the solver could not certify its solution to the required accuracy, levels may not be optimal: try another "
        "solver, and report it if the solver was 'lexicographic'"
    )
    DYNAMICS_FAILED = (
        "the dynamics of this state could not be solved: the joint-space inertia is not positive definite or a "
        "result is not finite; check the state and the model's masses and inertias"
    )
    NOT_FOLLOWING = (
        "the measured joints do not do what they were sent: a frozen sensor, a blocked joint, or joints in another "
        "order; the command comes to rest; check the joint that the note names"
    )
    INVALID_STATE = (
        "the state was not usable (not finite, too large, too old, or a quaternion not of length one): the command "
        "comes to rest; check the sensor or estimate that the note names"
    )
    STOPPED = (
        "a stop was asked for, or no answer was usable for longer than Braking(after=): the command comes to rest and "
        "holds; clear the cause that the note names, then call resume()"
    )

    @property
    def cut(self) -> bool:
        """True if the search was stopped: x is the better of its point and of the last answer."""
        return self in (Status.ITERATION_LIMIT, Status.TIME_LIMIT)

    @property
    def severity(self) -> int:
        """Rank among the members, 0 is best."""
        return _SEVERITY[self]

    @property
    def solved(self) -> bool:
        """True if the solution is the problem's optimum (its constraints may still be violated)."""
        return self in _SOLVED

    @property
    def usable(self) -> bool:
        """True if the solution may be sent and become the safe command of a session."""
        return self.severity < _SEVERITY[Status.NOT_CERTIFIED]

    @staticmethod
    def worst(*statuses: Status) -> Status:
        """Return the most severe of the given statuses, OPTIMAL for no argument."""
        return max(statuses, key=lambda s: s.severity, default=Status.OPTIMAL)


_SEVERITY = {status: rank for rank, status in enumerate(Status)}
_SOLVED = frozenset((Status.OPTIMAL, Status.RANK_UNCERTAIN, Status.CONSTRAINTS_VIOLATED))


@dataclass(frozen=True, slots=True)
class Stats:
    """Effort of one solve: counts, and seconds [s] spent on building and solving the back end problem."""

    iterations: int = 0
    factorisations: int = 0
    build_s: float = 0.0
    solve_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Result of a solver; owns its arrays.

    x: ``(n,)``.  residuals: the slack w_k of each level, ``(m_k,)``, computed from (problem, x).  active: per level
    ``(m_k,)`` int8, -1 at or below lower, +1 at or above upper, 0 free, 2 equality.  multipliers: if requested from the
    solver, per level k ``(m_0 + ... + m_k,)`` with sum_j A_j' lambda_kj = 0, lambda_kk = w_k, lambda_kj >= 0 at upper
    and <= 0 at lower sides.  stage_points: ``(levels, n)``, the optimum x_k of each level in its own stage (NaN
    without a stage: a priced level met for its price by x, another with no unmet level above), None without prices.
    """

    x: Vec
    status: Status
    residuals: tuple[Vec, ...]
    active: tuple[Signs, ...]
    stats: Stats = Stats()
    detail: str = ""
    multipliers: tuple[Vec, ...] | None = None
    stage_points: Mat | None = None

    def unwrap(self, problem: Hierarchy | None = None) -> Vec:
        """x if the status is ``solved``; raises NotSolved with a copy of the problem otherwise."""
        if not self.status.solved:
            text = f"{self.status.name}: {self.status.value}" + (f" ({self.detail})" if self.detail else "")
            raise NotSolved(text, None if problem is None else problem.copy())
        return self.x

    @property
    def norms(self) -> Vec:
        """||w_k|| of each level."""
        return np.array([float(np.sqrt(w @ w)) for w in self.residuals])

    def __str__(self) -> str:
        """Status, ||w_k|| of each level, and the solver's detail."""
        norms = ", ".join(f"{norm:.3g}" for norm in self.norms)
        return f"{self.status.name}; ||w|| {norms}" + (f"; {self.detail}" if self.detail else "")


def has_inequalities(rows: Rows) -> bool:
    """Return true if any row is an inequality that is not left out."""
    return bool(np.any((rows.lower != rows.upper) & ((rows.lower > -np.inf) | (rows.upper < np.inf))))


def _matrix(what: str, given: object) -> Mat:
    A = floats(what, given)
    if A.ndim != 2:
        raise ProblemError(f"{what}: a matrix must have two dimensions, given shape {A.shape}")
    return A
