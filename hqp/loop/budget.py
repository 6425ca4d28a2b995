"""The time of a tick: what a solver is given, so that what comes after it is done by the deadline."""

from __future__ import annotations

from time import thread_time

LATE = 1e-3
"""Share of the ticks at the deadline that may end after it."""

STEP = 40e-6
"""By how much the margin grows after a late tick [s]; it shrinks by LATE of that after one that was cut in time."""

FIRST = 0.25
"""Share of the deadline that is kept back before anything is known."""

LONGEST = 0.5
"""Largest share of the deadline that is kept back from the solver."""


class Budget:
    """Keeps back from the solver what its last turn, the command and the notes have taken in ticks before.

    The margin follows the quantile 1 - LATE of how late those ticks end, by stochastic approximation: m + s (1 - LATE)
    after a late tick, m - s LATE after another one.  CPU time counts, for other work on the machine tells nothing.
    """

    __slots__ = ("_begun", "deadline", "margin")

    def __init__(self, deadline: float) -> None:
        self.deadline, self.margin = deadline, FIRST * deadline
        self._begun: float | None = None

    def begin(self) -> None:
        """A tick begins that may be cut."""
        self._begun = thread_time()

    def skip(self) -> None:
        """The tick that ends next was not measured from its begin."""
        self._begun = None

    def left(self, spent: float) -> float:
        """Time for the solver [s], after so much of the tick."""
        return max(self.deadline - self.margin - spent, 1e-6)

    def end(self, *, cut: bool) -> None:
        """The tick ends; cut: its solver was stopped."""
        if self._begun is None:
            return
        late, self._begun = thread_time() - self._begun > self.deadline, None
        if late:
            self.margin = min(self.margin + STEP * (1.0 - LATE), LONGEST * self.deadline)
        elif cut:
            self.margin = max(self.margin - STEP * LATE, 0.0)
