"""Sessions from a file, and what every session lets in and out (built from cpp/session)."""

import builtins
from collections.abc import Callable, Sequence

from numpy import int32
from numpy.typing import NDArray

from hqp.arrays import Mat, Vec

class PlanError(Exception):
    """The file is no plan of this version."""

class ReferenceError(ValueError):
    """A reference that does not fit."""

class Session:
    """A session of the bytes of a file; raises PlanError with a sentence."""

    nq: int
    nv: int
    dt: float
    robot: str
    names: Sequence[str]
    joint_names: Sequence[str]
    home: Sequence[float]
    sizes: tuple[int, int, int]
    """Numbers of a command, of x, and levels."""

    def __init__(self, file: bytes) -> None: ...
    def step(
        self, q: Vec, v: Vec, command: Vec, x: Vec, residuals: Vec, time: float | None, now: float
    ) -> tuple[int, int, list[tuple[str, int, str]]]:
        """One tick into command, x and residuals: its status, how long it has been held, its notes.

        time, now: of the state, None where it does not tell, and of the tick [s].
        """

    def tell(self, reference: int, what: int, values: Vec) -> None:
        """What the next step is told: 0 a value, 1 velocity, 2 acceleration, 3 normal, 4 load; 5 a hold value."""

    def say(self, reference: int, present: bool) -> None:
        """Whether an element is in, in the next step."""

    def phase(self, name: str) -> None:
        """The phase of the steps from now on, "" for none."""

    def held(self, reference: int) -> Sequence[float]:
        """The hold value."""

    def integrate(self, q: Vec, v: Vec, dt: float, out: Vec) -> None:
        """q after moving with v for dt [s]."""

    def reset(self) -> None:
        """As just made."""

class StateBounds:
    """Magnitudes beyond which a state is a fault of its source, ``(nv,)`` each; names of the coordinates."""

    def __init__(
        self,
        low: Sequence[float],
        high: Sequence[float],
        speed: Sequence[float],
        distance: float,
        floating: bool,
        names: Sequence[str],
    ) -> None: ...
    def fault(self, angles: Vec, q: Vec, v: Vec) -> str:
        """Which number is too large; "" for none."""

class StateAge:
    """How old a state may be [s]."""

    def __init__(self, most: float) -> None: ...
    def fault(self, time: float | None, now: float) -> str:
        """What is wrong with a state of that time; "" for nothing."""

class RateLimiter:
    """Holds the change of a command within a rate; inverse: one over the largest change in a tick."""

    inverse: Sequence[float]

    def __init__(self, names: Sequence[str], inverse: Sequence[float], dt: float) -> None: ...
    def share(self, last: Vec, command: Vec) -> tuple[float, str]:
        """How far towards a command one tick may go, 0 to 1, and why not all the way."""

class ContactWatch:
    """Counts the ticks for which each contact has carried next to nothing, by the loads given for it."""

    LEAST_LOAD: float
    names: Sequence[str]
    missing: bool
    """Whether there is one that carried nothing when last measured."""

    def __init__(self, names: Sequence[str], dt: float) -> None: ...
    def measure(self, name: str, load: float) -> bool:
        """Take a load [N]; whether the name is that of a contact."""

    def judge(self, out: frozenset[str]) -> None:
        """Contacts that are out of the tick are not judged: nothing assumes them."""

    def lost(self) -> Sequence[tuple[str, str]]:
        """Names of contacts that are not there, with what was measured."""

class LimitWatch:
    """Counts how often each limit of a joint binds on the one side and then on the other, by the marks of its rows."""

    SPAN: float
    """Alternations are counted over this time, in the mean [s]."""
    OFTEN: float
    """Alternations a second from which on a joint is restless."""
    busy: bool
    """Whether a rate has still to fade, or bounds meet."""
    meet: bool
    """Whether the bounds of a joint meet: its limits are outside the window of what it can do."""

    def __init__(self, parts: Sequence[tuple[int, int]], names: Sequence[str], dt: float) -> None: ...
    def look(self, record: bytearray, begin: int, tick: int) -> Sequence[tuple[str, str]]:
        """Names of limits that alternate, with how often, by the marks of all rows from ``begin`` on; needed where
        they changed, or busy."""

    @staticmethod
    def passed(over: float, unit: str) -> str:
        """By how much a joint that comes to rest so far beyond its position limit passes it; "" for not at all."""

def violation(w: Vec, lower: Vec, upper: Vec, tolerance: float, limit: str, row_names: Callable[[], object]) -> str:
    """By how much an element's slacks are off, by the limit of that name, and which rows, worst first; "" for none."""

class Budget:
    """The time of a tick: what a solver is given, so that what comes after it is done by the deadline [s]."""

    LATE: float
    STEP: float
    FIRST: float
    LONGEST: float
    deadline: float
    margin: float

    def __init__(self, deadline: float) -> None: ...
    def begin(self, now: float) -> None:
        """A tick begins that may be cut; now: CPU time of the thread."""

    def skip(self) -> None:
        """The tick that ends next was not measured from its begin."""

    def left(self, spent: float) -> float:
        """Time for the solver, after so much of the tick."""

    def end(self, now: float, cut: bool) -> None:
        """The tick ends; cut: its solver was stopped."""

class Trend:
    """How the answers of a session move, from the last two that were solved."""

    LONGEST: int

    def __init__(self, n: int) -> None: ...
    def forget(self) -> None:
        """What was solved before tells nothing of what comes."""

    def take(self, x: Vec, tick: int) -> None:
        """A solved answer, and the number of its tick."""

    def after(self, last: Vec, tick: int, to: Vec) -> None:
        """Where the last x comes to in this tick; the last x itself where no two answers are known."""

def late(
    hierarchy: object, cut: Vec, last: Vec, ahead: Vec, joints: Sequence[int], most: float, violation: float, x: Vec
) -> None:
    """What is sent in place of an answer that was cut, into x."""

class Rest:
    """Answers that bring a robot to rest."""

    def begin(
        self, angles: Vec | None, v: Vec | None, holding: Vec | None, felt: Vec | None, x: Vec, now: bool
    ) -> None:
        """From the last good state, None where there was none, and the last x."""

    def next(self, x: Vec) -> None:
        """The next answer, into x."""

class SlowDown(Rest):
    """Velocity level."""

    def __init__(
        self, low: Sequence[float], high: Sequence[float], joints: Sequence[int], deceleration: float, dt: float
    ) -> None: ...

class Brake(Rest):
    """Acceleration level."""

    def __init__(self, nv: int, joints: Sequence[int], deceleration: float, dt: float) -> None: ...

class Hold(Rest):
    """Torque level."""

    def __init__(self, limit: Sequence[float], motors: Sequence[int], damping: float, dt: float) -> None: ...

class Batch:
    """Worlds of the bytes of a file over threads; raises PlanError with a sentence."""

    sizes: tuple[int, int, int]
    """Numbers of a command, of x, and levels."""
    state: tuple[int, int]
    """nq and nv."""
    threads: int
    bytes: int

    def __init__(self, file: builtins.bytes, count: int, threads: int) -> None: ...
    def step(
        self,
        q: Mat,
        v: Mat,
        targets: Sequence[tuple[str, int, Mat]],
        commands: Mat,
        status: NDArray[int32],
        residuals: Mat,
        x: Mat,
    ) -> None:
        """One tick of all worlds, without the lock of the interpreter."""

    def reset(self, world: int) -> None:
        """As just made."""
