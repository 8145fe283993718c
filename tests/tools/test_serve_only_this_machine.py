"""The viewer's server answers pages of this machine only, and reads no more than a page may send."""

import json
import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest
from made_trajectories import hold

from robot_retarget.base.files import SAMPLES
from robot_retarget.edit.touchup import Session, graph_of
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.tools.view.web import serve as web
from robot_retarget.tools.view.web.serve import LONGEST, EditServer, Served, serve
from robot_retarget.tools.view.web.take import Take, Viewer

OP3 = load_robot("op3")
MOTION = read_motion(SAMPLES / "wave.bvh").frames(0, 10)


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
    monkeypatch.setattr(web, "DEADLINE", 0.3)
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


def test_connections_that_send_a_byte_now_and_then_do_not_keep_a_page_waiting(served: Served) -> None:
    address = "127.0.0.1", served.server.server_port
    with ExitStack() as open_wires:
        for _ in range(40):
            wire = open_wires.enter_context(socket.create_connection(address, 5))
            wire.sendall(b"GET / HT")
        began = time.monotonic()
        assert status(served, "GET /", "Host: localhost") == 200
        assert time.monotonic() - began < 1


def test_a_request_has_one_deadline_however_slowly_it_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web, "DEADLINE", 0.3)
    with served_page() as served, socket.create_connection(("127.0.0.1", served.server.server_port), 5) as wire:
        began, wire_is_open = time.monotonic(), True
        while wire_is_open and time.monotonic() - began < 3:
            with suppress(TimeoutError, ConnectionError):
                wire.sendall(b"x")
                wire.settimeout(0.05)
                wire_is_open = bool(wire.recv(1))
        assert 0.3 <= time.monotonic() - began < 1.5


@pytest.mark.parametrize(
    "content", [b"[" * 9000, b'{"at": ' + b"[" * 400 + b"]" * 400 + b"}", b"\xff", b"{}", b"[1, 2]"]
)
def test_an_edit_that_is_none_is_refused_with_a_reason(content: bytes) -> None:
    take = Take(OP3, hold(OP3, 0.1))
    editor = Session(graph_of(MOTION, OP3, take.trajectory), take.trajectory, Path("edits.toml"), Path("edits.npz"))
    code, _, answer = EditServer(Viewer((take,)), editor).act("edit", content)
    assert code == 400 and json.loads(answer)["error"]


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


@pytest.mark.parametrize(
    "head", ["GET /?token={} HTTP/1.1\r\nHost: localhost\r\n\r\n", "GET /?token={} HTTP/1.1\r\nHo"]
)
def test_a_connection_that_is_dropped_leaves_no_traceback(
    served: Served, head: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.create_connection(("127.0.0.1", served.server.server_port), 5) as wire:
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        wire.sendall(head.format(served.token).encode())
        time.sleep(0.2)
    time.sleep(0.3)
    assert "Exception" not in capfd.readouterr().err
