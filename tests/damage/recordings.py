"""Damage to recordings: bytes of the file, values of its JSON, arrays and their headers."""

from __future__ import annotations

import io
import json
import random
import zipfile
from typing import Any

import numpy as np

from tests.damage import text

VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 1, 10**6, 2**40, 2**70, 10**400, 1e308, float("nan"), float("inf"), "", "x", "OPTIMAL", [], [1],
    [[1, 2], [3]], [2**40, 2**40], {}, {"x": 1},
)  # fmt: skip
SHAPES = ((), (0,), (2**40,), (10**8, 10**8), (-1,), (1, 2, 3, 4), (3, 0, 2**50), (2**63, 2**63))


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Damage the file of a recording in one to three places."""
    if rng.random() < 0.2:
        return text.bytes_of(data, rng)
    with zipfile.ZipFile(io.BytesIO(data)) as file:
        members = {name: file.read(name) for name in file.namelist()}
    for _ in range(rng.choice((1, 1, 2, 3))):
        if rng.random() < 0.6:
            told = json.loads(members["recording.json"])
            _value(told, rng)
            members["recording.json"] = json.dumps(told).encode()
        else:
            name = rng.choice([name for name in members if name.endswith(".npy")])
            members[name] = _array(members[name], rng)
            if rng.random() < 0.2:
                members.pop(name)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file:
        for name, content in members.items():
            file.writestr(name, content)
    return out.getvalue()


def _value(told: Any, rng: random.Random) -> None:
    """Replace, remove or double a value somewhere in JSON."""
    while True:
        keys = list(told) if isinstance(told, dict) else list(range(len(told)))
        key = rng.choice(keys)
        inside = told[key]
        if isinstance(inside, (dict, list)) and inside and rng.random() < 0.85:
            told = inside
            continue
        kind = rng.randrange(4)
        if kind == 0:
            del told[key]
        elif kind == 1 and isinstance(told, list):
            told.append(inside)
        else:
            told[key] = rng.choice(VALUES)
        return


def _array(content: bytes, rng: random.Random) -> bytes:
    """Change the header or the numbers, or drop bytes."""
    try:
        array = np.load(io.BytesIO(content))
    except Exception:  # damaged before
        return content
    kind = rng.randrange(5)
    if kind == 0:
        return text.bytes_of(content, rng)
    if kind == 1:
        array = array.astype(rng.choice((np.float32, np.int64, ">f8", np.complex128, "U3")))
    elif kind == 2:
        array = array.reshape(rng.choice(((-1,), (1, -1), array.shape[::-1], (*array.shape, 1))))
    elif kind == 3 and array.size:
        array.flat[rng.randrange(array.size)] = rng.choice((np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-320))
    out = io.BytesIO()
    if kind == 4:
        said = {"descr": "<f8", "fortran_order": rng.random() < 0.5, "shape": rng.choice(SHAPES)}
        np.lib.format.write_array_header_1_0(out, said)
        return out.getvalue() + array.tobytes()
    np.lib.format.write_array(out, array)
    return out.getvalue()
