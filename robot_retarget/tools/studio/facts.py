"""The facts of a project on the page: keypoints, choices, marks, verdict, formats and commands."""

from typing import Any

import numpy as np

from robot_retarget.base.arrays import intervals
from robot_retarget.base.keypoints import KEYPOINTS
from robot_retarget.formats import FORMATS
from robot_retarget.human.match import match
from robot_retarget.judge.report import Report
from robot_retarget.judge.report_text import cured, headline
from robot_retarget.tools.studio.project import ALLOWED, Project, choices_in
from robot_retarget.tools.summary import sureness
from robot_retarget.tools.view.web.take import Take
from robot_retarget.tools.view.web.viewer import Viewer

AT_END = 0.99
"""A joint beyond this share of the way from the middle of its range to an end is at its limit [-]: by definition a hundredth is left."""
MOST_MARKS = 40
"""Most marks each of missed edges, jumps and joint limits on the timeline [-]: more cannot be visited one by one."""


def packed(project: Project) -> bytes:
    """Return the packed take of a project with its facts."""
    with project.lock:
        version, take = project.version, project.take
        return Viewer((take,)).packed({"studio": {"version": version, **facts_of(project, take)}})


def facts_of(project: Project, take: Take) -> dict[str, Any]:
    """Return the facts of a project and its take, as a table that JSON can hold."""
    report = None if take.stale else take.report
    return {
        "solved": project.editor is not None,
        "keypoints": _keypoints(project),
        "joints": list(project.motion.skeleton.names),
        "bodies": [take.robot.model.body(k).name for k in range(1, take.robot.model.nbody)],
        "choices": project.choices,
        "allowed": ALLOWED,
        "kinds": _kinds(project),
        "marks": marks_of(project, take) if project.editor else [],
        "notes": list(project.notes),
        "verdict": _verdict(report) if report else None,
        "formats": {name: f"{kind.description}; for {kind.readers}" for name, kind in FORMATS.items()},
        "commands": project.commands(),
    }


def _keypoints(project: Project) -> list[dict[str, str]]:
    """Return each keypoint with its joints of the human, its body of the robot, and the confidence of both."""
    motion, robot = project.motion, project.robot
    found, names = match(motion, robot, project.map_file), motion.skeleton.names
    rows = []
    for keypoint in KEYPOINTS:
        mark, site = found.recognition.marks.get(keypoint), found.anatomy.sites.get(keypoint)
        row = {"name": keypoint, "human": "", "human_sure": "missing", "robot": "", "robot_sure": "missing"}
        if mark:
            row |= {"human": " + ".join(names[j] for j in mark.joints), "human_sure": sureness(mark.confidence)}
        if site:
            row |= {"robot": robot.model.body(site.body).name, "robot_sure": sureness(site.confidence)}
        rows.append(row)
    return rows


def _kinds(project: Project) -> list[dict[str, Any]]:
    """Return the kinds of edges and whether each is on."""
    return [{"name": kind, "on": kind not in project.dropped} for kind in sorted({*project.kinds, *project.dropped})]


def marks_of(project: Project, take: Take) -> list[dict[str, Any]]:
    """Return the moments to look at: kind, first and last time [s], and a sentence.

    The order is: missed edges, jumps, costly edges, joint limits, contacts of links.
    """
    trajectory, robot, fps = take.trajectory, take.robot, take.trajectory.fps
    found = list[tuple[str, int, int, str]]()
    if take.solution is not None:
        found += [("edge missed", min(e.frames), max(e.frames), e.sentence) for e in take.solution.unmet[:MOST_MARKS]]
        for joint, frame, step in take.solution.jumps()[:MOST_MARKS]:
            found.append(("jump", frame, frame, f"{joint} turns by {np.degrees(step):+.0f}° in a frame"))
        for e in take.solution.costliest(3):
            said = f"{e.name}: {100 * e.measured:.1f} cm, target {100 * e.target:.1f} cm"
            found.append(("costly edge", e.frame, e.frame, said))
    middle, half = (robot.lower + robot.upper) / 2, np.maximum((robot.upper - robot.lower) / 2, 1e-9)
    at_end = np.abs(trajectory.angles - middle) > AT_END * half
    spans = [(robot.joint_names[k], *span) for k in range(at_end.shape[1]) for span in intervals(at_end[:, k])]
    spans.sort(key=lambda span: span[1] - span[2])
    for name, first, stop in spans[:MOST_MARKS]:
        found.append(("joint limit", first, stop - 1, f"{name} is at the end of its range"))
    for event in take.warnings.events if take.warnings else ():
        if event.contact is not None:
            found.append(("contact", event.contact, event.last, f"{' and '.join(event.pair)} touch"))
    return [{"kind": kind, "from": a / fps, "to": b / fps, "said": said} for kind, a, b, said in found]


def _verdict(report: Report) -> dict[str, Any]:
    cures = [
        {"reasons": reasons, "what": what, "command": command, "sets": choices_in(command) if command else {}}
        for reasons, what, command in cured(report)
    ]
    return {"badge": report.badge.contract(), "headline": headline(report), "cures": cures}
