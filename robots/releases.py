"""Pinocchio 2.7 under the names of Pinocchio 3: the last on PyPI beside NumPy 1.26, as Isaac Lab has it."""

from __future__ import annotations

import copyreg
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

CURRENT = hasattr(pin, "Convention")


def _pickled(model: Any) -> tuple[Any, ...]:
    """Pickle a model as its binary file; the text that 2.7 pickles loses infinite limits."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model"
        model.saveToBinary(str(path))
        return _unpickled, (path.read_bytes(),)


def _unpickled(data: bytes) -> Any:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model"
        path.write_bytes(data)
        model = pin.Model()
        model.loadFromBinary(str(path))
        return model


def _set_armature(model: Any, armature: Any) -> None:
    model.rotorInertia = armature


if not CURRENT:
    copyreg.pickle(pin.Model, _pickled)
    pin.Frame.parentJoint = property(lambda frame: frame.parent)
    pin.Model.armature = property(lambda model: model.rotorInertia, _set_armature)  # no algorithm of 2.7 reads it


def crba(model: Any, data: Any, q: Any) -> None:
    """Compute the upper triangle of the inertia matrix M ``(nv, nv)``, armature included, into data.M."""
    if CURRENT:
        pin.crba(model, data, q, pin.Convention.WORLD)
    else:
        pin.crba(model, data, q)
        data.M[np.diag_indices(model.nv)] += model.rotorInertia
