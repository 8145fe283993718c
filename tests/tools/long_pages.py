"""Pages of the product with long data: a robot with 40 joints, twenty clips, messages of 400 characters."""

from dataclasses import replace
from pathlib import Path

from made_trajectories import robot_of, swing

from robot_retarget.base.errors import MotionError
from robot_retarget.base.files import SAMPLES
from robot_retarget.collision import warnings_of
from robot_retarget.edit.keyframe_files import keyframe_file
from robot_retarget.human.read import read_motion
from robot_retarget.judge.report import Report
from robot_retarget.judge.rollout import simulate
from robot_retarget.judge.verdict import judge
from robot_retarget.robot import Robot, load_robot
from robot_retarget.scores.likeness import unlikeness
from robot_retarget.tools.batch.filters import choose, read_filters
from robot_retarget.tools.batch.report import ClipCard, examples_of, save_page
from robot_retarget.tools.batch.task import Row
from robot_retarget.tools.studio.project import Project
from robot_retarget.tools.studio.studio import Studio
from robot_retarget.tools.view.page import save_page as save_report
from robot_retarget.tools.view.web.editor import TakeEditor
from robot_retarget.tools.view.web.keyframes import KeyframeDesk
from robot_retarget.tools.view.web.take import Take, take_of
from robot_retarget.tools.view.web.viewer import Viewer
from robot_retarget.trajectory import Trajectory

LIMBS, SEGMENTS = ("left_arm", "right_arm", "left_leg", "right_leg"), 10
MESSAGE = ("the skeleton of the file has no joint that could be a left knee, since its chain ends at the hip; " * 5)[
    :400
]
POOR = {
    "duration_s": 4.0, "moves_deg": 60.0, "held_pct": 55.5, "limb_deg_mean": 31.25, "near_err": 0.125, "contact_recall": 0.4,
    "skate_cm_s": 27.5, "self_pen_max_cm": 6.25, "ground_pen_max_cm": 11.5, "float_med_cm": 9.5, "speed_p99": 0.97,
    "jerk_rms": 912.0, "root_residual": 0.87, "root_residual_p95": 1.4, "root_jerk": 1423.5, "root_height_min": 0.31,
    "zmp_out_pct": 83.3, "zmp_margin_cm": -31.0, "torque_over_pct": 41.0, "flight_pct": 44.0, "travel_m": 12.5,
    "feet_travel_m": 11.8, "limit_frames": 118, "joint_jumps": 12,
}  # fmt: skip
"""Figures that every filter leaves out for every reason."""


def long_robot(folder: Path) -> Robot:
    """A trunk with four chains of ten hinges, each with a long name."""
    chains = ""
    for limb, (x, y) in zip(LIMBS, ((0.1, 0.1), (0.1, -0.1), (-0.1, 0.1), (-0.1, -0.1)), strict=True):
        links = "".join(
            f'<body name="{limb}_segment_{k}" pos="{x if not k else 0} {y if not k else 0} {-0.05 if k else 0}">'
            f'<joint name="{limb}_segment_{k}_{("yaw", "pitch", "roll")[k % 3]}_joint" axis="{k % 2} {(k + 1) % 2} 0" range="-90 90"/>'
            '<geom type="capsule" fromto="0 0 0 0 0 -.04" size=".012" mass=".05"/>'
            for k in range(SEGMENTS)
        )
        chains += links + "</body>" * SEGMENTS
    text = f'<mujoco><worldbody><body name="trunk" pos="0 0 1"><freejoint/><geom type="box" size=".1 .1 .1" mass="2"/>{chains}</body></worldbody></mujoco>'
    return robot_of(text, folder / "long.xml", "a_research_humanoid_with_forty_joints")


def long_report(robot: Robot) -> tuple[Report, Trajectory]:
    """A report with a reason for nearly every limit, two of them of 400 characters."""
    source = "captured/session_03/" + "a_clip_with_a_long_name_" * 3 + ".bvh"
    moved = replace(swing(robot, robot.joint_names[0], 0.9, 0.5, 1.0, 50.0), source=source)
    found = simulate(moved, robot, mode="pinned", draws=0, others=False, warnings=warnings_of(moved, robot))
    name = robot.joint_names[3]
    overlap = {"bodies": ["left_arm_segment_9" * 10, "right_leg_segment_9" * 9], "depth_m": 0.0123, "frames": 214}
    poor = {
        "worst_joint": name, "worst_joint_rms_rad": 0.71, "saturated_joint": name, "saturated_share": 0.93, "hottest_joint": name,
        "temperature_rise_K": 71.0, "speed_ratio_joint": name, "speed_ratio": 7.1, "self_contacts": [overlap, overlap],
        "self_contact_depth_m": 0.0123, "range_excess_joint": name, "range_excess_rad": 0.2, "slowdown": 4.5, "limb_rad": 0.7,
        "limb_rad_arms": 0.9, "limb_rad_trunk": 0.5, "limb_rad_legs": 0.8, "contacts_lost": 0.9, "steps_shortened": 0.8,
        "path_off": 1.5, "heading_off_rad": 1.1, "steps_lost": 0.9, "unfinished_share": 0.6,
    }  # fmt: skip
    attempt = {
        "legs": "follow",
        "mode": "dynamic",
        "reach": 0.8,
        "slowdown": 1.3,
        "margin_m": -0.012,
        "solved": 4,
        "reasons": MESSAGE,
    }
    figures = {**found.figures, **poor, "notes": [MESSAGE, "a short note"], "attempts": [attempt] * 3}
    most = found.thresholds
    assert max(map(len, judge(figures, most))) >= 400
    report = replace(
        found, verdict="fail", reasons=judge(figures, most), unlike=unlikeness(figures, most), figures=figures
    )
    assert report.trajectory is not None
    return report, report.trajectory


def report_page(robot: Robot, folder: Path) -> Path:
    """`report.html`."""
    report, played = long_report(robot)
    written = save_report(report, played, folder / "report.html", warnings=warnings_of(played, robot))
    assert isinstance(written, Path)
    return written


def batch_page(folder: Path) -> Path:
    """`summary.html`."""
    rows = [
        Row("op3", f"session_{k:02}/a_clip_with_a_long_name_{k}", "x", "done", "", 300, 30.0, figures=POOR)
        for k in range(17)
    ]
    rows += [replace(rows[0], clip=f"broken_{k}", state="failed", message=MESSAGE, figures={}) for k in range(3)]
    chosen = [choose(rows, one) for one in read_filters().values()]
    cards = [ClipCard(*one, None, None) for one in examples_of(rows, chosen, 8)]
    return save_page(rows, chosen, cards, folder / "summary.html")


def long_viewer(robot: Robot) -> Viewer:
    """The page of `viewer.html`, with touch-ups."""
    report, played = long_report(robot)
    take = take_of(played, robot, report=report)
    return Viewer((Take(robot, played, None, take.warnings, report),))


def long_keyframes(robot: Robot, folder: Path) -> KeyframeDesk:
    """The page of a file of keyframes."""
    return KeyframeDesk(keyframe_file(str(folder / f"{'long_name_' * 9}.json"), robot), lambda _: long_report(robot)[0])


def long_studio(robot: Robot, folder: Path) -> tuple[Studio, str]:
    """A studio with eight clips on the robot, one of them judged; and the name of that one."""
    report, played = long_report(robot)
    studio = Studio(folder / "studio")
    studio.robots["robot"] = str(robot.path)
    keys = [f"session_{k:02}/{'long_name_' * 9}{k}.bvh@robot" for k in range(8)]
    for key in keys:
        place = folder / "studio" / key.rpartition("/")[0]
        place.mkdir(parents=True, exist_ok=True)
        clip = place / key.rpartition("/")[2].partition("@")[0], read_motion(SAMPLES / "wave.bvh")
        project = Project(key, clip, (str(robot.path), load_robot("op3")), "robot", studio.changed)
        project.editor = TakeEditor(take_of(played, robot, report=report if key == keys[0] else None), None)
        project.work.state = "solved"
        studio.projects[key] = project
    studio.projects[keys[1]].ended(studio.projects[keys[1]].work, MotionError(MESSAGE))
    return studio, keys[0]
