"""Recordings as files: NumPy's npz, with everything that a tick needs and without its robot."""

from __future__ import annotations

import io
import json
import time
import zipfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from hqp.arrays import Vec
from hqp.errors import HqpError
from hqp.explanation.counters import Counters
from hqp.explanation.multipliers import explain
from hqp.explanation.words import Explanation
from hqp.problem import Hierarchy, Solution, Stats, Status
from hqp.programs.formulation import Place
from hqp.recorder import checked
from hqp.recorder.checked import FORMAT
from hqp.recorder.layout import arrays_of, pattern_of, rebuilt

if TYPE_CHECKING:
    from hqp.declare.robot import Robot
    from hqp.recorder.ring import Recorded, Segment

PAUSE = 2e-4
"""The writing thread lets the control loop in for so long after every tick [s]."""


def about(session: Recorded) -> dict[str, Any]:
    """Constant data: machine, versions, robot, stack, solver."""
    from hqp import serial
    from hqp.commands.manifest import manifest
    from hqp.recorder.ring import robot_hash

    controller, robot = session.controller, session.robot
    try:
        toml = serial.dumps(controller.stack)
    except Exception:  # elements of the user's own with fields that are no plain data
        toml = ""
    return manifest(
        kind="recording",
        robot={
            "name": robot.name,
            "hash": robot_hash(robot),
            "joints": list(robot.joint_names),
            "tangent": [robot.joint_name(i) for i in range(robot.nv)],
        },
        stack=str(controller.stack),
        toml=toml,
        formulation=repr(controller.formulation),
        solver=repr(controller.solver),
        dt=session.dt,
    )


def write(path: Path, about: dict[str, Any], segments: Sequence[Segment], ticks: int, robot: Robot) -> Path:
    """Write the latest ticks of some segments; slowly, so that the loop beside it is not held up.

    Returns the file, ``path`` or, where that is taken, another beside it.  Raises OSError where it cannot be written.
    """
    parts: list[dict[str, Any]] = []
    arrays: dict[str, Any] = {}
    left = ticks
    for segment in reversed(segments):
        k = min(segment.count, segment.ticks, left)
        left -= k
        if k:
            parts.append(_segment(segment, k, robot, len(parts), arrays))
    parts.reverse()
    text = json.dumps({**about, "format": FORMAT, "segments": parts})
    stem, number = path.stem, 0
    while path.exists() or path.with_suffix(".part").exists():
        number += 1
        path = path.with_stem(f"{stem}_{number}")
    partial = path.with_suffix(".part")
    try:
        with zipfile.ZipFile(partial, "x", zipfile.ZIP_DEFLATED, compresslevel=1) as file:
            file.writestr("recording.json", text)
            for name, array in arrays.items():
                content = io.BytesIO()
                np.lib.format.write_array(content, array, allow_pickle=False)
                file.writestr(f"{name}.npy", content.getbuffer())
                time.sleep(PAUSE)
        return partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def _segment(segment: Segment, k: int, robot: Robot, number: int, arrays: dict[str, Any]) -> dict[str, Any]:
    """The ticks of a segment as JSON, their numbers into ``arrays``."""
    ticks: list[dict[str, Any]] = []
    rows: list[list[Any]] = []
    numbers: dict[str, list[Vec]] = {"q": [], "v": [], "command": [], "x": [], "solved": []}
    stages: dict[str, Vec] = {}
    for j in range(segment.count - k, segment.count):
        i = j % segment.ticks
        entry = segment.entries[i]
        assert entry is not None
        tick, references = entry
        size = segment.memory.size
        problem = segment.memory.problem(bytes(segment.view[i * size : (i + 1) * size]))
        rows.append(arrays_of(problem))
        solution = tick.solution
        for name, value in (("q", tick.state.q), ("v", tick.state.v), ("command", tick.command), ("x", tick.x)):
            numbers[name].append(np.array(value))
        numbers["solved"].append(np.full(problem.n, np.nan) if solution is None else np.array(solution.x))
        if solution is not None and solution.stage_points is not None:
            stages[f"{number}_stages_{len(ticks)}"] = solution.stage_points
        ticks.append(
            {
                "count": tick.count,
                "status": tick.status.name,
                "solved": "" if solution is None else solution.status.name,
                "held": tick.held,
                "transition": tick.transition,
                "notes": [[note.element, note.status.name, note.detail] for note in tick.notes],
                "references": [
                    {
                        key: np.asarray(value).tolist()
                        for key in ("value", "velocity", "acceleration")
                        if (value := getattr(reference, key)) is not None
                    }
                    | {"name": reference.name}
                    for reference in references
                ],
            }
        )
        time.sleep(PAUSE)
    for name, values in numbers.items():
        arrays[f"{number}_{name}"] = np.array(values)
    for i, column in enumerate(zip(*rows, strict=True)):
        arrays[f"{number}_rows_{i}"] = np.array(column)
    arrays.update(stages)
    program = segment.program
    places = [
        {
            "name": name,
            "type": type(place.element).__name__,
            "weight": place.element.weight,
            "equality": place.element.equality,
            "level": place.level,
            "start": place.part.start,
            "stop": place.part.stop,
            "declared": place.declared,
            "rows": list(place.element.row_names(robot)),
        }
        for name, place in program.places.items()
    ]
    return {
        "kind": program.kind,
        "number": number,
        "pattern": pattern_of(program.problem),
        "places": places,
        "ticks": ticks,
    }


@dataclass(frozen=True)
class RecordedTick:
    """A tick of a recording: its inputs, its outputs, and the hierarchy between them.

    count: number in the session.  solved: status of the solver's solution x_solved, "" if there was no solve.  command:
    as sent.  notes: (element, status, text).  references: values by element.
    """

    count: int
    kind: str
    status: Status
    solved: str
    held: int
    transition: float
    notes: tuple[tuple[str, str, str], ...]
    references: tuple[dict[str, Any], ...]
    q: Vec
    v: Vec
    command: Vec
    x: Vec
    x_solved: Vec
    problem: Hierarchy = field(repr=False)
    places: dict[str, Place] = field(repr=False)
    row_names: dict[str, tuple[str, ...]] = field(repr=False)
    stage_points: Any = field(repr=False, default=None)

    @cached_property
    def solution(self) -> Solution | None:
        """Solution of the solver, residuals and active rows recomputed; None if there was no solve."""
        from hqp.solvers.base import finish

        if not self.solved:
            return None
        status = Status[self.solved]
        return finish(self.problem, self.x_solved, status, Stats(), stages=self.stage_points)

    def explain(self) -> Explanation:
        """Explain the residual and the losses of each element; raises HqpError for a tick without a solve."""
        if self.solution is None:
            raise HqpError(f"tick {self.count}: {self.status.name}, not solved")
        return explain(self.problem, self.solution, self.places, self.row_names)


class Recording:
    """The ticks of a file, in order; ``about`` describes their origin.  Needs no robot.

    Raises DeclarationError where something is missing, of another kind or size, or no number.
    """

    def __init__(self, about: dict[str, Any], arrays: dict[str, Any]) -> None:
        checked.about(about)
        self.about = {key: value for key, value in about.items() if key != "segments"}
        self.ticks: tuple[RecordedTick, ...] = tuple(
            tick
            for i, segment in enumerate(about["segments"])
            for tick in _ticks(segment, arrays, about["robot"], f"segments[{i}]")
        )

    @property
    def counters(self) -> Counters | None:
        """Counters of the session when the file was begun, None in files of earlier versions."""
        counters = self.about.get("counters")
        return None if counters is None else Counters(**counters)

    def __len__(self) -> int:
        return len(self.ticks)

    def __iter__(self) -> Iterator[RecordedTick]:
        return iter(self.ticks)

    def __getitem__(self, index: int) -> RecordedTick:
        return self.ticks[index]

    def __str__(self) -> str:
        robot, count = self.about["robot"], Counter(tick.status.name for tick in self.ticks)
        statuses = ", ".join(f"{name} {k}" for name, k in count.items())
        counters = "" if self.counters is None else f"\nsince the session was made: {self.counters}"
        return (
            f"{self.about['stack']}\n{len(self)} ticks of {1e3 * self.about['dt']:g} ms on {robot['name']} "
            f"({robot['hash']}), hqp {self.about['hqp']}, {self.about['made']}\n{statuses}{counters}"
        )


def _ticks(
    segment: dict[str, Any], arrays: dict[str, Any], robot: dict[str, Any], where: str
) -> Iterator[RecordedTick]:
    pattern, columns = checked.segment(segment, arrays, robot, where)
    number = segment["number"]
    places, names = {}, {}
    for place in segment["places"]:
        element: Any = SimpleNamespace(weight=place["weight"], equality=place["equality"], name=place["name"])
        places[place["name"]] = Place(element, place["level"], slice(place["start"], place["stop"]), place["declared"])
        names[place["name"]] = tuple(place["rows"])
    numbers = {name: arrays[f"{number}_{name}"] for name in checked.NUMBERS}
    for i, tick in enumerate(segment["ticks"]):
        q, v, command, x, solved = (numbers[name][i] for name in checked.NUMBERS)
        yield RecordedTick(
            count=tick["count"],
            kind=segment["kind"],
            status=Status[tick["status"]],
            solved=tick["solved"],
            held=tick["held"],
            transition=tick["transition"],
            notes=tuple((element, status, text) for element, status, text in tick["notes"]),
            references=tuple(tick["references"]),
            q=q,
            v=v,
            command=command,
            x=x,
            x_solved=solved,
            problem=rebuilt(pattern, [column[i] for column in columns]),
            places=places,
            row_names=names,
            stage_points=arrays.get(f"{number}_stages_{i}"),
        )


def load(path: str | Path) -> Recording:
    """Read a recording; raises DeclarationError for a file of another kind, a later format, or one that is damaged."""
    return Recording(*checked.unpacked(path))
