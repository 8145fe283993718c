"""The page over HTTP, for a browser on this machine or at the other end of an ssh tunnel; with an editor, for touch-ups."""

import json
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Condition, Lock
from typing import Any, Protocol
from urllib.parse import urlsplit

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import RobotRetargetError, UsageError
from robot_retarget.collision.warn import warnings_of
from robot_retarget.human.surroundings import first_frame
from robot_retarget.judge.report import Report
from robot_retarget.live.loop import LivePose
from robot_retarget.robot.model import Robot
from robot_retarget.scene.scene import Scene
from robot_retarget.tools.view.web.shapes import shapes_of, shapes_of_scene
from robot_retarget.tools.view.web.show import SCALAR_LAST, poses, seen
from robot_retarget.tools.view.web.take import Take, Viewer
from robot_retarget.trajectory import Trajectory

HOST = "127.0.0.1"
"""Only this machine is served; other machines connect through ssh."""
PORT = 8410
WAIT = 1.0
"""Interval of keep-alive messages to a page without new poses [s]."""
LONGEST = 10_000
"""Longest message from a page [bytes]."""
OWN = {"localhost", "127.0.0.1", "::1"}
"""Names of this machine. Requests under another host name are refused, which stops DNS rebinding."""


class Editor(Protocol):
    """Edits the first take."""

    @property
    def trajectory(self) -> Trajectory:
        """As it is now."""
        ...

    @property
    def before(self) -> Trajectory | None:
        """As it was before the latest edit."""
        ...

    def make(self, table: Mapping[str, Any]) -> None:
        """Make an edit."""
        ...

    def undo(self) -> None:
        """Undo the last edit."""
        ...

    def redo(self) -> None:
        """Redo the last undone edit."""
        ...

    def save(self) -> tuple[Path, Path]:
        """Write the edits and the trajectory."""
        ...

    def state(self) -> dict[str, Any]:
        """Return the state of the edits for the page."""
        ...


@dataclass(frozen=True, eq=False)
class Served:
    """A page at an address."""

    server: ThreadingHTTPServer

    @property
    def address(self) -> str:
        """URL of the page."""
        return f"http://localhost:{self.server.server_port}/"

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


class Following(Protocol):
    """Source of the latest pose."""

    def next(self, seen: int, timeout: float) -> tuple[int, bytes] | None:
        """Return the number of the latest pose and the pose, once the number differs from `seen`; None after `timeout` [s]."""
        ...


Judge = Callable[[Trajectory], Report]
"""Passes a verdict on a trajectory."""


class EditServer:
    """Answers requests for the page, for touch-ups and for verdicts on them, one at a time."""

    def __init__(self, viewer: Viewer, editor: Editor | None, live: bool = False, judge: Judge | None = None):
        self._viewer, self._editor, self._judge, self._lock = viewer, editor, judge, Lock()
        self.page: bytes = viewer.page_with(editor is not None, live).encode()

    def act(self, what: str, content: bytes) -> tuple[HTTPStatus, str, bytes]:
        """Answer to a request: its status, type and content."""
        with self._lock:
            try:
                if self._editor is None:
                    raise UsageError("touch-ups need the motion: open the viewer with it")
                return self._done(what, self._editor, content)
            except (RobotRetargetError, ValueError) as error:
                return _refused(HTTPStatus.BAD_REQUEST, str(error))
            except Exception as error:  # a defect reaches the page as an error message, and the server continues
                reason = f"a defect of robot-retarget: {type(error).__name__}: {error}"
                return _refused(HTTPStatus.INTERNAL_SERVER_ERROR, reason)

    def _done(self, what: str, editor: Editor, content: bytes) -> tuple[HTTPStatus, str, bytes]:
        if what == "save":
            files = [str(path) for path in editor.save()]
            return HTTPStatus.OK, "application/json", json.dumps({"files": files}).encode()
        if what == "edit":
            editor.make(_bounded(json.loads(content)))
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
    return {**table, "at": [float(bound) for bound in at] if isinstance(at, list) else at}


ACTS = ("edit", "undo", "redo", "save", "check", "judge")


def serve(
    viewer: Viewer,
    port: int = PORT,
    editor: Editor | None = None,
    following: Following | None = None,
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
    edit_server = EditServer(viewer, editor, following is not None, judge)

    class Handler(BaseHTTPRequestHandler):
        def parse_request(self) -> bool:
            if not super().parse_request():
                return False
            origin = self.headers.get("Origin")
            if _host_of(f"//{self.headers.get('Host', '')}") in OWN and (origin is None or _host_of(origin) in OWN):
                return True
            self.send_error(HTTPStatus.FORBIDDEN, "only pages of this machine are answered")
            return False

        def do_GET(self) -> None:
            if self.path.split("?")[0] in ("/", "/index.html"):
                self._answer(HTTPStatus.OK, "text/html; charset=utf-8", edit_server.page)
            elif self.path == "/live" and following is not None:
                self._send_poses(following)
            else:
                self.send_error(HTTPStatus.NOT_FOUND)

        def _send_poses(self, following: Following) -> None:
            """Send poses as server-sent events until the page is closed."""
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/event-stream")
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            seen = 0
            with suppress(ConnectionError):
                while True:
                    seen, pose = following.next(seen, WAIT) or (seen, b"")
                    self.wfile.write(b"data: " + pose + b"\n\n" if pose else b":\n\n")

        def do_POST(self) -> None:
            what, length = self.path.strip("/"), self.headers.get("Content-Length", "0")
            kind = self.headers.get("Content-Type", "")
            own = kind.startswith("application/json")  # no form of another site's page
            if what not in ACTS or not own:
                self.send_error(HTTPStatus.NOT_FOUND)
            elif not (length.isascii() and length.isdigit() and int(length) <= LONGEST):
                self.send_error(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"Content-Length is 0 to {LONGEST}")
            else:
                self._answer(*edit_server.act(what, self.rfile.read(int(length))))

        def _answer(self, status: HTTPStatus, kind: str, content: bytes) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            with suppress(ConnectionError):  # a page that was closed meanwhile
                self.end_headers()
                self.wfile.write(content)

        def log_message(self, format: str, *args: object) -> None:
            pass  # the terminal shows the address, not every request

    try:
        return Served(ThreadingHTTPServer((HOST, port), Handler))
    except (OSError, OverflowError) as error:
        raise UsageError(f"cannot serve on port {port}: {error}; --port takes another, 0 any that is free") from error


# A robot, and the bodies around it, where the latest pose has them, for a page that is served.


class LiveRobot:
    """The latest pose, shared with waiting pages. Older poses are dropped."""

    def __init__(self, robot: Robot, scene: Scene | None = None) -> None:
        self._robot, self._shapes = robot, shapes_of(robot)
        around = None if scene is None else first_frame(scene)
        drawn = () if around is None else seen(shapes_of_scene(around))
        self._names = [around.names[body] for body in drawn] if around is not None else []
        self._count, self._pose = 0, b""
        self._changed = Condition()
        still = Trajectory(robot.standing()[None], 1.0, robot.joint_names, robot.name, source="live", scene=around)
        self.viewer: Viewer = Viewer((Take(robot, still),))

    def show(self, qpos: Floats, bodies: Mapping[str, Floats] | None = None, size: float = 1.0) -> None:
        """The robot stands so now (nq,), and the bodies around it, `size` times as large as captured, have these poses (7,)."""
        rows: dict[str, Any] = {"robot": np.round(poses(self._robot, qpos[None], self._shapes), 4).ravel().tolist()}
        if bodies:
            around = np.array([bodies[name] for name in self._names]).reshape(-1, 7)[:, SCALAR_LAST]
            rows |= {"bodies": np.round(around, 4).ravel().tolist(), "size": size}
        with self._changed:
            self._count, self._pose = self._count + 1, json.dumps(rows).encode()
            self._changed.notify_all()

    def next(self, seen: int, timeout: float) -> tuple[int, bytes] | None:
        """The latest pose as the page takes it, and its number, once that is not the one seen last."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._count != seen, timeout):
                return None
            return self._count, self._pose


# Poses on a page in the browser.


class PageSink:
    """A page that follows; `served` says where.

    Raises:
        UsageError: its port is taken.
    """

    def __init__(self, robot: Robot, port: int = PORT, scene: Scene | None = None) -> None:
        self._robot = LiveRobot(robot, scene)
        self.served: Served = serve(self._robot.viewer, port, following=self._robot)

    def show(self, pose: LivePose) -> None:
        self._robot.show(pose.qpos, pose.bodies, pose.size)
