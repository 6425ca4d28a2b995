"""Sessions from a file, and the checks of states and commands of every session (built from cpp/session)."""

import builtins
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from numpy import int32
from numpy.typing import NDArray

from hqp.arrays import Mat, Vec
from hqp.declare.reference import Reference

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
    fingerprint: str
    names: Sequence[str]
    joint_names: Sequence[str]
    home: Sequence[float]
    sizes: tuple[int, int, int]
    """Numbers of a command, of x, and levels."""
    counters: tuple[int, int, int, int, int, int, float, float]
    """As hqp.explanation.counters.Counters."""
    heartbeat: int

    def __init__(self, file: bytes, key: bytes) -> None: ...
    def step(
        self, q: Vec, v: Vec, command: Vec, x: Vec, residuals: Vec, time: float | None, now: float
    ) -> tuple[int, int, list[tuple[str, int, str]]]:
        """One tick into command, x and residuals: its status, how long it has been held, its notes.

        time, now: of the state, None where it does not tell, and of the tick [s].
        """

    stopped: str
    """The reason of the stop, "" while the session runs."""

    def stop(self, reason: str) -> None:
        """Come to rest and hold until ``resume``; any thread may call both."""

    def resume(self) -> None:
        """End a stop."""

    def begin(self, command: Vec, q: Vec | None, v: Vec | None) -> None:
        """Start from the command that is sent now; q, v: the state, None if unknown."""

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

class Live:
    """A session over the arrays of a program: the tree of ``hqp.loop.document.live_tree``, with its callbacks.

    good: whether a command was sent, by an answer or as ``begin`` says.  start: the x that rates of the first tick
    start from.  held: for how many ticks the command has been coming to rest.
    """

    good: bool
    start: list[float]
    held: int
    deadline: float
    margin: float
    counters: tuple[int, int, int, int, int, int, float, float]
    heartbeat: int

    def __init__(self, tree: Mapping[str, Any]) -> None: ...
    def tell(self, references: tuple[Reference, ...]) -> int:
        """Give the next step references: -1, or the place of the first one that does not fit, of which none is kept."""

    def aim(self, targets: dict[str, Any]) -> bool:
        """Give it targets by name that are taken unchanged; False for one that is not."""

    stopped: str
    """The reason of the stop, "" while the session runs."""

    def stop(self, reason: str) -> None:
        """Come to rest and hold until ``resume``, in all lines of a session; any thread may call both."""

    def resume(self) -> None:
        """End a stop."""

    def begin(self, command: Vec, q: Vec | None, v: Vec | None, angles: Vec | None) -> bytearray:
        """Start from the command that is sent now; its record.  q, v, angles: of the state, None if unknown."""

    def ask(self) -> None:
        """All rows of the next step are filled in Python."""

    def phase(self, name: str) -> None:
        """The phase of the steps from now on, "" for none."""

    def step(
        self, q: Vec, v: Vec, time: float | None, now: float, angles: Vec | None, fault: str | None
    ) -> bytearray | tuple[bytearray, int, int, list[tuple[str, int, str]], int]:
        """One tick: its record (``hqp.loop.record``); with status, ticks held, notes and how many of these are not on
        limits of joints where it is not simply optimal.

        time, now: of the state, None where it does not tell, and of the tick [s].  angles: of q where native kinematics
        do not know all joints.  fault: why the state is not valid, None where that is to be found.
        """

    def follow(self, other: Live) -> None:
        """Go on with what another session sent last."""

    def keep_hold(self, name: str, value: Vec) -> None:
        """Hold an element at this value, flat, until it is out."""

    def holds(self) -> dict[str, list[float]]:
        """Hold values, flat, by name."""

    def too_large(self, q: Vec, v: Vec, angles: Vec) -> str:
        """Which number of a valid state is too large; "" for none."""

class Transition:
    """From one session to another without a jump: hqp/cpp/session/transition.hpp.

    depth: how many transitions are under way, this one included.  progress: 0 at the start, 1 at the end.
    """

    depth: int
    progress: float

    def __init__(
        self,
        sessions: Sequence[Live],
        way: Mapping[str, Any],
        ticks: float,
        under_way: Transition | None,
        owner: object,
    ) -> None:
        """sessions: of the stacks on the way.  way: of ``hqp.loop.transition.way``.  under_way: to the first one.
        owner: has this object and the sessions; its begins, before, after and sent are called in a tick."""

    def measure(self, name: str, load: float) -> None:
        """Load that a contact was measured to bear in the next tick [N]."""

    def step(self, q: Vec, v: Vec, time: float | None, now: float, angles: Vec | None, fault: str | None) -> None:
        """One tick of both stacks of the pair; arguments as of ``Live.step``."""

    def end(self) -> None:
        """Let the last session go on alone from what was sent."""

    def pass_on(self, session: Live) -> None:
        """Let another session go on alone from what was sent."""

    def begin(self) -> None:
        """Start from the command that all sessions have begun with."""

class RateLimiter:
    """Holds the change of a command within a limit of that name; inverse: one over the largest change in a tick."""

    inverse: Sequence[float]

    def __init__(self, joints: Sequence[str], inverse: Sequence[float], dt: float, name: str) -> None: ...

class ContactWatch:
    """Counts the ticks for which each contact has carried next to nothing, by the loads given for it."""

    LEAST_LOAD: float

    def __init__(self, names: Sequence[str], dt: float) -> None: ...

class LimitWatch:
    """Counts how often each limit of a joint binds on the one side and then on the other, by the marks of its rows."""

    SPAN: float
    """Alternations are counted over this time, in the mean [s]."""
    OFTEN: float
    """Alternations a second from which on a joint is restless."""

    def __init__(self, parts: Sequence[tuple[int, int]], names: Sequence[str], dt: float) -> None: ...
    def look(self, record: bytearray, begin: int, tick: int) -> list[tuple[str, int, str]]:
        """Notes on limits that alternate, with how often, by the marks of all rows from ``begin`` on; needed where
        they changed, or busy."""

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

class Rest:
    """Answers that bring a robot to rest."""

class Brake(Rest):
    """Acceleration level."""

    def __init__(self, nv: int, joints: Sequence[int], deceleration: float, dt: float) -> None: ...

class Outgoing:
    """What is sent of the answers to a hierarchy: notes of element, number of a status and text.

    before: the x that was sent last, whether an answer was usable before, and the number of the tick.
    """

    LONGEST: int
    """After so many ticks that were cut the answers before tell little of what comes."""

    def __init__(
        self,
        hierarchy: object,
        parts: Sequence[tuple[str, int, int, int, Sequence[str]]],
        motors: Sequence[int],
        most: float,
        violation: float,
        sentences: Sequence[str],
    ) -> None:
        """parts: of elements of subject_to, name, level, first and last row in it and their names.  motors: their
        places in x.  most: by how much one may change in a tick towards an answer that was cut.  violation:
        VIOLATION_TOLERANCE.  sentences: on each status."""

    def take(
        self,
        answer: tuple[int, Vec, Vec, str],
        before: tuple[Vec, bool, int],
        rest: Rest,
        start: Callable[[], tuple[Vec, Vec, Vec | None, Vec | None] | None],
        contacts: ContactWatch,
        limiter: RateLimiter | None,
        x: Vec,
    ) -> tuple[bool, list[tuple[str, int, str]]]:
        """The answer of a solver, or what is sent in its place, into x; whether it is usable.

        answer: number of its status, x, slacks of all rows, of no account where it is OPTIMAL, and detail.  rest,
        start: as below, of this state.
        """

    def rest(
        self,
        rest: Rest,
        start: Callable[[], tuple[Vec, Vec, Vec | None, Vec | None] | None],
        fit: bool,
        held: int,
        why: int,
        before: tuple[Vec, bool, int],
        limiter: RateLimiter | None,
        x: Vec,
    ) -> list[tuple[str, int, str]]:
        """The next x towards rest.  start: angles, v, holding and felt of this state, if it is fit, or of the last good
        one.  held: for how many ticks by now.  why: the status of the tick."""

    def solved(self, x: Vec, tick: int) -> None:
        """A solved answer that was sent in the tick of that number."""

class Batch:
    """Worlds of the bytes of a file over threads; raises PlanError with a sentence."""

    sizes: tuple[int, int, int]
    """Numbers of a command, of x, and levels."""
    state: tuple[int, int]
    """nq and nv."""
    threads: int
    bytes: int
    kind: str
    """velocity, acceleration or torque: what a command is."""
    counters: tuple[int, int, int, int, int, int, float, float]

    def __init__(self, file: builtins.bytes, count: int, threads: int, key: builtins.bytes) -> None: ...
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

    def integrate(self, q: Mat, v: Mat, dt: float, out: Mat) -> None:
        """q after moving with v for dt [s], of all worlds."""

    def stop(self, world: int, reason: str) -> None:
        """Come to rest and hold until ``resume``."""

    def resume(self, world: int) -> None:
        """End a stop."""

    def begin(self, world: int, command: Vec, q: Vec | None, v: Vec | None) -> None:
        """Start from the command that is sent now; q, v: the state, None if unknown."""

    def reset(self, world: int) -> None:
        """As just made."""
