"""`studio`: one page to drop a clip and choose a robot, see, correct, judge and export."""

from pathlib import Path

from robot_retarget.tools.cli import options as opt
from robot_retarget.tools.cli.command import argument, command, option, options
from robot_retarget.tools.cli.view import show_page


@options
class StudioOptions:
    """The clips that the page begins with, and where its files are kept."""

    clips: list[Path] | None = argument("Motions to begin with; a folder stands for its files.", default=None)
    robot: str = option(f"{opt.ROBOT}, for these.", "--robot", "-r", default=opt.DEFAULT_ROBOT)
    out: Path = option("Folder of the studio: each clip has a folder in it.", *opt.OUT, default=Path("studio"))
    port: int = option("Where to serve the page; 0 takes a free port.", default=8410)
    browser: bool = option("Open a browser, if there is a display.", default=True)


@command(epilog="Example: robot-retarget studio dance.bvh --robot op3")
def studio(how: StudioOptions, printing: opt.PrintOptions) -> None:
    """Retarget, correct, judge and export on a page.

    Motions and robots are dropped into the page, which only this machine can open.
    """
    from robot_retarget.tools.studio.studio import Studio

    opened = Studio(how.out)
    served = opened.served(how.port)
    opened.reopen()
    for clip in how.clips or ():
        opened.bring(clip, how.robot)
    show_page(served, how.browser, printing)
