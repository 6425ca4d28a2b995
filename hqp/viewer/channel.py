"""Memory shared by a control loop and the viewer's process: a ring of ticks one way, targets the other way."""

from __future__ import annotations

import mmap
import os
import pickle
import struct
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hqp.arrays import Mat, Vec

SLOTS = 512
"""Ticks that the ring keeps: 1 s at 500 Hz, far more than the viewer's period."""

HEAD = 8
"""Numbers before the vectors of a tick: sequence, clock [s], version of the stack, status, four times [s]."""

SNAPSHOT_BYTES = 4 << 20
TARGET = 17
"""Numbers of a target: a version and at most sixteen values."""

_COUNT, _SNAPSHOT, _CLOSED, _PAUSED, _STEPS, _READY, _TARGETS = range(7)
_HEADER = 16
_pack = struct.Struct(f"{HEAD}d").pack_into


@dataclass(frozen=True)
class Layout:
    """Sizes of a channel: numbers in the vectors of a tick, and targets that the page may move."""

    room: int
    targets: int

    @property
    def width(self) -> int:
        """Numbers in one slot: head, vectors and the sequence again."""
        return HEAD + self.room + 1

    @property
    def bytes(self) -> int:
        """Size of the shared file."""
        return 8 * (_HEADER + SLOTS * self.width + 2 * TARGET * self.targets) + 2 * SNAPSHOT_BYTES


class Channel:
    """Both ends of the shared memory; one process writes ticks, the other writes targets and the pause flag.

    A tick's slot carries its sequence number at both ends, so that a reader leaves out a slot that is being written.
    """

    def __init__(self, layout: Layout, path: str | Path | None = None) -> None:
        self.layout = layout
        self.owner = path is None
        if path is None:
            folder = "/dev/shm" if os.path.isdir("/dev/shm") else None
            handle, name = tempfile.mkstemp(prefix="hqp_view_", dir=folder)
            os.ftruncate(handle, layout.bytes)
            path = name
        else:
            handle = os.open(path, os.O_RDWR)
        self.path = Path(path)
        self._map = mmap.mmap(handle, layout.bytes)
        os.close(handle)
        numbers: Vec = np.frombuffer(self._map, dtype=np.float64)
        self._header = memoryview(self._map).cast("d")
        self._width = layout.width
        ring = numbers[_HEADER : _HEADER + SLOTS * layout.width].reshape(SLOTS, layout.width)
        self._ring = ring
        self._ends = ring[:, -1]
        self.set_used(layout.room)
        at = _HEADER + SLOTS * layout.width
        size = TARGET * layout.targets
        self._wanted: Mat = numbers[at : at + size].reshape(-1, TARGET)
        self._current: Mat = numbers[at + size : at + 2 * size].reshape(-1, TARGET)
        self._blob = 8 * (at + 2 * size)

    # the loop's end

    def set_used(self, used: int) -> None:
        """Set the number of entries of a tick's vectors, at most the layout's room."""
        self._bodies = [slot[HEAD : HEAD + used] for slot in self._ring]

    def write(self, head: tuple[float, ...], vectors: tuple[Vec, ...]) -> None:
        """Put one tick into the ring: the seven numbers after the sequence, and the vectors."""
        header = self._header
        count = header[_COUNT]
        index = int(count) % SLOTS
        at = 8 * (_HEADER + index * self._width)
        _pack(self._map, at, count + 0.5, *head)
        np.concatenate(vectors, out=self._bodies[index])
        self._ends[index] = count
        header[_HEADER + index * self._width] = count
        header[_COUNT] = count + 1.0

    def write_snapshot(self, content: Any) -> bool:
        """Publish a picklable account of one tick; False if it is too large to pass."""
        data = pickle.dumps(content, 5)
        if len(data) > SNAPSHOT_BYTES - 8:
            return False
        turn = int(self._header[_SNAPSHOT]) + 1
        start = self._blob + (turn % 2) * SNAPSHOT_BYTES
        self._map[start : start + 8] = len(data).to_bytes(8, "little")
        self._map[start + 8 : start + 8 + len(data)] = data
        self._header[_SNAPSHOT] = turn
        return True

    @property
    def targets_version(self) -> float:
        """Number of targets that the page has set so far; unchanged means nothing new."""
        return self._header[_TARGETS]

    def wanted(self, index: int, size: int) -> Vec | None:
        """Value that the page requests for a target, None without a request."""
        return self._wanted[index, 1 : 1 + size].copy() if self._wanted[index, 0] else None

    def set_current(self, index: int, value: Vec) -> None:
        """Publish the value of a target for the page."""
        self._current[index, 1 : 1 + value.size] = value
        self._current[index, 0] = 1.0

    @property
    def paused(self) -> bool:
        """True if the page requests a pause."""
        return self._header[_PAUSED] != 0.0

    @property
    def steps(self) -> int:
        """Number of single steps requested so far."""
        return int(self._header[_STEPS])

    @property
    def ready(self) -> float:
        """Port of the page once it is served, 0 before, -1 if it failed."""
        return self._header[_READY]

    # the page's end

    @property
    def count(self) -> int:
        """Ticks written so far."""
        return int(self._header[_COUNT])

    @property
    def closed(self) -> bool:
        """True if the loop has ended."""
        return self._header[_CLOSED] != 0.0

    def read(self, since: int) -> Mat:
        """Slots of ticks ``since`` and later that are still in the ring, ``(k, width)``, oldest first."""
        count = self.count
        first = max(since, count - SLOTS + 16, 0)
        if count <= first:
            return np.empty((0, self.layout.width))
        wanted = np.arange(first, count)
        slots = self._ring[wanted % SLOTS]
        whole = (slots[:, 0] == wanted) & (slots[:, -1] == wanted)
        return np.asarray(slots[whole])

    def read_snapshot(self, since: int) -> tuple[int, Any] | None:
        """Newest snapshot and its number, None if there is none after ``since`` or it is being replaced."""
        turn = int(self._header[_SNAPSHOT])
        if turn <= since:
            return None
        start = self._blob + (turn % 2) * SNAPSHOT_BYTES
        size = int.from_bytes(self._map[start : start + 8], "little")
        data = self._map[start + 8 : start + 8 + size]
        if int(self._header[_SNAPSHOT]) > turn + 1:
            return None
        return turn, pickle.loads(data)

    def set_wanted(self, index: int, value: Vec | None) -> None:
        """Request a value for a target, or release it to the loop with None."""
        if value is not None:
            self._wanted[index, 1 : 1 + value.size] = value
        self._wanted[index, 0] = 0.0 if value is None else self._wanted[index, 0] + 1.0
        self._header[_TARGETS] = self._header[_TARGETS] + 1.0

    def current(self, index: int, size: int) -> Vec | None:
        """Value of a target in the loop, None before the first one."""
        return self._current[index, 1 : 1 + size].copy() if self._current[index, 0] else None

    def set_paused(self, paused: bool) -> None:
        """Request that the loop waits or continues."""
        self._header[_PAUSED] = float(paused)

    def add_step(self) -> None:
        """Request one tick from a waiting loop."""
        self._header[_STEPS] = self._header[_STEPS] + 1.0

    def set_ready(self, port: float) -> None:
        """Publish the port of the page, -1 for a failure."""
        self._header[_READY] = port

    def close(self) -> None:
        """The loop has ended; the file goes with it."""
        self._header[_CLOSED] = 1.0
        if self.owner:
            self.path.unlink(missing_ok=True)
