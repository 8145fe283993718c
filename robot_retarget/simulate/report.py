"""The report: figures of a replay and a rollout, and the verdict over them."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from robot_retarget import __version__
from robot_retarget.arrays import Floats, frozen
from robot_retarget.files import replacing
from robot_retarget.simulate.contacts import Contacts
from robot_retarget.simulate.figures import (
    at_frames,
    fall_figures,
    plain_figures,
    replay_figures,
    rollout_figures,
    tracking_figures,
)
from robot_retarget.simulate.plant import Plant
from robot_retarget.simulate.stepping import Rollout
from robot_retarget.trajectory import Trajectory

NAMED_PAIRS = 3
"""So many overlapping pairs get a sentence of their own."""


@dataclass(frozen=True)
class Thresholds:
    """What is still a pass. A simulation that breaks down fails in any case, and so does a fall in mode `free`."""

    tracking_rms: float = 0.2
    """Of the worst joint [rad]: 11°, what a servo of 50 ms lag loses at 4 rad/s."""
    penetration: float = 0.001
    """Of the robot with itself in the replay [m]; no frame may be deeper."""
    range_excess: float = 0.01
    """Beyond a joint's range in the replay [rad]."""


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
    """For plots: `time` (F,) [s]; `wanted`, `measured`, `error` (F, n) [rad]; `torque` (F, n) [N m]."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "reasons", tuple(self.reasons))
        object.__setattr__(self, "series", {name: frozen(values) for name, values in self.series.items()})

    def contract(self) -> dict[str, Any]:
        """The content of `report.json`."""
        return {
            "verdict": self.verdict,
            "reasons": list(self.reasons),
            "figures": dict(self.figures),
            "trajectory_sha256": self.trajectory_sha256,
            "robot": self.robot,
            "version": self.version,
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


def build_report(
    trajectory: Trajectory,
    plant: Plant,
    replayed: Contacts,
    rollout: Rollout,
    plain: Rollout,
    mode: str,
    sha256: str,
    thresholds: Thresholds,
) -> Report:
    """Put figures together and pass the verdict; `plain` is the rollout without compensation, maybe the same."""
    robot = plant.robot
    tracking = at_frames(trajectory, robot, rollout)
    figures: dict[str, Any] = {
        "mode": mode,
        "frames": len(trajectory),
        "fps": round(trajectory.fps, 4),
        "duration_s": round(trajectory.duration, 4),
        **tracking_figures(tracking, plant, rollout, trajectory.fps),
        **plain_figures(trajectory, plant, plain, compensated=plain is not rollout),
        **replay_figures(trajectory, robot, replayed, thresholds.penetration),
        **rollout_figures(rollout, robot),
        **(fall_figures(rollout, robot) if mode == "free" else {}),
        "notes": list(plant.notes),
    }
    reasons = judge(figures, thresholds)
    series = {
        "time": tracking.times,
        "wanted": tracking.wanted,
        "measured": tracking.measured,
        "error": tracking.error,
        "torque": tracking.torque,
    }
    return Report("fail" if reasons else "pass", reasons, figures, sha256, robot.name, series=series)


def judge(figures: Mapping[str, Any], thresholds: Thresholds) -> tuple[str, ...]:
    """The reasons against a trajectory, none for a pass."""
    reasons = []
    if figures["unstable_s"] is not None:
        reasons.append(f"the simulation broke down at {figures['unstable_s']:g} s")
    if figures.get("fall_s") is not None:
        when = f"at {figures['fall_s']:g} s" if figures["fall_s"] >= 0 else "in the first pose, before it began to move"
        reasons.append(f"fell: {figures['fall_body']} touched the floor {when}")
    if (figures.get("worst_joint_rms_rad") or 0) > thresholds.tracking_rms:
        reasons.append(
            f"{figures['worst_joint']} tracks {figures['worst_joint_rms_rad']:.3g} rad off (rms), "
            f"more than {thresholds.tracking_rms:g} rad"
        )
    reasons += _overlaps(figures["self_contacts"], thresholds.penetration)
    if figures["range_excess_rad"] > thresholds.range_excess:
        reasons.append(f"{figures['range_excess_joint']} leaves its range by {figures['range_excess_rad']:.3g} rad")
    return tuple(reasons)


def _overlaps(pairs: list[dict[str, Any]], penetration: float) -> list[str]:
    """A sentence for each of the deepest pairs, and one for how many more there are; pairs come deepest first."""
    deep = [line for line in pairs if line["depth_m"] > penetration]
    sentences = [
        f"{' and '.join(line['bodies'])} overlap by up to {1000 * line['depth_m']:.1f} mm, "
        f"touching in {line['frames']} frames"
        for line in deep[:NAMED_PAIRS]
    ]
    return [*sentences, f"{len(deep) - NAMED_PAIRS} more pairs overlap"] if len(deep) > NAMED_PAIRS else sentences
