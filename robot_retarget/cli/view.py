"""`view`: show trajectories in a browser, on a page, as a film or as pictures."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from robot_retarget.cli import console
from robot_retarget.cli.bars import progress
from robot_retarget.cli.options import Force, Frames, Json, Limits, Overrides, Quiet, Up
from robot_retarget.cli.stages import FILM_COST, load, read_clip, require_source
from robot_retarget.errors import UsageError

if TYPE_CHECKING:
    from robot_retarget.motion import Motion
    from robot_retarget.robot import Robot
    from robot_retarget.simulate.plant import Mode
    from robot_retarget.view.web import Take
    from robot_retarget.view.web.serve import Editor, Judge, Served

commands: typer.Typer = typer.Typer()

Output = Path | None


@commands.command(epilog="Example: robot-retarget view dance.npz --robot op3 --motion dance.bvh")
def view(
    trajectories: Annotated[list[Path], typer.Argument(help="Trajectories .npz, side by side.")],
    robot: Annotated[
        list[str],
        typer.Option("--robot", "-r", help="As for solve; once for all trajectories, or once for each of them."),
    ],
    motion: Annotated[Path | None, typer.Option(help="The clip that they come from, to show the human too.")] = None,
    frames: Frames = None,
    up: Up = None,
    map_file: Overrides = None,
    simulated: Annotated[
        Literal["pinned", "free"] | None,
        typer.Option(
            "--simulate",
            help="Play them on simulated servos before, pinned or free, where no report lies beside; by default the report's mode.",
        ),
    ] = None,
    static: Annotated[Output, typer.Option(help="A page to write (.html), that opens without a network.")] = None,
    video: Annotated[Output, typer.Option(help="A film to write (.mp4), of the first trajectory.")] = None,
    gif: Annotated[Output, typer.Option(help="An animated GIF to write, of the first trajectory.")] = None,
    strip: Annotated[Output, typer.Option(help="A strip of moments to write (.png), of the first trajectory.")] = None,
    edits: Annotated[
        Path,
        typer.Option(
            help="Where touch-ups are saved (.toml), for mend and solve; the trajectory is saved next to it (.npz)."
        ),
    ] = Path("EDITS.toml"),
    port: Annotated[int, typer.Option(help="Where to serve the page; 0 takes a free port.")] = 8410,
    browser: Annotated[bool, typer.Option(help="Open a browser, if there is a display.")] = True,
    limits: Limits = None,
    force: Force = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Look at trajectories: robot, human, contacts, balance, near pairs, limits, curves."""
    from robot_retarget.files import require_writable
    from robot_retarget.view.web import Viewer
    from robot_retarget.view.web.serve import serve

    for path in filter(None, (static, video, gif, strip)):
        require_writable(path)
    clip = None if motion is None else read_clip(motion, frames, up=up)
    takes = _takes(trajectories, robot, clip, map_file, simulated, limits, force)
    _draw(takes[0], video, gif, strip)
    if static is not None:
        page = Viewer(takes).save(static)
        console.note(f"{page} has {page.stat().st_size / 1e6:.1f} MB")
    if written := [str(path) for path in (strip, video, gif, static) if path is not None]:
        console.show_result({"files": written}, f"wrote {', '.join(written)}", json)
    else:
        editor = None if clip is None else _editor(takes[0], clip, map_file, edits)
        judged = takes[0].report
        mode = simulated or ("auto" if judged is None else judged.figures["mode"])
        served = serve(Viewer(takes), port, editor, judge=_judge(takes[0].robot, mode))
        _answer(served, browser, json)


def _takes(
    trajectories: list[Path],
    robots: list[str],
    clip: "Motion | None",
    map_file: Path | None,
    mode: "Mode | None",
    limits: Path | None,
    force: bool,
) -> "tuple[Take, ...]":
    from robot_retarget.formats import load_trajectory
    from robot_retarget.simulate.rollout import report_beside, simulate
    from robot_retarget.view.web import file_names, take_of

    if len(robots) not in (1, len(trajectories)):
        raise UsageError(f"--robot is given once, or {len(trajectories)} times; got {len(robots)}")
    models = {name: load(name, limits) for name in robots}
    takes = []
    names = file_names(trajectories) if len(trajectories) > 1 else [""]
    for path, name, file in zip(trajectories, robots * (len(trajectories) // len(robots)), names, strict=True):
        played = load_trajectory(path, models[name])
        if clip is not None:
            require_source(played, clip, force)
        beside = report_beside(path, played, models[name], mode)
        report = simulate(played, models[name], mode=mode) if mode and beside is None else beside
        takes.append(take_of(played, models[name], clip, overrides=map_file, report=report, name=file))
    return tuple(takes)


def _draw(take: "Take", video: Output, gif: Output, strip: Output) -> None:
    """Write the requested pictures.

    Raises:
        UsageError: a picture cannot be drawn.
    """
    from robot_retarget.view import Unavailable
    from robot_retarget.view import gif as write_gif
    from robot_retarget.view import strip as draw_strip
    from robot_retarget.view import video as write_video

    shown = (take.human.points, take.human.bones) if take.human else (None, None)
    what = take.robot, take.trajectory
    if strip is not None:
        drawn = draw_strip(*what, *shown)
        _require_drawn(drawn if isinstance(drawn, Unavailable) else drawn.save(strip), strip)
    if video is not None:
        with progress({"film": FILM_COST * take.trajectory.duration}) as stages:
            film = write_video(*what, video, *shown, progress=stages.begin("film"))
        _require_drawn(film, video)
    if gif is not None:
        with progress({"gif": take.trajectory.duration}) as stages:
            film = write_gif(*what, gif, *shown, progress=stages.begin("gif"))
        _require_drawn(film, gif)


def _require_drawn(outcome: object, path: Path) -> None:
    from robot_retarget.view import Film, Unavailable

    if isinstance(outcome, Unavailable):
        raise UsageError(f"cannot draw {path}: {outcome.reason}")
    if isinstance(outcome, Film) and outcome.note:
        console.note(outcome.note)


def _editor(take: "Take", motion: "Motion", map_file: Path | None, edits: Path) -> "Editor":
    """What touches up the first trajectory."""
    from robot_retarget.edit.session import Session, graph_of

    graph = graph_of(motion, take.robot, take.trajectory, map_file)
    return Session(graph, take.trajectory, edits, edits.with_suffix(".npz"))


def _judge(robot: "Robot", mode: str) -> "Judge":
    """What passes the verdict on a trajectory after a touch-up."""
    from functools import partial

    from robot_retarget.simulate.rollout import simulate

    return partial(simulate, robot=robot, mode=mode)


def _answer(served: "Served", browser: bool, json: bool) -> None:
    import os
    import sys
    import webbrowser

    sentence = f"{served.address} shows it; from elsewhere first: {served.tunnel_command()}. Ctrl-C ends."
    console.show_result({"address": served.address}, sentence, json)
    if browser and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or sys.platform != "linux"):
        webbrowser.open(served.address)
    served.forever()
