"""Teleoperation: references from an operator's hands, and the ways by which these come in."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from .follow import Follow
from .udp import UdpReceiver

if TYPE_CHECKING:
    from .webxr import WEBXR, OperatorPage

__all__ = ["WEBXR", "Follow", "OperatorPage", "UdpReceiver"]


def __getattr__(name: str) -> object:
    """The page needs the viewer's doors: import it on first use."""
    if name in ("WEBXR", "OperatorPage"):
        return getattr(importlib.import_module(f"{__name__}.webxr"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
