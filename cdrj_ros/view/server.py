"""The web server of the page: viser's, restricted to its own pages and to its own addresses."""

from __future__ import annotations

import http
import importlib
import re
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from ipaddress import ip_address
from types import ModuleType
from typing import Any, Final

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.text import printable

LOCAL: Final = ("localhost", "127.0.0.1", "::1")
"""Names of this machine; the first one is the default."""

MISSING: Final = (
    "the page in a browser needs the package viser, which is not installed: "
    "pip install 'viser>=1.1,<1.2'"
)

POLICY: Final = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob:; worker-src blob:; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data: blob:; "
    "connect-src 'self' data: blob: ws://{asked}; frame-src 'none'; frame-ancestors 'none'; "
    "base-uri 'none'; form-action 'none'"
)
"""Content security policy: nothing is loaded from, sent to or shown in another page.

The client of viser is a script in its page, so scripts in the page cannot be forbidden.
"""

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
        """A server without a tunnel to a public address."""

        def request_share_url(self, verbose: bool = True) -> None:
            """Refuse."""

    _check_address(host)
    rich.reconfigure(quiet=True)  # viser prints a box with addresses
    with _guarded(host):
        return Server(host=host, port=port, verbose=False)


def address_of(server: Any, host: str) -> str:
    """Address of the page."""
    name = "localhost" if host in ("0.0.0.0", "::") else host
    shown = f"[{name}]" if ":" in name else name
    return f"http://{shown}:{server.get_port()}"


def _check_address(host: str) -> None:
    """Bind once: viser would wait forever for an address that this machine does not have."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, 0, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        with socket.socket(family, kind, protocol) as one:
            one.bind(address)
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UsageError(f"cannot listen on host {printable(host)!r}: {reason}") from None


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


@contextmanager
def _guarded(host: str) -> Iterator[None]:
    """While entered, servers that are started ask ``allowed`` first, and send ``POLICY``.

    viser has no option for either.
    """
    websocket_server: Any = importlib.import_module("websockets.asyncio.server")
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    serve = websocket_server.serve

    def start(*arguments: Any, process_request: Callable[[Any, Any], Any], **options: Any) -> Any:
        def process(connection: Any, request: Any) -> Any:
            headers = request.headers
            try:
                asked = headers.get("Host")
                fine = allowed(host, asked, headers.get("Origin"))
            except LookupError:  # a header is given twice
                fine = False
            if not fine:
                return Response(http.HTTPStatus.FORBIDDEN, "FORBIDDEN", Headers())
            answer = process_request(connection, request)
            if answer is not None:
                answer.headers["Content-Security-Policy"] = POLICY.format(asked=asked)
                answer.headers["X-Content-Type-Options"] = "nosniff"
                answer.headers["Referrer-Policy"] = "no-referrer"
            return answer

        return serve(*arguments, process_request=process, **options)

    websocket_server.serve = start
    try:
        yield
    finally:
        websocket_server.serve = serve
