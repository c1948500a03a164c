"""The web server of the page: viser's, restricted to its own pages and to its own addresses.

viser has no option for either, so it listens at an address that nobody knows, and a proxy, which
browsers reach, checks every request.
"""

from __future__ import annotations

import asyncio
import errno
import http.client
import re
import secrets
import socket
from collections.abc import Callable, Sequence
from http import HTTPStatus
from ipaddress import ip_address
from types import ModuleType
from typing import Any, Final

from websockets.asyncio.client import connect
from websockets.asyncio.connection import Connection
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.output import printable

LOCAL: Final = ("localhost", "127.0.0.1", "::1")
"""Names of this machine; the first one is the default."""

MISSING: Final = (
    "the page in a browser needs the package viser, which is not installed: "
    "pip install 'viser>=1.1,<1.2'"
)

_ASKED: Final = re.compile(r"(?P<name>\[[0-9a-f:.]+\]|[a-z0-9._-]+)(:\d{1,5})?", re.IGNORECASE)
"""Header ``Host``: a name, an IPv4 address or an IPv6 address in brackets, and a port."""


def load_viser() -> ModuleType:
    """The ``viser`` package.

    Raises:
        UsageError: it is not installed.
    """
    try:
        import viser
    except ImportError as error:
        raise UsageError(MISSING) from error
    module: ModuleType = viser
    return module


def open_server(host: str, port: int) -> Any:
    """Start a viser server, at the next free port if ``port`` is taken.

    The page can change a running estimator, so the server refuses connections that other web
    pages open, see ``allowed``.  viser's tunnel to a public server is off.

    Args:
        host: address to listen on; a name in ``LOCAL`` for this machine only.
        port: TCP port; 0 for any.

    Raises:
        UsageError: viser is not installed, or this machine does not have the address.
    """
    viser = load_viser()
    import rich

    class Server(viser.ViserServer):  # type: ignore[misc, name-defined]
        """A server behind a proxy, without a tunnel to a public address."""

        def __init__(self) -> None:
            """Start both."""
            secret = secret_address()
            super().__init__(host=secret, port=0, verbose=False)
            self._proxy = Proxy(secret, super().get_port(), lambda *of: allowed(host, *of))
            try:
                self._in_loop(self._proxy.listen(host, port))
            except (OSError, UnicodeError):
                super().stop()
                raise

        def _in_loop(self, work: Any) -> None:
            asyncio.run_coroutine_threadsafe(work, self.get_event_loop()).result()

        def get_port(self) -> int:
            """Port of the proxy."""
            return self._proxy.port

        def stop(self) -> None:
            """Stop both."""
            self._in_loop(self._proxy.close())
            super().stop()

        def request_share_url(self, verbose: bool = True) -> None:
            """Refuse."""

    rich.reconfigure(quiet=True)  # viser prints a box with addresses
    try:
        return Server()
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UsageError(f"cannot listen on host {printable(host)!r}: {reason}") from None


def address_of(server: Any, host: str) -> str:
    """Address of the page."""
    name = "localhost" if host in ("0.0.0.0", "::") else host
    shown = f"[{name}]" if ":" in name else name
    return f"http://{shown}:{server.get_port()}"


def allowed(host: str, asked: str | None, origin: str | None) -> bool:
    """Whether a request is answered.

    A web page of another server reaches this one under its own name if that name is made to stand
    for this machine's address.  So the browser must have asked for ``host`` itself or, if the
    server listens beyond this machine, for a numeric address or a name that the machine gives
    itself; and the page that opens a connection must be that of the same address.

    Args:
        host: address that the server listens on.
        asked: header ``Host`` of the request.
        origin: header ``Origin``, with which a browser names the page that opens a connection.
    """
    match = _ASKED.fullmatch(asked or "")
    if match is None:
        return False
    name = match["name"].strip("[]").lower().removesuffix(".")
    if name not in (*LOCAL, host.lower()):
        own = socket.gethostname().lower()
        if host in LOCAL or not (_is_address(name) or name in (own, f"{own}.local")):
            return False
    return origin is None or origin == f"http://{asked}"


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


POLICY: Final = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob:; worker-src blob:; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data: blob:; "
    "connect-src 'self' data: blob: ws://{asked}; frame-src 'none'; frame-ancestors 'none'; "
    "base-uri 'none'; form-action 'none'"
)
"""Content security policy: nothing is loaded from, sent to or shown in another page.

The client of viser is a script in its page, so scripts in the page cannot be forbidden.
"""

MOST_PORTS: Final = 1000
"""Ports that are tried where the first ones are taken."""

LARGEST: Final = 50 * 1024 * 1024
"""Largest message [bytes], viser's own limit."""

TIMEOUT_S: Final = 30.0
"""Time in which the server behind the proxy gives a file."""

CLOSE_S: Final = 1.0
"""Time in which a browser must answer that a connection ends."""


def secret_address() -> str:
    """A random address of this machine alone, of the 2^24 that Linux has for this.

    A web page of another server, opened in a browser on this machine, can reach what listens at
    127.0.0.1, but it cannot guess this address.

    Raises:
        OSError: this machine has only one such address.
    """
    address = ".".join(map(str, (127, *(1 + secrets.randbelow(254) for _ in range(3)))))
    with socket.create_server((address, 0)):
        return address


class Proxy:
    """Passes on what ``allowed`` permits to the server behind it, and ``POLICY`` with its files."""

    def __init__(
        self, host: str, port: int, allowed: Callable[[str | None, str | None], bool]
    ) -> None:
        """Remember who is asked.

        Args:
            host: address of the server behind the proxy.
            port: its port.
            allowed: whether a request with these headers ``Host`` and ``Origin`` is answered.
        """
        self._behind = (host, port)
        self._allowed = allowed
        self._server: Server

    @property
    def port(self) -> int:
        """Where the proxy listens."""
        return int(next(iter(self._server.sockets)).getsockname()[1])

    async def listen(self, host: str, port: int) -> None:
        """Listen on ``host``, at the next free port if ``port`` is taken; 0 is any.

        Raises:
            OSError: this machine does not have the address.
        """
        for more in range(MOST_PORTS):
            try:
                self._server = await serve(
                    self._hold, host, port + more,
                    process_request=self._answer, select_subprotocol=_first,
                    max_size=LARGEST, compression=None, close_timeout=CLOSE_S,
                )  # fmt: skip
            except OSError as error:
                if error.errno != errno.EADDRINUSE or more == MOST_PORTS - 1:
                    raise
            else:
                return

    async def close(self) -> None:
        """Stop listening and close all connections."""
        self._server.close()
        await self._server.wait_closed()

    async def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Refuse a request, answer it, or let it open a WebSocket connection."""
        headers = request.headers
        try:
            asked = headers.get("Host")
            allowed = self._allowed(asked, headers.get("Origin"))
        except LookupError:  # a header is given twice
            allowed = False
        if not allowed:
            return connection.respond(HTTPStatus.FORBIDDEN, "FORBIDDEN\n")
        if "Upgrade" in headers:
            return None
        try:
            answer = await asyncio.to_thread(
                self._fetch, request.path, ", ".join(headers.get_all("Accept-Encoding"))
            )
        except (ValueError, http.client.HTTPException):  # it is no path
            return connection.respond(HTTPStatus.NOT_FOUND, "NOT FOUND\n")
        answer.headers["Content-Security-Policy"] = POLICY.format(asked=asked)
        answer.headers["X-Content-Type-Options"] = "nosniff"
        answer.headers["Referrer-Policy"] = "no-referrer"
        return answer

    def _fetch(self, path: str, encodings: str) -> Response:
        """Get a file from the server behind the proxy."""
        behind = http.client.HTTPConnection(*self._behind, timeout=TIMEOUT_S)
        try:
            behind.request("GET", path, headers={"Accept-Encoding": encodings})
            answer = behind.getresponse()
            headers = Headers(answer.getheaders())
            return Response(answer.status, answer.reason, headers, answer.read())
        finally:
            behind.close()

    async def _hold(self, browser: ServerConnection) -> None:
        """Pass on the messages of a WebSocket connection until one side closes it."""
        host, port = self._behind
        offered = [browser.subprotocol] if browser.subprotocol else None
        async with connect(
            f"ws://{host}:{port}", subprotocols=offered, max_size=LARGEST, compression=None,
            proxy=None,
        ) as behind:  # fmt: skip
            await asyncio.gather(_pass_on(browser, behind), _pass_on(behind, browser))


def _first(_: ServerConnection, offered: Sequence[Subprotocol]) -> Subprotocol | None:
    """The first one, which the server behind the proxy is then offered alone."""
    return next(iter(offered), None)


async def _pass_on(source: Connection, target: Connection) -> None:
    """Pass on messages until the source closes; then close the target for the same reason."""
    try:
        while True:
            await target.send(await source.recv())
    except ConnectionClosed as end:
        reason = end.rcvd
        await (target.close(reason.code, reason.reason) if reason else target.close())
