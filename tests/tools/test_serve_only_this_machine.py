"""The viewer's server answers pages of this machine only, and reads no more than a page may send."""

import socket
import struct
import threading
import time
from collections.abc import Iterator

import pytest
from made_trajectories import hold

from robot_retarget.robot import load_robot
from robot_retarget.tools.view.web.serve import LONGEST, serve
from robot_retarget.tools.view.web.take import Take, Viewer

OP3 = load_robot("op3")


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    served = serve(Viewer((Take(OP3, hold(OP3, 0.02)),)), 0)
    thread = threading.Thread(target=served.forever, daemon=True)
    thread.start()
    yield served.server.server_port
    served.server.shutdown()
    thread.join()


def status(port: int, request: str, *lines: str) -> int:
    """The status of a raw HTTP request."""
    text = "\r\n".join([f"{request} HTTP/1.1", *lines, "Connection: close", "", "{}"])
    with socket.create_connection(("127.0.0.1", port), 5) as wire:
        wire.sendall(text.encode())
        return int(wire.recv(4096).split()[1])


@pytest.mark.parametrize("name", ["localhost", "127.0.0.1", "[::1]", "LocalHost"])
def test_pages_of_this_machine_are_answered(port: int, name: str) -> None:
    assert status(port, "GET /", f"Host: {name}:{port}", f"Origin: http://{name}:{port}") == 200
    assert status(port, "GET /", f"Host: {name}:9999") == 200  # at the other end of an ssh tunnel


@pytest.mark.parametrize(
    "lines",
    [
        ["Host: evil.example"],
        ["Host: evil.example:80", "Origin: http://localhost"],
        ["Host: localhost", "Origin: http://evil.example"],
        ["Host: localhost", "Origin: null"],
        ["Host: localhost.evil.example"],
        ["Host: [::1"],
        [],
    ],
)
@pytest.mark.parametrize("request_line", ["GET /", "POST /save"])
def test_other_pages_are_refused(port: int, lines: list[str], request_line: str) -> None:
    assert status(port, request_line, *lines, "Content-Type: application/json", "Content-Length: 2") == 403


@pytest.mark.parametrize("length", ["-1", "x", "1e3", "٣", str(LONGEST + 1), "9" * 30])
def test_a_length_that_is_none_or_too_long_is_refused_unread(port: int, length: str) -> None:
    head = "Host: localhost", "Content-Type: application/json", f"Content-Length: {length}"
    assert status(port, "POST /save", *head) == 413


def test_a_page_that_is_closed_before_it_has_come_leaves_no_traceback(
    port: int, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.create_connection(("127.0.0.1", port), 5) as wire:
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        wire.sendall(f"GET / HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n".encode())
        wire.recv(1)
    time.sleep(0.5)
    assert "Exception" not in capfd.readouterr().err
