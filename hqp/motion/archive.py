"""Arrays of an npz file: no more memory than its bytes hold, and no objects."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

LARGEST = 2**30
"""Limit of the arrays that are read, unpacked, in all [bytes]: nine hours of 22 joints at 60 Hz."""


def read_arrays(path: Path, names: Sequence[str]) -> dict[str, Any]:
    """The arrays of these names that the file has; raises ValueError, or an error of zipfile, for a damaged file.

    Sizes are compared before memory is taken: a header may announce more than follows.
    """
    found: dict[str, Any] = {}
    with zipfile.ZipFile(path) as file:
        held = {info.filename.removesuffix(".npy"): info for info in file.infolist()}
        size = sum(held[name].file_size for name in names if name in held)
        if size > LARGEST:
            raise ValueError(f"it unpacks to {size} bytes, allowed {LARGEST}")
        for name in names:
            if name in held:
                with file.open(held[name]) as content:
                    found[name] = _read(name, content, held[name].file_size)
    return found


def _read(name: str, content: Any, size: int) -> Any:
    version = np.lib.format.read_magic(content)
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = header(content)
    if dtype.hasobject or math.prod(shape) * dtype.itemsize != size - content.tell():
        raise ValueError(f"{name} has objects, or another size than its header says")
    flat = np.frombuffer(bytearray(content.read()), dtype) if dtype.itemsize else np.zeros(math.prod(shape), dtype)
    return flat.reshape(shape[::-1]).T if fortran else flat.reshape(shape)
