"""Who is let in: hosts and origins before all else, connections that are bounded, a token that outlives a restart."""

import os
import socket
import stat
import time

import httpx
import pytest
from support.example_organs import organ

import palpate as pp
from palpate.server import access_token, bounded_connections
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import serving

UPGRADE = (
    b"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    b"Sec-WebSocket-Key: MDEyMzQ1Njc4OTAxMjM0NQ==\r\n"
)
REQUESTS = {
    "scene": b"GET /scene",
    "nothing there": b"GET /none",
    "static": b"GET /static/main.js",
    "socket": b"GET /socket",
}


@pytest.fixture(scope="module")
def address():
    with serving(pp.Session(pp.model(organ(7), "springs"), radius=14.0, sweeps=2), loopback_socket(None)) as found:
        yield found


def answer(address, kind, host, origin=None):
    """The server's bytes for a request with these bytes as Host and Origin."""
    base, token = address.split("/?")
    with socket.create_connection(("127.0.0.1", int(base.split(":")[2])), 10) as connection:
        more = UPGRADE if kind == "socket" else b"Connection: close\r\n"
        more += b"" if origin is None else b"Origin: " + origin + b"\r\n"
        line = REQUESTS[kind] + b"?" + token.encode() + b" HTTP/1.1\r\n"
        connection.sendall(line + b"Host: " + host + b"\r\n" + more + b"\r\n")
        return connection.recv(10_000)


def host_of(address):
    return address.split("//")[1].split("/")[0].encode()


@pytest.mark.parametrize("kind", REQUESTS)
@pytest.mark.parametrize(
    "host",
    [b"[::1", b"[", b"]", b"", b"a b", b"\xff\xfe", b"127.0.0.1:x", b"127.0.0.1:999999", b"u@127.0.0.1", b"[::z]"],
)
def test_a_host_that_is_none_is_a_bad_request_before_anything_else(address, capfd, kind, host):
    assert answer(address, kind, host).startswith(b"HTTP/1.1 400 ")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("kind", REQUESTS)
@pytest.mark.parametrize(
    "origin",
    [b"http://[", b"http://[::1", b"http://127.0.0.1:x", b"\xff", b"//", b"http://a\r\nOrigin: http://b", b"http://"],
)
def test_an_origin_that_is_none_is_a_bad_request_before_anything_else(address, capfd, kind, origin):
    assert answer(address, kind, host_of(address), origin).startswith(b"HTTP/1.1 400 ")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("kind", REQUESTS)
@pytest.mark.parametrize(("host", "origin"), [(b"evil.example", None), (None, b"http://evil.example"), (None, b"null")])
def test_a_stranger_is_refused_everywhere(address, capfd, kind, host, origin):
    assert answer(address, kind, host or host_of(address), origin).startswith(b"HTTP/1.1 403 ")
    assert capfd.readouterr().err == ""


def test_the_page_itself_needs_no_token_but_its_data_do(address):
    base = address.split("/?")[0]
    assert httpx.get(base).status_code == 200
    assert httpx.get(f"{base}/scene").status_code == 403


@pytest.mark.parametrize(
    "begun",
    [b"", b"GET / HT", b"GET / HTTP/1.1\r\nHost: ", b"POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 9\r\n\r\n1"],
)
def test_a_request_that_never_arrives_is_given_up(monkeypatch, address, begun):
    """Bytes that trickle in give it no more time."""
    monkeypatch.setattr(bounded_connections, "REQUEST_TIMEOUT", 0.3)
    with socket.create_connection(("127.0.0.1", int(host_of(address).split(b":")[1])), 0.05) as connection:
        connection.sendall(begun)
        for _ in range(100):
            try:
                if not connection.recv(1000):
                    return
            except TimeoutError:
                connection.sendall(b"a" if begun else b"")
            except ConnectionError:
                return
    pytest.fail("still open")


def test_a_connection_too_many_is_refused_and_those_before_go_on(monkeypatch, address):
    monkeypatch.setattr(bounded_connections, "MOST_CONNECTIONS", 5)
    port = int(host_of(address).split(b":")[1])
    with httpx.Client() as early:
        assert early.get(address).status_code == 200
        held = [socket.create_connection(("127.0.0.1", port), 10) for _ in range(4)]
        with socket.create_connection(("127.0.0.1", port), 10) as late:
            assert late.recv(1000).startswith(b"HTTP/1.1 503 ")
        assert early.get(address).status_code == 200
        for connection in held:
            connection.close()


@pytest.fixture
def state(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path / "palpate" / "token"


def test_the_token_outlives_a_restart_for_some_hours_and_is_for_its_owner_only(state):
    first = access_token.access_token()
    assert len(first) >= 22
    assert access_token.access_token() == first
    assert stat.S_IMODE(state.stat().st_mode) == 0o600
    old = time.time() - access_token.LIFETIME - 1
    os.utime(state, (old, old))
    second = access_token.access_token()
    assert second != first
    state.chmod(0o644)  # others have seen it
    assert access_token.access_token() != second
    assert stat.S_IMODE(state.stat().st_mode) == 0o600


def test_without_a_folder_for_it_a_token_is_made_for_once(state):
    state.parent.write_text("a file where the folder should be")
    assert access_token.access_token() != access_token.access_token()
