"""The page over HTTP, for a browser on this machine or at the other end of an ssh tunnel; with an editor, for touch-ups."""

import json
import secrets
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import BoundedSemaphore, Lock
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

from robot_retarget.base.errors import RobotRetargetError, UsageError
from robot_retarget.base.untrusted.documents import parse_json
from robot_retarget.collision import warnings_of
from robot_retarget.judge.report import Report
from robot_retarget.tools.view.web.take import Viewer
from robot_retarget.trajectory import Trajectory

if TYPE_CHECKING:
    from robot_retarget.edit.touchup import Session
    from robot_retarget.tools.view.web.live import LiveRobot

HOST = "127.0.0.1"
"""Only this machine is served; other machines connect through ssh."""
PORT = 8410
LONGEST = 10_000
"""Longest message from a page [bytes]."""
DEADLINE = 10.0
"""Longest time from a connection to the end of its request, and in which a page takes an answer [s]."""
MOST = 32
"""Number of connections at once. One more closes the oldest whose request is not whole; without such a one it is closed itself."""
STATE = 0.5
"""Interval of the state of a stream [s]."""
OWN = {"localhost", "127.0.0.1", "::1"}
"""Names of this machine. Requests under another host name are refused, which stops DNS rebinding."""
HEADERS = {
    "X-Frame-Options": "DENY",
    "Content-Security-Policy": "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
"""Of every answer: no page shows this one in a frame, no cache and no link keeps its address."""


@dataclass(frozen=True, eq=False)
class Served:
    """A page at an address."""

    server: ThreadingHTTPServer
    token: str
    """A token in its address; requests without it get no answer."""

    @property
    def address(self) -> str:
        """URL of the page."""
        return f"http://localhost:{self.server.server_port}/?token={self.token}"

    def forever(self) -> None:
        """Serve until the process is interrupted."""
        try:
            self.server.serve_forever(poll_interval=0.2)
        except KeyboardInterrupt:
            pass
        finally:
            self.server.server_close()

    def tunnel_command(self) -> str:
        """Return the ssh command that forwards the port to another machine."""
        return f"ssh -L {self.server.server_port}:localhost:{self.server.server_port} {socket.gethostname()}"


class _Server(ThreadingHTTPServer):
    """A server with few threads, and a deadline for every request."""

    request_queue_size = MOST  # connections that wait: one beyond these is tried again after a second

    def __init__(self, address: tuple[str, int], handler: type[BaseHTTPRequestHandler]):
        self._free = BoundedSemaphore(MOST)
        self._sending = dict[socket.socket, float]()
        super().__init__(address, handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        if not self._free.acquire(blocking=False):
            oldest = list(self._sending)[:1]
            self._hang_up(*oldest)
            if not self._free.acquire(timeout=DEADLINE * len(oldest)):
                self.shutdown_request(request)
                return
        self._sending[request] = time.monotonic() + DEADLINE
        super().process_request(request, client_address)

    def service_actions(self) -> None:
        """Close connections whose request is late; the server calls it after every request and several times a second."""
        self._hang_up(*(each for each, until in list(self._sending.items()) if time.monotonic() > until))

    def _hang_up(self, *late: socket.socket) -> None:
        """Wake up the threads that read from connections."""
        for each in late:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)

    def came(self, request: socket.socket) -> None:
        """Note that a request is whole: the deadline is over."""
        self._sending.pop(request, None)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self.came(request)
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print a defect; dropped connections are silent."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


Judge = Callable[[Trajectory], Report]
"""Passes a verdict on a trajectory."""


class EditServer:
    """Answers requests for the page, for takes, for touch-ups and for verdicts on them, one at a time."""

    def __init__(
        self, viewer: Viewer, editor: "Session | None", following: "LiveRobot | None" = None, judge: Judge | None = None
    ):
        self._viewer, self._editor, self._following, self._judge, self._lock = viewer, editor, following, judge, Lock()
        self.page: bytes = viewer.page_with(editor is not None, following is not None).encode()

    def act(self, what: str, content: bytes) -> tuple[HTTPStatus, str, bytes]:
        """Answer to a request: its status, type and content."""
        with self._lock:
            try:
                if what == "record":
                    if self._following is None:
                        raise UsageError("only a live page records")
                    return HTTPStatus.OK, "application/json", json.dumps(self._following.record()).encode()
                if self._editor is None:
                    raise UsageError("touch-ups need the motion: open the viewer with it")
                return self._done(what, self._editor, content)
            except (RobotRetargetError, ValueError) as error:
                return _refused(HTTPStatus.BAD_REQUEST, str(error))
            except Exception as error:  # a defect reaches the page as an error message, and the server continues
                reason = f"a defect of robot-retarget: {type(error).__name__}: {error}"
                return _refused(HTTPStatus.INTERNAL_SERVER_ERROR, reason)

    def _done(self, what: str, editor: "Session", content: bytes) -> tuple[HTTPStatus, str, bytes]:
        if what == "save":
            files = [str(path) for path in editor.save()]
            return HTTPStatus.OK, "application/json", json.dumps({"files": files}).encode()
        if what == "edit":
            table = _bounded(parse_json(content.decode(), "the edit", UsageError))
            editor.make(table, bool(table.pop("instead", False)))
        elif what in ("undo", "redo"):
            getattr(editor, what)()
        first, *others = self._viewer.takes
        now, whole = editor.trajectory, what in ("check", "judge") and len(editor.trajectory) > 1
        warnings = warnings_of(now, first.robot) if whole else None
        report = self._judged(now) if what == "judge" else first.report
        take = replace(first, trajectory=now, warnings=warnings, report=report, solution=None, before=editor.before)
        self._viewer = replace(self._viewer, takes=(take, *others))
        return HTTPStatus.OK, "application/octet-stream", Viewer((take,)).packed({"touch": editor.state()})

    def _judged(self, trajectory: Trajectory) -> Report:
        if self._judge is None:
            raise UsageError("this viewer has no simulation for a verdict")
        return self._judge(trajectory)


def _refused(status: HTTPStatus, reason: str) -> tuple[HTTPStatus, str, bytes]:
    return status, "application/json", json.dumps({"error": reason}).encode()


def _host_of(url: str) -> str:
    """Return the host name of a URL, or an empty text."""
    try:
        return urlsplit(url).hostname or ""
    except ValueError:
        return ""


def _bounded(table: Any) -> dict[str, Any]:
    """Return an edge from a page. JSON has no infinity, so the page sends it as a text."""
    if not isinstance(table, dict):
        raise ValueError("an edit is a table of keys and values")
    at = table.get("at")
    return {**table, "at": [float(one) if isinstance(one, str) else one for one in at] if isinstance(at, list) else at}


ACTS = ("edit", "undo", "redo", "save", "check", "judge", "record")


def serve(
    viewer: Viewer,
    port: int = PORT,
    editor: "Session | None" = None,
    following: "LiveRobot | None" = None,
    judge: Judge | None = None,
) -> Served:
    """Open a port for a viewer; `forever` answers.

    Args:
        port: 0 takes one that is free.
        editor: of the first take.
        following: source of live poses for the first take, which has one frame.
        judge: passes the verdict on the first take after a touch-up.

    Raises:
        UsageError: the port is taken, or may not be used.
    """
    edit_server = EditServer(viewer, editor, following, judge)

    token = secrets.token_urlsafe(16)

    class Handler(BaseHTTPRequestHandler):
        timeout = DEADLINE

        def parse_request(self) -> bool:
            if not super().parse_request():
                return False
            host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
            self._what, _, query = self.path.partition("?")
            given = parse_qs(query).get("token", [""])[0]
            if _host_of(f"//{host}") not in OWN or origin not in (None, f"http://{host}"):
                self.send_error(HTTPStatus.FORBIDDEN, "only this page is answered")
            elif not secrets.compare_digest(given.encode(), token.encode()):
                self.send_error(HTTPStatus.FORBIDDEN, "open the address that the command prints: it has a token")
            else:
                return True
            return False

        def end_headers(self) -> None:
            for name, value in HEADERS.items():
                self.send_header(name, value)
            super().end_headers()

        def _came(self) -> None:
            assert isinstance(self.server, _Server)
            self.server.came(self.connection)

        def do_GET(self) -> None:
            self._came()
            if self._what in ("/", "/index.html"):
                self._answer(HTTPStatus.OK, "text/html; charset=utf-8", edit_server.page)
            elif self._what == "/live" and following is not None:
                self._send_poses(following)
            else:
                self.send_error(HTTPStatus.NOT_FOUND)

        def _send_poses(self, following: "LiveRobot") -> None:
            """Send poses and the state of the stream as server-sent events until the page is closed."""
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/event-stream")
            self.end_headers()
            seen, said = 0, float("-inf")
            with suppress(ConnectionError, TimeoutError):
                while True:
                    seen, pose = following.next(seen, STATE) or (seen, b"")
                    if pose:
                        self.wfile.write(b"data: " + pose + b"\n\n")
                    if time.monotonic() - said >= STATE:
                        said = time.monotonic()
                        self.wfile.write(b"event: state\ndata: " + json.dumps(following.state()).encode() + b"\n\n")

        def do_POST(self) -> None:
            what, length = self._what.strip("/"), self.headers.get("Content-Length", "0")
            own = self.headers.get("Content-Type", "").startswith("application/json")  # no form of another site's page
            if what not in ACTS or not own:
                self.send_error(HTTPStatus.NOT_FOUND)
            elif not (length.isascii() and length.isdigit() and int(length) <= LONGEST):
                self.send_error(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"Content-Length is 0 to {LONGEST}")
            else:
                content = self.rfile.read(int(length))
                self._came()
                self._answer(*edit_server.act(what, content))

        def _answer(self, status: HTTPStatus, kind: str, content: bytes) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            with suppress(ConnectionError, TimeoutError):  # a page that was closed meanwhile
                self.end_headers()
                self.wfile.write(content)

        def log_message(self, format: str, *args: object) -> None:
            pass  # the terminal shows the address, not every request

    try:
        return Served(_Server((HOST, port), Handler), token)
    except (OSError, OverflowError) as error:
        raise UsageError(f"cannot serve on port {port}: {error}; --port takes another, 0 any that is free") from error
