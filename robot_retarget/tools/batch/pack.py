"""All clips of a robot in one file, as trainers load them."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.errors import UsageError
from robot_retarget.base.files import folder, replacing
from robot_retarget.base.untrusted.arrays import save_npz
from robot_retarget.base.untrusted.pickles import dump_pickle, load_pickle
from robot_retarget.formats import FORMATS, FormatOptions
from robot_retarget.formats.robot_motion import RobotMotion, robot_motion
from robot_retarget.tools.batch.task import DONE, Job, Row, robot_of
from robot_retarget.trajectory import load_trajectory

FOLDER = "packed"


def pack_all(rows: Sequence[Row], job: Job, format: str) -> str:
    """Write one file of a packed format for each robot; returns their paths.

    Raises:
        UsageError: the robot does not suit the format, or its clips differ in their frame rate.
    """
    written = list[Path]()
    for name in job.robots:
        robot = robot_of(name, job.settings.limits)
        done = [row for row in rows if row.robot == robot.name and row.state == DONE]
        if not done:
            continue
        motions = []
        for row in done:
            trajectory = load_trajectory(job.out / row.robot / f"{row.clip}.npz")
            kind = FORMATS[format]
            motions.append(
                (row.clip, robot_motion(trajectory, robot, FormatOptions(), kind.fps, kind.ordered, kind.name))
            )
        target = folder(job.out / FOLDER) / f"{robot.name}-{format}{FORMATS[format].suffix}"
        with replacing(target) as scratch:
            PACKED[format](motions, scratch)
        written.append(target)
    return ", ".join(map(str, written)) or "nothing: no clip is done"


Motions = Sequence[tuple[str, RobotMotion]]


def _locomujoco(motions: Motions, path: Path) -> None:
    """LocoMuJoCo's Trajectory of several clips: tracks one after the other, `split_points` where each begins."""
    rates = {motion.fps for _, motion in motions}
    if len(rates) > 1:
        raise UsageError(
            f"one frame rate a file: the clips have {', '.join(f'{rate:g}' for rate in sorted(rates))}; use --fps"
        )
    parts = [_arrays(motion, path) for _, motion in motions]
    lengths = [len(motion) for _, motion in motions]
    every: dict[str, Any] = dict(parts[0])
    for key in TRACKS:
        every[key] = np.concatenate([part[key] for part in parts])
    every["split_points"] = np.concatenate([[0], np.cumsum(lengths)])
    save_npz(path, **every)


TRACKS = ("qpos", "qvel", "xpos", "xquat", "cvel", "subtree_com", "site_xpos", "site_xmat")


def _arrays(motion: RobotMotion, path: Path) -> dict[str, Any]:
    """The arrays of one clip, as its format writes them."""
    single = path.with_name(f"{path.name}.one.npz")
    try:
        FORMATS["locomujoco"].write(motion, single)
        with np.load(single, allow_pickle=False) as archive:
            return {key: archive[key] for key in archive.files}
    finally:
        single.unlink(missing_ok=True)


def _phc(motions: Motions, path: Path) -> None:
    """PHC's dictionary of clips by name, which SONIC and ASAP load too."""
    clips: dict[str, Any] = {}
    for name, motion in motions:
        FORMATS["phc"].write(motion, path)
        clips[name] = next(iter(load_pickle(path).values()))
    path.write_bytes(dump_pickle(clips))


PACKED: dict[str, Callable[[Motions, Path], None]] = {"locomujoco": _locomujoco, "phc": _phc}
"""By format; a new packed form is a function and a line here."""
