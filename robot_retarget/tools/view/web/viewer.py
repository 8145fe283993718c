"""The viewer's page: one HTML file with everything in it, that opens without a server or a network."""

import base64
import html
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_retarget.base.files import write_text
from robot_retarget.base.pages import rendered
from robot_retarget.human.motion import Motion
from robot_retarget.judge.report import Report
from robot_retarget.robot.model import Robot
from robot_retarget.tools.view.web.show import Packer, take_header
from robot_retarget.tools.view.web.take import Take, human_of, take_of
from robot_retarget.trajectory import Trajectory

if TYPE_CHECKING:
    from robot_retarget.solver.pipeline import Result

ASSETS = Path(__file__).with_name("assets")
CELL = 720
"""Height of the page in a notebook's cell [pixels]."""


@dataclass(frozen=True, eq=False)
class Viewer:
    """Takes side by side on one page. In a notebook it shows itself."""

    takes: tuple[Take, ...]

    def __repr__(self) -> str:
        return f"<Viewer of {', '.join(take.title for take in self.takes)}>"

    @cached_property
    def data(self) -> bytes:
        """The packed data of the page."""
        return self.packed({})

    def packed(self, more: dict[str, Any]) -> bytes:
        """Return the packed takes; `more` adds entries to the header."""
        packer = Packer()
        return packer.packed({"takes": [take_header(take, packer) for take in self.takes], **more})

    @property
    def page(self) -> str:
        """The HTML."""
        return self.page_with()

    def page_with(self, kind: str = "viewer", nonce: str = "") -> str:
        """The HTML.

        Args:
            kind: `viewer`, or with a server `touch` (touch-ups), `keyframes` or `studio`.
            nonce: nonce of its scripts in the server's policy.
        """
        return rendered(
            ASSETS / "page.html",
            title=" · ".join(take.title for take in self.takes),
            style=_asset("vendor.css") + _asset("style.css"),
            modules=json.dumps({"imports": {f"#{path.stem}": _module(path) for path in _scripts(kind)}}),
            licences=_asset("vendor.LICENCES.txt").replace("--", "–"),
            kind=kind,
            nonce=nonce,
            data=base64.b64encode(self.data).decode("ascii"),
        )

    def save(self, path: str | Path) -> Path:
        """Write the page, whole or not at all.

        Raises:
            OutputError: it cannot be written.
        """
        return write_text(path, self.page)

    def _repr_html_(self) -> str:
        frame = f"width:100%;height:{CELL}px;border:0;border-radius:8px"
        return f'<iframe srcdoc="{html.escape(self.page)}" style="{frame}" allow="fullscreen"></iframe>'


def view(
    *shown: "Take | Result | Trajectory | str | Path",
    report: "Report | None" = None,
    robot: "Robot | str | Path | None" = None,
    motion: "Motion | None" = None,
) -> Viewer:
    """Show motions of robots side by side, in a notebook or with `.save("page.html")`.

    Args:
        shown: results of `retarget`, trajectories, files that `load_trajectory` reads, or takes.
        report: the report of the first motion (`simulate`), for badge and simulated motion; by default the one next to its file.
        robot: the robot of trajectories and files; by default the robot that they name.
        motion: the human motion of trajectories and files.

    Raises:
        RobotError: the robot that a trajectory names is not known: give `robot`.
        TrajectoryError: a file cannot be read, or belongs to another robot.
    """
    return Viewer(tuple(_take(what, report if k == 0 else None, robot, motion) for k, what in enumerate(shown)))


def _take(
    what: "Take | Result | Trajectory | str | Path",
    report: "Report | None",
    robot: "Robot | str | Path | None",
    motion: Motion | None,
) -> Take:
    from robot_retarget.formats import load_trajectory
    from robot_retarget.judge.rollout import report_beside
    from robot_retarget.robot import as_robot

    if isinstance(what, Take):
        return what
    if isinstance(what, Trajectory):
        return take_of(what, as_robot(robot or what.robot), motion, report=report)
    if isinstance(what, str | Path):
        model = None if robot is None else as_robot(robot)
        played = load_trajectory(what, model)
        model = model or as_robot(played.robot)
        report = report or report_beside(Path(what), played, model)
        return take_of(played, model, motion, report=report, name=Path(what).name)
    warnings = what.warnings if len(what.trajectory) > 1 else None
    return Take(what.robot, what.trajectory, human_of(what.match, what.motion), warnings, report, what.solution)


STUDIO = {"live.js", "studio.js", "zip.js"}
"""Scripts of the studio's page only."""


def _scripts(kind: str) -> list[Path]:
    return [path for path in sorted(ASSETS.glob("*.js")) if kind == "studio" or path.name not in STUDIO]


def _asset(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")


def _module(path: Path) -> str:
    """Return a script as a data URL, which a page without a server can import."""
    return "data:text/javascript;base64," + base64.b64encode(path.read_bytes()).decode("ascii")
