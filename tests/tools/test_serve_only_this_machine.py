"""The viewer's server answers pages of this machine only, and reads no more than a page may send."""

import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

import pytest
from made_trajectories import hold

from robot_retarget.robot import load_robot
from robot_retarget.tools.view.web import serve as web
from robot_retarget.tools.view.web.serve import LONGEST, Served, serve
from robot_retarget.tools.view.web.take import Take, Viewer

OP3 = load_robot("op3")


@contextmanager
def served_page() -> Iterator[Served]:
    served = serve(Viewer((Take(OP3, hold(OP3, 0.02)),)), 0)
    thread = threading.Thread(target=served.forever, daemon=True)
    thread.start()
    yield served
    served.server.shutdown()
    thread.join()


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    with served_page() as page:
        yield page


@pytest.fixture
def port(served: Served) -> int:
    return served.server.server_port


def head_of(served: Served, request: str, *lines: str, token: str | None = None) -> str:
    """The head of the answer to a raw HTTP request, with the token of the page's address."""
    text = "\r\n".join(
        [f"{request}?token={served.token if token is None else token} HTTP/1.1", *lines, "Connection: close", "", "{}"]
    )
    with socket.create_connection(("127.0.0.1", served.server.server_port), 5) as wire:
        wire.sendall(text.encode())
        return wire.recv(4096).decode("latin-1").partition("\r\n\r\n")[0]


def status(served: Served, request: str, *lines: str, token: str | None = None) -> int:
    return int(head_of(served, request, *lines, token=token).split()[1])


@pytest.mark.parametrize("name", ["localhost", "127.0.0.1", "[::1]", "LocalHost"])
def test_pages_of_this_machine_are_answered(served: Served, port: int, name: str) -> None:
    assert status(served, "GET /", f"Host: {name}:{port}", f"Origin: http://{name}:{port}") == 200
    assert status(served, "GET /", f"Host: {name}:9999") == 200  # at the other end of an ssh tunnel


@pytest.mark.parametrize("token", ["", "x", "é"])
@pytest.mark.parametrize("request_line", ["GET /", "POST /save", "GET /live"])
def test_without_the_token_of_the_address_nothing_is_answered(served: Served, request_line: str, token: str) -> None:
    lines = f"Host: localhost:{served.server.server_port}", "Content-Type: application/json", "Content-Length: 2"
    assert status(served, request_line, *lines, token=token) == 403


def test_no_other_page_shows_it_in_a_frame(served: Served) -> None:
    head = head_of(served, "GET /", "Host: localhost")
    assert (
        "X-Frame-Options: DENY" in head and "frame-ancestors 'none'" in head and "Referrer-Policy: no-referrer" in head
    )


def test_bodies_that_never_come_hold_few_threads_and_not_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web, "SILENCE", 0.3)
    monkeypatch.setattr(web, "MOST", 4)
    before = threading.active_count()
    with served_page() as served, ExitStack() as open_wires:
        head = f"POST /save?token={served.token} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 9\r\n\r\n"
        address = "127.0.0.1", served.server.server_port
        wires = [open_wires.enter_context(socket.create_connection(address, 60)) for _ in range(30)]
        for wire in wires:
            with suppress(ConnectionError):
                wire.sendall(head.encode())
        assert threading.active_count() - before <= web.MOST + 1
        for wire in wires:  # refused at once, or left when no body came
            with suppress(ConnectionError):
                while wire.recv(4096):
                    pass
        while threading.active_count() - before > 1:
            time.sleep(0.01)
        assert status(served, "GET /", "Host: localhost") == 200


@pytest.mark.parametrize(
    "lines",
    [
        ["Host: evil.example"],
        ["Host: evil.example:80", "Origin: http://localhost"],
        ["Host: localhost", "Origin: http://evil.example"],
        ["Host: localhost", "Origin: null"],
        ["Host: localhost:8410", "Origin: http://localhost:9999"],
        ["Host: localhost:8410", "Origin: https://localhost:8410"],
        ["Host: localhost.evil.example"],
        ["Host: [::1"],
        [],
    ],
)
@pytest.mark.parametrize("request_line", ["GET /", "POST /save"])
def test_other_pages_are_refused(served: Served, lines: list[str], request_line: str) -> None:
    assert status(served, request_line, *lines, "Content-Type: application/json", "Content-Length: 2") == 403


@pytest.mark.parametrize("length", ["-1", "x", "1e3", "٣", str(LONGEST + 1), "9" * 30])
def test_a_length_that_is_none_or_too_long_is_refused_unread(served: Served, length: str) -> None:
    head = "Host: localhost", "Content-Type: application/json", f"Content-Length: {length}"
    assert status(served, "POST /save", *head) == 413


def test_a_page_that_is_closed_before_it_has_come_leaves_no_traceback(
    served: Served, port: int, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.create_connection(("127.0.0.1", port), 5) as wire:
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        wire.sendall(f"GET /?token={served.token} HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n".encode())
        wire.recv(1)
    time.sleep(0.5)
    assert "Exception" not in capfd.readouterr().err
