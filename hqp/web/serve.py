"""viser's server behind the doors."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import importlib
import io
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

from hqp.errors import HqpError
from hqp.web.doors import Doors, address


def serve(doors: Doors, port: int) -> Any:
    """A viser server behind these doors, at that port or the next that is free, 0 for any."""
    import viser  # pyright: ignore[reportMissingImports]

    class Closed(viser.ViserServer):  # type: ignore[misc,unused-ignore]
        def request_share_url(self, verbose: bool = True) -> None:
            """Refuse a public tunnel, which any client may request from viser."""

    with _guarded(doors), contextlib.redirect_stdout(io.StringIO()):  # viser prints an address without the token
        server = Closed(host=doors.host, port=port, verbose=False, label="hqp")
    _require_closed(doors, server.get_port())
    return server


@contextmanager
def tolerating_races() -> Iterator[None]:
    """Leave the rest of a drawing to the next one if viser's loop changes the waiters of its event meanwhile.

    viser sets an ``asyncio.Event`` from the caller's thread, which may raise RuntimeError once the message is queued.
    """
    try:
        yield
    except RuntimeError as error:
        if "mutated during iteration" not in str(error):
            raise


@contextmanager
def _guarded(doors: Doors) -> Iterator[None]:
    """Put servers that viser starts meanwhile behind these doors.

    viser passes its own ``process_request`` to ``websockets.asyncio.server.serve`` inside a thread and takes none from
    its caller, so this replaces ``serve`` while viser starts.  A proxy would leave viser's port open.
    """
    library: Any = importlib.import_module("websockets.asyncio.server")
    original = library.serve

    def serve_guarded(*arguments: Any, process_request: Any, **options: Any) -> Any:
        return original(*arguments, process_request=checked(doors, process_request), **options)

    library.serve = serve_guarded
    try:
        yield
    finally:
        library.serve = original


def checked(doors: Doors, answer: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Awaitable[Any]]:
    """A ``process_request`` of websockets that checks a request and passes it on to ``answer``."""
    turn = asyncio.Lock()

    async def process_request(connection: Any, request: Any) -> Any:
        refusal = doors.refusal(request.path, request.headers)
        if refusal is not None:
            if "Authorization" in request.headers:
                async with turn:  # one password at a time, two per second
                    await asyncio.sleep(0.5)
            response = connection.respond(refusal[0], f"Refused: {refusal[1]}.\n")
            if refusal[0] is HTTPStatus.UNAUTHORIZED:
                response.headers["WWW-Authenticate"] = 'Basic realm="hqp view: any name, and the password"'
            return response
        response = answer(connection, request)
        if response is not None:
            response.headers["Set-Cookie"] = f"{doors.cookie}={doors.crumb}; Path=/; HttpOnly; SameSite=Strict"
            response.headers["Referrer-Policy"] = "no-referrer"
            response.headers["Content-Security-Policy"] = "frame-ancestors 'self'"
            response.headers["Cache-Control"] = "no-store"
        return response

    return process_request


def _require_closed(doors: Doors, port: int) -> None:
    """Raise HqpError if the page opens without a token: another version of viser may serve it in another way."""
    connection = http.client.HTTPConnection(urlsplit(address(doors.host, port)).hostname or "", port, timeout=10.0)
    try:
        connection.request("GET", "/")
        status = connection.getresponse().status
    finally:
        connection.close()
    if status not in (HTTPStatus.FORBIDDEN, HTTPStatus.UNAUTHORIZED):
        raise HqpError(f"the page would be open to everybody (HTTP {status}): this viser is not one that hqp knows")
