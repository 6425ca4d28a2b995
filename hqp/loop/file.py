"""The file of a plan: a header line, then JSON; live arrays are places in numbered buffers.

docs/plan_file.md has the format.
"""

from __future__ import annotations

import dataclasses
import hmac
import json
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

import hqp
from hqp.errors import DeclarationError, HqpError
from hqp.kinds import file_path
from hqp.loop.document import Exported, document

if TYPE_CHECKING:
    from hqp.declare.stack import Stack
    from hqp.sequence import Sequence


Array: TypeAlias = NDArray[Any]

TYPES = {"f8", "i8", "i4", "i1"}
"""Types of buffers."""


@dataclasses.dataclass
class _Buffer:
    """Memory shared by arrays: its begin and end, and the type of its items."""

    begin: int
    end: int
    kind: str
    arrays: list[Array] = dataclasses.field(default_factory=list)


def plain(tree: Any, scratch: Iterable[Array] = ()) -> tuple[Any, list[dict[str, Any]]]:
    """A tree of objects as plain data, and the buffers with its arrays, which become places: {"@": [buffer, at, size]}.

    Dataclasses become dictionaries with their class.  scratch: arrays whose numbers do not matter.  Buffers are
    numbered in the order of their arrays; runs store the parts that are not zero.  Raises HqpError for an array that is
    not contiguous or of another type, or an object that is no data.
    """
    arrays: list[Array] = []
    _gather(tree, arrays)
    buffers = _buffers(arrays)
    found = _encoded(tree, buffers)
    empty = {_address(array) for array in scratch}
    return found, [_described(buffer, empty) for buffer in buffers]


def _gather(tree: Any, arrays: list[Array]) -> None:
    if isinstance(tree, np.ndarray):
        if tree.size:
            arrays.append(tree)
    elif dataclasses.is_dataclass(tree):
        for field in dataclasses.fields(tree):
            _gather(getattr(tree, field.name), arrays)
    elif isinstance(tree, Mapping):
        for value in tree.values():
            _gather(value, arrays)
    elif isinstance(tree, (list, tuple)):
        for value in tree:
            _gather(value, arrays)


def _address(array: Array) -> int:
    return int(array.__array_interface__["data"][0])


def _kind(array: Array) -> str:
    kind = array.dtype.str[1:]
    contiguous = array.flags.c_contiguous or array.flags.f_contiguous
    if kind not in TYPES or not contiguous:
        raise HqpError(f"a plan file stores contiguous arrays of {', '.join(sorted(TYPES))}, given {array.dtype}")
    return kind


def _buffers(arrays: list[Array]) -> list[_Buffer]:
    """Memory that arrays share, in the order in which they come up."""
    spans = sorted({(_address(a), _address(a) + a.nbytes, _kind(a)) for a in arrays})
    merged: list[_Buffer] = []
    for begin, end, kind in spans:
        last = merged[-1] if merged else None
        if last is not None and begin < last.end:
            if kind != last.kind:
                raise HqpError("a plan file cannot store two arrays of different types that share memory")
            last.end = max(last.end, end)
        else:
            merged.append(_Buffer(begin, end, kind))
    order: dict[int, _Buffer] = {}
    for array in arrays:
        buffer = _owner(merged, array)
        buffer.arrays.append(array)
        order.setdefault(id(buffer), buffer)
    return list(order.values())


def _owner(buffers: Iterable[_Buffer], array: Array) -> _Buffer:
    at = _address(array)
    return next(buffer for buffer in buffers if buffer.begin <= at < buffer.end)


def _encoded(tree: Any, buffers: list[_Buffer]) -> Any:
    if tree is None or isinstance(tree, (bool, str)):
        return tree
    if isinstance(tree, (int, np.integer)):
        return int(tree)
    if isinstance(tree, (float, np.floating)):
        return _number(float(tree))
    if isinstance(tree, np.bool_):
        return bool(tree)
    if isinstance(tree, np.ndarray):
        return _place(tree, buffers)
    if dataclasses.is_dataclass(tree) and not isinstance(tree, type):
        fields = {field.name: getattr(tree, field.name) for field in dataclasses.fields(tree)}
        return {"class": type(tree).__name__, **{name: _encoded(value, buffers) for name, value in fields.items()}}
    if isinstance(tree, Mapping):
        return {str(name): _encoded(value, buffers) for name, value in tree.items()}
    if isinstance(tree, (list, tuple)):
        return [_encoded(value, buffers) for value in tree]
    raise HqpError(f"a plan file cannot store a {type(tree).__name__}")


def _place(array: Array, buffers: list[_Buffer]) -> dict[str, list[int]]:
    if not array.size:
        return {"@": [0, 0, 0]}
    buffer = _owner(buffers, array)
    return {"@": [buffers.index(buffer), (_address(array) - buffer.begin) // array.itemsize, array.size]}


def _described(buffer: _Buffer, empty: set[int]) -> dict[str, Any]:
    """Type, size and runs [start, numbers] without zeros."""
    dtype = np.dtype(buffer.kind)
    values = np.zeros((buffer.end - buffer.begin) // dtype.itemsize, dtype)
    for array in buffer.arrays:
        if _address(array) not in empty:
            start = (_address(array) - buffer.begin) // dtype.itemsize
            values[start : start + array.size] = array.ravel(order="K")
    runs = []
    filled = np.flatnonzero(values)
    for run in np.split(filled, np.flatnonzero(np.diff(filled) > 1) + 1):
        if run.size:
            numbers = values[run[0] : run[-1] + 1].tolist()
            runs.append([int(run[0]), [_number(x) if isinstance(x, float) else x for x in numbers]])
    return {"type": buffer.kind, "size": int(values.size), "runs": runs}


def _number(x: float) -> float | str:
    """A number as JSON has it."""
    return x if math.isfinite(x) else "nan" if math.isnan(x) else "inf" if x > 0.0 else "-inf"


FORMAT = 1
"""Number of the format; it changes with the meaning of a file."""


def text(
    session: Exported,
    sequence: Sequence | None = None,
    key: bytes | None = None,
    stacks: Mapping[str, Stack] | None = None,
    more: Mapping[str, Any] | None = None,
) -> bytes:
    """The file of a session; equal declarations give equal bytes.

    key: signs it, None for no signature.  more: further parts of the file.
    """
    secret = key_bytes(key)
    tree, scratch = document(session, sequence, stacks)
    found, buffers = plain({**tree, **(more or {})}, scratch)
    body = json.dumps({**found, "buffers": buffers}, separators=(",", ":"), allow_nan=False).encode()
    head = f"hqp plan, format {FORMAT}, version {hqp.__version__}, size {len(body)}, hash {fnv1a(body):016x}"
    signature = f", hmac {hmac.digest(secret, body, 'sha256').hex()}" if secret else ""
    return f"{head}{signature}\n".encode() + body


def key_bytes(key: bytes | None) -> bytes:
    """The key of a site, empty for None; raises DeclarationError for anything but some bytes."""
    if key is not None and (not isinstance(key, bytes) or not key):
        kind = "empty" if isinstance(key, bytes) else type(key).__name__
        raise DeclarationError("plan", "bad key", value=kind, allowed="bytes, at least one, or None")
    return key or b""


def write(
    session: Exported,
    path: str | os.PathLike[str],
    sequence: Sequence | None = None,
    key: bytes | None = None,
    stacks: Mapping[str, Stack] | None = None,
    more: Mapping[str, Any] | None = None,
) -> None:
    """Write the file of a session, all of it or nothing."""
    target = file_path("plan", path)
    beside = target.with_name(f".{target.name}.{os.getpid()}")
    beside.write_bytes(text(session, sequence, key, stacks, more))
    os.replace(beside, target)


def fnv1a(data: bytes) -> int:
    """The FNV-1a hash of 64 bits; it detects damage, not forgery."""
    found = 0xCBF29CE484222325
    for byte in data:
        found = (found ^ byte) * 0x100000001B3 & 0xFFFFFFFFFFFFFFFF
    return found


def read(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The tree of a file."""
    content: dict[str, Any] = json.loads(Path(path).read_bytes().split(b"\n", 1)[1])
    return content
