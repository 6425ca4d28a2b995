"""The last ticks of a session: rows copied into a ring each tick, files written by a thread."""

from __future__ import annotations

import hashlib
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.errors import DeclarationError
from hqp.formulation import Program
from hqp.problem import Status
from hqp.recorder.layout import LINE, Memory
from hqp.reference import Reference

try:
    from hqp import _assembly as native
except ImportError:  # no compiler was there
    native = None  # type: ignore[assignment]

if TYPE_CHECKING:
    from hqp.robot import Robot
    from hqp.session import Session
    from hqp.tick import Tick

TRIGGERS: dict[str, Callable[[Any], bool]] = {
    "not optimal": lambda tick: tick.status is not Status.OPTIMAL,
    "not solved": lambda tick: not tick.status.solved,
    "held": lambda tick: tick.held > 0,
    "noted": lambda tick: bool(tick.notes),
    "never": lambda tick: False,
}

SEGMENTS = 4
"""Compiled stacks whose ticks are kept at a time; a change of stack begins another."""


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
        self.entries: list[tuple[Tick, tuple[Reference, ...]] | None] = [None] * ticks
        self.count = 0


class Recorder:
    """Keeps the last ticks of a session and writes them to a file when something happens (``Session.record``).

    ticks: how many are kept.  on: when a file is written, "not optimal", "not solved", "held", "noted", "never", or a
    function of the tick; the next file comes ``ticks`` ticks later at the earliest.  to: a folder.  files: what was
    written.  Raises DeclarationError for a number of ticks that is none, or an unknown name.
    """

    def __init__(self, session: Session, ticks: int, on: str | Callable[[Tick], bool], to: str | Path) -> None:
        from hqp.recorder.files import about

        if not isinstance(ticks, int) or ticks < 1:
            raise DeclarationError("record", "bad number of ticks", value=ticks, allowed="1 and more")
        if not callable(on) and on not in TRIGGERS:
            raise DeclarationError("record", "unknown trigger", value=on, allowed=", ".join(TRIGGERS))
        self.ticks, self.folder, self.files = ticks, Path(to), list[Path]()
        self.folder.mkdir(parents=True, exist_ok=True)
        self._optimal = on == "not optimal"
        self._trigger: Callable[[Tick], bool] = on if callable(on) else TRIGGERS[on]
        self._about = about(session)
        self._robot = session.robot
        self._spare: list[bytearray] = []
        self._segments: list[Segment] = []
        self._segment: Segment | None = None
        self._quiet = 0
        self._threads: list[threading.Thread] = []
        self._begin(session.program)
        assert self._segment is not None
        self._spare.append(bytearray(len(self._segment.ring)))  # for the ticks while a file is written

    def _begin(self, program: Program) -> Segment:
        self._segments = self._segments[-SEGMENTS + 1 :]
        segment = self._segment = Segment(program, self.ticks, self._spare)
        self._segments.append(segment)
        return segment

    def take(self, tick: Tick, references: tuple[Reference, ...]) -> None:
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

    def dump(self) -> None:
        """Write what is there to a file, in a thread; the ring begins anew."""
        from hqp.recorder.files import write

        segments, self._segments = self._segments, []
        last = segments[-1]
        assert self._segment is last
        self._begin(last.program)
        self._quiet = self.ticks
        stamp = time.strftime("%Y%m%dT%H%M%S", time.gmtime())
        entry = last.entries[(last.count - 1) % last.ticks]
        count = 0 if entry is None else entry[0]._count
        path = self.folder / f"{self._robot.name}_{stamp}_{count}.npz"

        def work() -> None:
            write(path, self._about, segments, self.ticks, self._robot)
            self.files.append(path)
            for segment in segments[-2:]:
                segment.snapshots = None
                segment.view.release()
                self._spare.append(segment.ring)
            del self._spare[:-2]

        thread = threading.Thread(target=work, name="hqp flight recorder")
        self._threads = [*(t for t in self._threads if t.is_alive()), thread]
        thread.start()

    def wait(self) -> None:
        """Until every file is written."""
        for thread in self._threads:
            thread.join()


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
