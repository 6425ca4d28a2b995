"""The viewer's process: reads the shared memory of the loop, draws it, and returns dragged targets."""

from __future__ import annotations

import os
import pickle
import sys
import threading
import time
import traceback
from typing import Any

import numpy as np

from hqp.web.serve import tolerating_races

from .account import make_account
from .camera import PERIOD, Cameras
from .channel import Channel
from .description import RobotDescription, StackDescription
from .history import History
from .page import overlay, panel

NOTES_BELOW = "<style>.mantine-Notifications-root{top:auto!important;bottom:1em!important}</style>"
"""viser's own notes, for example on slow graphics, stand at the bottom of the scene: at the top is the page's
sentence."""

SCENE_PERIOD, PAGE_PERIOD = 1.0 / 30.0, 0.2
PANEL = "var(--hqp-panel, 27em)"
_UNITS = {"Velocity": "rad/s", "Acceleration": "rad/s²", "Torque": "N m"}


class Server:
    """One page for one session."""

    def __init__(self, about: dict[str, Any]) -> None:
        from hqp import robots
        from hqp.web.serve import serve

        from .scene import Scene

        self._about: RobotDescription = about["robot"]
        self._stack: StackDescription = about["stack"]
        self._title, self._budget = about["title"], 1e6 * about["dt"]
        self._channel = Channel(about["layout"], about["path"])
        self._robot = robots.load(pickle.loads(self._about.model))
        names = [self._robot.joint_name(c) for c in range(self._robot.nv)]
        self._joints = (tuple(names), *self._about.limits)
        self._history = History(self._stack)
        self._server = serve(about["doors"], about["port"])
        self._server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        self._server.gui.main_panel.dock_right()
        self._scene = Scene(self._server, self._about, self._robot, self._channel, about["drag"])
        self._scene.show_stack(self._stack, _contact_frames(self._stack))
        self._cameras = Cameras(self._server, self._scene.outline())
        self._server.gui.add_html(NOTES_BELOW)
        if about["control"]:
            self._add_loop_buttons()
        if about["drag"]:
            self._add_release_button()
        self._overlay = self._server.gui.add_html("")
        self._panel = self._server.gui.add_html("")
        self._forces: dict[str, Any] = {}
        self._snapshot: dict[str, Any] | None = None
        self._seen, self._turn = 0, 0
        self._look_at = self._show_at = 0.0
        self._errors: dict[str, tuple[float, str]] = {}
        self._before: tuple[float, dict[str, tuple[float, str]]] = (0.0, {})
        self._channel.set_ready(float(self._server.get_port()))

    def _add_loop_buttons(self) -> None:
        buttons = self._server.gui.add_button_group("Loop", ("Pause", "Step", "Run"))

        @buttons.on_click  # type: ignore[untyped-decorator,unused-ignore]
        def _(event: Any) -> None:
            choice = buttons.value
            if choice == "Step":
                self._channel.set_paused(True)
                self._channel.add_step()
            else:
                self._channel.set_paused(choice == "Pause")

    def _add_release_button(self) -> None:
        home = self._server.gui.add_button("Give targets back", hint="Let go of every dragged target")

        @home.on_click  # type: ignore[untyped-decorator,unused-ignore]
        def _(event: Any) -> None:
            for handle in self._scene.handles:
                handle.release()

    def run(self, alive: threading.Event) -> None:
        """Draw until the loop ends or its process does."""
        while alive.is_set() and not self._channel.closed:
            start = time.monotonic()
            with tolerating_races():
                self._read()
                if self._history.latest is not None and np.isfinite(self._history.part(0)).all():
                    self._draw(start)
            time.sleep(max(0.0, SCENE_PERIOD - (time.monotonic() - start)))
        self._server.stop()

    def _draw(self, now: float) -> None:
        """Move the scene; pictures and panels at their own periods."""
        motion = np.nan_to_num(self._history.part(1))
        self._errors = self._scene.update(self._history.part(0), motion, self._forces)
        if now >= self._look_at and not self._scene.in_hand:  # no picture moves under a hand
            self._look_at = now + PERIOD
            self._cameras.update(self._scene.outline(), self._scene.targets())
        if now >= self._show_at and self._snapshot is not None:
            self._show_at = now + PAGE_PERIOD
            self._show(self._snapshot)

    def _read(self) -> None:
        snapshot = self._channel.read_snapshot(self._turn)
        if snapshot is not None:
            self._turn, self._snapshot = snapshot
            self._forces = self._snapshot["forces"]
            if self._snapshot["version"] != self._stack.version:
                stack = pickle.loads(self._snapshot["stack"])
                self._history.restart(stack)
                self._scene.show_stack(stack, _contact_frames(stack))
                self._stack = stack
        count = self._channel.count
        self._history.add(self._channel.read(self._seen))
        self._seen = count

    def _show(self, snapshot: dict[str, Any]) -> None:
        state = self._robot.current
        assert state is not None
        motion = (state.angles, np.nan_to_num(self._history.part(1)))
        account = make_account(self._stack, snapshot, self._errors, self._joints, motion, self._closing())
        self._scene.show_apart(account.apart)
        curves = self._history.curves()
        unit = _UNITS.get(self._stack.formulation, "")
        self._overlay.content = overlay(account, curves, self._title, PANEL)
        self._panel.content = panel(account, curves, self._budget, unit)

    def _closing(self) -> dict[str, float]:
        """Rate of decrease of every target's distance [m/s, rad/s], since the last call."""
        now = time.monotonic()
        (then, before), self._before = self._before, (now, self._errors)
        dt = max(now - then, SCENE_PERIOD)
        return {name: (before[name][0] - e[0]) / dt for name, e in self._errors.items() if name in before}


def _contact_frames(stack: StackDescription) -> dict[str, str]:
    return {m.name: m.frame for m in stack.members if m.contact and m.frame}


def main() -> int:
    """Serve the session described on standard input until that is closed."""
    if hasattr(os, "nice"):
        os.nice(5)  # the loop comes first
    about = pickle.load(sys.stdin.buffer)
    alive = threading.Event()
    alive.set()

    def watch() -> None:
        while os.read(sys.stdin.fileno(), 4096):  # until the process that started this one ends; takes no lock
            pass
        alive.clear()

    threading.Thread(target=watch, daemon=True).start()
    try:
        server = Server(about)
    except Exception:
        traceback.print_exc()
        Channel(about["layout"], about["path"]).set_ready(-1.0)
        return 1
    server.run(alive)
    return 0
