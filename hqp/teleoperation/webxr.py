"""A page that turns a headset's or a phone's browser into an operator: hands and head over a websocket."""

from __future__ import annotations

import asyncio
import importlib
import json
from collections.abc import Mapping
from http import HTTPStatus
from importlib.resources import files
from threading import Event, Thread
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from hqp.declare.stack import Stack
from hqp.errors import HqpError
from hqp.tasks import Pose, Position
from hqp.web.doors import LOOPBACK, Doors, address, listening
from hqp.web.serve import checked

from .follow import Follow
from .messages import LARGEST, Hands

WEBXR = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""WebXR's axes (right, up, backwards) in a robot's (ahead, left, up): the ``frame`` of a Follow."""

SOCKET = "/operator"


def operators(stack: Stack) -> dict[str, Follow]:
    """Sources of references for the hands of a stack and its head, by device: left, right, head, phone.

    Each moves the first Position of three axes, or Pose, with a matching name or frame; if no name matches right, the
    right hand moves the first of the others.  A phone moves the task of the right hand.
    """
    elements = [e for level in stack.levels for e in level]
    tasks = [e for e in elements if isinstance(e, Pose) or (isinstance(e, Position) and e.axes == "xyz")]
    chosen: dict[str, Any] = {}
    for task in tasks:
        words = f"{task.name} {task.frame}".lower()
        side = next((side for side in ("left", "right", "head") if side in words), "other")
        chosen.setdefault(side, task)
    if "right" not in chosen and "other" in chosen:
        chosen["right"] = chosen["other"]
    made = {side: Follow(chosen[side], clutch=True, frame=WEBXR) for side in chosen if side != "other"}
    return {**made, "phone": made["right"]} if "right" in made else made


class OperatorPage:
    """Serves the page and receives its messages, in a thread of its own; ``url`` is its address, with the token.

    follows: sources of references by device: left, right, head of a headset, phone; made with ``clutch=True,
    frame=WEBXR``.  A hand counts while its grip is squeezed, a phone while its screen is touched.  doors: access
    control of the viewer; a token of its own where None is given.  A browser gives poses only to a page of its own
    machine or one over HTTPS: for a headset on a cable, ``adb reverse tcp:PORT tcp:PORT``.  Raises HqpError where
    websockets is missing or the port is taken.
    """

    def __init__(
        self, follows: Mapping[str, Follow], *, host: str = LOOPBACK, port: int = 0, doors: Doors | None = None
    ) -> None:
        self.hands = Hands(follows)
        self.doors = doors or Doors(listening(host), (host,))
        self._page = files("hqp.teleoperation").joinpath("operator.html").read_bytes()
        self._port, self._error, self._ready = port, "", Event()
        self._loop = asyncio.new_event_loop()
        self._end = asyncio.Event()
        try:
            self._library: Any = importlib.import_module("websockets.asyncio.server")
            self._response: Any = importlib.import_module("websockets.http11").Response
            self._headers: Any = importlib.import_module("websockets.datastructures").Headers
        except ImportError as error:
            raise HqpError("the operator's page needs websockets: pip install 'hqp[view]'") from error
        self._thread = Thread(target=self._run, name="hqp operator", daemon=True)
        self._thread.start()
        self._ready.wait(timeout=10.0)
        if self._error or not self._ready.is_set():
            raise HqpError(f"the operator's page did not start: {self._error or 'no answer'}")

    @property
    def url(self) -> str:
        """Address of the page on this machine, with the token that opens it."""
        return address(self.doors.host, self._port, self.doors.token)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        except OSError as error:
            self._error = str(error)
            self._ready.set()
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        server = self._library.serve(
            self._talk, self.doors.host, self._port, process_request=checked(self.doors, self._answer), max_size=LARGEST
        )
        async with server as running:
            self._port = running.sockets[0].getsockname()[1]
            self._ready.set()
            await self._end.wait()

    def _answer(self, connection: Any, request: Any) -> Any:
        """The page; None lets a websocket go on."""
        path = urlsplit(request.path).path
        if path == SOCKET:
            return None
        if path != "/":
            return connection.respond(HTTPStatus.NOT_FOUND, "There is one page here.\n")
        headers = self._headers({"Content-Type": "text/html; charset=utf-8", "Content-Length": str(len(self._page))})
        return self._response(HTTPStatus.OK.value, HTTPStatus.OK.phrase, headers, self._page)

    async def _talk(self, connection: Any) -> None:
        """Take messages of a connection, and answer if it is refused, or no longer."""
        answered = ""
        try:
            async for message in connection:
                refused = "" if self.hands.take(message, connection) is not None else self.hands.fault
                if refused != answered:
                    answered = refused
                    await connection.send(json.dumps({"refused": refused}))
        finally:
            self.hands.leave(connection)

    def close(self) -> None:
        """Stop the page."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._end.set)
            self._thread.join(timeout=5.0)

    def __enter__(self) -> OperatorPage:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
