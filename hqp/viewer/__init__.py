"""See a session in a browser: the robot, its targets, and the levels that limit each other."""

from __future__ import annotations

from typing import Any

from hqp.web.doors import LOOPBACK

from .session_view import View

__all__ = ["View", "view"]


def view(
    session: Any,
    *,
    control: bool = False,
    host: str = LOOPBACK,
    port: int = 0,
    password: str | None = None,
    period: float = 0.1,
    title: str = "",
) -> View:
    """Open a page that shows a session; see View."""
    return View(session, control=control, host=host, port=port, password=password, period=period, title=title)
