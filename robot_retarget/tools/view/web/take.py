"""A take: a robot's trajectory with its human, warnings, report and solution."""

import base64
import html
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.files import write_text
from robot_retarget.base.pages import rendered
from robot_retarget.collision import Warnings, warnings_of
from robot_retarget.human.match import Match, match
from robot_retarget.human.motion import Motion
from robot_retarget.judge.report import Report
from robot_retarget.robot.model import Robot
from robot_retarget.robot.timing import require_same_robot
from robot_retarget.solver.solution import Solution
from robot_retarget.tools.view.web.show import Packer, take_header
from robot_retarget.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Human:
    """The human's keypoints over the duration of a trajectory."""

    points: Floats
    """(T', K, 3), z up [m]."""
    bones: Ints
    """(B, 2) which keypoints a bone joins."""
    names: tuple[str, ...]
    """K keypoints."""


@dataclass(frozen=True, eq=False)
class Take:
    """One robot in motion.

    Raises:
        TrajectoryError: the trajectory belongs to another robot.
    """

    robot: Robot
    trajectory: Trajectory
    human: Human | None = None
    """The motion that it came from."""
    warnings: Warnings | None = None
    """Of the trajectory (`warnings_of`)."""
    report: Report | None = None
    """Of the trajectory (`simulate`), or of it before a touch-up."""
    solution: Solution | None = None
    """The solution of the trajectory, for the stress of its edges."""
    before: Trajectory | None = None
    """As it was before the latest touch-up, frame by frame."""
    name: str = ""
    """Its name among other takes, such as that of a file; by default its source."""

    def __post_init__(self) -> None:
        require_same_robot(self.trajectory, self.robot)

    @property
    def title(self) -> str:
        """Its title."""
        return f"{self.name or self.trajectory.source or 'a trajectory'} on {self.robot.name}"

    @property
    def stale(self) -> bool:
        """Whether the report is of another motion than the trajectory."""
        judged = self.report and self.report.trajectory
        return judged is not None and not np.array_equal(judged.qpos, self.trajectory.qpos)


def human_of(match: Match, motion: Motion) -> Human:
    """The human of a motion, in all its keypoints."""
    return Human(*match.figure(motion), match.recognition.keypoints)


def take_of(
    trajectory: Trajectory,
    robot: Robot,
    motion: Motion | None = None,
    *,
    overrides: str | Path | None = None,
    report: Report | None = None,
    name: str = "",
) -> Take:
    """A trajectory with what can be said of it: its warnings, and the human where a motion is given.

    Args:
        motion: the trajectory's source; it is shown at the times that the trajectory answers to.
        overrides: a TOML file that replaces lines of the keypoint map (`human.match.match`).
        name: of the take among others.

    Raises:
        TrajectoryError: the trajectory belongs to another robot.
        MatchError: the motion is not human, or the robot no humanoid.
    """
    require_same_robot(trajectory, robot)
    human = None if motion is None else human_of(match(motion, robot, overrides), _in_step(motion, trajectory))
    warnings = warnings_of(trajectory, robot) if len(trajectory) > 1 else None
    return Take(robot, trajectory, human, warnings, report, name=name)


def file_names(paths: Sequence[Path]) -> list[str]:
    """Return different names for paths: file names, with as many folders as are necessary."""
    parts = [path.absolute().parts for path in paths]
    most = max(map(len, parts), default=1)
    found = (["/".join(own[-count:]) for own in parts] for count in range(1, most + 1))
    return next((names for names in found if len(set(names)) == len(set(parts))), [])


def _in_step(motion: Motion, trajectory: Trajectory) -> Motion:
    """The motion at the frames of the trajectory."""
    return motion.at_source_time(trajectory.source_time, trajectory.fps)


# The viewer's page: one HTML file with everything in it, that opens without a server or a network.

if TYPE_CHECKING:
    from robot_retarget.judge.report import Report
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
        """The takes, and more that the page is to know."""
        packer = Packer()
        return packer.packed({"takes": [take_header(take, packer) for take in self.takes], **more})

    @property
    def page(self) -> str:
        """The HTML."""
        return self.page_with()

    def page_with(self, kind: str = "viewer", nonce: str = "") -> str:
        """The HTML.

        Args:
            kind: `viewer`, or where a server answers `touch` (touch-ups) or `studio`.
            nonce: of its scripts, as the server's policy names it.
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
    """Look at motions of robots side by side: `.save("page.html")`, or the cell of a notebook.

    Args:
        shown: results of `retarget`, trajectories, files that `load_trajectory` reads, or takes.
        report: of the first (`simulate`), for its badge and its simulated motion; by default the one beside a file.
        robot: of trajectories and files; by default the robot that they name.
        motion: the human that trajectories and files come from, to show it too.

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
        return take_of(
            played, model, motion, report=report or report_beside(Path(what), played, model), name=Path(what).name
        )
    warnings = what.warnings if len(what.trajectory) > 1 else None
    return Take(what.robot, what.trajectory, human_of(what.match, what.motion), warnings, report, what.solution)


STUDIO = {"live.js", "studio.js", "zip.js"}
"""Scripts that other pages do not load."""


def _scripts(kind: str) -> list[Path]:
    return [path for path in sorted(ASSETS.glob("*.js")) if kind == "studio" or path.name not in STUDIO]


def _asset(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")


def _module(path: Path) -> str:
    """A script as an address that a page without a server can import from."""
    return "data:text/javascript;base64," + base64.b64encode(path.read_bytes()).decode("ascii")
