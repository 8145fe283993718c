"""The report as one page: the verdict in a sentence, a film, limits, charts, then figures. No script, nothing from elsewhere: it opens offline.

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
from robot_retarget.simulate.report_text import Line, facts, headline, judged_lines
from robot_retarget.simulate.units import shown
from robot_retarget.trajectory import Trajectory, fingerprint, load_trajectory
from robot_retarget.view import charts
from robot_retarget.view.approaches import NEEDS_MATPLOTLIB
from robot_retarget.view.loop import AnimatedWebP
from robot_retarget.view.picture import Picture, Unavailable

TEMPLATE = Path(__file__).with_name("page.html")
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
        film=_film(film),
        pictures=_pictures(strip, viewer),
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
    advice = _advice(report.figures) if report.reasons else []
    found = (*report.reasons, *report.unlike)
    return (_list(found) if found else "") + "".join(f"<p>{html.escape(text)}</p>" for text in advice)


def _advice(f: Any) -> list[str]:
    """Return advice on failures that an option can prevent, a sentence each."""
    advice = []
    if f.get("fall_s") is not None:
        advice.append("To stay upright: keep both feet in place (--legs stand), or use balance (--balance static).")
    if f["speed_ratio"] > 1:
        advice.append(
            f"{f['speed_ratio_joint']} exceeds its speed limit in the plan: slow the clip, or leave the quick move out."
        )
    if f["self_contact_share"] > 0 or f["tracked_self_contact_share"] > 0:
        advice.append("Where links touch, and when: see the warnings below, and the near pairs in the viewer.")
    return advice


def _facts(f: Any) -> str:
    """Return every reported figure with its meaning."""
    rows = [
        f"<tr><td>{html.escape(what)}</td><td><b>{html.escape(value)}</b></td><td>{html.escape(meaning)}</td></tr>"
        for what, value, meaning in (*facts(f), *_foreseen(f))
    ]
    return _table(("figure", "value", "meaning"), rows)


def _foreseen(f: Any) -> list[tuple[str, str, str]]:
    predicted = f.get("foreseen")
    if not predicted or not predicted["tracked_contacts"]:
        return []
    share = f"{predicted['tracked_contacts_foreseen']} of {predicted['tracked_contacts']}"
    return [("contacts foreseen", share, "touches on the servos that were warned of")]


def _film(film: Path | AnimatedWebP | Unavailable | None) -> str:
    """Return the film, which begins again when it ends, or a sentence in its place."""
    if isinstance(film, Unavailable):
        return f"<p class='film said'>No film: {html.escape(film.reason)}.</p>"
    if isinstance(film, AnimatedWebP):
        pace = f"{film.pace:.2g} times as fast as the robot" if film.pace > 1 else ""
        said = html.escape("; ".join(filter(None, (pace, film.note))))
        image = f"<img alt='film of the motion' src='data:image/webp;base64,{_base64(film.data)}'>"
        return f"<figure class='film'>{image}<figcaption class='said'>{said}</figcaption></figure>"
    if film is None or not film.is_file():
        return ""
    source = f"data:video/mp4;base64,{_base64(film.read_bytes())}"
    return f"<figure class='film'><video autoplay loop muted playsinline controls src='{source}'></video></figure>"


def _pictures(strip: Picture | None, viewer: Path | None) -> str:
    parts = []
    if viewer is not None and viewer.is_file():
        parts.append(f"<p class='said'><a href='{html.escape(viewer.name)}'>Look at it from all sides</a></p>")
    if strip is not None:
        parts.append(f"<img alt='moments of the motion' src='data:image/webp;base64,{_base64(strip.webp)}'>")
    return f"<section><h2>The motion</h2>{''.join(parts)}</section>" if parts else ""


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


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
    """Return how many limits are kept, the broken ones in full view, and all of them folded."""
    lines = judged_lines(report)
    broken = [line for line in lines if not line.held]
    summary = f"{len(lines) - len(broken)} of {len(lines)} limits kept"
    if not broken:
        return f"<details><summary>{summary}</summary>{_judged(lines)}</details>"
    return f"<h2>{summary}</h2>{_judged(broken)}<details><summary>All limits</summary>{_judged(lines)}</details>"


def _judged(lines: Sequence[Line]) -> str:
    rows = [
        f"<tr><td class='{'yes' if line.held else 'no'}'>{'✓' if line.held else '✗'}</td>"
        f"<td>{html.escape(line.what)}</td><td>{line.value}</td><td>{line.most}</td></tr>"
        for line in lines
    ]
    return _table(("", "what", "is", "at most"), rows)


def _joints(joints: Any) -> str:
    """Every joint a row, every figure a column."""
    keys = list(dict.fromkeys(key for own in joints.values() for key in own))
    ends = [next((end for end in UNITS if key.endswith(end)), "") for key in keys]
    rows = [
        f"<tr><td>{html.escape(name)}</td>"
        + "".join(f"<td>{_number(own.get(key), UNITS.get(end, ''))}</td>" for key, end in zip(keys, ends, strict=True))
        + "</tr>"
        for name, own in joints.items()
    ]
    heads = (key.removesuffix(end).replace("_", " ") for key, end in zip(keys, ends, strict=True))
    return _table(("joint", *heads), rows)


def _number(value: float | None, unit: str) -> str:
    return "–" if value is None else shown(value, unit)


def _table(heads: Sequence[str], rows: Iterable[str]) -> str:
    head = "".join(f"<th>{html.escape(name)}</th>" for name in heads)
    return f"<div class='wide'><table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"


def _notes(notes: Sequence[str]) -> str:
    return f"<section><h2>Notes</h2>{_list(notes)}</section>" if notes else ""


def _list(sentences: Iterable[str]) -> str:
    return "<ul>" + "".join(f"<li>{html.escape(sentence)}</li>" for sentence in sentences) + "</ul>"
