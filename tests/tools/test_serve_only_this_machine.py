"""The viewer's server answers pages of this machine only, and reads no more than a page may send."""

import json
import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
from made_trajectories import hold

from robot_retarget.base.errors import RobotRetargetError
from robot_retarget.base.files import SAMPLES
from robot_retarget.edit.touchup import Session, graph_of
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.tools.view.web import serve as web
from robot_retarget.tools.view.web.editor import TakeEditor, serve_viewer
from robot_retarget.tools.view.web.serve import LARGEST_MESSAGE, Served
from robot_retarget.tools.view.web.take import Take
from robot_retarget.tools.view.web.viewer import Viewer

OP3 = load_robot("op3")
MOTION = read_motion(SAMPLES / "wave.bvh").frames(0, 10)


@contextmanager
def served_page() -> Iterator[Served]:
    served = serve_viewer(Viewer((Take(OP3, hold(OP3, 0.02)),)), 0)
    thread = threading.Thread(target=served.forever, daemon=True)
    thread.start()
    yield served
    served.close()
    thread.join()


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    with served_page() as page:
        yield page


@pytest.fixture
def port(served: Served) -> int:
    return served.port


def head_of(served: Served, request: str, *lines: str, token: str | None = None) -> str:
    """The head of the answer to a raw HTTP request, with the token of the page's address."""
    text = "\r\n".join(
        [f"{request}?token={served.token if token is None else token} HTTP/1.1", *lines, "Connection: close", "", "{}"]
    )
    with socket.create_connection(("127.0.0.1", served.port), 5) as wire:
        wire.sendall(text.encode())
        return wire.recv(4096).decode("latin-1").partition("\r\n\r\n")[0]


def status(served: Served, request: str, *lines: str, token: str | None = None) -> int:
    return int(head_of(served, request, *lines, token=token).split()[1])


@pytest.mark.parametrize("name", ["localhost", "127.0.0.1", "[::1]", "LocalHost"])
def test_pages_of_this_machine_are_answered(served: Served, port: int, name: str) -> None:
    assert status(served, "GET /", f"Host: {name}:{port}", f"Origin: http://{name}:{port}") == 200
    assert status(served, "GET /", f"Host: {name}:9999") == 200  # at the other end of an ssh tunnel


@pytest.mark.parametrize("token", ["", "x", "%C3%A9"])
@pytest.mark.parametrize("request_line", ["GET /", "POST /save", "GET /live"])
def test_without_the_token_of_the_address_nothing_is_answered(served: Served, request_line: str, token: str) -> None:
    lines = f"Host: localhost:{served.port}", "Content-Type: application/json", "Content-Length: 2"
    assert status(served, request_line, *lines, token=token) == 403


def test_no_other_page_shows_it_in_a_frame(served: Served) -> None:
    head = head_of(served, "GET /", "Host: localhost").lower()
    assert (
        "x-frame-options: deny" in head and "frame-ancestors 'none'" in head and "referrer-policy: no-referrer" in head
    )


def test_bodies_that_never_come_are_left_in_time_and_hold_no_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web, "DEADLINE", 0.5)
    with served_page() as served, ExitStack() as open_wires:
        before = threading.active_count()
        head = f"POST /save?token={served.token} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 9\r\n\r\n"
        wires = [open_wires.enter_context(socket.create_connection(("127.0.0.1", served.port), 60)) for _ in range(40)]
        for wire in wires:
            wire.sendall(head.encode())
        assert status(served, "GET /", "Host: localhost") == 200
        assert threading.active_count() - before <= 1  # of the page
        began = time.monotonic()
        for wire in wires:
            with suppress(ConnectionError):
                while wire.recv(4096):
                    pass
        assert time.monotonic() - began < 5


def test_connections_that_send_a_byte_now_and_then_do_not_keep_a_page_waiting(served: Served) -> None:
    address = "127.0.0.1", served.port
    with ExitStack() as open_wires:
        for _ in range(40):
            wire = open_wires.enter_context(socket.create_connection(address, 5))
            wire.sendall(b"GET / HT")
        began = time.monotonic()
        assert status(served, "GET /", "Host: localhost") == 200
        assert time.monotonic() - began < 1


def test_a_request_has_one_deadline_however_slowly_it_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web, "DEADLINE", 0.3)
    with served_page() as served, socket.create_connection(("127.0.0.1", served.port), 5) as wire:
        began, wire_is_open = time.monotonic(), True
        while wire_is_open and time.monotonic() - began < 3:
            with suppress(TimeoutError, ConnectionError):
                wire.sendall(b"x")
                wire.settimeout(0.05)
                wire_is_open = bool(wire.recv(1))
        assert 0.3 <= time.monotonic() - began < 1.5


@pytest.mark.parametrize("table", [{}, [1, 2], "x", None, {"a": "l_hand", "b": "l_hand", "at": ["x"]}])
def test_an_edit_that_is_none_is_refused_with_a_reason(table: object) -> None:
    take = Take(OP3, hold(OP3, 0.1))
    editor = Session(graph_of(MOTION, OP3, take.trajectory), take.trajectory, Path("edits.toml"), Path("edits.npz"))
    with pytest.raises((RobotRetargetError, ValueError), match=r"\w+"):
        TakeEditor(take, editor).act("edit", table)


@pytest.mark.parametrize("content", [b"[" * 9000, b'{"at": ' + b"[" * 400 + b"]" * 400 + b"}", b"\xff"])
def test_a_message_that_is_no_json_is_refused_with_a_reason(served: Served, content: bytes) -> None:
    where = f"http://localhost:{served.port}/edit?token={served.token}"
    with pytest.raises(HTTPError) as refused:
        urlopen(Request(where, content, {"Content-Type": "application/json"}))
    assert refused.value.code == 400 and json.loads(refused.value.read())["error"]


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
    assert status(served, request_line, *lines, "Content-Type: application/json", "Content-Length: 2") in (400, 403)


@pytest.mark.parametrize("length", ["-1", "x", "1e3", "٣", str(LARGEST_MESSAGE + 1), "9" * 30])
def test_a_length_that_is_none_or_too_long_is_refused_unread(served: Served, length: str) -> None:
    head = "Host: localhost", "Content-Type: application/json", f"Content-Length: {length}"
    assert status(served, "POST /save", *head) in (400, 413)


@pytest.mark.parametrize(
    "head", ["GET /?token={} HTTP/1.1\r\nHost: localhost\r\n\r\n", "GET /?token={} HTTP/1.1\r\nHo"]
)
def test_a_connection_that_is_dropped_leaves_no_traceback(
    served: Served, head: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.create_connection(("127.0.0.1", served.port), 5) as wire:
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        wire.sendall(head.format(served.token).encode())
        time.sleep(0.2)
    time.sleep(0.3)
    assert "Exception" not in capfd.readouterr().err
