"""Constraints between two frames of the robot, which may coincide by declaration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from hqp.declare.element import Element

from .fields import check_frame


@dataclass(frozen=True, kw_only=True)
class _TwoFrames(Element):
    """``frame`` and ``relative_to`` of a subclass, two different frames; ``closed``: they coincide."""

    if TYPE_CHECKING:
        frame: str
        relative_to: str | None
    closed: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.relative_to is None:
            raise self.invalid("relative_to", None, "the name of the other frame")
        check_frame(self, "relative_to", self.relative_to)
        if self.relative_to == self.frame:
            raise self.invalid("relative_to", self.relative_to, f"a frame other than {self.frame!r}")
        if not isinstance(self.closed, bool):
            raise self.invalid("closed", self.closed, "True or False")

    def default_name(self) -> str:
        """Both frames."""
        return f"{self.frame}_{self.relative_to}"

    @property
    def declares_hold(self) -> bool:
        """True if the frames coincide by declaration."""
        return self.closed
