"""Who is let in to a page: the one gate before all that `operate` and `view` serve to browsers.

The token is the first part of the path, in the link that is printed. A browser sends it to this page alone; a cookie it
would send to every port of this machine. Whoever is refused is refused before the handshake: no socket, no file, no
byte of theirs is kept. viser and websockets are imported when a page is made: a vehicle needs none.
"""

from __future__ import annotations

import argparse
import hmac
import ipaddress
import logging
import os
import re
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout, suppress
from http import HTTPStatus
from importlib.util import find_spec
from io import StringIO
from typing import Any, NamedTuple
from urllib.parse import quote, unquote_to_bytes

from sphere_nav.geometry import SE3
from sphere_nav_tools.cli.constants import (
    GUESS_S,
    MAX_GUESSES,
    MAX_OUTSIDE,
    MAX_VISITORS,
    MIN_TOKEN,
)
from sphere_nav_tools.offline.settings import add

PORTS = {"view": 8080, "operate": 8081}
INSTALL = "pip install 'viser>=1.1,<2'"
TOKEN_VARIABLE = "SPHERE_NAV_TOKEN"
LOCAL_NAMES = frozenset(("localhost", "127.0.0.1", "[::1]"))
ANYWHERE = ("0.0.0.0", "::")
HOST = re.compile(r"(\[[0-9a-f:.]+\]|[^\[\]:@/\s]+)(:\d{1,5})?")
FOREIGN_SITES = ("cross-site", "same-site")  # another port is another page, too
Refusal = tuple[HTTPStatus, str]


class Address(NamedTuple):
    """Of a page: the command that serves it, where, and the token."""

    command: str
    host: str
    port: int
    token: str

    def link(self, port: int) -> str:
        """Return the link to the page at a port; served at all addresses, it has the name of this machine."""
        name = socket.gethostname() if self.host in ANYWHERE else bracketed(self.host)
        return f"http://{name}:{port}/{quote(self.token, safe='')}"


class Gate:
    """Judges requests by the host that they name, the page that they come from, and the token."""

    def __init__(self, host: str, token: str, acts: Mapping[str, Callable[[], str]] = {}) -> None:
        """`host`: the address that is served at; `acts`: what answers, at once, who asks for a path."""
        self._acts = acts
        self.is_closed = False  # whether the server asks it
        self._token, self._names = token.encode(), own_names(host)
        self._paid_at: dict[str, float] = {}  # by network: when its wrong tokens are forgotten, one each GUESS_S
        self._known = deque[int](maxlen=MAX_VISITORS)  # wrong ones: an old page that reconnects is no new guess

    def admit(self, connection: Any, request: Any) -> Any:
        """Return the answer that refuses a request; None where it goes on, the token taken off its path."""
        begin, _, rest = request.path.partition("?")[0].removeprefix("/").partition("/")
        here, visitor = connection.local_address[0], connection.remote_address[0]
        refusal = self.judge(unquote_to_bytes(begin), request.headers, here, visitor)
        if refusal is not None:
            return connection.respond(refusal[0], f"{refusal[1]}\n")
        connection.is_admitted, request.path = True, f"/{rest}"
        if rest in self._acts:
            return connection.respond(HTTPStatus.OK, self._acts[rest]())
        return None

    def judge(self, guess: bytes, headers: Any, here: str, visitor: str) -> Refusal | None:
        """Return why a request is refused; None: it is not. `here`: the address of ours that it has reached."""
        hosts, sites = headers.get_all("Host"), headers.get_all("Sec-Fetch-Site")
        if len(hosts) != 1 or not self._is_own(hosts[0].lower(), here):
            return HTTPStatus.FORBIDDEN, "Host: not a name of this page: use the printed link."
        own = (f"http://{hosts[0].lower()}", f"https://{hosts[0].lower()}")
        is_document = headers.get_all("Sec-Fetch-Dest") == ["document"]  # a link that was followed
        is_foreign = any(site in FOREIGN_SITES for site in sites) and not is_document
        if is_foreign or any(origin.lower() not in own for origin in headers.get_all("Origin")):
            return HTTPStatus.FORBIDDEN, "Origin: asked for by another page."
        return self._judge_token(guess, network_of(visitor))

    def _is_own(self, host: str, here: str) -> bool:
        """Whether a host is ours, at any port: one end of a tunnel may have another."""
        found = HOST.fullmatch(host)
        return found is not None and (found[1] in self._names or found[1] == bracketed(here))

    def _judge_token(self, guess: bytes, visitor: str) -> Refusal | None:
        refusal = HTTPStatus.FORBIDDEN, "This page needs its token: use the printed link."
        known = hash((visitor, guess))
        if not guess or known in self._known:
            return refusal
        now = time.monotonic()
        paid_at = max(self._paid_at.get(visitor, now), now)
        if paid_at - now > (MAX_GUESSES - 1) * GUESS_S:
            return HTTPStatus.TOO_MANY_REQUESTS, f"Too many wrong tokens from here: wait {MAX_GUESSES * GUESS_S:g} s."
        if hmac.compare_digest(guess, self._token):
            return None
        if visitor not in self._paid_at and len(self._paid_at) >= MAX_VISITORS:
            self._paid_at.pop(next(iter(self._paid_at)))
        self._paid_at[visitor] = paid_at + GUESS_S
        self._known.append(known)
        return refusal


def own_names(host: str) -> frozenset[str]:
    """Return what a page at an address may be called; the address that a request has reached is one in any case."""
    with suppress(ValueError):  # a name
        if host == "localhost" or ipaddress.ip_address(host).is_loopback:
            return LOCAL_NAMES
    machine = socket.gethostname().lower()
    return LOCAL_NAMES.union({machine, f"{machine}.local"}, () if host in ANYWHERE else {bracketed(host.lower())})


def bracketed(host: str) -> str:
    """Return an address as it stands in a link."""
    return f"[{host.partition('%')[0]}]" if ":" in host else host


def network_of(address: str) -> str:
    """Return whose guesses are counted together: an IPv4 address, a /64 of IPv6."""
    return str(ipaddress.ip_network((address.partition("%")[0], 64 if ":" in address else 32), strict=False))


def add_options(parser: argparse.ArgumentParser, command: str) -> None:
    """Declare where a command serves its page, and the token."""
    add(parser, "--host", "HOST", "address to serve at (%(default)s: this machine only)", default="127.0.0.1")
    add(parser, "--port", "PORT", f"port ({PORTS[command]}, or the next free one)", int)
    add(parser, "--token", "TOKEN", f"part of the link (a new one each time); also {TOKEN_VARIABLE}", default="")


def address_of(command: str, arguments: argparse.Namespace) -> Address:
    """Return where a command serves its page; ValueError before anything starts where it cannot."""
    if find_spec("viser") is None:
        raise ValueError(f"{command}: expected the package viser, found none: {INSTALL}")
    host, port = arguments.host, arguments.port
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        socket.create_server((host, port or 0), family=family).close()
    except (OSError, OverflowError) as error:
        named = f"--host {host}" if port is None else f"--host {host} --port {port}"
        raise ValueError(f"{named}: expected an address of this machine and a free port of it, found {error}") from None
    return Address(command, host, PORTS[command] if port is None else port, token_for(arguments.token))


def token_for(given: str) -> str:
    """Return the token of a page: the one that was given, that of the environment, or a new one."""
    found = given or os.environ.get(TOKEN_VARIABLE, "")
    if found and len(found) < MIN_TOKEN:
        raise ValueError(f"--token: expected {MIN_TOKEN} characters or more, found {len(found)}")
    return found or secrets.token_urlsafe(16)


def make_server(address: Address, acts: Mapping[str, Callable[[], str]] = {}) -> Any:
    """Return a server of pages behind its gate; ValueError where the gate cannot be put before it.

    `acts`: what a page may ask for without its websocket, by path.
    """
    import viser

    class Server(viser.ViserServer):
        def request_share_url(self, verbose: bool = True) -> str | None:
            """Refuse: no page goes through a tunnel of others because a browser asks for it."""
            return None

    gate = Gate(address.host, address.token, acts)
    with gated(gate), redirect_stdout(StringIO()):  # where viser tells a link without the token
        server = Server(address.host, address.port, label=f"sphere_nav {address.command}", verbose=False)
    if not gate.is_closed:
        server.stop()
        found = f"found {viser.__version__}: {INSTALL}"
        raise ValueError(f"{address.command}: expected a viser that websockets serves, {found}")
    return server


class WebPage:
    """A page behind the gate, for any number of browsers until `close`."""

    def __init__(self, address: Address, acts: Mapping[str, Callable[[], str]] = {}) -> None:
        """`acts`: as of `make_server`."""
        self.closed, self._address = threading.Event(), address
        self.server = make_server(address, acts)
        self.server.scene.set_up_direction("+z")

    @property
    def url(self) -> str:
        """The link that leads to it."""
        return self._address.link(int(self.server.get_port()))

    def close(self) -> None:
        """End the page and the threads of its browsers."""
        self.closed.set()
        self.server.stop()

    def has(self, client: Any) -> bool:
        """Whether a browser is still there."""
        return not self.closed.is_set() and client.client_id in self.server.get_clients()


def browser_pose(camera: Any) -> SE3:
    """Return T_map_camera of a browser's camera: z forward, x right, y down, as ours."""
    w, x, y, z = camera.wxyz
    return SE3.from_quaternion([x, y, z, w], camera.position)


@contextmanager
def gated(gate: Gate) -> Iterator[None]:
    """Put a gate before whatever websockets begins to serve meanwhile: viser has no way to hand it one."""
    from websockets.asyncio import server as module

    serve, connection_class = module.serve, doorway(module.ServerConnection)

    def serve_gated(*words: Any, process_request: Any, **options: Any) -> Any:
        gate.is_closed = True

        def process(connection: Any, request: Any) -> Any:
            return gate.admit(connection, request) or process_request(connection, request)

        return serve(*words, process_request=process, create_connection=connection_class, **options)

    logging.getLogger("websockets.server").addFilter(is_of_interest)
    setattr(module, "serve", serve_gated)  # noqa: B010
    try:
        yield
    finally:
        setattr(module, "serve", serve)  # noqa: B010


def is_of_interest(record: logging.LogRecord) -> bool:
    """Whether a line of websockets is more than noise that came in place of a request."""
    return record.msg != "opening handshake failed"


def doorway(base: Any) -> Any:
    """Return a kind of connection of which, while it is not admitted, there are a few only: the oldest goes."""

    class Doorway(base):
        is_admitted = False

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            outside = [one for one in self.server.handlers if not (one.is_admitted or one.transport.is_closing())]
            if len(outside) > MAX_OUTSIDE:
                outside[0].transport.abort()

    return Doorway
