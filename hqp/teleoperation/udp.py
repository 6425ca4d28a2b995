"""An operator's hands over UDP: one JSON object a datagram, with a token, on this machine alone."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Mapping
from contextlib import suppress
from threading import Thread

from hqp.errors import DeclarationError, HqpError

from .follow import Follow
from .messages import LARGEST, Hands

LOOPBACK = "127.0.0.1"


class UdpReceiver:
    """Takes datagrams, each a message as of ``Hands`` with a field ``token``, in a thread of its own.

    follows: sources of references by the hand's name.  port: 0 for any; ``port`` has the actual one.  token: made where
    none is given; ``token`` has it.  A datagram without it is refused, without an answer.  Only this machine is
    listened to.  Raises HqpError where the port is taken, DeclarationError for an empty token.
    """

    def __init__(self, follows: Mapping[str, Follow], *, port: int = 0, token: str | None = None) -> None:
        if token is not None and (not isinstance(token, str) or not token):
            raise DeclarationError("UdpReceiver", "an empty token", value=token, allowed="a text, or None")
        self.token = token or secrets.token_urlsafe(24)
        self.hands = Hands(follows, self.token)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((LOOPBACK, port))
        except OSError as error:
            self._socket.close()
            raise HqpError(f"cannot bind UDP port {port}: {error}") from error
        self.port = int(self._socket.getsockname()[1])
        self._thread = Thread(target=self._run, name="hqp udp", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while True:
            try:
                data, sender = self._socket.recvfrom(LARGEST + 1)
            except OSError:
                return  # closed
            self.hands.take(data, sender)

    def close(self) -> None:
        """Listen no more."""
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self._thread.join(timeout=1.0)

    def __enter__(self) -> UdpReceiver:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
