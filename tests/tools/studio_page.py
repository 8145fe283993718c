"""A studio that is served, and what a page or a shell asks of it."""

import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.parse import urlencode
from urllib.request import Request, urlopen

from robot_retarget.base.files import SAMPLES
from robot_retarget.tools.studio.project import Project
from robot_retarget.tools.studio.studio import Studio
from robot_retarget.tools.view.web.serve import Served

PATIENCE = 120.0
"""So long a step may take on a busy machine [s]."""


def short_clip(folder: Path) -> Path:
    """Write a clip of 24 frames of the sample `wave`."""
    head, frames = (SAMPLES / "wave.bvh").read_text(encoding="utf-8").split("Frame Time:", 1)
    interval, *rows = frames.splitlines()
    head = head.rsplit("Frames:", 1)[0] + f"Frames: 24\nFrame Time:{interval}\n"
    path = folder / "my wave.bvh"
    path.write_text(head + "\n".join(rows[40:64]) + "\n", encoding="utf-8")
    return path


class Opened:
    """A studio at its address."""

    def __init__(self, studio: Studio, served: Served) -> None:
        self.studio, self.served = studio, served

    def asked(self, path: str, content: bytes | None = None, **more: str) -> bytes:
        """What the studio answers to a request; an error raises `HTTPError`."""
        where = f"http://localhost:{self.served.port}/{path}?{urlencode({'token': self.served.token, **more})}"
        kind = {} if content is None or path == "drop" else {"Content-Type": "application/json"}
        with urlopen(Request(where, content, kind)) as answer:
            return answer.read()

    def refusal(self, path: str, content: bytes | None = None, **more: str) -> tuple[int, str]:
        """Status and reason of a request that is refused."""
        try:
            self.asked(path, content, **more)
        except HTTPError as error:
            said = error.read().decode()
            return error.code, json.loads(said)["error"] if said.startswith("{") else said
        raise AssertionError(f"{path} was answered")

    def drop(self, path: Path, robot: str = "op3") -> dict[str, Any]:
        """Drop a file."""
        return json.loads(self.asked("drop", path.read_bytes(), name=path.name, robot=robot))

    def do(self, project: Project, what: str, value: Any = None) -> None:
        """Ask for something and wait until it is done."""
        self.asked("do", json.dumps({"what": what, "value": value}).encode(), project=project.key)
        self.wait(project)

    def wait(self, project: Project) -> None:
        """Wait until nothing is computed for a project."""
        end = time.monotonic() + PATIENCE
        while project.work.busy:
            assert time.monotonic() < end, project.line()
            time.sleep(0.05)

    def solved(self, path: Path, robot: str = "op3") -> Project:
        """Drop a clip and wait until it is solved."""
        project = self.studio.project(self.drop(path, robot)["projects"][0])
        self.wait(project)
        assert project.work.state == "solved", project.line()
        return project


@contextmanager
def opened_studio(place: Path) -> Iterator[Opened]:
    """A studio in a folder, closed at the end."""
    studio = Studio(place)
    served = studio.served(0)
    thread = threading.Thread(target=served.forever, daemon=True)
    thread.start()
    try:
        yield Opened(studio, served)
    finally:
        served.close()
        thread.join(5)
