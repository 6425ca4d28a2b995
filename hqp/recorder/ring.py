"""The last ticks of a session: rows copied into a ring each tick, files written by a thread."""

from __future__ import annotations

import hashlib
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from hqp.declare.reference import Reference
from hqp.errors import DeclarationError, HqpError
from hqp.explanation.notes import Note
from hqp.numbers import whole
from hqp.problem import Status
from hqp.programs.formulation import Program
from hqp.recorder.layout import LINE, Memory

try:
    from hqp import _assembly as native
except ImportError:  # no compiler was there
    native = None  # type: ignore[assignment]

if TYPE_CHECKING:
    from hqp.declare.robot import Robot

TRIGGERS: dict[str, Callable[[Any], bool]] = {
    "not optimal": lambda tick: tick.status is not Status.OPTIMAL,
    "not solved": lambda tick: not tick.status.solved,
    "held": lambda tick: tick.held > 0,
    "noted": lambda tick: bool(tick.notes),
    "never": lambda tick: False,
}

LOG = logging.getLogger("hqp")

UNWRITTEN = 4
"""Recordings that could not be written and are kept in memory; more are dropped, and counted."""

SEGMENTS = 4
"""Compiled stacks whose ticks are kept at a time; a change of stack begins another."""


class Recorded(Protocol):
    """Interface of a session."""

    controller: Any
    dt: float

    @property
    def robot(self) -> Any: ...
    @property
    def program(self) -> Program: ...


class Segment:
    """Ticks of one compiled stack, the latest ``ticks`` of them."""

    def __init__(self, program: Program, ticks: int, spare: list[bytearray]) -> None:
        self.memory = Memory(program.problem, program.copies, program.symmetric)
        self.program, self.ticks = program, ticks
        size = max(1, self.memory.size) * ticks + LINE
        fit = next((k for k, ring in enumerate(spare) if len(ring) == size), None)
        self.ring = spare.pop(fit) if fit is not None else bytearray(size)
        begin = -np.frombuffer(self.ring, np.uint8).ctypes.data % LINE
        self.view = memoryview(self.ring)[begin : begin + size - LINE]
        parts = [(part, begin) for part, begin, _ in self.memory.parts]
        self.snapshots: Any = None if native is None else native.Snapshots(parts, self.view, max(1, self.memory.size))
        self.entries: list[tuple[Any, tuple[Reference, ...]] | None] = [None] * ticks
        self.count = 0


class Recorder:
    """Keeps the last ticks of a session and writes them to a file when something happens (``Session.record``).

    ticks: number of ticks to keep.  on: when a file is written, "not optimal", "not solved", "held", "noted", "never",
    or a function of the tick; the next file comes ``ticks`` ticks later at the earliest.  to: a folder.  files: written
    files.  If a file cannot be written, its ticks are kept, every tick has a note, and ``wait`` reports it.  Raises
    DeclarationError for an invalid number of ticks, an unknown name, or a folder that cannot be made.
    """

    def __init__(self, session: Recorded, ticks: int, on: str | Callable[[Any], bool], to: str | Path) -> None:
        from hqp.recorder.files import about

        if not callable(on) and on not in TRIGGERS:
            raise DeclarationError("record", "unknown trigger", value=on, allowed=", ".join(TRIGGERS))
        self.ticks, self.folder, self.files = whole("record", "number of ticks", ticks, 1), Path(to), list[Path]()
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DeclarationError("record", f"cannot make the folder: {error}", value=str(to)) from error
        self._optimal = on == "not optimal"
        self._trigger: Callable[[Any], bool] = on if callable(on) else TRIGGERS[on]
        self._about = about(session)
        self._robot = session.robot
        self._spare: list[bytearray] = []
        self._segments: list[Segment] = []
        self._segment: Segment | None = None
        self._quiet = 0
        self._threads: list[threading.Thread] = []
        self._unwritten: list[_Unwritten] = []
        self._dropped = 0
        self._begin(session.program)
        assert self._segment is not None
        self._spare.append(bytearray(len(self._segment.ring)))  # for the ticks while a file is written

    def _begin(self, program: Program) -> Segment:
        self._segments = self._segments[-SEGMENTS + 1 :]
        segment = self._segment = Segment(program, self.ticks, self._spare)
        self._segments.append(segment)
        return segment

    def take(self, tick: Any, references: tuple[Reference, ...]) -> None:
        """Keep a tick, and write a file where it is one to write."""
        segment, program = self._segment, tick.program
        if segment is None or segment.program is not program:
            if program is None:
                return
            segment = self._begin(program)
        i = segment.count % segment.ticks
        if segment.snapshots is not None:
            segment.snapshots.take(i)
        else:
            base, view = i * segment.memory.size, segment.view
            for part, begin, end in segment.memory.parts:
                view[base + begin : base + end] = part
        segment.entries[i] = (tick, references)
        segment.count += 1
        if self._quiet:
            self._quiet -= 1
        elif (not self._optimal or tick.status is not Status.OPTIMAL) and self._trigger(tick):
            self.dump()
        if self._unwritten:
            tick.add((Note("recorder", tick.status, self._failure()),))

    def dump(self) -> None:
        """Write the ticks to a file, in a thread; the ring begins anew.  Without a tick there is nothing to do."""
        segments, self._segments = self._segments, []
        last = segments[-1]
        assert self._segment is last
        self._begin(last.program)
        entry = last.entries[(last.count - 1) % last.ticks] or next((s.entries[0] for s in segments if s.count), None)
        if entry is None:
            return
        self._quiet = self.ticks
        stamp = time.strftime("%Y%m%dT%H%M%S", time.gmtime())
        path = self.folder / f"{self._robot.name}_{stamp}_{entry[0].count}.npz"
        about = {**self._about, "counters": entry[0].counters._asdict()}
        thread = threading.Thread(target=self._write, args=(path, segments, about), name="hqp flight recorder")
        self._threads = [*(t for t in self._threads if t.is_alive()), thread]
        thread.start()

    def _write(self, path: Path, segments: list[Segment], about: dict[str, Any]) -> None:
        """Write a file; ticks that could not be written are kept."""
        from hqp.recorder.files import write

        try:
            self.files.append(write(path, about, segments, self.ticks, self._robot))
        except Exception as error:  # a full disk, a folder that is gone, an element's own row names
            LOG.warning("recording %s could not be written: %s", path, error)
            if len(self._unwritten) < UNWRITTEN:
                self._unwritten.append(_Unwritten(path, segments, about, f"{type(error).__name__}: {error}"))
            else:
                self._dropped += 1
            return
        for segment in segments[-2:]:
            segment.snapshots = None
            segment.view.release()
            self._spare.append(segment.ring)
        del self._spare[:-2]

    def wait(self, to: str | Path | None = None) -> None:
        """Until every file is written; files that failed before are tried again, in the folder ``to`` if given.

        Raises HqpError with files and reasons where that fails again; the ticks are kept for another ``wait``.
        """
        for thread in self._threads:
            thread.join()
        unwritten, self._unwritten = self._unwritten, []
        for one in unwritten:
            self._write(one.path if to is None else Path(to) / one.path.name, one.segments, one.about)
        if self._unwritten:
            raise HqpError(f"{self._failure()}; wait(to=FOLDER) tries another folder")
        if self._dropped:
            dropped, self._dropped = self._dropped, 0
            raise HqpError(f"{dropped} more recordings could not be written and were dropped")

    def _failure(self) -> str:
        more = f", and {self._dropped} that were dropped" if self._dropped else ""
        return "recordings could not be written: " + "; ".join(map(str, self._unwritten)) + more


@dataclass(frozen=True)
class _Unwritten:
    """Ticks whose file could not be written, and why."""

    path: Path
    segments: list[Segment]
    about: dict[str, Any]
    reason: str

    def __str__(self) -> str:
        return f"{self.path} ({self.reason})"


def robot_hash(robot: Robot) -> str:
    """16 hexadecimal digits of the names, limits, inertia at home and frames of a robot."""
    twin = robot.copy()
    state = twin.state()
    digest = hashlib.sha256()
    for text in (robot.name, *robot.joint_names, *robot.frame_names):
        digest.update(text.encode() + b"\0")
    numbers = [robot.lower, robot.upper, robot.velocity_limit, robot.effort_limit, twin.home, state.mass_matrix()]
    for array in numbers:
        digest.update(np.ascontiguousarray(array, dtype=np.float64).tobytes())
    state = twin.state()
    for name in robot.frame_names:
        digest.update(np.round(state.position(name), 9).tobytes())
    return digest.hexdigest()[:16]
