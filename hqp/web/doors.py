"""Access control of the viewer's page: every request is checked before viser sees it.

A browser lets any web page open a websocket to this machine, and an attacker's host name may resolve to it.  So a
request needs a Host that is a name of this machine, no Origin but the page's own, and the token or the password.  An
admitted page gets a cookie, which its websocket sends.  Its value is not the token: a browser shows cookies to the
pages of all ports of a host, including those of other users of the machine.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import ipaddress
import re
import secrets
import socket
from dataclasses import dataclass, field
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

from hqp.errors import HqpError
from hqp.numbers import number

NETWORK = (
    "A page open to the network is not encrypted: anybody who reads its token or password there has full control. "
    "Use a trusted network or an SSH tunnel."
)
"""Warning of SECURITY.md for a host other than this machine alone."""

LOOPBACK = "127.0.0.1"
"""Host that only this machine reaches."""

_HOST = re.compile(r"(?:\[([0-9a-f:.]+)\]|([a-z0-9_.-]+))(?::[0-9]+)?")


def is_loopback(host: str) -> bool:
    """Return true if only this machine reaches an address, or the address of a name."""
    return host == "localhost" or ((ip := _ip(host)) is not None and ip.is_loopback)


def is_everywhere(host: str) -> bool:
    """Return true if an address stands for all of this machine's."""
    return (ip := _ip(host)) is not None and ip.is_unspecified


def listening(host: str) -> str:
    """The IP address to listen at for a host; raises HqpError if there is none.

    It is one address, because a name of two would get two ports; and viser tries port after port if it cannot listen.
    """
    try:
        where = socket.getaddrinfo(host or "0.0.0.0", 0, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        where.sort(key=lambda found: found[0] != socket.AF_INET)
        family, kind, protocol, _, place = where[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.bind(place)
    except OSError as error:
        raise HqpError(f"the page cannot be served at {host!r}, which is not an address of this machine") from error
    return str(place[0])


def checked_port(port: int) -> int:
    """The port of a page, 0 for any; raises DeclarationError for a number that no port has."""
    return int(number("page", "port", port, 0, most=65535))


def address(host: str, port: int, token: str = "") -> str:
    """The address of a page that is served at an IP address, as this machine reaches it."""
    if is_everywhere(host):
        host = "::1" if ":" in host else "127.0.0.1"
    return f"http://{f'[{host}]' if ':' in host else host}:{port}/" + (f"?token={token}" if token else "")


def _secret() -> str:
    return secrets.token_urlsafe(24)


@dataclass
class Doors:
    """Requirements on a request.

    host: IP address where the page is served; names: its other names.  token: secret in its address.  password:
    alternative to the token, none if empty.  once: a second token for one page, because every user of the machine can
    read the command line of the opened browser.  crumb: value of the cookie.
    """

    host: str
    names: tuple[str, ...] = ()
    password: str = field(default="", repr=False)
    token: str = field(default_factory=_secret, repr=False)
    once: str = field(default_factory=_secret, repr=False)
    crumb: str = field(default_factory=_secret, repr=False)

    def refusal(self, path: str, headers: Any) -> tuple[HTTPStatus, str] | None:
        """Reason of a refusal, None for an admitted request; headers: with ``get_all``, like those of websockets."""
        hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
        if len(hosts) != 1 or not self._is_own(hosts[0]):
            message = "this name is not one of the machine's own: open the page by its IP address"
            return HTTPStatus.FORBIDDEN, message
        own = (f"http://{hosts[0]}".lower(), f"https://{hosts[0]}".lower())
        if any(origin.lower() not in own for origin in origins):
            return HTTPStatus.FORBIDDEN, "a page from elsewhere may not talk to this one"
        if self._is_known(path, headers):
            return None
        if self.password:
            return HTTPStatus.UNAUTHORIZED, "enter the password, or open the full address with its token"
        return HTTPStatus.FORBIDDEN, "open the full address printed by hqp, with its token"

    def _is_own(self, host: str) -> bool:
        """Return true if a Host header names this machine; an IP address cannot be made to resolve to another one."""
        match = _HOST.fullmatch(host.lower())
        if match is None:
            return False
        name = match[1] or match[2]
        if is_loopback(name):
            return True
        if is_loopback(self.host):
            return False
        own = socket.gethostname().lower()
        return _ip(name) is not None or name in (own, own.partition(".")[0] + ".local", *map(str.lower, self.names))

    def _is_known(self, path: str, headers: Any) -> bool:
        for token in parse_qs(urlsplit(path).query).get("token", []):
            if _equal(token, self.token):
                return True
            if self.once and _equal(token, self.once):
                self.once = ""
                return True
        for line in headers.get_all("Cookie"):
            try:
                cookie = SimpleCookie(line).get(self.cookie)
            except CookieError:
                continue
            if cookie is not None and _equal(cookie.value, self.crumb):
                return True
        return bool(self.password) and any(map(self._is_password, headers.get_all("Authorization")))

    def _is_password(self, line: str) -> bool:
        kind, _, word = line.partition(" ")
        try:
            given = base64.b64decode(word, validate=True).decode().partition(":")[2]
        except (binascii.Error, UnicodeDecodeError):
            return False
        return kind.lower() == "basic" and _equal(given, self.password)

    @property
    def cookie(self) -> str:
        """Name of the cookie, different for each page, because all ports of a host share cookies."""
        return "hqp-" + hashlib.sha256(self.token.encode()).hexdigest()[:12]


def _ip(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        return None


def _equal(given: str, known: str) -> bool:
    return secrets.compare_digest(given.encode(), known.encode())
