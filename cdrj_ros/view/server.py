"""The web server of the page: viser's, restricted to its own pages and to its own addresses.

viser has no option for either, so it listens at an address that nobody knows, and a proxy, which
browsers reach, checks every request.
"""

from __future__ import annotations

import asyncio
import re
import socket
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

    from cdrj_ros.view.proxy import Proxy, secret_address

    class Server(viser.ViserServer):  # type: ignore[misc, name-defined]
        """A server behind a proxy, without a tunnel to a public address."""

        def __init__(self) -> None:
            """Start both."""
            secret = secret_address()
            super().__init__(host=secret, port=0, verbose=False)
            self._proxy = Proxy(secret, super().get_port(), lambda *of: allowed(host, *of))
            try:
                self._in_loop(self._proxy.listen(host, port))
            except BaseException:
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
