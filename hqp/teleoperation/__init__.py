"""Teleoperation: references from an operator's hands."""

from __future__ import annotations

from .follow import Follow

__all__ = ["Follow"]
