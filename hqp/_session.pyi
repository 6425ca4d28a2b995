"""Sessions from a file, and checks of states and commands for every session (built from cpp/session)."""

import builtins
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from numpy import int32, uint8
from numpy.typing import NDArray

from hqp.arrays import Mat, Vec
from hqp.declare.reference import Reference

_Two: TypeAlias = tuple[float, float]
_Velocity: TypeAlias = tuple[float, float, float]
_Four: TypeAlias = tuple[float, float, float, float]
_Six: TypeAlias = tuple[float, float, float, float, float, float]
_Place: TypeAlias = tuple[int, float, float, float, float]

class PlanError(Exception):
    """Raised for a file that is no plan of this version."""

class ReferenceError(ValueError):
    """Raised for a reference that does not fit."""

class Session:
    """Session from the bytes of a file; raises PlanError with the reason."""

    nq: int
    nv: int
    dt: float
    robot: str
    fingerprint: str
    names: Sequence[str]
    joint_names: Sequence[str]
    home: Sequence[float]
    sizes: tuple[int, int, int]
    """Lengths of command and x, and number of levels."""
    counters: tuple[int, int, int, int, int, int, float, float]
    """Counters in the order of hqp.explanation.counters.Counters."""
    heartbeat: int
    stacks: Sequence[str]
    """Names of the stacks, "" for the first one."""
    transition: float
    """How far a change of stack has come."""

    def __init__(self, file: bytes, key: bytes) -> None: ...
    def change(self, stack: str, over: float) -> None:
        """Switch to a stack, at once or within ``over`` seconds at least."""

    def step(
        self, q: Vec, v: Vec, command: Vec, x: Vec, residuals: Vec, time: float | None, now: float
    ) -> tuple[int, int, list[tuple[str, int, str]], int]:
        """Run a tick into command, x and residuals; return status, ticks held, notes, and the number of levels.

        time, now: measurement time of the state, None if unknown, and time of the tick [s].
        """

    stopped: str
    """Reason of the stop, "" while the session runs."""

    def stop(self, reason: str) -> None:
        """Come to rest and hold until ``resume``; any thread may call both."""

    def resume(self) -> None:
        """End a stop."""

    def begin(self, command: Vec, q: Vec | None, v: Vec | None) -> None:
        """Start from the present command; q, v: the state, None if unknown."""

    def set_reference(self, reference: int, what: int, values: Vec) -> None:
        """Set a reference of the next step: 0 value, 1 velocity, 2 acceleration, 3 normal, 4 load; 5 hold value."""

    def say(self, reference: int, present: bool) -> None:
        """Switch an element on or off in the next step."""

    def phase(self, name: str) -> None:
        """Set the phase of the following steps, "" for none."""

    def held(self, reference: int) -> Sequence[float]:
        """Return the hold value of an element."""

    def integrate(self, q: Vec, v: Vec, dt: float, out: Vec) -> None:
        """Write q after motion with v for dt [s] to out."""

    def reset(self) -> None:
        """Return to the initial state."""

class Live:
    """Session over the arrays of a program: the tree of ``hqp.loop.document.live_tree``, with its callbacks.

    good: true after a command by an answer or by ``begin``.  start: the x from which rates of the first tick count.
    held: ticks for which the command has been coming to rest.
    """

    good: bool
    start: list[float]
    held: int
    deadline: float
    margin: float
    counters: tuple[int, int, int, int, int, int, float, float]
    heartbeat: int

    def __init__(self, tree: Mapping[str, Any]) -> None: ...
    def take_references(self, references: tuple[Reference, ...]) -> int:
        """Set references of the next step; return -1, or the index of the first one that does not fit, and keep none
        then."""

    def aim(self, targets: dict[str, Any]) -> bool:
        """Set targets by name that need no conversion; return false if one does."""

    stopped: str
    """Reason of the stop, "" while the session runs."""

    def stop(self, reason: str) -> None:
        """Come to rest and hold until ``resume``, in all lines of a session; any thread may call both."""

    def resume(self) -> None:
        """End a stop."""

    def begin(self, command: Vec, q: Vec | None, v: Vec | None, angles: Vec | None) -> bytearray:
        """Start from the present command and return its record.  q, v, angles: the state, None if unknown."""

    def ask(self) -> None:
        """Fill all rows of the next step in Python."""

    def phase(self, name: str) -> None:
        """Set the phase of the following steps, "" for none."""

    def step(
        self, q: Vec, v: Vec, time: float | None, now: float, angles: Vec | None, fault: str | None
    ) -> bytearray | tuple[bytearray, int, int, list[tuple[str, int, str]], int]:
        """Run a tick and return its record (``hqp.loop.tick``); unless plainly optimal, also status, ticks held,
        notes, and the number of notes that do not concern limits of joints.

        time, now: measurement time of the state, None if unknown, and time of the tick [s].  angles: angles of q if
        native kinematics lack a joint.  fault: reason of an invalid state, None to check it here.
        """

    def follow(self, other: Live) -> None:
        """Continue from the last command of another session."""

    def keep_hold(self, name: str, value: Vec) -> None:
        """Hold an element at this flat value until it is switched off."""

    def holds(self) -> dict[str, list[float]]:
        """Return hold values, flat, by name."""

    def acceleration(self, torques: Vec, found: Vec) -> None:
        """Write the acceleration of each coordinate under these torques, by the dynamics of the latest tick."""

    def weigh(self, heavier: float) -> None:
        """Multiply the masses of the robot's links by this from the next tick on; loads stay."""

    def too_large(self, q: Vec, v: Vec, angles: Vec) -> str:
        """Name the number of a valid state that is too large; "" for none."""

class Transition:
    """Transition from one session to another without a jump: hqp/cpp/session/transition.hpp.

    depth: number of transitions under way, this one included, at most DEEPEST.  progress: 0 at the start, 1 at the end.
    """

    DEEPEST: int
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
        """sessions: one for each stack on the path.  way: result of ``hqp.loop.way``.  under_way: transition
        to the first session.  owner: owner of this object and the sessions; each tick calls its begins, before, after
        and sent."""

    def measure(self, name: str, load: float) -> None:
        """Set the measured load of a contact in the next tick [N]."""

    def step(self, q: Vec, v: Vec, time: float | None, now: float, angles: Vec | None, fault: str | None) -> None:
        """Run a tick of both stacks of the pair; arguments as in ``Live.step``."""

    def end(self) -> None:
        """Let the last session continue alone from the last command."""

    def pass_on(self, session: Live) -> None:
        """Let another session continue alone from the last command."""

    def begin(self) -> None:
        """Start from the command of the sessions' own ``begin``."""

class LimitWatch:
    """Counter of alternations of each joint limit between its two sides, by the marks of its rows."""

    SPAN: float
    """Time constant of the mean number of alternations [s]."""
    OFTEN: float
    """Alternations per second above which a joint is restless."""

    def __init__(self, parts: Sequence[tuple[int, int]], names: Sequence[str], dt: float) -> None: ...
    def look(self, record: bytearray, begin: int, tick: int) -> list[tuple[str, int, str]]:
        """Return notes on alternating limits with their rates, by the marks of all rows from ``begin`` on; call it if
        marks changed, or while busy."""

class Budget:
    """Time budget of a tick: the solver's share, so that the work after it ends by the deadline [s]."""

    LATE: float
    STEP: float
    FIRST: float
    LONGEST: float
    deadline: float
    margin: float

    def __init__(self, deadline: float) -> None: ...
    def begin(self, now: float) -> None:
        """Begin a tick that may be cut; now: CPU time of the thread."""

    def skip(self) -> None:
        """Exclude the next end from the measurement: its begin was not measured."""

    def left(self, spent: float) -> float:
        """Return the time left for the solver after ``spent`` [s] of the tick."""

    def end(self, now: float, cut: bool) -> None:
        """End the tick; cut: the solver was stopped."""

class CutAnswers:
    """Commands in place of answers to a hierarchy that the deadline has cut; for tests."""

    LONGEST: int
    """Ticks after which the answers before are no longer extrapolated."""

    def __init__(
        self,
        hierarchy: object,
        motors: Sequence[int],
        most: float,
        violation: float,
        sentences: Sequence[str],
        dt: float,
    ) -> None:
        """motors: their indices in x.  most: largest change of one in a tick towards a cut answer.  violation:
        VIOLATION_TOLERANCE.  sentences: one per status."""

    def instead(self, cut: Vec, last: Vec, tick: int, x: Vec) -> list[tuple[str, int, str]]:
        """Write the command in place of a cut answer into x; return notes.  last: x sent before."""

    def solved(self, x: Vec, tick: int) -> None:
        """Take a solved answer, sent in the tick of that number."""

    def rest(self, last: Vec, tick: int, x: Vec) -> None:
        """Write the first command towards rest into x."""

class Batch:
    """Worlds from the bytes of a file over threads; raises PlanError with the reason."""

    sizes: tuple[int, int, int]
    """Lengths of command and x, and number of levels."""
    state: tuple[int, int]
    """nq and nv."""
    threads: int
    bytes: int
    kind: str
    """Kind of the command: velocity, acceleration or torque."""
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
        noted: bool,
    ) -> list[list[tuple[str, int, str]]]:
        """Run a tick of all worlds, without the interpreter lock; return the notes of each if they are wanted."""

    def integrate(self, q: Mat, v: Mat, dt: float, out: Mat) -> None:
        """Write q after motion with v for dt [s] to out, for all worlds."""

    def change(self, world: int, stack: str, over: float) -> None:
        """Switch to a stack, at once or within ``over`` seconds at least."""

    def stop(self, world: int, reason: str) -> None:
        """Come to rest and hold until ``resume``."""

    def resume(self, world: int) -> None:
        """End a stop."""

    def begin(self, world: int, command: Vec, q: Vec | None, v: Vec | None) -> None:
        """Start from the present command; q, v: the state, None if unknown."""

    def reset(self, world: int) -> None:
        """Return to the initial state."""

QUICK: float
"""Shortest step time as a share of the gait's."""
COMFORT: float
"""Share of the reach above which steps become quicker instead of longer."""
TURNS: float
"""Largest change of the turning rate from step to step [rad/s]."""

def next_foothold(period: float, width: float, reach: _Four, stance: _Place, command: _Velocity) -> _Place:
    """Return the next foothold, see ``Footsteps.next``."""

def within_reach(reach: _Four, foothold: _Place, stance: _Place) -> _Place:
    """Return the nearest foothold within reach, see ``Footsteps.within``."""

def adjusted(
    stance: _Place,
    planned: _Place,
    offset: _Two,
    left: float,
    period: float,
    reach: _Four,
    error: _Two,
    ankle: _Two,
    omega: float,
    now: _Two,
    bounds: tuple[float, float, float, float, float],
) -> tuple[_Place, float]:
    """Return foothold and time left after a push, see ``walking.adjust``; bounds: soonest, latest, usual, speed,
    least."""

class Ability:
    """Limits of a walk, see ``walking.preview``."""

    change: float

    def __init__(self, gait: _Six, reach: _Four, width: float, height: float, gravity: float) -> None: ...
    def allowed(self, requested: _Velocity) -> tuple[_Velocity, list[str]]:
        """Return the nearest command that steps follow, and the reasons of its changes."""

    def paced(self, now: _Velocity, requested: _Velocity) -> _Velocity:
        """Return the velocity of the next step."""

    def paces(self, now: _Velocity, requested: _Velocity, most: int) -> list[_Velocity]:
        """Return the velocities of the steps until the command is met."""

    def haste(self, pace: _Velocity) -> float:
        """Return the time of a step at a velocity, a share of that of the gait."""

class DcmPlan:
    """ZMP and DCM, see ``walking.DcmPlan``."""

    duration: float

    def __init__(self, pieces: Sequence[tuple[float, Sequence[float], Sequence[float]]], omega: float) -> None: ...
    def at(self, time: float) -> tuple[_Two, _Two]:
        """Return ZMP and DCM."""

class Swing:
    """Path of a foot in the air, see ``walking.Swing``."""

    RISE: float
    LEAD: float
    FOLLOWS: float
    SINKS: float
    FALLS: float
    left: float
    soonest: float
    duration: float
    time: float
    x: list[float]
    v: list[float]
    a: list[float]
    goal: list[float]

    def __init__(
        self, start: Sequence[float], goal: Sequence[float], duration: float, height: float, search: float, depth: float
    ) -> None: ...
    def step(self, dt: float) -> None:
        """One tick on."""

    def retarget(self, goal: Sequence[float], fastest: float, dt: float) -> None:
        """Move the goal towards another one."""

    def clear(self, z: float) -> bool:
        """Rise again, to the swing's height above z."""

class WalkState:
    """Numbers of a walker between two ticks; phase: 0 stand, 1 shift, 2 swing."""

    phase: int
    stance: int
    entered: bool
    walking: bool
    started: bool
    edge: bool
    stepped: bool
    wait: float
    command: _Velocity
    pace: _Velocity
    holds: tuple[_Place, _Place]
    nominal: _Place
    target: _Place
    planned: tuple[_Place, _Place, _Two, float]
    swing: Swing
    t: float
    duration: float
    since: float
    time: float
    z: float
    raised: float
    share: float
    yaw: float
    felt: float
    due: float
    heavier: float
    sunk: _Two
    zmp: _Two
    sum: _Two
    capture_point: _Two

class Walker:
    """Phases and references of a walk, see ``walking.Walker``."""

    TOUCH: float
    EARLY: float
    LATE: float
    FADE: float
    SLEW: float
    TAKE: float
    AHEAD: float
    CORRECTION: float
    CREEPS: float
    LAST: float
    HEAVIER: float
    WEIGHING: float
    SETTLES: float
    UNFELT: float
    SAG: float
    NOISE: float
    state: WalkState
    why: list[str]
    ahead: list[_Place]
    stands: bool
    support: str
    stopping_time: float
    pieces: list[tuple[float, _Two, _Two]]
    height: float
    share: float
    balance: Vec
    swing: Vec
    swing_velocity: Vec
    swing_acceleration: Vec
    trunk: Vec
    normals: tuple[Vec, Vec]

    def __init__(self, tree: object) -> None: ...
    def go(self, velocity: _Velocity) -> None:
        """Walk at the nearest velocity that steps follow."""

    def follow(self, footholds: Sequence[_Place]) -> None:
        """Step on footholds in turn."""

    def refuse(self, reason: str) -> None:
        """Stand, because the session is stopped."""

    def stop(self) -> None:
        """Come to stand, over as many steps as it takes."""

    def step(self, q: Vec, v: Vec, loads: Vec | None) -> None:
        """Compute the references for a state."""

    def step_on(
        self, com: Sequence[float], velocity: Sequence[float], soles: Sequence[Sequence[float]], loads: Vec | None
    ) -> None:
        """Compute the references for a CoM and two soles, each a position and a rotation row by row."""

    def observe(self, v: Vec, found: Vec) -> None:
        """Write the rates of this tick without their noise."""

    def moves(self, acceleration: Vec | None) -> None:
        """Take the acceleration by the torques of this tick, None if unknown: next rates, friction to overcome."""

    def finish(self, command: Vec, loads: Vec | None) -> None:
        """End the tick: scale and bound the torques in place."""

    def planned(self, time: float) -> _Two:
        """Return the ZMP of the plan."""

class FeetEstimator:
    """Base of a robot from IMU and legs, see ``estimation.FeetEstimator``."""

    slipping: list[bool]

    def __init__(self, tree: object, q: Vec) -> None: ...
    def update(self, q: Vec, v: Vec, specific_force: Vec, loads: Vec, found_q: Vec, found_v: Vec) -> None:
        """Write the state with the estimated base."""

class RateObserver:
    """Rates of some columns without their noise, see ``estimation.RateObserver``."""

    def __init__(self, columns: Sequence[int], nv: int, keeps: float, most: float) -> None: ...
    def update(self, v: Vec) -> None:
        """Correct measured rates in place."""

    def expect(self, v: Vec) -> None:
        """Take the rates that the command leads to."""

    def forget(self) -> None:
        """Expect nothing."""

class Filter:
    """Filter behind a policy, see ``policies.PolicyFilter``.

    free: torques or velocities by the command ``(n,)``.  lacking: torques that the model lacks ``(k,)``.  middle:
    configuration at which the stack has its rows ``(nq,)``.  limited: 1 for joints whose command is changed ``(n,)``.
    """

    free: Vec
    lacking: Vec
    middle: Vec
    limited: NDArray[uint8]

    def __init__(self, tree: Mapping[str, Any]) -> None: ...
    def begin(self, command: Vec, q: Vec, v: Vec) -> None:
        """Take a command for a measured state."""

    def end(self, x: Vec, solved: bool, command: Vec) -> bool:
        """Write the command for the stack's answer x; return true if a joint is limited."""

    def reset(self) -> None:
        """Discard earlier commands and estimates."""

class Filters:
    """Filters from the bytes of a file over threads, see ``policies.PolicyFilters``."""

    sizes: tuple[int, int, int]
    state: tuple[int, int]
    threads: int
    counters: tuple[int, int, int, int, int, int, float, float]

    def __init__(self, file: builtins.bytes, count: int, threads: int, key: builtins.bytes) -> None: ...
    def step(self, q: Mat, v: Mat, policy: Mat, commands: Mat, status: NDArray[int32], residuals: Mat, x: Mat) -> None:
        """Run a tick of all worlds, without the interpreter lock."""

    def stop(self, world: int, reason: str) -> None:
        """Come to rest and hold until ``resume``."""

    def resume(self, world: int) -> None:
        """End a stop."""

    def reset(self, world: int) -> None:
        """Return to the initial state."""

class Walkers:
    """Walkers from the bytes of a file over threads, see ``walking.Walkers``."""

    phases: list[int]
    supports: list[str]
    velocities: list[_Velocity]
    sizes: tuple[int, int, int]
    state: tuple[int, int]
    threads: int
    counters: tuple[int, int, int, int, int, int, float, float]

    def __init__(self, file: builtins.bytes, count: int, threads: int, key: builtins.bytes) -> None: ...
    def step(
        self,
        q: Mat,
        v: Mat,
        loads: Mat | None,
        commands: Mat,
        status: NDArray[int32],
        residuals: Mat,
        x: Mat,
    ) -> None:
        """Run a tick of all worlds, without the interpreter lock."""

    def go(self, world: int, forward: float, left: float, turn: float) -> None:
        """Walk at the nearest velocity that steps follow."""

    def follow(self, world: int, footholds: Sequence[_Place]) -> None:
        """Step on footholds in turn."""

    def stop(self, world: int) -> None:
        """Come to stand."""

    def halt(self, world: int, reason: str) -> None:
        """End the walk, then hold until ``resume``."""

    def resume(self, world: int) -> None:
        """End a halt."""

    def reset(self, world: int) -> None:
        """Return to the initial state."""

    def why(self, world: int) -> list[str]:
        """Return the reasons of a command's differences."""
