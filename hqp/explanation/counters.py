"""Counters of a session, which its native part keeps (hqp/cpp/session/counters.hpp)."""

from __future__ import annotations

from typing import NamedTuple


class Counters(NamedTuple):
    """Counters of a session since its creation, through every change of its stack.

    ticks: finished ticks.  late: ticks longer than dt.  cut: ticks whose search the deadline or the iteration limit
    stopped.  held: ticks whose command was coming to rest.  rejected_states, rejected_references: invalid inputs.
    longest_gap: longest time from the begin of a tick to that of the next [s].  worst_time: longest tick [s], without
    Python.
    """

    ticks: int
    late: int
    cut: int
    held: int
    rejected_states: int
    rejected_references: int
    longest_gap: float
    worst_time: float

    def __str__(self) -> str:
        return (
            f"{self.ticks} ticks: {self.late} late, {self.cut} cut, {self.held} held; rejected: "
            f"{self.rejected_states} states, {self.rejected_references} references; longest gap "
            f"{1e3 * self.longest_gap:.3g} ms, worst time {1e3 * self.worst_time:.3g} ms"
        )
