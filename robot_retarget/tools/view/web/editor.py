"""Touch-ups of a take from its page, and verdicts on them."""

from collections.abc import Callable
from dataclasses import replace
from threading import Lock
from typing import TYPE_CHECKING, Any, Protocol

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route

from robot_retarget.base.errors import UsageError
from robot_retarget.collision import warnings_of
from robot_retarget.judge.report import Report
from robot_retarget.tools.view.web.serve import PORT, Served, message_of, serve
from robot_retarget.tools.view.web.take import Take
from robot_retarget.tools.view.web.viewer import Viewer
from robot_retarget.trajectory import Trajectory

if TYPE_CHECKING:
    from robot_retarget.edit.touchup import Session

Judge = Callable[[Trajectory], Report]
"""Passes a verdict on a trajectory."""


class TakeEditor:
    """A take under touch-up. One request at a time changes it."""

    def __init__(self, take: Take, session: "Session | None", judge: Judge | None = None):
        """Start with a take; without a session it cannot be edited."""
        self.take, self.session, self.judge, self.lock = take, session, judge, Lock()

    def act(self, what: str, table: Any) -> dict[str, Any] | bytes:
        """Edit, undo, redo, check, judge or save; return the packed take, or the names of the saved files.

        Args:
            what: one of `ACTS`.
            table: the edge, for `edit`.

        Raises:
            UsageError: the editor has no session, or no judge for `judge`.
            GraphError: the edit is refused.
        """
        with self.lock:
            if self.session is None:
                raise UsageError("touch-ups need the motion: open the viewer with it")
            if what == "save":
                return {"files": [str(path) for path in self.session.save()]}
            if what == "edit":
                edge = _bounded(table)
                self.session.make(edge, bool(edge.pop("instead", False)))
            elif what in ("undo", "redo"):
                getattr(self.session, what)()
            self._show(self.session, what)
            return Viewer((self.take,)).packed({"touch": self.session.state()})

    def _show(self, session: "Session", what: str) -> None:
        """Replace the take by the session's trajectory: `check` and `judge` add warnings, `judge` adds a verdict."""
        now = session.trajectory
        whole = what in ("check", "judge") and len(now) > 1
        warnings = warnings_of(now, self.take.robot) if whole else None
        report = self._judged(now) if what == "judge" else self.take.report
        self.take = replace(
            self.take, trajectory=now, warnings=warnings, report=report, solution=None, before=session.before
        )

    def _judged(self, trajectory: Trajectory) -> Report:
        if self.judge is None:
            raise UsageError("this viewer has no simulation for a verdict")
        return self.judge(trajectory)


def _bounded(table: Any) -> dict[str, Any]:
    """Return the table of an edge from a page; texts in `at` become numbers, because JSON has no infinity."""
    if not isinstance(table, dict):
        raise ValueError("an edit is a table of keys and values")
    at = table.get("at")
    return {**table, "at": [float(one) if isinstance(one, str) else one for one in at] if isinstance(at, list) else at}


class Acts(Protocol):
    """An object that answers the requests of a page."""

    def act(self, what: str, table: Any) -> dict[str, Any] | bytes: ...


ACTS = ("edit", "undo", "redo", "save", "check", "judge")


def touch_routes(editor_of: Callable[[Request], Acts], acts: tuple[str, ...] = ACTS) -> list[BaseRoute]:
    """Return a route for each act.

    Args:
        editor_of: returns the object that answers a request.
        acts: names of the acts, which are the paths of the routes.
    """
    from anyio.to_thread import run_sync

    async def act(request: Request) -> Response:
        table = await message_of(request)
        done = await run_sync(editor_of(request).act, request.url.path.strip("/"), table)
        return Response(done, media_type="application/octet-stream") if isinstance(done, bytes) else JSONResponse(done)

    return [Route(f"/{what}", act, methods=["POST"]) for what in acts]


def serve_viewer(
    viewer: Viewer, port: int = PORT, session: "Session | None" = None, judge: Judge | None = None
) -> Served:
    """Open a port for a viewer; `forever` answers.

    Args:
        viewer: the takes; the first one can be edited.
        port: 0 selects a free port.
        session: the touch-up of the first take.
        judge: passes the verdict on the first take after a touch-up.

    Raises:
        UsageError: the port is taken, or may not be used.
    """
    first, *others = viewer.takes
    editor = TakeEditor(first, session, judge)

    def page(nonce: str) -> str:
        return Viewer((editor.take, *others)).page_with("viewer" if session is None else "touch", nonce)

    return serve(page, touch_routes(lambda request: editor), port)
