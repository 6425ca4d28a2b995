"""Access to the page: a real page and real clients, with foreign origins and names, with and without a token."""

from __future__ import annotations

import base64
import http.client
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

import hqp
from hqp import Level, Stack
from hqp.errors import HqpError, NetworkWarning
from hqp.tasks import Posture
from hqp.web.doors import NETWORK, Doors, is_loopback, listening

EVIL = "http://evil.example"
ROOT = Path(__file__).parents[2]


def make_session() -> hqp.Session:
    return hqp.Controller(Stack(Level(Posture()))).session(hqp.robots.load("ur5"), 0.002)


class Page:
    """A served page and its replies to clients."""

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        self.url, self.host, self.port = url, parts.hostname or "", parts.port or 0
        self.token = parts.query.removeprefix("token=")
        self.own = f"http://{self.host}:{self.port}"

    def get(self, path: str = "/", **headers: str) -> http.client.HTTPResponse:
        """The answer to a page request."""
        client = http.client.HTTPConnection(self.host, self.port, timeout=60.0)
        client.request("GET", path, headers=headers)
        response = client.getresponse()
        response.read()
        return response

    def connect(self, query: str = "", origin: str | None = None, host: str = "", **headers: str) -> int:
        """Status of a websocket's handshake: 101 if it is accepted and viser talks."""
        from websockets.exceptions import InvalidStatus
        from websockets.sync.client import connect

        viser = pytest.importorskip("viser")
        address = f"ws://{host or f'{self.host}:{self.port}'}/{query}"
        options: dict[str, Any] = {"origin": origin, "subprotocols": [f"viser-v{viser.__version__}"]}
        wire = socket.create_connection((self.host, self.port))
        try:
            with connect(address, sock=wire, additional_headers=headers, **options) as client:
                assert client.recv(timeout=60.0)
                return 101
        except InvalidStatus as error:
            return error.response.status_code


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    pytest.importorskip("viser")
    with hqp.view(make_session()) as view:
        yield Page(view.url)


def test_a_websocket_of_a_foreign_page_is_refused(page: Page) -> None:
    token = f"?token={page.token}"
    assert page.connect(token, page.own) == 101
    assert page.connect(token) == 101  # a program has no origin
    for foreign in (EVIL, "null", "http://localhost:3000", f"http://evil.example:{page.port}", page.own + "0"):
        assert page.connect(token, foreign) == 403, foreign
        assert page.connect("", foreign) == 403, foreign


def test_without_the_token_nothing_opens(page: Page) -> None:
    assert len(page.token) >= 32
    for query in ("", "?token=", f"?token={page.token[:-1]}", "?token=é", "?password=" + page.token):
        assert page.connect(query.replace("é", "%C3%A9"), page.own) == 403
        assert page.get("/" + query.replace("é", "%C3%A9")).status == 403
    assert page.get("/index.html").status == 403
    assert page.get(f"/?token={page.token}").status == 200
    assert page.get(f"/?token={page.token}", Origin=EVIL).status == 403


def test_the_page_hands_its_websocket_a_cookie(page: Page) -> None:
    answer = page.get(f"/?token={page.token}")
    cookie = answer.headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    given = cookie.split(";")[0]
    assert page.token not in cookie  # other ports of this host may read it
    assert page.get(f"/?token={given.partition('=')[2]}").status == 403
    assert page.connect("", page.own, Cookie=f"other=1; {given}") == 101
    assert page.get("/", Cookie=given).status == 200
    assert page.connect("", EVIL, Cookie=given) == 403
    assert page.connect("", page.own, Cookie=given[:-1]) == 403


def test_a_name_that_is_made_to_resolve_here_is_refused(page: Page) -> None:
    query = f"/?token={page.token}"
    rebound = f"evil.example:{page.port}"
    assert page.get(query, Host=rebound).status == 403
    assert page.connect(query[1:], f"http://{rebound}", host=rebound) == 403
    assert page.connect(query[1:], host=rebound) == 403
    for name in (f"localhost:{page.port}", "localhost:9000", "127.0.0.1", f"[::1]:{page.port}"):  # through a tunnel
        assert page.get(query, Host=name).status == 200, name
    for name in ("", "192.168.1.5", "localhost.evil.example", "evil.example@localhost", "127.0.0.1.nip.io", "[", "::"):
        assert page.get(query, Host=name).status == 403, name


@pytest.mark.long
def test_two_pages_have_two_ports_and_two_tokens(page: Page) -> None:
    with hqp.view(make_session()) as view:
        other = Page(view.url)
        assert other.port != page.port
        assert other.get(f"/?token={page.token}").status == 403
        assert page.token not in repr(view)
        assert other.token not in repr(view)


@pytest.mark.long
def test_a_browser_is_opened_with_a_token_that_is_good_once(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("viser")
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url) or True)
    with hqp.view(make_session()) as view:
        assert view.open()
        page, query = Page(view.url), "/?" + urlsplit(opened[0]).query
        assert page.token not in opened[0]
        given = page.get(query).headers["Set-Cookie"].split(";")[0]
        assert page.get(query).status == 403
        assert page.get(query, Cookie=given).status == 200  # reload of the tab


@pytest.mark.long
def test_a_host_of_the_network_warns_and_takes_the_password() -> None:
    pytest.importorskip("viser")
    with pytest.warns(NetworkWarning) as caught:
        view = hqp.view(make_session(), host="0.0.0.0", password="Grüße")
    assert str(caught[0].message) == NETWORK
    assert caught[0].filename == __file__
    with view:
        page = Page(view.url)
        assert page.get("/", Host="192.168.1.5").status == 401
        assert page.get("/").headers["WWW-Authenticate"].startswith("Basic")
        assert page.connect("", page.own) == 401

        def authorize(word: str) -> str:
            return "Basic " + base64.b64encode(f"me:{word}".encode()).decode()

        answer = page.get("/", Host="192.168.1.5", Authorization=authorize("Grüße"))
        assert answer.status == 200
        cookie = answer.headers["Set-Cookie"].split(";")[0]
        assert page.connect("", "http://192.168.1.5", host="192.168.1.5", Cookie=cookie) == 101
        assert page.connect("", EVIL, Authorization=authorize("Grüße")) == 403
        assert page.get("/", Host="evil.example", Authorization=authorize("Grüße")).status == 403
        start = time.monotonic()
        for wrong in ("", "grüße", "x"):
            assert page.get("/", Authorization=authorize(wrong)).status == 401
        assert time.monotonic() - start > 1.4, "passwords are tried at full speed"
        assert page.get("/", Authorization="Basic %%%").status == 401
        assert page.get(f"/?token={page.token}").status == 200


def test_the_warning_is_the_sentence_of_the_security_page() -> None:
    text = " ".join((ROOT / "SECURITY.md").read_text(encoding="utf-8").split())
    assert NETWORK in text


def test_a_host_that_is_none_is_told_at_once() -> None:
    pytest.importorskip("viser")
    for host in ("203.0.113.7", "no such host"):
        with pytest.raises(HqpError, match="not an address of this machine"):
            hqp.view(make_session(), host=host)
    with pytest.raises(HqpError, match="empty password"):
        hqp.view(make_session(), password="")


def test_addresses() -> None:
    assert all(map(is_loopback, ("localhost", "127.0.0.1", "127.1.2.3", "::1")))
    assert not any(map(is_loopback, ("", "0.0.0.0", "::", "192.168.1.5", "localhost.evil.example")))
    assert listening("localhost") == "127.0.0.1"
    assert listening("") == "0.0.0.0"
    assert "secret" not in repr(Doors("127.0.0.1", token="secret", password="secret", once="secret"))


@pytest.mark.long
def test_the_command_prints_an_address_that_opens() -> None:
    pytest.importorskip("viser")
    command = [sys.executable, "-m", "hqp", "view", str(ROOT / "examples/g1.toml"), "--robot", "g1", "--no-browser"]
    with subprocess.Popen([*command, "--host", "0.0.0.0"], stdout=-1, stderr=-1, text=True) as process:
        try:
            assert process.stdout is not None
            lines = []
            while not any("another machine" in line for line in lines):
                lines.append(process.stdout.readline())
                assert lines[-1], process.stderr.read() if process.stderr else ""
            url = re.search(r"open (\S+)", "".join(lines))
            assert url is not None
            page = Page(url.group(1))
            assert page.get("/").status == 403
            assert page.get(f"/?token={page.token}").status == 200
        finally:
            process.terminate()
            told = process.communicate()[1]
    assert NETWORK in told


@pytest.mark.parametrize("port", [-1, 65536, 1.5j, None])
def test_a_number_that_no_port_has_is_refused_at_once(port: Any) -> None:
    pytest.importorskip("viser")
    with pytest.raises(HqpError, match=r"bad port.*at most 65535"):
        hqp.view(make_session(), port=port)
