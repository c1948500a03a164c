"""The page's server answers its own pages only, and the address is checked before it waits."""

import http.client
import socket
import subprocess
import sys
from ipaddress import ip_address, ip_network

import pytest

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.view.server import address_of, allowed, open_server

HERE = socket.gethostname().lower()
HANDSHAKE = {
    "Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Protocol": "viser-v1.1.1",
}  # fmt: skip


@pytest.fixture(scope="module")
def server():
    pytest.importorskip("viser")
    one = open_server("localhost", 0)
    yield one
    one.stop()


@pytest.mark.parametrize(
    ("host", "asked", "origin", "answer"),
    [
        ("localhost", "localhost:8080", None, True),
        ("localhost", "127.0.0.1:8080", "http://127.0.0.1:8080", True),
        ("localhost", "[::1]:8080", "http://[::1]:8080", True),
        ("localhost", "localhost:8080", "http://example.org", False),
        ("localhost", "localhost:8080", "http://localhost:9090", False),
        ("localhost", "localhost:8080", "null", False),
        ("localhost", "example.org:8080", "http://example.org:8080", False),
        ("localhost", None, None, False),
        ("localhost", "192.0.2.7:8080", "http://192.0.2.7:8080", False),
        ("localhost", "localhost@example.org", None, False),
        ("localhost", "localhost:8080; img-src *", None, False),
        ("127.0.0.2", "127.0.0.2:8080", "http://127.0.0.2:8080", True),
        ("127.0.0.2", "example.org:8080", "http://example.org:8080", False),
        ("robot.lan", "robot.lan:8080", "http://robot.lan:8080", True),
        ("192.0.2.7", "192.0.2.7", "http://192.0.2.7", True),
        ("192.0.2.7", "example.org:8080", "http://example.org:8080", False),
        ("0.0.0.0", "192.0.2.7:8080", "http://192.0.2.7:8080", True),
        ("0.0.0.0", f"{HERE}:8080", f"http://{HERE}:8080", True),
        ("0.0.0.0", f"{HERE}.local", f"http://{HERE}.local", True),
        ("0.0.0.0", f"{HERE}.example.org", f"http://{HERE}.example.org", False),
        ("0.0.0.0", "example.org:8080", "http://example.org:8080", False),
        ("0.0.0.0", "192.0.2.7:8080", "http://example.org", False),
        ("::", "[2001:db8::1]:8080", "http://[2001:db8::1]:8080", True),
        ("::", "example.org", None, False),
    ],
)
def test_a_request_needs_the_own_origin_and_a_name_of_this_machine(host, asked, origin, answer):
    assert allowed(host, asked, origin) is answer


def asked_of(server, headers):
    connection = http.client.HTTPConnection("localhost", server.get_port(), timeout=30.0)
    try:
        connection.request("GET", "/", headers=headers)
        return connection.getresponse()
    finally:
        connection.close()


def answer_of(server, **headers):
    return asked_of(server, {**HANDSHAKE, **headers}).status


def test_the_server_refuses_pages_of_others_and_foreign_names(server):
    own = address_of(server, "localhost")
    assert answer_of(server, Origin=own) == 101
    assert answer_of(server, Origin="http://example.org") == 403
    assert answer_of(server, Host="example.org", Origin="http://example.org") == 403


def test_viser_itself_listens_where_no_page_can_find_it(server):
    import viser

    from cdrj_ros.view.server import secret_address

    secret, port = server.get_host(), viser.ViserServer.get_port(server)
    assert ip_address(secret) in ip_network("127.0.0.0/8")
    assert len({secret_address() for _ in range(20)}) > 15
    for name in ("127.0.0.1", "::1", HERE):
        with pytest.raises(OSError):  # noqa: PT011
            socket.create_connection((name, port), timeout=5.0)
    socket.create_connection((secret, port), timeout=5.0).close()


def test_what_is_no_file_of_the_page_is_not_found(server):
    for path in ("/no", "/../../secret", "http://example.org/", "/%zz\x7f"):
        with socket.create_connection(("localhost", server.get_port()), timeout=30.0) as client:
            client.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
            assert client.recv(4096).split(b" ")[1] in (b"400", b"404"), path


def test_a_port_that_is_taken_is_passed_over():
    pytest.importorskip("viser")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        other = open_server("127.0.0.1", port)
        try:
            assert port < other.get_port() < port + 100
        finally:
            other.stop()


def test_the_page_may_neither_ask_other_servers_nor_be_framed(server):
    answer = asked_of(server, {})
    assert answer.status == 200
    rules = dict(
        rule.strip().split(" ", 1) for rule in answer.headers["Content-Security-Policy"].split(";")
    )
    for kind in ("default-src", "frame-src", "frame-ancestors", "base-uri", "form-action"):
        assert rules[kind] == "'none'"
    assert f"ws://localhost:{server.get_port()}" in rules["connect-src"].split()
    assert not any(
        word.startswith(("http", "*")) for rule in rules.values() for word in rule.split()
    )


def test_the_tunnel_to_a_public_server_is_off(server):
    assert server.request_share_url() is None
    assert server._share_tunnel is None


@pytest.mark.parametrize("host", ["203.0.113.1", "no such host"])
def test_an_address_of_another_machine_is_refused(host):
    pytest.importorskip("viser")
    with pytest.raises(UsageError, match="cannot listen on host"):
        open_server(host, 0)


def test_the_command_ends_with_code_2_without_viser(monkeypatch, capsys):
    from cdrj_ros.commands.view import main

    monkeypatch.setitem(sys.modules, "viser", None)
    assert main(["bag", "--robot", "prototype"]) == 2
    errors = capsys.readouterr().err
    assert errors.startswith("view: the page in a browser needs the package viser")
    assert errors.count("\n") == 1


def test_neither_estimator_nor_markers_nor_the_commands_help_import_viser():
    program = (
        "import sys\n"
        "import cdrj_ros.nodes.estimator, cdrj_ros.nodes.markers, cdrj_ros.commands.view\n"
        "assert not {'viser', 'websockets', 'trimesh'} & set(sys.modules)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
