"""`view`: show trajectories in a browser, on a page, as a film or as pictures."""

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import robot_retarget as rr
from robot_retarget.base.errors import UsageError
from robot_retarget.tools.cli import console
from robot_retarget.tools.cli import options as opt
from robot_retarget.tools.cli.command import argument, command, option, options
from robot_retarget.tools.cli.console import progress
from robot_retarget.tools.cli.run import require_source

if TYPE_CHECKING:
    from robot_retarget.edit.touchup import Session
    from robot_retarget.tools.view.web.serve import Served as Server
    from robot_retarget.tools.view.web.take import Take


@options
class DrawOptions:
    """Files that show the first trajectory, and the page of all."""

    static: Path | None = option("A page to write (.html), that opens without a network.", default=None)
    video: Path | None = option("A film to write (.mp4 or .gif), of the first trajectory.", default=None)
    strip: Path | None = option("A strip of moments to write (.png), of the first trajectory.", default=None)

    @property
    def files(self) -> list[Path]:
        """The files to write."""
        return [path for path in (self.strip, self.video, self.static) if path is not None]


@options
class ViewOptions(opt.ForceOptions, opt.LimitOptions, opt.ServoOptions, opt.MapOptions, opt.ReadOptions):
    """Trajectories, their robots and their clip."""

    trajectories: list[Path] | None = argument(
        "Trajectories .npz, side by side.", default=None, callback=opt.taking("trajectory")
    )
    robot: list[str] | None = option(
        "As for solve; once for all trajectories, or once for each of them; by default the robot that each names.",
        "--robot",
        "-r",
        default=None,
    )
    motion: Path | None = option("The clip that they come from, to show the human too.", default=None)
    simulated: Literal["pinned", "free"] | None = option(
        "Play them on simulated servos before, pinned or free, unless a report is next to them; by default the report's mode.",
        "--simulate",
        default=None,
    )


@options
class ServeOptions:
    """Where the page is served and touch-ups are saved."""

    edits: Path = option(
        "Where touch-ups are saved (.toml), for mend and solve; the trajectory is saved next to it (.npz).",
        default=Path("EDITS.toml"),
    )
    keyframes: str | None = option(
        "Make poses with times, of one robot, in place of trajectories: a file, new or of `edit keyframes` (.json, .bin#PAGE); the trajectory is saved next to it (.npz).",
        default=None,
    )
    port: int = option("Where to serve the page; 0 takes a free port.", default=8410)
    browser: bool = option("Open a browser, if there is a display.", default=True)


@command(epilog="Example: robot-retarget view dance.npz --robot op3 --motion dance.bvh")
def view(viewed: ViewOptions, drawn: DrawOptions, served: ServeOptions, printing: opt.PrintOptions) -> None:
    """Look at trajectories in a browser, a page or a film.

    Robot, human, contacts, balance, near pairs, limits, curves.
    """
    from functools import partial

    from robot_retarget.base.files import require_writable
    from robot_retarget.tools.view.web.editor import serve_viewer
    from robot_retarget.tools.view.web.viewer import Viewer

    if served.keyframes is not None:
        return _keyframes(served.keyframes, viewed, served, printing)
    for path in drawn.files:
        require_writable(path)
    if viewed.motion is None and viewed.frames is not None:
        raise UsageError("--frames is a part of --motion; robot-retarget edit cut keeps a part of a trajectory")
    clip = None if viewed.motion is None else viewed.read(viewed.motion)
    takes = _takes(viewed, clip)
    _draw(takes[0], drawn)
    if drawn.static is not None:
        page = Viewer(takes).save(drawn.static)
        console.note(f"{page} has {page.stat().st_size / 1e6:.1f} MB")
    if written := [str(path) for path in drawn.files]:
        printing.result({"files": written}, f"wrote {', '.join(written)}")
    else:
        editor = None if clip is None else _editor(takes[0], clip, viewed.map_file, served.edits)
        report = takes[0].report
        mode = viewed.simulated or ("auto" if report is None else report.figures["mode"])
        page = serve_viewer(Viewer(takes), served.port, editor, partial(rr.simulate, robot=takes[0].robot, mode=mode))
        show_page(page, served.browser, printing)


def _keyframes(name: str, viewed: ViewOptions, served: ServeOptions, printing: opt.PrintOptions) -> None:
    """Serve a page that makes keyframes.

    Raises:
        UsageError: trajectories or several robots are given, too.
    """
    from functools import partial

    from robot_retarget.edit.keyframe_files import keyframe_file
    from robot_retarget.tools.view.web.keyframes import KeyframeDesk, serve_keyframes

    if viewed.trajectories or len(viewed.robot or ()) > 1:
        raise UsageError("--keyframes makes one motion of one robot: give no trajectory, and --robot once")
    robot = opt.load(opt.named_robot("".join(viewed.robot or ())), viewed.limits, viewed.servos)
    mode = viewed.simulated or ("free" if robot.floating else "pinned")
    desk = KeyframeDesk(keyframe_file(name, robot), partial(rr.simulate, robot=robot, mode=mode))
    show_page(serve_keyframes(desk, served.port), served.browser, printing)


def _takes(viewed: ViewOptions, clip: "rr.Motion | None") -> "tuple[Take, ...]":
    from robot_retarget.judge.rollout import report_beside
    from robot_retarget.tools.view.web.take import file_names, take_of

    trajectories, mode = viewed.trajectories or [], viewed.simulated
    if not trajectories:
        raise UsageError("give trajectories to look at, or --keyframes FILE to make a motion")
    robots = viewed.robot or [rr.load_trajectory(path).robot for path in trajectories]
    if len(robots) not in (1, len(trajectories)):
        raise UsageError(f"--robot is given once, or {len(trajectories)} times; got {len(robots)}")
    models = {name: opt.load(name, viewed.limits) for name in robots}
    takes = []
    names = file_names(trajectories) if len(trajectories) > 1 else [""]
    for path, name, file in zip(trajectories, robots * (len(trajectories) // len(robots)), names, strict=True):
        played = rr.load_trajectory(path, models[name])
        if clip is not None:
            require_source(played, clip, viewed.force)
        beside = report_beside(path, played, models[name], mode)
        report = rr.simulate(played, models[name], mode=mode) if mode and beside is None else beside
        takes.append(take_of(played, models[name], clip, overrides=viewed.map_file, report=report, name=file))
    return tuple(takes)


def _draw(take: "Take", drawn: DrawOptions) -> None:
    """Write the requested pictures.

    Raises:
        UsageError: a picture cannot be drawn.
    """
    from robot_retarget.tools.view.film import strip, video
    from robot_retarget.tools.view.picture import Picture, Unavailable

    what = take.robot, take.trajectory
    shown = (take.human.points, take.human.bones) if take.human else (None, None)
    with progress() as begin:
        film = drawn.video and (video(*what, drawn.video, *shown, progress=begin("film")), drawn.video)
        picture = drawn.strip and (strip(*what, *shown), drawn.strip)
    for outcome, path in filter(None, (picture, film)):
        if isinstance(outcome, Unavailable):
            raise UsageError(f"cannot draw {path}: {outcome.reason}")
        if isinstance(outcome, Picture):
            outcome.save(path)
        if outcome.note:
            console.note(outcome.note)


def _editor(take: "Take", motion: "rr.Motion", map_file: Path | None, edits: Path) -> "Session":
    """What touches up the first trajectory."""
    from robot_retarget.edit.touchup import Session, graph_of

    graph = graph_of(motion, take.robot, take.trajectory, map_file)
    return Session(graph, take.trajectory, edits, edits.with_suffix(".npz"))


def show_page(served: "Server", browser: bool, printing: opt.PrintOptions) -> None:
    """Say where a page is served, open it in a browser, and serve it until Ctrl-C."""
    import os
    import sys
    import webbrowser

    sentence = f"{served.address} shows it; from elsewhere first: {served.tunnel_command()}. Ctrl-C ends."
    printing.result({"address": served.address}, sentence)
    if browser and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or sys.platform != "linux"):
        webbrowser.open(served.address)
    served.forever()
