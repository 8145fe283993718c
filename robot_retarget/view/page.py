"""The report as one page: the verdict in a sentence, pictures, charts, then figures. No script, nothing from elsewhere: it opens offline.

Charts are SVG from matplotlib rather than an interactive library: a plotting script of megabytes would be most of the
file, and a static chart shows a fault at once.
"""

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path
from string import Template
from typing import Any

from robot_retarget.collision.warn import Warnings
from robot_retarget.errors import TrajectoryError
from robot_retarget.files import replacing
from robot_retarget.simulate.report import Report
from robot_retarget.simulate.report_text import facts, headline, judged_lines
from robot_retarget.trajectory import Trajectory, fingerprint, load_trajectory
from robot_retarget.view import charts
from robot_retarget.view.approaches import NEEDS_MATPLOTLIB
from robot_retarget.view.picture import Unavailable

TEMPLATE = Path(__file__).with_name("page.html")


def save_page(
    report: Report,
    trajectory: Trajectory | str | Path,
    path: str | Path,
    *,
    warnings: Warnings | None = None,
    strip: Path | None = None,
    film: Path | None = None,
    viewer: Path | None = None,
) -> Path | Unavailable:
    """Write `report.html`, whole or not at all.

    Args:
        trajectory: that the report is of, or the path of its file.
        warnings: of the trajectory, for the timeline.
        strip: a picture (PNG) to embed.
        film: an mp4 to embed.
        viewer: the viewer's page in the same folder, to link to.

    Raises:
        TrajectoryError: the report is of another trajectory.
        OutputError: it cannot be written.
    """
    played = trajectory if isinstance(trajectory, Trajectory) else load_trajectory(trajectory)
    if fingerprint(trajectory) != report.trajectory_sha256:
        raise TrajectoryError("the report is of another trajectory: their sha256 differ")
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        return Unavailable(NEEDS_MATPLOTLIB)
    page = Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        title=html.escape(f"{played.source or 'a trajectory'} on {report.robot}: {report.badge.text}"),
        level=report.badge.level,
        badge=html.escape(report.badge.text),
        motion=html.escape(played.source or "a trajectory"),
        robot=html.escape(report.robot),
        how=_how(report),
        reasons=_reasons(report),
        headline=html.escape(headline(report)),
        facts=_facts(report.figures),
        pictures=_pictures(strip, film, viewer),
        charts=_charts(report, warnings),
        checks=_checks(report),
        joints=_joints(report.figures["joints"]),
        notes=_notes(report.figures["notes"]),
        sha256=report.trajectory_sha256,
        version=html.escape(report.version),
    )
    with replacing(path) as scratch:
        scratch.write_text(page, encoding="utf-8")
    return Path(path)


def _how(report: Report) -> str:
    f = report.figures
    mode = "standing free on a floor" if f["mode"] == "free" else "pelvis held"
    goals = "goals compensate lag and load" if f["compensated"] else "goals without compensation"
    return f"{f['duration_s']:.3g} s, {f['frames']} frames at {f['fps']:g} fps · {mode} · {goals}"


def _reasons(report: Report) -> str:
    """Reasons and differences from the human; advice on what failed."""
    if report.badge.level == "pass":
        return "<p>Every limit below is kept.</p>"
    advice = _advice(report.figures) if report.reasons else []
    return _list((*report.reasons, *report.unlike)) + "".join(f"<p>{html.escape(text)}</p>" for text in advice)


def _advice(f: Any) -> list[str]:
    """Return advice on failures that an option can prevent, a sentence each."""
    told = []
    if f.get("fall_s") is not None:
        told.append("To stay upright: keep both feet in place (--legs stand), or use balance (--balance static).")
    if f["speed_ratio"] > 1:
        told.append(
            f"{f['speed_ratio_joint']} exceeds its speed limit in the plan: slow the clip, or leave the quick move out."
        )
    if f["self_contact_share"] > 0 or f["tracked_self_contact_share"] > 0:
        told.append("Where links touch, and when: see the warnings below, and the near pairs in the viewer.")
    return told


def _facts(f: Any) -> str:
    """Return every reported figure with its meaning."""
    rows = [
        f"<tr><td>{html.escape(what)}</td><td><b>{html.escape(value)}</b></td><td>{html.escape(meaning)}</td></tr>"
        for what, value, meaning in (*facts(f), *_foreseen(f))
    ]
    return _table(("figure", "value", "meaning"), rows)


def _foreseen(f: Any) -> list[tuple[str, str, str]]:
    told = f.get("foreseen")
    if not told or not told["tracked_contacts"]:
        return []
    share = f"{told['tracked_contacts_foreseen']} of {told['tracked_contacts']}"
    return [("contacts foreseen", share, "touches on the servos that were warned of")]


def _pictures(strip: Path | None, film: Path | None, viewer: Path | None) -> str:
    parts = []
    if viewer is not None and viewer.is_file():
        parts.append(f"<p class='said'><a href='{html.escape(viewer.name)}'>Look at it from all sides</a></p>")
    if strip is not None and strip.is_file():
        parts.append(f"<img alt='moments of the motion' src='data:image/png;base64,{_encoded(strip)}'>")
    if film is not None and film.is_file():
        parts.append(f"<video controls loop muted src='data:video/mp4;base64,{_encoded(film)}'></video>")
    return f"<section><h2>The motion</h2>{''.join(parts)}</section>" if parts else ""


def _encoded(path: Path) -> str:
    return base64.b64encode(path.read_bytes()).decode("ascii")


def _charts(report: Report, warnings: Warnings | None) -> str:
    planned = "" if report.figures["mode"] == "free" else ", as planned"
    drawn = (
        ("Tracking", "the joints with the largest error in plain playback", lambda: charts.tracking(report)),
        ("Error by joint", "", lambda: charts.errors(report)),
        ("Torque against its limit", "", lambda: charts.torques(report)),
        ("Balance" + planned, "over the soles, and how far inside them", lambda: charts.balance(report)),
        (
            "Warnings of self-contact",
            "bars: warnings; red: contacts in the plan; triangles: start of contacts on the servos",
            lambda: charts.timeline(report, warnings),
        ),
    )
    if not len(report.series.get("time", ())):
        return ""
    parts = [(title, said, draw()) for title, said, draw in drawn]
    return "".join(f"<section><h2>{t}</h2><p class='said'>{s}</p>{chart}</section>" for t, s, chart in parts if chart)


def _checks(report: Report) -> str:
    rows = [
        f"<tr><td class='{'yes' if line.held else 'no'}'>{'✓' if line.held else '✗'}</td>"
        f"<td>{html.escape(line.what)}</td><td>{line.value}</td><td>{line.most}</td></tr>"
        for line in judged_lines(report)
    ]
    return _table(("", "what", "is", "at most"), rows)


def _joints(joints: Any) -> str:
    """Every joint a row, every figure a column."""
    keys = list(dict.fromkeys(key for own in joints.values() for key in own))
    rows = [
        f"<tr><td>{html.escape(name)}</td>{''.join(f'<td>{_number(own.get(key))}</td>' for key in keys)}</tr>"
        for name, own in joints.items()
    ]
    return _table(("joint", *(key.replace("_", " ") for key in keys)), rows)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


def _table(heads: Sequence[str], rows: Iterable[str]) -> str:
    head = "".join(f"<th>{html.escape(name)}</th>" for name in heads)
    return f"<div class='wide'><table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"


def _notes(notes: Sequence[str]) -> str:
    return f"<section><h2>Notes</h2>{_list(notes)}</section>" if notes else ""


def _list(sentences: Iterable[str]) -> str:
    return "<ul>" + "".join(f"<li>{html.escape(sentence)}</li>" for sentence in sentences) + "</ul>"
