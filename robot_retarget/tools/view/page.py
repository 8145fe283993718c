"""The report as one page: the verdict in a sentence, a film, limits, charts, then figures. No script, nothing from elsewhere: it opens offline.

Charts are SVG from matplotlib rather than an interactive library: a plotting script of megabytes would be most of the
file, and a static chart shows a fault at once.
"""

import base64
from pathlib import Path
from typing import Any

from robot_retarget.base.errors import TrajectoryError
from robot_retarget.base.files import write_text
from robot_retarget.base.pages import rendered
from robot_retarget.collision import Warnings
from robot_retarget.judge.report import Report
from robot_retarget.judge.report_text import attempted, cured, facts, headline, judged_lines
from robot_retarget.scores.figure import shown
from robot_retarget.tools.view import charts
from robot_retarget.tools.view.film import AnimatedWebP
from robot_retarget.tools.view.picture import Picture, Unavailable
from robot_retarget.trajectory import Trajectory, fingerprint, load_trajectory

TEMPLATE = Path(__file__).with_name("page.html")
STYLE = Path(__file__).with_name("pages.css")
"""Of the report and of the page of a batch."""
UNITS = {"_rad": "rad", "_s": "s", "_Nm": "N m", "_A": "A", "_K": "K", "_share": "of all"}
"""Unit of a joint's figure, by the end of its name."""


def save_page(
    report: Report,
    trajectory: Trajectory | str | Path,
    path: str | Path,
    *,
    warnings: Warnings | None = None,
    strip: Picture | None = None,
    film: Path | AnimatedWebP | Unavailable | None = None,
    viewer: Path | None = None,
) -> Path | Unavailable:
    """Write `report.html`, whole or not at all.

    Args:
        trajectory: that the report is of, or the path of its file.
        warnings: of the trajectory, for the timeline.
        strip: moments of the motion, to embed.
        film: an mp4 or a loop to embed, or the reason for its absence.
        viewer: the viewer's page in the same folder, to link to.

    Raises:
        TrajectoryError: the report is of another trajectory.
        OutputError: it cannot be written.
    """
    played = trajectory if isinstance(trajectory, Trajectory) else load_trajectory(trajectory)
    if fingerprint(trajectory) != report.trajectory_sha256:
        raise TrajectoryError("the report is of another trajectory: their sha256 differ")
    if missing := charts.without_matplotlib():
        return missing
    lines, heads = judged_lines(report), _joint_heads(report.figures["joints"])
    broken = [line for line in lines if not line.held]
    page = rendered(
        TEMPLATE,
        style=STYLE.read_text(encoding="utf-8"),
        report=report,
        motion=played.source or "a trajectory",
        headline=headline(report),
        cures=cured(report),
        **_film(film),
        lines=lines,
        broken=broken,
        kept=f"{len(lines) - len(broken)} of {len(lines)} limits kept",
        strip=None if strip is None else _base64(strip.webp),
        bodies="; ".join(map(str, played.scene.bodies if played.scene else ())),
        viewer=viewer.name if viewer is not None and viewer.is_file() else None,
        charts=_charts(report, warnings),
        facts=[*facts(report.figures), *_foreseen(report.figures)],
        attempts=attempted(report.figures),
        heads=[key.removesuffix(end).replace("_", " ") for key, end in heads.items()],
        joints=[(name, _values(own, heads)) for name, own in report.figures["joints"].items()],
    )
    return write_text(path, page)


def _foreseen(f: Any) -> list[tuple[str, str, str]]:
    predicted = f.get("foreseen")
    if not predicted or not predicted["tracked_contacts"]:
        return []
    share = f"{predicted['tracked_contacts_foreseen']} of {predicted['tracked_contacts']}"
    return [("contacts foreseen", share, "touches on the servos that were warned of")]


def _film(film: Path | AnimatedWebP | Unavailable | None) -> dict[str, str]:
    """Return the film or loop with its caption, or the reason for its absence."""
    found: dict[str, str] = dict.fromkeys(("absent", "loop_data", "film_data", "caption"), "")
    if isinstance(film, Unavailable):
        found["absent"] = film.reason
    elif isinstance(film, AnimatedWebP):
        pace = f"{film.pace:.2g} times as fast as the robot" if film.pace > 1 else ""
        found |= {"loop_data": _base64(film.data), "caption": "; ".join(filter(None, (pace, film.note)))}
    elif film is not None and film.is_file():
        found["film_data"] = _base64(film.read_bytes())
    return found


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


def _charts(
    report: Report, warnings: Warnings | None
) -> list[tuple[str, str, list[tuple[str, str]], list[charts.Chart]]]:
    """Return the title, the explanation, the keys and the charts of every section that has something to show."""
    if not len(report.series.get("time", ())):
        return []
    planned = "" if report.figures["mode"] == "free" else ", as planned"
    plain = ("plain",) * report.figures["compensated"]
    worst = "the joints with the largest error in plain playback"
    drawn = (
        ("Tracking", worst, ("wanted", *plain, "measured"), charts.tracking(report)),
        ("Error and torque by joint", "", (*plain, "measured"), charts.loads(report)),
        ("Balance" + planned, "over the soles, and how far inside them", ("zmp", "com"), charts.balance(report)),
        ("Warnings of contact", "", ("warned", "touch"), charts.timeline(report, warnings)),
    )
    return [
        (title, meaning, [charts.KEYS[key] for key in keys], found) for title, meaning, keys, found in drawn if found
    ]


def _joint_heads(joints: Any) -> dict[str, str]:
    """Return every figure of a joint, with the suffix of its name that means its unit."""
    keys = dict.fromkeys(key for own in joints.values() for key in own)
    return {key: next((end for end in UNITS if key.endswith(end)), "") for key in keys}


def _values(own: Any, heads: dict[str, str]) -> list[str]:
    """Return a joint's figures in common units."""
    found = ((own.get(key), UNITS.get(end, "")) for key, end in heads.items())
    return ["–" if value is None else shown(value, unit) for value, unit in found]
