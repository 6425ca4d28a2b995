"""The loop's side of the viewer: a few copies a tick, the page lives in a process of its own."""

from __future__ import annotations

import contextlib
import os
import pickle
import socket
import subprocess
import sys
import time
import warnings
import webbrowser
from time import perf_counter
from typing import Any, ClassVar

import numpy as np

from hqp.arrays import Mat, Vec
from hqp.declare.reference import Reference
from hqp.declare.robot import State
from hqp.errors import DeclarationError, HqpError, NetworkWarning
from hqp.explanation.account import too_fast
from hqp.explanation.notes import STATUSES
from hqp.loop.session import Session, Tick
from hqp.problem import Hierarchy, Selection
from hqp.tasks import CollisionAvoidance
from hqp.web.doors import LOOPBACK, NETWORK, Doors, address, checked_port, is_everywhere, is_loopback, listening

from .channel import Channel, Layout
from .description import StackDescription, describe_robot, describe_stack

BATCH = 8
"""Ticks that are copied to the page together, 16 ms at 500 Hz."""

TARGET_PERIOD = 1.0 / 30.0
"""Between two looks at where the loop has its targets [s]."""

_TARGETS = 24
"""Targets that there is room for, at least."""


class View:
    """A page that shows a session: the robot, its targets, every level's residual, and the levels that limit each
    other.

    Call ``view.step(state, *references)`` in place of ``session.step``, or keep ``session.step`` and call
    ``view.show(state, tick, *references)`` after it.  The page is served by another process, so that the loop pays for
    copies only.  It opens with the whole address that ``url`` is, or with the password.

    control: targets can be dragged in the page and then replace references of the same name in ``view.step``, and
    ``view.wait`` honours its pause and step buttons; without it the page shows and nothing else.  host: this machine
    only by default; another one opens the page to the network and warns.  port: port of the page, the next free one if
    it is taken, 0 for any.  password: opens the page, too.  period: between two accounts of the active elements [s].
    Raises HqpError where viser is missing, the host is no address of this machine or the page does not come up.
    """

    steers: ClassVar[bool] = True
    """True if a dragged target can change the motion."""

    def __init__(
        self,
        session: Session,
        *,
        control: bool = False,
        host: str = LOOPBACK,
        port: int = 0,
        password: str | None = None,
        period: float = 0.1,
        title: str = "",
    ) -> None:
        self.session, self.period, self.control = session, period, bool(control)
        if password is not None and (not isinstance(password, str) or not password):
            raise DeclarationError("view", "an empty password", allowed="a text, or None")
        self._password = password or ""
        self._run = session.line  # line with the rows of the displayed tick: in a transition another one
        self._codes = {status: i for i, status in enumerate(STATUSES)}
        self._version = 0
        self._program: Any = None
        self.description: StackDescription
        first = describe_stack(session.line, session.controller.formulation, 0)
        self._channel = Channel(Layout(2 * sum(first.sizes) + 256, max(_TARGETS, 2 * len(first.targets))))
        self._answered = 0.0
        self._dragged: dict[str, Reference] = {}
        self._holds: dict[str, Vec | Mat] = {}
        self._content: dict[str, Any] = {}
        self._batch: list[tuple[float, State, Tick]] = []
        self._hurry = session.dt > 0.01
        self._due = self._targets_due = 0.0
        self._steps = 0
        try:
            self._describe()
            self._start(host, port, title)
        except BaseException:
            self._channel.close()
            raise

    @property
    def url(self) -> str:
        """Address of the page on this machine, with the token that opens it."""
        return address(self._doors.host, int(self._channel.ready), self._doors.token)

    @property
    def elsewhere(self) -> str:
        """Address of the page for other machines, empty where they do not reach it."""
        host = self._doors.host
        if is_loopback(host):
            return ""
        return address(
            socket.gethostname() if is_everywhere(host) else host, int(self._channel.ready), self._doors.token
        )

    @property
    def doors(self) -> Doors:
        """Access control of the page; for pages that belong to this one."""
        return self._doors

    def open(self) -> bool:
        """Open the page in this machine's browser, whose command line shows a token that is good once; False: none."""
        return webbrowser.open(address(self._doors.host, int(self._channel.ready), self._doors.once))

    def step(self, state: State, *references: Reference) -> Tick:
        """One tick of the session with dragged targets in place of references of the same name, then shown."""
        if self.control and self._channel.targets_version != self._answered:
            self._take_targets()
        if self._dragged:
            references = (*(r for r in references if r.name not in self._dragged), *self._dragged.values())
        tick = self.session.step(state, *references)
        self.show(state, tick, *references)
        return tick

    def show(self, state: State, tick: Tick, *references: Reference) -> None:
        """Show a tick that the session has just made; costs a few microseconds."""
        clock = perf_counter()
        self._run = tick.line or self.session.line
        if self._run.program is not self._program:
            self._describe()
        # a tick is taken apart and copied in batches: most ticks pay for being kept, not for cold memory
        self._batch.append((clock, state, tick))
        if len(self._batch) >= BATCH or self._hurry:
            self._flush()
        if clock >= self._targets_due:
            self._targets_due = clock + TARGET_PERIOD
            self._show_targets(references)
            if clock >= self._due:
                self._due = clock + self.period
                self._snapshot(tick)

    def _flush(self) -> None:
        for clock, state, tick in self._batch:
            solution, times = tick.solution, tick.times
            if solution is None:
                vectors: tuple[Vec, ...] = (state.q, state.v, tick.command, self._nothing)
            else:
                vectors = (state.q, state.v, tick.command, solution.x, *solution.residuals)
            parts = (0.0,) * 4 if times is None else (times.state, times.assemble, times.solve, times.command)
            self._channel.write((clock, self._version, self._codes[tick.status], *parts), vectors)
        self._batch.clear()

    @property
    def paused(self) -> bool:
        """True while the page requests a pause; a simulation calls ``wait``, a robot's loop goes on."""
        return self.control and self._channel.paused

    def wait(self) -> None:
        """Return at once, or, during a pause, when it ends or at the next single step."""
        if self.paused:
            self._flush()
        while self.paused and self._channel.steps == self._steps:
            if self._server.poll() is not None:
                return
            time.sleep(0.02)
        self._steps = self._channel.steps

    def close(self) -> None:
        """Stop the page."""
        self._flush()
        self._channel.close()
        if self._server.stdin is not None:
            with contextlib.suppress(OSError):
                self._server.stdin.close()
        try:
            self._server.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            self._server.terminate()

    def __enter__(self) -> View:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<View of {self.session.robot.name} at {address(self._doors.host, int(self._channel.ready))}>"

    def _describe(self) -> None:
        """After a change of stack: new sizes, new targets at their hold values."""
        self._flush()
        self._version += 1
        room, formulation = self._channel.layout.targets, self.session.controller.formulation
        description = describe_stack(self._run, formulation, self._version, room)
        used = sum(description.sizes)
        if used > self._channel.layout.room:
            raise HqpError("the new stack is more than twice as large as the one the viewer was started with")
        self._program, self.description = self._run.program, description
        self._pickled = pickle.dumps(description, 5)
        self._channel.set_used(used)
        self._nothing = np.full(used - sum(description.sizes[:3]), np.nan)
        self._places = {t.name: i for i, t in enumerate(description.targets)}
        self._holds, self._content = {}, {}
        self._due = 0.0

    def _start(self, host: str, port: int, title: str) -> None:
        try:
            import viser  # noqa: F401  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise HqpError("the viewer needs viser and trimesh: pip install 'hqp[view]'") from error
        port, self._doors = checked_port(port), Doors(listening(host), (host,), self._password)
        if not is_loopback(self._doors.host):
            warnings.warn(NETWORK, NetworkWarning, stacklevel=4)
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        # this hqp from any folder: with -m Python looks in the current folder first
        program = f"import sys; sys.path[:] = {sys.path!r}; from hqp.viewer import server; sys.exit(server.main())"
        self._server = subprocess.Popen(
            [sys.executable, "-c", program],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            env=environment,
        )
        session = self.session
        title = title or f"{session.robot.name}, {type(session.controller.formulation).__name__.lower()} level"
        about = {
            "path": str(self._channel.path),
            "layout": self._channel.layout,
            "robot": describe_robot(session.robot),
            "stack": self.description,
            "doors": self._doors,
            "control": self.control,
            "drag": self.control and self.steers,
            "port": port,
            "dt": session.dt,
            "title": title + ("" if self.control else " · read only"),
        }
        assert self._server.stdin is not None
        pickle.dump(about, self._server.stdin)
        self._server.stdin.flush()
        while not self._channel.ready:
            if self._server.poll() is not None:
                raise HqpError(
                    f"the viewer's page did not start: its process ended with {self._server.returncode}; "
                    "its error output is above"
                )
            time.sleep(0.02)
        if self._channel.ready < 0:
            raise HqpError("the viewer's page did not start; see the output of its process above")

    def _take_targets(self) -> None:
        """Read the targets dragged in the page since the last tick."""
        self._answered = self._channel.targets_version
        self._dragged = {}
        for target in self.description.targets:
            value = self._channel.wanted(self._places[target.name], target.size)
            if value is not None:
                self._dragged[target.name] = Reference(target.name, value.reshape(target.shape))

    def _show_targets(self, references: tuple[Reference, ...]) -> None:
        """Publish the targets for the page: the references of the loop, and the hold values of all others."""
        given = {r.name: r.value for r in references if r.value is not None}
        if not self._holds:
            self._holds = self._run.hold_values
        for name, index in self._places.items():
            value = given.get(name, self._holds.get(name))
            if value is not None:
                self._channel.set_current(index, value.ravel())

    def _fast(self, tick: Tick) -> frozenset[str]:
        """Elements that lack the rate of their reference more than its place."""
        program, solution = self._run.program, tick.solution
        assert solution is not None
        lack = {n: solution.residuals[p.level][p.part] / p.element.weight for n, p in program.places.items()}
        return frozenset(n for n, w in lack.items() if too_fast(program, n, w, tick.state.v))

    def _problem(self) -> Hierarchy:
        """The hierarchy of the tick that is shown."""
        return self._run.program.problem

    def _row_names(self) -> dict[str, tuple[str, ...]]:
        """Names of rows that change from tick to tick: the pairs of a collision avoidance that are near."""
        named = (e for e in self._run.stack if isinstance(e, CollisionAvoidance))
        return {e.name: tuple(e.row_names(self.session.robot)) for e in named}

    def _contact_forces(self, tick: Tick) -> dict[str, Vec]:
        """Forces and moments of contacts in world axes, at torque level."""
        forces = getattr(self._run.program, "contact_forces", None)
        return {} if forces is None or tick.solution is None else dict(forces(tick.solution.x, world=True))

    def _snapshot(self, tick: Tick) -> None:
        """Publish this tick; a held tick uses the rows of the last one that was not."""
        if tick.solution is not None:
            self._content = self._rows(tick)
        if self._content:
            notes = [(note.element, note.detail) for note in tick.notes]
            self._channel.write_snapshot({**self._content, **self._numbers(tick), "notes": notes})

    def _numbers(self, tick: Tick) -> dict[str, Any]:
        """Status of this tick, and the counters of its session."""
        return {"status": tick.status.name, "counters": self.session.counters}

    def _rows(self, tick: Tick) -> dict[str, Any]:
        """The rows of this tick, from which the page's process computes the account."""
        problem, solution = self._problem(), tick.solution
        assert solution is not None
        return {
            "version": self._version,
            "stack": self._pickled,
            "rows": [
                ((r.A.index, r.A.scale) if isinstance(r.A, Selection) else r.A, r.lower, r.upper)
                for r in problem.levels
            ],
            "metric": problem.metric,
            "origin": problem.origin,
            "n": problem.n,
            "prices": problem.prices,
            "eta": problem.eta,
            "turning": problem.turning,
            "stage_points": solution.stage_points,
            "fast": self._fast(tick),
            "names": self._row_names(),
            "motion": None if problem.motion is None else (problem.motion.F, problem.motion.f),
            "x": solution.x,
            "residuals": solution.residuals,
            "active": solution.active,
            "solved": solution.status.name,
            "forces": self._contact_forces(tick),
        }
