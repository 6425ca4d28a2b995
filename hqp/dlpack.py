"""Arrays of other libraries through DLPack: a torch tensor on the CPU is read where it is, and one is returned."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hqp.errors import ProblemError

CPU = 1
"""The device type of DLPack whose memory the solver can read."""


def is_foreign(given: object) -> bool:
    """Return true for an array of another library than NumPy."""
    return hasattr(given, "__dlpack__") and not isinstance(given, (np.ndarray, np.generic))


def numbers(given: Any) -> Any:
    """Return a foreign array as a NumPy view of the same memory, anything else as it is.

    Raises ProblemError for an array on another device than the CPU.
    """
    if not is_foreign(given):
        return given
    device = given.__dlpack_device__()
    if int(device[0]) != CPU:
        raise ProblemError(f"an array on device {device} cannot be read: move it to the CPU first (tensor.cpu())")
    if getattr(given, "requires_grad", False):
        given = given.detach()  # no gradient goes through an active set
    return np.from_dlpack(given)


def first_foreign(*given: object) -> Any:
    """Return the first foreign array, None if there is none."""
    return next((one for one in given if is_foreign(one)), None)


def returned(array: NDArray[Any], like: Any) -> Any:
    """Return the array in the library and float type of ``like``, which shares its memory; itself for None."""
    if like is None:
        return array
    module = sys.modules[type(like).__module__.partition(".")[0]]
    made = module.from_dlpack(array)
    return made.to(like.dtype) if array.dtype.kind == "f" and hasattr(made, "to") else made
