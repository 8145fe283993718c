"""The report: figures of a replay and a rollout, and the verdict over them."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats, frozen
from robot_retarget.base.errors import UsageError
from robot_retarget.base.files import MODELS, write_text
from robot_retarget.base.pages import card, data_frame
from robot_retarget.base.untrusted.documents import FORMAT_VERSION, SEAL, content_sha256, read_json, sealed
from robot_retarget.base.version import VERSION
from robot_retarget.collision import Warnings
from robot_retarget.contact.stance import Stance, planned_stance
from robot_retarget.human.features import features_of
from robot_retarget.human.match import match
from robot_retarget.human.motion import Motion
from robot_retarget.judge.cures import Cure, Origin
from robot_retarget.judge.feedback import feedback_figures
from robot_retarget.judge.figures import (
    Tracking,
    at_frames,
    between_figures,
    fall_figures,
    goal_figures,
    own_contacts,
    plain_figures,
    replay_figures,
    rollout_figures,
    tracking_figures,
)
from robot_retarget.judge.plant import Mode, Plant
from robot_retarget.judge.playback import Rollout
from robot_retarget.judge.stance import ankle_figures, contact_figures, stance_figures, stance_of
from robot_retarget.judge.verdict import Badge, Thresholds, at_edge, badge_of, cures, judge, near_limits
from robot_retarget.robot.contacts import Contacts
from robot_retarget.robot.model import Robot
from robot_retarget.robot.support import feet_of
from robot_retarget.scores.likeness import likeness_of, unlikeness
from robot_retarget.trajectory import Trajectory

# Score of the warnings: contacts on the servos that were predicted, and warnings that came true.

SEPARATE_CONTACTS = 0.1
"""Touches of a pair this long after one another are two contacts [s]."""
LATE = 0.25
"""Largest delay of a contact after the end of its warning, because servos lag [s]: four times the 57 ms of an XM430."""


def warning_score(warnings: Warnings, contacts: Contacts, times: np.ndarray, robot: Robot) -> dict[str, Any]:
    """Count contacts (self-contacts `contacts` at `times` of their frames) and warnings against each other."""
    happened = touches(contacts, times, robot)
    links = {robot.model.body(body).name for body in range(robot.model.nbody)}
    events = [
        event for event in warnings.events if links.issuperset(event.pair)
    ]  # bodies of a scene are no self-contact
    warned = [(frozenset(e.pair), e.first_warning / warnings.fps, e.last / warnings.fps) for e in events]
    leads, fulfilled = [], set()
    for pair, start in happened:
        before = [k for k, (p, since, last) in enumerate(warned) if p == pair and since <= start <= last + LATE]
        fulfilled |= set(before)
        if before:
            leads.append(start - warned[before[0]][1])
    return {
        "warnings": len(warned),
        "warnings_fulfilled": len(fulfilled),
        "tracked_contacts": len(happened),
        "tracked_contacts_foreseen": len(leads),
        "median_lead_s": round(float(np.median(leads)), 4) if leads else None,
    }


def touches(contacts: Contacts, times: np.ndarray, robot: Robot) -> list[tuple[frozenset[str], float]]:
    """Each contact of two links with the time of its beginning, in order; links as the warnings name them."""
    model, found = robot.model, []
    for first, second in sorted(contacts.pairs()):
        pair = frozenset(model.body(int(model.body_weldid[body])).name for body in (first, second))
        at = np.unique(times[contacts.of((contacts.bodies == (first, second)).all(1)).frame])
        at = at[at >= 0]
        starts = at[np.diff(at, prepend=-np.inf) > SEPARATE_CONTACTS]
        found += [(pair, float(start)) for start in starts]
    return sorted(found, key=lambda touch: touch[1])


@dataclass(frozen=True, eq=False)
class Report:
    """The outcome of a simulation: figures, verdict and reasons."""

    verdict: str
    """`pass` or `fail`."""
    reasons: tuple[str, ...]
    """A sentence for each thing that failed; empty for a pass."""
    figures: Mapping[str, Any]
    """JSON-able; see `judge.figures`."""
    trajectory_sha256: str
    """Of the trajectory's file."""
    robot: str
    model: str = ""
    """The robot as `load_robot` takes it: a shipped name, or the path of its model."""
    version: str = VERSION
    series: Mapping[str, Floats] = field(default_factory=dict)
    """For plots. At the frames: `time` (F,) [s]; `wanted`, `measured`, `error` and `plain` (F, n) [rad], the last NaN where
    plain playback had broken down; `torque` (F, n) and `bounds` (n,) [N m]; `simulated` (F, nq). Of standing (`Stance`), as simulated in mode
    `free`, else as planned, for a robot with feet: `state_time` (N,) [s]; `com`, `zmp` (N, 2) [m]; `com_margin`,
    `zmp_margin` (N,) [m]; `soles` (N, K, 2) [m] and
    `down` (N, K)."""

    joint_names: tuple[str, ...] = ()
    """Of the columns of the series."""
    thresholds: Thresholds = field(default_factory=Thresholds)
    unlike: tuple[str, ...] = ()
    """Differences from the human's motion, a sentence each; they do not fail it."""
    touches: tuple[tuple[frozenset[str], float], ...] = ()
    """Pairs of links that touched on the servos, and when [s]."""
    trajectory: Trajectory | None = None
    """The trajectory of `trajectory_sha256`, with the judged goals, to be played."""
    executed: Trajectory | None = None
    """The motion as simulated, at the frames of the trajectory."""
    origin: Origin | None = None
    """Files and commands that its cures name; by default the robot and the trajectory's source."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "reasons", tuple(self.reasons))
        object.__setattr__(self, "series", {name: frozen(values) for name, values in self.series.items()})

    @property
    def cures(self) -> tuple[Cure, ...]:
        """What helps against each reason and each difference from the human, in their order, as commands."""
        source = self.trajectory.source if self.trajectory is not None else ""
        own = Origin(robot=self.model or self.robot, motion=source or Origin.motion)
        return cures(self.figures, self.thresholds, self.origin or own)

    @property
    def badge(self) -> Badge:
        """The verdict with its conditions, worded and coloured alike in every output."""
        return badge_of(self.reasons, self.unlike, self.figures)

    def with_playback(self, played: Mapping[str, Any]) -> "Report":
        """Return the report with the tracking errors of a playback on a bus."""
        names = ("tracking_rms_rad", "worst_joint", "worst_joint_rms_rad")
        return replace(self, figures={**self.figures, **{f"played_{name}": played.get(name) for name in names}})

    def __repr__(self) -> str:
        why = f": {'; '.join(self.reasons)}" if self.reasons else ""
        return f"<Report {self.badge.text}, {self.robot}{why}>"

    def _repr_html_(self) -> str:
        shown = {name: value for name, value in self.figures.items() if isinstance(value, int | float | str)}
        facts = {name.replace("_", " "): f"{v:.4g}" if isinstance(v, float) else str(v) for name, v in shown.items()}
        return card(f"{self.robot}: {self.badge.text}", facts, (*self.reasons, *self.unlike))

    def to_frame(self) -> Any:
        """Return the motion of the servos as a pandas DataFrame: columns (wanted | measured | error [rad] | torque [N m], joint).

        Raises:
            UsageError: pandas is not installed.
        """
        kinds = [kind for kind in ("wanted", "measured", "error", "torque") if kind in self.series]
        columns = {(kind, joint): self.series[kind][:, k] for kind in kinds for k, joint in enumerate(self.joint_names)}
        return data_frame(columns, self.series.get("time", np.zeros(0)))

    @classmethod
    def load(cls, path: str | Path) -> "Report":
        """Read verdict and figures from `report.json`; a report holds no series there.

        Raises:
            UsageError: it is no report, was edited, or is of another version.
        """
        content = read_json(path, UsageError)
        if not isinstance(content, dict) or content.get("format_version") != FORMAT_VERSION:
            raise UsageError(f"{path} is no report of format {FORMAT_VERSION}")
        if content.get(SEAL) != content_sha256(content):
            raise UsageError(f"{path} was edited since it was written")
        try:
            return cls(
                content["verdict"], tuple(content["reasons"]), content["figures"], content["trajectory_sha256"],
                content["robot"], content.get("model", ""), content["version"], unlike=tuple(content["unlike"] or ()),
            )  # fmt: skip
        except (KeyError, TypeError) as error:
            raise UsageError(f"{path}: no report: it lacks {error}") from None

    def contract(self) -> dict[str, Any]:
        """Return the content of `report.json`, sealed."""
        return sealed(
            {
                "verdict": self.verdict,
                "reasons": list(self.reasons),
                "figures": dict(self.figures),
                "trajectory_sha256": self.trajectory_sha256,
                "robot": self.robot,
                "version": self.version,
                "format_version": FORMAT_VERSION,
                "unlike": list(self.unlike) if self.badge.compared else None,
                "badge": self.badge.contract(),
                "mode": self.figures["mode"],
                "thresholds": self.thresholds.changed,
                "model": self.model,
                "cures": [cure._asdict() for cure in self.cures],
            }
        )

    def save(self, path: str | Path) -> Path:
        """Write `report.json`, whole or not at all.

        Raises:
            OutputError: it cannot be written.
        """
        return write_text(path, self.text())

    def text(self) -> str:
        """The text of `report.json`."""
        return json.dumps(self.contract(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


@dataclass(frozen=True, eq=False)
class SimulatedTrajectory:
    """A trajectory with its simulations."""

    trajectory: Trajectory
    plant: Plant
    mode: Mode
    replayed: Contacts
    rollout: Rollout
    plain: Rollout
    """Without compensation; equal to `rollout` if the goals are not compensated."""
    warnings: Warnings | None = None
    fallen: tuple[bool, ...] = ()
    """Per drawn simulation, whether the robot fell."""
    human: Motion | None = None
    """With which a motion under a policy is compared."""


def build_report(
    played: SimulatedTrajectory, sha256: str, thresholds: Thresholds, servos: Mapping[str, Any] | None = None
) -> Report:
    """Put the figures together and pass the verdict.

    Args:
        servos: which servos judged, and the tracking errors on all of them (`worlds.trial_figures`).
    """
    trajectory, plant, rollout, robot = played.trajectory, played.plant, played.rollout, played.plant.robot
    free = played.mode == "free"
    tracking = at_frames(trajectory, robot, rollout)
    fall = fall_figures(rollout, robot, trajectory) if free else {}
    stance = stance_of(plant, rollout) if free else planned_stance(robot, trajectory)
    until = fall.get("fall_s")
    executed = as_executed(trajectory, rollout, tracking.times) if len(tracking.times) else None
    figures: dict[str, Any] = {
        "mode": played.mode,
        "balance": trajectory.balance,
        "backlash_rad": plant.backlash,
        "frames": len(trajectory),
        "fps": round(trajectory.fps, 4),
        "duration_s": round(trajectory.duration, 4),
        **tracking_figures(tracking, plant, rollout, trajectory.fps),
        **(servos or {}),
        **plain_figures(trajectory, plant, played.plain, compensated=played.plain is not rollout),
        **replay_figures(trajectory, robot, played.replayed, thresholds.penetration),
        **between_figures(trajectory, robot),
        **goal_figures(trajectory, plant, rollout, until),
        **rollout_figures(rollout, robot, until),
        **contact_figures(plant.bodies, rollout, robot, trajectory, until),
        **fall,
        **(ankle_figures(plant, trajectory.qpos[0]) if until is not None and plant.policy is None else {}),
        **feedback_figures(rollout.added, rollout.stopped, rollout.times, robot.joint_names, until),
        **(stance_figures(stance, until) if free else {}),
        **_foreseen(played, until),
        **(trajectory.likeness if plant.policy is None else _under_policy(played, executed, until)),
        "draws": len(played.fallen),
        **({"fallen_share": sum(played.fallen) / len(played.fallen)} if played.fallen else {}),
        "notes": [*plant.notes, *_choices(played)],
    }
    reasons, unlike = judge(figures, thresholds), unlikeness(figures, thresholds)
    figures |= {"at_edge": at_edge(figures, thresholds), "near_limits": near_limits(figures, thresholds)}
    figures["notes"] = [*figures["notes"], *figures["near_limits"]]
    if figures.get("not_standing"):
        figures["notes"].append(f"no robot plays this standing on its own feet: {figures['not_standing']}")
    series = {**_tracks(tracking, at_frames(trajectory, robot, played.plain), plant), **_stands(stance)}
    series["simulated"] = _poses(rollout, tracking.times)
    touched = touches(own_contacts(rollout, robot, until), rollout.times, robot)
    return Report(
        "fail" if reasons else "pass", reasons, figures, sha256, robot.name,
        series=series, joint_names=robot.joint_names, thresholds=thresholds, touches=tuple(touched), trajectory=trajectory,
        unlike=unlike, executed=executed, model=robot.name if robot.path.is_relative_to(MODELS) else str(robot.path),
    )  # fmt: skip


def series_of(trajectory: Trajectory, plant: Plant, rollout: Rollout) -> dict[str, Floats]:
    """Return the series of one simulation at the frames: motion of the joints, and poses."""
    tracking = at_frames(trajectory, plant.robot, rollout)
    return {**_tracks(tracking, tracking, plant), "simulated": _poses(rollout, tracking.times)}


OF_A_PLAN = ("stride", "pace", "steps_shortened", "not_standing", "unfinished_share")
"""Figures of likeness that a plan of steps and its solution have, and an executed motion has not."""


def _choices(played: SimulatedTrajectory) -> list[str]:
    """Notes on tests that were left out, and how to run them."""
    notes, robot = [], played.plant.robot
    if played.mode == "pinned" and robot.floating and feet_of(robot).names:
        notes.append("the pelvis is held: balance is not tested; legs 'stand' keeps both feet in place and tests it")
    if played.trajectory.likeness.get("legs") == "stand":
        notes.append("both feet stay in place by choice (legs 'stand'): legs, path, heading and steps are not compared")
    if played.plant.policy is not None and played.human is None:
        notes.append("the motion under the policy is not compared with the human: give the motion (--motion)")
    return notes


def _under_policy(played: SimulatedTrajectory, executed: Trajectory | None, until: float | None) -> dict[str, Any]:
    """Return the way of the root and, where the human is known, the likeness of the motion as executed, up to a fall at `until` [s]."""
    if executed is None:
        return {}
    robot, plan = played.plant.robot, played.trajectory
    upright = slice(None if until is None else max(round(until * executed.fps), 2))
    ways = (qpos[upright, robot.root_address :][[0, -1], :2] for qpos in (executed.qpos, plan.qpos))
    way, planned = (np.linalg.norm(end - start) for start, end in ways)
    found: dict[str, Any] = {"way_m": round(float(way), 4), "planned_way_m": round(float(planned), 4)}
    if played.human is None:
        return found
    human = played.human.at_source_time(executed.source_time, executed.fps)
    chosen = {name: plan.likeness[name] for name in ("slowdown", "legs") if name in plan.likeness}
    what = (features_of(human, match(human, robot)), robot, executed.qpos, upright)
    likeness = likeness_of(*what, scene=executed.scene, **chosen)
    return found | likeness.figures() | dict.fromkeys(OF_A_PLAN)


def _foreseen(played: SimulatedTrajectory, until: float | None) -> dict[str, Any]:
    if played.warnings is None:
        return {}
    contacts = own_contacts(played.rollout, played.plant.robot, until)
    return {"foreseen": warning_score(played.warnings, contacts, played.rollout.times, played.plant.robot)}


def _tracks(tracking: Tracking, plain: Tracking, plant: Plant) -> dict[str, Floats]:
    same = {name: getattr(tracking, name) for name in ("wanted", "measured", "error", "torque")}
    plain_measured = _so_far(plain.measured, len(tracking.times))
    return {"time": tracking.times, "plain": plain_measured, "bounds": plant.bounds, **same}


def _poses(rollout: Rollout, times: Floats) -> Floats:
    """(F, nq) the states next to times (F,)."""
    return rollout.qpos[np.searchsorted(rollout.times, times).clip(max=len(rollout.times) - 1)]


def as_executed(trajectory: Trajectory, rollout: Rollout, times: Floats) -> Trajectory:
    """Return the simulated motion at the times (F,) of the first frames; goals and likeness are the plan's and left out."""
    human = trajectory.source_time[: len(times)]
    return replace(trajectory, qpos=_poses(rollout, times), source_time=human, goals=None, likeness={})


def _so_far(values: Floats, frames: int) -> Floats:
    """Return (F, n) values, NaN after the last: one of two simulations may break down before the other."""
    reached = np.full((frames, values.shape[1]), np.nan)
    reached[: len(values)] = values[:frames]
    return reached


def _stands(stance: Stance | None) -> dict[str, Floats]:
    if stance is None:
        return {}
    same = {name: getattr(stance, name) for name in ("com", "zmp", "com_margin", "zmp_margin", "down")}
    return {"state_time": stance.times, "soles": stance.points[..., :2], **same}
