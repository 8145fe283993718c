"""Format `mujoco-keyframes`: an MJCF file of keyframes, a frame each, to be included in the robot's.

`<key name time qpos/>`, qpos in MuJoCo's order, root w x y z. `<include file="keys.xml"/>` in the robot's MJCF makes the
frames the keyframes of `simulate` and of `mj_resetDataKeyframe`.
"""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import TrajectoryError
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource
from robot_retarget.formats.text.named_csv import rate

EXACT = "%.17g"


def write(motion: RobotMotion, path: Path, bodies: Floats | None = None) -> None:
    """Write the keyframes.

    Args:
        bodies: (T, M, 7) poses of mocap bodies, for a model that has them.
    """
    top = ElementTree.Element("mujoco", model=motion.robot.name)
    keys = ElementTree.SubElement(top, "keyframe")
    for frame, qpos in enumerate(motion.qpos):
        mocap = {} if bodies is None else {"mpos": _row(bodies[frame, :, :3]), "mquat": _row(bodies[frame, :, 3:])}
        time = EXACT % (frame / motion.fps)
        ElementTree.SubElement(keys, "key", {"name": f"frame_{frame}", "time": time, "qpos": _row(qpos), **mocap})
    ElementTree.indent(top)
    path.write_text(ElementTree.tostring(top, encoding="unicode") + "\n", encoding="utf-8")


def _row(values: Floats) -> str:
    return " ".join(EXACT % value for value in values.ravel())


def read(source: TrajectorySource) -> Columns:
    """Read the keyframes."""
    return read_keys(source.text)


def read_keys(text: str) -> Columns:
    """The keyframes of an MJCF text in the order of their times.

    Raises:
        TrajectoryError: not XML, no keyframes with qpos, or of several widths.
    """
    try:
        keys = [key for key in ElementTree.fromstring(text).iter("key") if key.get("qpos")]
        rows = [(float(key.get("time", 0)), np.array((key.get("qpos") or "").split(), dtype=float)) for key in keys]
    except (ElementTree.ParseError, ValueError) as error:
        raise TrajectoryError(f"not MJCF: {error}") from error
    if not rows:
        raise TrajectoryError("no keyframe with qpos")
    if len({len(qpos) for _, qpos in rows}) > 1:
        raise TrajectoryError("keyframes of several widths")
    rows.sort(key=lambda row: row[0])
    return Columns(qpos=np.stack([qpos for _, qpos in rows]), fps=rate(np.array([time for time, _ in rows])))


FORMAT = TrajectoryFormat(
    name="mujoco-keyframes",
    suffix=".xml",
    description="MJCF keyframes, to be included in the robot's file",
    write=write,
    read=read,
    claims=lambda source: source.text.lstrip().startswith("<mujoco") and "<key " in source.text,
    readers="MuJoCo",
    complete=False,
)
