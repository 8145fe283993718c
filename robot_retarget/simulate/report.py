"""The report: figures of a replay and a rollout, and the verdict over them."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget import __version__
from robot_retarget.arrays import Floats, frozen
from robot_retarget.collision.warn import Warnings
from robot_retarget.describe.likeness import Likeness
from robot_retarget.files import replacing
from robot_retarget.notebook import card, frame
from robot_retarget.simulate.contacts import Contacts
from robot_retarget.simulate.figures import (
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
from robot_retarget.simulate.foreseen import foreseen_figures, touches
from robot_retarget.simulate.plant import Mode, Plant
from robot_retarget.simulate.stance import Stance, planned_stance, stance_figures, stance_of
from robot_retarget.simulate.stepping import Rollout
from robot_retarget.simulate.thresholds import UNLIKE, Thresholds
from robot_retarget.trajectory import Trajectory

FORMAT_VERSION = 2
"""Of `report.json`. 1, unnamed: reports of trajectories without their goals."""
NAMED_PAIRS = 3
"""So many overlapping pairs get a sentence of their own."""


@dataclass(frozen=True, eq=False)
class Report:
    """What became of a trajectory on servos."""

    verdict: str
    """`pass` or `fail`."""
    reasons: tuple[str, ...]
    """A sentence for each thing that failed; empty for a pass."""
    figures: Mapping[str, Any]
    """JSON-able; see `figures.py`."""
    trajectory_sha256: str
    """Of the trajectory's file."""
    robot: str
    version: str = __version__
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
    """In what a motion is unlike the human's, a sentence each; a pass all the same."""
    touches: tuple[tuple[frozenset[str], float], ...] = ()
    """Pairs of links that touched on the servos, and when [s]."""
    trajectory: Trajectory | None = None
    """With the goals that were judged: what `trajectory_sha256` is of, and what is to be played."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "reasons", tuple(self.reasons))
        object.__setattr__(self, "series", {name: frozen(values) for name, values in self.series.items()})

    @property
    def judgement(self) -> str:
        """For people: `pass`, `pass, but unlike` or `fail`."""
        return "pass, but unlike" if self.verdict == "pass" and self.unlike else self.verdict

    def __repr__(self) -> str:
        why = f": {'; '.join(self.reasons)}" if self.reasons else ""
        return f"<Report {self.verdict}, {self.robot} {self.figures['mode']}{why}>"

    def _repr_html_(self) -> str:
        shown = {name: value for name, value in self.figures.items() if isinstance(value, int | float | str)}
        facts = {name.replace("_", " "): f"{v:.4g}" if isinstance(v, float) else str(v) for name, v in shown.items()}
        return card(f"{self.robot}: {self.verdict}", facts, self.reasons)

    def to_frame(self) -> Any:
        """What the servos did as a pandas DataFrame: columns (wanted | measured | error [rad] | torque [N m], joint).

        Raises:
            UsageError: pandas is not installed.
        """
        kinds = [kind for kind in ("wanted", "measured", "error", "torque") if kind in self.series]
        columns = {(kind, joint): self.series[kind][:, k] for kind in kinds for k, joint in enumerate(self.joint_names)}
        return frame(columns, self.series.get("time", np.zeros(0)))

    def contract(self) -> dict[str, Any]:
        """The content of `report.json`."""
        return {
            "verdict": self.verdict,
            "reasons": list(self.reasons),
            "figures": dict(self.figures),
            "trajectory_sha256": self.trajectory_sha256,
            "robot": self.robot,
            "version": self.version,
            "format_version": FORMAT_VERSION,
            "unlike": list(self.unlike),
        }

    def save(self, path: str | Path) -> Path:
        """Write `report.json`, whole or not at all.

        Raises:
            OutputError: it cannot be written.
        """
        with replacing(path) as scratch:
            text = json.dumps(self.contract(), indent=1, ensure_ascii=False, allow_nan=False)
            scratch.write_text(text + "\n", encoding="utf-8")
        return Path(path)


@dataclass(frozen=True, eq=False)
class Played:
    """A trajectory and what became of it."""

    trajectory: Trajectory
    plant: Plant
    mode: Mode
    replayed: Contacts
    rollout: Rollout
    plain: Rollout
    """Without compensation; the same where none was asked for."""
    warnings: Warnings | None = None
    likeness: Likeness | None = None
    fallen: tuple[bool, ...] = ()
    """Of drawn worlds, whether it fell there."""


def build_report(played: Played, sha256: str, thresholds: Thresholds) -> Report:
    """Put figures together and pass the verdict."""
    trajectory, plant, rollout, robot = played.trajectory, played.plant, played.rollout, played.plant.robot
    free = played.mode == "free"
    tracking = at_frames(trajectory, robot, rollout)
    fall = fall_figures(rollout, robot, trajectory) if free else {}
    stance = stance_of(plant, rollout) if free else planned_stance(robot, trajectory)
    until = fall.get("fall_s")
    figures: dict[str, Any] = {
        "mode": played.mode,
        "frames": len(trajectory),
        "fps": round(trajectory.fps, 4),
        "duration_s": round(trajectory.duration, 4),
        **tracking_figures(tracking, plant, rollout, trajectory.fps),
        **plain_figures(trajectory, plant, played.plain, compensated=played.plain is not rollout),
        **replay_figures(trajectory, robot, played.replayed, thresholds.penetration),
        **between_figures(trajectory, robot),
        **goal_figures(trajectory, plant, rollout, until),
        **rollout_figures(rollout, robot, until),
        **fall,
        **(stance_figures(stance, until) if free else {}),
        **_foreseen(played, until),
        **(played.likeness.figures() if played.likeness else {}),
        "draws": len(played.fallen),
        **({"fallen_share": sum(played.fallen) / len(played.fallen)} if played.fallen else {}),
        "notes": list(plant.notes),
    }
    reasons, unlike = judge(figures, thresholds), unlikeness(figures, thresholds)
    series = {**_tracks(tracking, at_frames(trajectory, robot, played.plain), plant), **_stands(stance)}
    series["simulated"] = _poses(rollout, tracking.times)
    touched = touches(own_contacts(rollout, robot, until), rollout.times, robot)
    return Report(
        "fail" if reasons else "pass", reasons, figures, sha256, robot.name,
        series=series, joint_names=robot.joint_names, thresholds=thresholds, touches=tuple(touched), trajectory=trajectory,
        unlike=unlike,
    )  # fmt: skip


def _foreseen(played: Played, until: float | None) -> dict[str, Any]:
    if played.warnings is None:
        return {}
    contacts = own_contacts(played.rollout, played.plant.robot, until)
    return {"foreseen": foreseen_figures(played.warnings, contacts, played.rollout.times, played.plant.robot)}


def _tracks(tracking: Tracking, plain: Tracking, plant: Plant) -> dict[str, Floats]:
    return {
        "time": tracking.times,
        "wanted": tracking.wanted,
        "measured": tracking.measured,
        "plain": _so_far(plain.measured, len(tracking.times)),
        "error": tracking.error,
        "torque": tracking.torque,
        "bounds": plant.bounds,
    }


def _poses(rollout: Rollout, times: Floats) -> Floats:
    """(F, nq) the states next to times (F,)."""
    if not len(times):
        return rollout.qpos[:0]
    return rollout.qpos[np.clip(np.searchsorted(rollout.times, times), 0, len(rollout.times) - 1)]


def _so_far(values: Floats, frames: int) -> Floats:
    """(F, n) values of so many frames: one of two simulations may have broken down before the other."""
    reached = np.full((frames, values.shape[1]), np.nan)
    reached[: len(values)] = values[:frames]
    return reached


def _stands(stance: Stance | None) -> dict[str, Floats]:
    if stance is None:
        return {}
    return {
        "state_time": stance.times,
        "com": stance.com,
        "zmp": stance.zmp,
        "com_margin": stance.com_margin,
        "zmp_margin": stance.zmp_margin,
        "soles": stance.points[..., :2],
        "down": stance.down,
    }


def judge(figures: Mapping[str, Any], most: Thresholds) -> tuple[str, ...]:
    """The reasons against a trajectory, none for a pass."""
    reasons = [*_upright(figures), *_servos(figures, most)]
    reasons += _overlaps(figures["self_contacts"], most.penetration, "overlap")
    if figures["between_frames_depth_m"] > max(most.between_frames, figures["self_contact_depth_m"]):
        depth, when = 1000 * figures["between_frames_depth_m"], figures["between_frames_s"]
        pair = " and ".join(figures["between_frames_bodies"])
        reasons.append(f"{pair} pass through each other by {depth:.1f} mm between two frames, at {when:g} s")
    if figures.get("fall_s") is None:
        planned = [line["bodies"] for line in figures["self_contacts"] if line["depth_m"] > most.penetration]
        hits = [line for line in figures["tracked_self_contacts"] if line["bodies"] not in planned]
        reasons += _overlaps(hits, most.tracked_penetration, "hit each other on the servos, overlapping")
        if figures.get("fallen_share", 0) > most.fallen_share:
            share, count = figures["fallen_share"], figures["draws"]
            reasons.append(
                f"falls in {round(share * count)} of {count} worlds with other mass, friction, servos and tilt"
            )
        if (figures.get("foot_slip_m") or 0) > most.foot_slip:
            reasons.append(f"a foot slides {100 * figures['foot_slip_m']:.1f} cm while it stands")
    if figures["range_excess_rad"] > most.range_excess:
        reasons.append(f"{figures['range_excess_joint']} leaves its range by {figures['range_excess_rad']:.3g} rad")
    return tuple(reasons)


def unlikeness(figures: Mapping[str, Any], most: Thresholds) -> tuple[str, ...]:
    """In what a motion is unlike the human's."""
    said = []
    for check in UNLIKE:
        value, bound = figures.get(check.figure), getattr(most, check.threshold)
        if value is None or value <= bound:
            continue
        if check.unit == "rad":
            part = check.figure.rsplit("_", 1)[-1]
            said.append(f"{part} are {np.degrees(value):.0f}° off the human's on the mean, {_worst(figures)}")
        elif check.figure == "slowdown":
            said.append(f"it takes {value:.1f} times as long as the human")
        else:
            said.append(f"{check.what}: {100 * value:.0f} %, more than {100 * bound:.0f} %")
    return tuple(said)


def _worst(figures: Mapping[str, Any]) -> str:
    return f"most of all {figures['limb_worst']} by {np.degrees(figures['limb_rad_worst']):.0f}°"


def _upright(figures: Mapping[str, Any]) -> list[str]:
    """Whether the simulation and the robot came to the end."""
    reasons = []
    if figures["unstable_s"] is not None:
        reasons.append(f"the simulation broke down at {figures['unstable_s']:g} s")
    if figures.get("fall_s") is not None:
        when = f"at {figures['fall_s']:g} s" if figures["fall_s"] >= 0 else "in the first pose, before it began to move"
        body = figures["fall_body"]
        reasons.append(f"fell: {f'{body} touched the floor' if body else 'sank to half its height'} {when}")
    return reasons


def _servos(figures: Mapping[str, Any], most: Thresholds) -> list[str]:
    """What is too much for the servos."""
    reasons = []
    if (figures.get("worst_joint_rms_rad") or 0) > most.tracking_rms:
        reasons.append(
            f"{figures['worst_joint']} tracks {figures['worst_joint_rms_rad']:.3g} rad off (rms), "
            f"more than {most.tracking_rms:g} rad"
        )
    cap = figures.get("goal_step_limit_rad")
    if cap is not None and figures["goal_step_rad"] > cap:
        reasons.append(
            f"{figures['goal_step_joint']} is {figures['goal_step_rad']:.2g} rad from its goal, and playback holds goals back "
            f"beyond {cap:g} rad"
        )
    if figures["speed_ratio"] > most.speed_ratio:
        reasons.append(
            f"{figures['speed_ratio_joint']} would have to turn {figures['speed_ratio']:.2g} times as fast as it can"
        )
    if figures.get("saturated_share", 0) > most.saturated_share:
        share = 100 * figures["saturated_share"]
        reasons.append(f"{figures['saturated_joint']} gives all the torque it has {share:.0f} % of the time")
    if figures.get("temperature_rise_K", 0) > most.temperature_rise:
        reasons.append(f"{figures['hottest_joint']} warms up by {figures['temperature_rise_K']:.0f} K")
    return reasons


def _overlaps(pairs: list[dict[str, Any]], penetration: float, what: str) -> list[str]:
    """A sentence for each of the deepest pairs, and one for how many more there are; pairs come deepest first."""
    deep = [line for line in pairs if line["depth_m"] > penetration]
    sentences = [
        f"{' and '.join(line['bodies'])} {what} by up to {1000 * line['depth_m']:.1f} mm, "
        f"touching in {line['frames']} frames"
        for line in deep[:NAMED_PAIRS]
    ]
    return [*sentences, f"{len(deep) - NAMED_PAIRS} more pairs {what}"] if len(deep) > NAMED_PAIRS else sentences
