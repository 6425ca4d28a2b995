"""Sessions from a file (built from cpp/session)."""

import builtins
from collections.abc import Sequence

from numpy import int32
from numpy.typing import NDArray

from hqp.arrays import Mat, Vec

class PlanError(Exception):
    """The file is no plan of this version."""

class ReferenceError(ValueError):
    """A reference that does not fit."""

class Session:
    """A session of the bytes of a file; raises PlanError with a sentence."""

    nq: int
    nv: int
    dt: float
    robot: str
    names: Sequence[str]
    joint_names: Sequence[str]
    home: Sequence[float]
    sizes: tuple[int, int, int]
    """Numbers of a command, of x, and levels."""

    def __init__(self, file: bytes) -> None: ...
    def step(self, q: Vec, v: Vec, command: Vec, x: Vec, residuals: Vec) -> tuple[int, int, list[tuple[str, int, str]]]:
        """One tick into command, x and residuals: its status, how long it has been held, its notes."""

    def tell(self, reference: int, what: int, values: Vec) -> None:
        """What the next step is told: 0 a value, 1 velocity, 2 acceleration, 3 normal, 4 load; 5 a hold value."""

    def held(self, reference: int) -> Sequence[float]:
        """The hold value."""

    def integrate(self, q: Vec, v: Vec, dt: float, out: Vec) -> None:
        """q after moving with v for dt [s]."""

    def reset(self) -> None:
        """As just made."""

class Batch:
    """Worlds of the bytes of a file over threads; raises PlanError with a sentence."""

    sizes: tuple[int, int, int]
    """Numbers of a command, of x, and levels."""
    state: tuple[int, int]
    """nq and nv."""
    threads: int
    bytes: int

    def __init__(self, file: builtins.bytes, count: int, threads: int) -> None: ...
    def step(
        self,
        q: Mat,
        v: Mat,
        targets: Sequence[tuple[str, int, Mat]],
        commands: Mat,
        status: NDArray[int32],
        residuals: Mat,
        x: Mat,
    ) -> None:
        """One tick of all worlds, without the lock of the interpreter."""

    def reset(self, world: int) -> None:
        """As just made."""
