"""Everything that a run writes at its end: summary, lists of filters, near-duplicates, pictures of extremes."""

from collections.abc import Sequence
from pathlib import Path

from robot_retarget.base.errors import RobotRetargetError
from robot_retarget.base.files import folder, write_csv, write_text
from robot_retarget.tools.batch.duplicates import near_duplicates
from robot_retarget.tools.batch.filters import Chosen, Filter, choose
from robot_retarget.tools.batch.page import ClipCard, extremes_of, save_page
from robot_retarget.tools.batch.summary import save_csv, save_parquet
from robot_retarget.tools.batch.task import Job, Row, robot_of

LISTS, PICTURES = "lists", "extremes"


def write_reports(rows: Sequence[Row], filters: Sequence[Filter], job: Job, extremes: int) -> list[Chosen]:
    """Write `summary.csv`, `summary.parquet`, `summary.html`, `lists/` and `extremes/` into the folder of results.

    Args:
        extremes: how many of the worst and of the best clips get a strip and a viewer.
    """
    out = job.out
    save_csv(rows, out / "summary.csv")
    save_parquet(rows, out / "summary.parquet")
    chosen = [choose(rows, one) for one in filters]
    for one in chosen:
        _save_lists(one, folder(out / LISTS))
    pairs = near_duplicates(rows)
    write_csv(folder(out / LISTS) / "near_duplicates.csv", ("robot", "clip", "like"), pairs)
    shown = [_pictured(row, job) for row in extremes_of(rows, extremes)] if extremes else []
    save_page(rows, chosen, shown, len(pairs), out / "summary.html")
    return chosen


def _save_lists(one: Chosen, target: Path) -> None:
    """The outputs that pass, a path a line, and the others with their reasons."""
    write_text(target / f"{one.filter.name}.txt", "".join(f"{row.robot}/{row.clip}.npz\n" for row in one.passed))
    rejected = ((row.robot, row.clip, "; ".join(reasons)) for row, reasons in one.rejected)
    write_csv(target / f"{one.filter.name}_rejected.csv", ("robot", "clip", "reasons"), rejected)


def _pictured(row: Row, job: Job) -> ClipCard:
    """Draw a strip and a viewer of a row."""
    from robot_retarget.tools.view.film import strip
    from robot_retarget.tools.view.picture import Picture
    from robot_retarget.tools.view.web.take import Take, Viewer
    from robot_retarget.trajectory import load_trajectory

    name = next(name for name in job.robots if robot_of(name, job.settings.limits).name == row.robot)
    robot, target = robot_of(name, job.settings.limits), folder(job.out / PICTURES)
    stem = f"{row.robot}-{row.clip.replace('/', '-')}"
    try:
        trajectory = load_trajectory(job.out / row.robot / f"{row.clip}.npz")
        Viewer((Take(robot, trajectory),)).save(target / f"{stem}.html")
        picture = strip(robot, trajectory, count=6, height=240)
    except RobotRetargetError:
        return ClipCard(row, None, None)
    if isinstance(picture, Picture):
        picture.save(target / f"{stem}.png")
    drawn = f"{PICTURES}/{stem}.png" if isinstance(picture, Picture) else None
    return ClipCard(row, drawn, f"{PICTURES}/{stem}.html")
