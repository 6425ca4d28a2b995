"""Checks of a recording file: types, shapes and numbers, each refused by its place in the file."""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from hqp.arrays import Mask
from hqp.errors import DeclarationError, HqpError
from hqp.explanation.counters import Counters
from hqp.problem import Hierarchy, Selection, Status
from hqp.recorder.layout import from_pattern

FORMAT = 1

LARGEST = 2**32
"""Limit of the memory for the arrays of a file, in all [bytes]."""

MOST = 1e100
"""Numbers of a solved tick are smaller: their products are numbers, too."""

NUMBERS = ("q", "v", "command", "x", "solved")
"""Arrays of a segment that have a row a tick."""

KINDS = ("velocity", "acceleration", "torque")
STATUSES = tuple(status.name for status in Status)
WORDS = {str: "text", int: "an integer", float: "a number", bool: "true or false", list: "a list", dict: "a table"}


def refuse(where: str, message: str, value: object = None, allowed: str = "") -> NoReturn:
    """Raise DeclarationError."""
    raise DeclarationError("recording", f"{where}: {message}", value=value, allowed=allowed)


def unpacked(path: str | Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The text of a file as JSON, and its arrays by name; raises DeclarationError for a file that is not a
    recording."""
    try:
        with zipfile.ZipFile(path) as file:
            size = sum(info.file_size for info in file.infolist())
            if size > LARGEST:
                raise ValueError(f"it unpacks to {size} bytes, allowed {LARGEST}")
            header = json.loads(file.read("recording.json"))
            names = [info.filename for info in file.infolist() if info.filename != "recording.json"]
            arrays = {name.removesuffix(".npy"): _array(file, name) for name in names}
    except Exception as error:  # zipfile, zlib, NumPy and json raise various errors for a damaged file
        raise DeclarationError("recording", f"not a recording: {error}", value=str(path)) from error
    if not isinstance(header, dict) or header.get("format") != FORMAT or header.get("kind") != "recording":
        given = header.get("format") if isinstance(header, dict) else header
        raise DeclarationError("recording", "unknown format", value=given, allowed=str(FORMAT))
    return header, arrays


def _array(file: zipfile.ZipFile, name: str) -> Any:
    """A float64 array; its size is that of the data in the file, not that of its header."""
    with file.open(name) as content:
        version = np.lib.format.read_magic(content)
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = header(content)
        data = bytearray(content.read())
    if dtype != np.dtype("<f8") or len(data) != 8 * math.prod(shape):
        raise ValueError(f"{name} is not an array of float64 of its declared size")
    flat = np.frombuffer(data)
    return flat.reshape(shape[::-1]).T if fortran else flat.reshape(shape)


def take(table: Any, name: str, kind: type, where: str) -> Any:
    """The value of that name, of that kind; raises DeclarationError."""
    if not isinstance(table, dict):
        refuse(where, "is not a table", table)
    value = table.get(name)
    fits = type(value) is kind or (kind is float and type(value) is int)
    if not fits or (type(value) is int and abs(value) > 2**53):
        refuse(f"{where}.{name}", "missing or of another type", value, WORDS[kind])
    return value


def texts(table: Any, name: str, where: str) -> list[str]:
    """A list of text."""
    found: list[str] = take(table, name, list, where)
    if not all(isinstance(item, str) for item in found):
        refuse(f"{where}.{name}", "is not a list of strings", found)
    return found


def about(header: dict[str, Any]) -> None:
    """Check the header of a recording; raises DeclarationError."""
    for name in ("stack", "toml", "made", "hqp"):
        take(header, name, str, "file")
    dt = take(header, "dt", float, "file")
    if not 0.0 < dt < math.inf:
        refuse("file.dt", "is not a control period [s]", dt, "dt > 0")
    robot = take(header, "robot", dict, "file")
    for name in ("name", "hash"):
        take(robot, name, str, "robot")
    for name in ("joints", "tangent"):
        texts(robot, name, "robot")
    if not take(header, "segments", list, "file"):
        refuse("file.segments", "there is no tick in it")
    if header.get("counters") is not None:
        _counters(header)


def _counters(header: dict[str, Any]) -> None:
    counters = take(header, "counters", dict, "file")
    if set(counters) != set(Counters._fields):
        refuse("file.counters", "other counters", sorted(counters), ", ".join(Counters._fields))
    for name in Counters._fields:
        value = take(counters, name, float, "counters")
        if not 0.0 <= value < math.inf:
            refuse(f"counters.{name}", "is not a count or a time [s]", value, "0 or above")


def segment(part: Any, arrays: dict[str, Any], robot: dict[str, Any], where: str) -> tuple[Hierarchy, list[Any]]:
    """The pattern of a segment and the arrays of its rows; raises DeclarationError for a misfit."""
    if take(part, "kind", str, where) not in KINDS:
        refuse(f"{where}.kind", "unknown", part["kind"], ", ".join(KINDS))
    number, pattern = take(part, "number", int, where), take(part, "pattern", dict, where)
    ticks = take(part, "ticks", list, where)
    if not ticks:
        refuse(f"{where}.ticks", "there is no tick in it")
    k, n = len(ticks), take(pattern, "n", int, f"{where}.pattern")
    sizes = {"v": len(robot["tangent"]), "command": len(robot["joints"]), "x": n, "solved": n}
    for name in NUMBERS:
        found = arrays.get(f"{number}_{name}")
        shape = (k, sizes.get(name, 0 if found is None else found.shape[-1] if found.ndim else 0))
        if found is None or found.shape != shape:
            refuse(f"array {number}_{name}", "missing, or of another shape", None if found is None else found.shape)
    columns = []
    for i, rows in enumerate(_shapes(pattern, n, f"{where}.pattern")):
        found = arrays.get(f"{number}_rows_{i}")
        if found is None or found.shape != (k, *rows):
            given = None if found is None else found.shape
            refuse(f"array {number}_rows_{i}", "missing, or of another shape", given, str((k, *rows)))
        columns.append(found)
    try:
        made = from_pattern(pattern)
    except (HqpError, ValueError, TypeError, KeyError, OverflowError) as error:
        refuse(f"{where}.pattern", str(error))
    for i, tick in enumerate(ticks):
        _tick(tick, f"{where}.ticks[{i}]")
        stages = arrays.get(f"{number}_stages_{i}")
        if stages is not None and (stages.shape != (len(made.levels), n) or np.any(np.abs(stages) >= MOST)):
            fault = "has another shape or numbers that are too large"
            refuse(f"array {number}_stages_{i}", fault, stages.shape, str((len(made.levels), n)))
    usable = np.array([bool(tick["solved"]) and Status[tick["solved"]].usable for tick in ticks])
    if not np.all(np.abs(arrays[f"{number}_solved"][usable]) < MOST):
        refuse(f"array {number}_solved", "a sent command is not finite")
    _numbers(made, columns, usable, f"array {number}_rows")
    _places(part, made, where)
    return made, columns


def _shapes(pattern: dict[str, Any], n: int, where: str) -> Sequence[tuple[int, ...]]:
    """Shapes of the arrays of a tick in the order of ``layout.arrays_of``, before any is made."""
    found: list[tuple[int, ...]] = []
    take(pattern, "constraints", int, where)
    for level in take(pattern, "levels", list, where):
        if isinstance(level, dict) and "shape" in level:
            size = tuple(_integers(level, "shape", f"{where}.levels"))
            if len(size) != 2 or min(size) < 0:
                refuse(f"{where}.levels", "a shape is two numbers", size)
            found.append(size)
        else:
            size = (len(_integers(level, "index", f"{where}.levels")),)
            take(level, "scale", list, f"{where}.levels")
        found += [size[:1], size[:1]]
    for name, shape in (("metric", (n, n)), ("origin", (n,))):
        if take(pattern, name, bool, where):
            found.append(shape)
    if pattern.get("motion") is not None:
        motion = take(pattern, "motion", dict, where)
        F = tuple(_integers(motion, "F", f"{where}.motion"))
        if not 1 <= len(F) <= 2 or min(F) < 0:
            refuse(f"{where}.motion", "F is a vector or a matrix", F)
        found += [F, F[:1]] if take(motion, "f", bool, f"{where}.motion") else [F]
    return found


def _integers(table: Any, name: str, where: str) -> list[int]:
    found: list[int] = take(table, name, list, where)
    if not all(type(item) is int and abs(item) < 2**53 for item in found):
        refuse(f"{where}.{name}", "is not a list of integers", found)
    return found


def _numbers(pattern: Hierarchy, columns: list[Any], usable: Mask, where: str) -> None:
    """Check that rows of a solved tick have finite entries, and no lower bound above its upper one."""
    bounds: set[int] = set()
    i = 0
    for rows in pattern.levels:
        i += 0 if isinstance(rows.A, Selection) else 1
        lower, upper = columns[i][usable], columns[i + 1][usable]
        if not np.all((lower <= upper) & (lower < MOST) & (upper > -MOST)):
            refuse(f"{where}_{i}", "bounds are NaN or lower > upper")
        bounds |= {i, i + 1}
        i += 2
    for j, column in enumerate(columns):
        sizes = np.abs(column[usable])
        if not np.all((sizes < MOST) | ((sizes == np.inf) & (j in bounds))):
            refuse(f"{where}_{j}", "a number is not finite or too large")
    scales = [rows.A.scale for rows in pattern.levels if isinstance(rows.A, Selection)]
    for values in (*scales, pattern.prices, pattern.turning):
        if values is not None and np.any(np.abs(values) >= MOST):
            refuse("pattern", "a scale or price is too large", values.tolist())
    motion = pattern.motion
    if motion is not None and motion.F.ndim == 1:
        j = len(columns) - (1 if motion.f is None else 2)
        if not np.all(columns[j][usable] > 0.0):
            refuse(f"{where}_{j}", "a diagonal of motion is not positive")


def _tick(tick: Any, where: str) -> None:
    for name in ("count", "held"):
        take(tick, name, int, where)
    take(tick, "transition", float, where)
    if take(tick, "status", str, where) not in STATUSES or take(tick, "solved", str, where) not in ("", *STATUSES):
        refuse(where, "unknown status", [tick["status"], tick["solved"]], ", ".join(STATUSES))
    for note in take(tick, "notes", list, where):
        if not (isinstance(note, list) and len(note) == 3 and all(isinstance(word, str) for word in note)):
            refuse(f"{where}.notes", "a note is element, status and text", note)
        if note[1] not in STATUSES:
            refuse(f"{where}.notes", "unknown status", note[1], ", ".join(STATUSES))
    for reference in take(tick, "references", list, where):
        take(reference, "name", str, f"{where}.references")
        for name in ("value", "velocity", "acceleration"):
            try:
                np.array(reference.get(name, 0.0), dtype=np.float64)
            except (ValueError, TypeError, OverflowError):
                refuse(f"{where}.references.{name}", "is not an array of numbers", reference[name])


def _places(part: dict[str, Any], pattern: Hierarchy, where: str) -> None:
    names: set[str] = set()
    for i, place in enumerate(take(part, "places", list, where)):
        here = f"{where}.places[{i}]"
        for name in ("name", "type", "declared"):
            take(place, name, str, here)
        take(place, "equality", bool, here)
        weight = take(place, "weight", float, here)
        level, start, stop = (take(place, name, int, here) for name in ("level", "start", "stop"))
        texts(place, "rows", here)  # as many as named rows
        if not 0 <= level < len(pattern.levels) or not 0 <= start <= stop <= pattern.levels[level].m:
            refuse(here, "lies outside the levels", [level, start, stop])
        if place["name"] in names or not 0.0 < weight < MOST:
            refuse(here, "its name is duplicate or its weight is not positive", [place["name"], weight])
        names.add(place["name"])
