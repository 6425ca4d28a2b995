"""See a session in a browser: the robot, what is asked of it, and what holds what back."""

from __future__ import annotations

from typing import Any

from .session_view import View

__all__ = ["View", "view"]


def view(session: Any, *, host: str = "127.0.0.1", port: int = 8080, period: float = 0.1, title: str = "") -> View:
    """Open a page that shows a session; see View."""
    return View(session, host=host, port=port, period=period, title=title)
