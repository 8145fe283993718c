"""The studio's server: projects, their threads, and the routes of the page."""

import json
import os
import shutil
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from filecmp import cmp
from functools import cache, partial
from pathlib import Path
from threading import Condition, Lock
from typing import Any

from anyio import sleep
from anyio.to_thread import run_sync
from starlette.background import BackgroundTask
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route

import robot_retarget as rr
from robot_retarget.base.errors import FileError, MatchError, RobotRetargetError, UsageError, known
from robot_retarget.base.files import SAMPLES, folder
from robot_retarget.base.untrusted.documents import read_json
from robot_retarget.base.untrusted.limits import is_zip
from robot_retarget.robot import recognise, shipped_robots
from robot_retarget.tools.cli.console import note
from robot_retarget.tools.cli.options import DEFAULT_ROBOT, MODELS
from robot_retarget.tools.studio.facts import packed
from robot_retarget.tools.studio.project import STORED, Project, Work
from robot_retarget.tools.studio.uploads import motions_within, place_for, plain_name, robot_model, unpacked_zip
from robot_retarget.tools.view.web import serve as web
from robot_retarget.tools.view.web.editor import TakeEditor, touch_routes
from robot_retarget.tools.view.web.live import LiveRobot, live_routes
from robot_retarget.tools.view.web.serve import Served, message_of, serve
from robot_retarget.tools.view.web.viewer import Viewer

AT_ONCE = max(os.cpu_count() or 1, 2)
"""Largest number of works that run at the same time."""
LIVE = "live"
"""Name of the stream among the projects."""
BREATH = 0.2
"""Least interval between two events of the list of projects [s]."""


class Studio:
    """Clips on robots, in a folder.

    Args:
        place: the folder; it has a subfolder for each clip.
        following: a robot that follows a stream; None without a stream.
    """

    def __init__(self, place: Path, following: LiveRobot | None = None) -> None:
        self.place, self.following = folder(place), following
        self.projects: dict[str, Project] = {}
        self.robots: dict[str, str] = {name: name for name in shipped_robots()}
        """The robots on the page: name → argument of `load_robot`."""
        self._loaded = dict[str, rr.Robot]()
        self._motion = cache(rr.read_motion)
        self._pool, self._lock = ThreadPoolExecutor(AT_ONCE), Lock()
        self._changes, self._changed = 0, Condition()

    # Projects and their steps.

    def changed(self) -> None:
        """Notify every page of a change."""
        with self._changed:
            self._changes += 1
            self._changed.notify_all()

    def robot(self, model: str) -> rr.Robot:
        """Load a robot once, and return it."""
        with self._lock:
            if model not in self._loaded:
                self._loaded[model] = rr.load_robot(model)
            return self._loaded[model]

    def project(self, key: str) -> Project:
        """Return a project.

        Raises:
            UsageError: no project has the key.
        """
        if key not in self.projects:
            raise UsageError(f"no project {key!r}; {known(self.projects, typed=key)}")
        return self.projects[key]

    def add(self, motion: Path, robot: str) -> Project:
        """Add a clip on a robot, show it, and start to solve it. A clip that is already on the robot keeps its project.

        Raises:
            UsageError: the robot is not on the page.
            MotionError, RobotError: a file cannot be read.
            MatchError: the motion is not human, or the robot is not a humanoid.
        """
        if robot not in self.robots:
            raise UsageError(f"no robot {robot!r}; {known(self.robots, typed=robot)}")
        key = f"{motion.relative_to(self.place)}@{robot}"
        if key in self.projects:
            return self.projects[key]
        model = self.robots[robot]
        project = Project(key, (motion, self._motion(motion)), (model, self.robot(model)), robot, self.changed)
        try:
            project.open()
        except MatchError as error:
            raise MatchError(f"{motion.name} on {robot}: {error}") from error
        self.projects[key] = project
        self.begin(project, project.reopen)
        return project

    def reopen(self) -> None:
        """Add the projects that are stored in the folder; note each that cannot be read on stderr."""
        for path in sorted(self.place.rglob(STORED)):
            try:
                stored = read_json(path, FileError)
                self.robots.setdefault(stored["robot"], stored["model"])
                self.add(path.parent.with_name(stored["motion"]), stored["robot"])
            except (RobotRetargetError, KeyError, TypeError, ValueError) as error:
                note(f"{path} is left out: {error}")

    def begin(self, project: Project, *steps: Callable[[Work], None]) -> None:
        """Stop the present work of a project and queue steps. They run one after the other in a thread of the pool."""
        work = project.waits()

        def run() -> None:
            try:
                for step in steps:
                    step(work)
            except Exception as error:  # a defect is a state of its project
                project.ended(work, error)

        self._pool.submit(run)

    def act(self, project: Project, what: str, message: dict[str, Any]) -> None:
        """Apply a request of a page to a project.

        Raises:
            UsageError: the request or its value is unknown.
            MatchError: a keypoint, joint or body is unknown, or does not fit.
        """
        value = message.get("value")
        match what:
            case "solve":
                project.choose(value or {})
                self.begin(project, project.solve)
            case "judge":
                self.begin(project, project.judge)
            case "cure":
                project.cure(str(value))
                self.begin(project, project.solve, project.judge)
            case "mend":
                project.mend(*(value if isinstance(value, list) and len(value) == 3 else ("", "", "")))
                project.open()
                self.begin(project, project.solve)
            case "kinds":
                project.keep_kinds(value if isinstance(value, list) else [])
                self.begin(project, project.solve)
            case "stop":
                project.work.stop = True
            case "remove":
                with project.lock:
                    project.work.stop = bool(self.projects.pop(project.key, None))
                    (project.place / STORED).unlink(missing_ok=True)
            case _:
                raise UsageError(f"a project does not {what!r}")
        self.changed()

    # Files from the page, and from the command line.

    def bring(self, path: Path, robot: str) -> None:
        """Add a clip, or the clips of a folder, from outside the studio; copy each into a new subfolder.

        Raises:
            RobotRetargetError: the robot or the clip cannot be read, or no file of the folder can.
        """
        if robot not in self.robots:
            recognise(self.robot(robot))
            self.robots[robot] = robot
        files = sorted(each for each in path.rglob("*") if each.is_file()) if path.is_dir() else [path]
        self._each(files, lambda file: self._bring(file, robot))

    def _bring(self, file: Path, robot: str) -> None:
        """Copy a clip and add it; add the earlier copy if the studio has the clip."""
        copied, others = self._copied(file), [project.motion_file for project in self.projects.values()]
        same = next((other for other in others if cmp(copied, other, shallow=False)), None)
        if same is None:
            self.taken(copied, robot)
        else:
            shutil.rmtree(copied.parent)
            self.add(same, robot)

    def _copied(self, file: Path) -> Path:
        copied = place_for(self.place, file.name) / plain_name(file.name)
        try:
            shutil.copyfile(file, copied)
        except OSError as error:
            shutil.rmtree(copied.parent)
            raise UsageError(f"cannot read {file}: {error.strerror}") from error
        return copied

    def _each(self, files: list[Path], take: Callable[[Path], Any]) -> list[str]:
        """Call `take` with each file; return the reasons of the refused ones.

        Raises:
            RobotRetargetError: `take` refuses every file; the error is that of the first.
        """
        wrong = list[RobotRetargetError]()
        for file in files:
            try:
                take(file)
            except RobotRetargetError as error:
                wrong.append(error)
        if len(wrong) == len(files) and wrong:
            raise wrong[0]
        return [str(error) for error in wrong]

    def taken(self, path: Path, robot: str) -> dict[str, Any]:
        """Accept an uploaded file: add its robot to the list, or its clips on a robot.

        Raises:
            RobotRetargetError: the file holds no robot and no clip; its folder is removed.
        """
        inside = f"{path.parent}/"
        try:
            unpacked = unpacked_zip(path) if is_zip(path) and path.suffix.lower() == ".zip" else None
            model = robot_model(unpacked) if unpacked else path if path.suffix.lower() in MODELS else None
            if model is not None:
                notes = recognise(self.robot(str(model))).notes
                name = path.parent.name if path.parent.name not in self.robots else f"my_{path.parent.name}"
                self.robots[name] = str(model)
                self.changed()
                return {"robot": name, "notes": notes}
            keys = list[str]()
            clips = motions_within(unpacked) if unpacked else [path]
            left_out = self._each(clips, lambda clip: keys.append(self.add(clip, robot).key))
            return {"projects": keys, "left_out": [why.replace(inside, "") for why in left_out]}
        except RobotRetargetError as error:
            shutil.rmtree(path.parent, ignore_errors=True)
            meshes = "; drop its folder, or a zip of it, with the meshes" if "opening file" in str(error) else ""
            raise type(error)(str(error).replace(inside, "") + meshes) from error

    # Routes of the page.

    def lines(self) -> bytes:
        """Return the lists of projects, robots and samples as a server-sent event."""
        projects = [project.line() for project in [*self.projects.values()]]
        samples = sorted(path.name for path in SAMPLES.glob("*.bvh"))
        facts = {"projects": projects, "robots": [*self.robots], "live": self.following is not None, "samples": samples}
        return b"data: " + json.dumps(facts).encode() + b"\n\n"

    def _next(self, seen: int) -> int:
        with self._changed:
            self._changed.wait_for(lambda: self._changes != seen, 5.0)
            return self._changes

    async def _events(self) -> AsyncIterator[bytes]:
        seen = -1
        while True:
            seen = await run_sync(self._next, seen)
            yield self.lines()
            await sleep(BREATH)

    async def _show_events(self, request: Request) -> Response:
        return StreamingResponse(self._events(), media_type="text/event-stream")

    def _asked(self, request: Request) -> Project:
        return self.project(request.query_params.get("project", ""))

    def _editor(self, request: Request) -> TakeEditor:
        editor = self._asked(request).editor
        if editor is None:
            raise UsageError("wait until it is solved")
        return editor

    def _show_take(self, request: Request) -> Response:
        if self.following is not None and request.query_params.get("project") == LIVE:
            content = self.following.viewer.packed({"studio": {"version": 1}})
        else:
            content = packed(self._asked(request))
        return Response(content, media_type="application/octet-stream")

    def _recorded(self, take: dict[str, Any]) -> dict[str, Any]:
        """Add the performer's motion of a recorded take as a clip; return the take with its project."""
        if self.following is None or not take.get("motion"):
            return take
        model, copied = self.following.robot, self._copied(Path(take["motion"]))
        name = next((name for name in self.robots if name == model.name), str(model.path))
        self.robots.setdefault(name, name)
        self._loaded.setdefault(self.robots[name], model)
        return take | {"projects": [self.add(copied, name).key]}

    async def _do(self, request: Request) -> Response:
        message = await message_of(request)
        if not isinstance(message, dict):
            raise UsageError("a message is a table")
        await run_sync(self.act, self._asked(request), str(message.get("what")), message)
        return JSONResponse({})

    async def _add(self, request: Request) -> Response:
        """Add a sample, or the clip of a project, on a robot."""
        message = await message_of(request)
        robot, sample, of = (str(message.get(key, "")) for key in ("robot", "sample", "of"))
        if of:
            motion = self.project(of).motion_file
        elif (SAMPLES / plain_name(sample)).is_file():
            motion = self._copied(SAMPLES / plain_name(sample))
        else:
            raise UsageError(f"no sample {sample!r}")
        project = await run_sync(self.add, motion, robot)
        return JSONResponse({"projects": [project.key]})

    async def _drop(self, request: Request) -> Response:
        name, robot = plain_name(request.query_params.get("name", "")), request.query_params.get("robot", "")
        if int(request.headers.get("content-length", 0)) > web.LARGEST:
            raise HTTPException(413, _too_large(name))
        path, size = place_for(self.place, name) / name, 0
        try:
            with path.open("wb") as file:
                async for piece in request.stream():
                    size += len(piece)
                    if size > web.LARGEST:
                        raise UsageError(_too_large(name))
                    file.write(piece)
        except BaseException:
            shutil.rmtree(path.parent, ignore_errors=True)
            raise
        return JSONResponse(await run_sync(self.taken, path, robot))

    def _export(self, request: Request) -> Response:
        path, name = self._asked(request).export(request.query_params.get("format", ""))
        return FileResponse(path, filename=name, background=BackgroundTask(shutil.rmtree, path.parent, True))

    def served(self, port: int) -> Served:
        """Open a port for the page; `forever` answers.

        Raises:
            UsageError: the port is taken, or may not be used.
        """
        self._pool.submit(self.robot, DEFAULT_ROBOT)  # the default robot is loaded before the first clip
        routes = [
            Route("/events", self._show_events),
            Route("/take", self._show_take),
            Route("/do", self._do, methods=["POST"]),
            Route("/add", self._add, methods=["POST"]),
            Route(web.UPLOAD, self._drop, methods=["POST"]),
            Route("/export", self._export),
            *(live_routes(self.following, self._recorded) if self.following else ()),
            *touch_routes(self._editor, ("edit", "undo", "redo", "check", "save")),
        ]
        return serve(partial(Viewer(()).page_with, "studio"), routes, port)


def _too_large(name: str) -> str:
    return f"{name} has more than {web.LARGEST / 1e6:.0f} MB, the most that the studio takes"
