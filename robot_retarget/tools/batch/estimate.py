"""How long a run will take, before it begins."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from robot_retarget.base.errors import RobotRetargetError
from robot_retarget.tools.batch.manifest import Manifest
from robot_retarget.tools.batch.run import RunPlan

SAMPLED = 12
"""Clips that are read to learn how many seconds of motion a byte holds."""
PACE = 2.0
"""Seconds of motion that a core retargets and scores in a second, where no clip of the folder is timed yet: G1 at 30 frames/s."""


@dataclass(frozen=True)
class Estimate:
    """Of the tasks that are left."""

    tasks: int
    kept: int
    motion_seconds: float
    """Of all tasks together, each robot counted."""
    core_seconds: float
    measured: bool
    """Whether the pace is that of this folder's earlier clips."""

    def hours(self, jobs: int) -> float:
        """Duration on `jobs` processes [h]."""
        return self.core_seconds / jobs / 3600


def estimate(plan: RunPlan, manifest: Manifest) -> Estimate:
    """Estimate a plan from a sample of its clips and from the times in the manifest."""
    paths = sorted({task.path for task in plan.tasks})
    chosen = (
        [Path(paths[k * len(paths) // SAMPLED]) for k in range(SAMPLED)]
        if len(paths) > SAMPLED
        else [*map(Path, paths)]
    )
    lengths = [(path.stat().st_size, length) for path in chosen if (length := _length(path)) is not None]
    size = sum(bytes_ for bytes_, _ in lengths)
    per_byte = sum(length for _, length in lengths) / size if size else 0.0
    motion = sum(Path(task.path).stat().st_size for task in plan.tasks) * per_byte
    pace = _pace(manifest)
    return Estimate(len(plan.tasks), plan.kept, motion, motion / (pace or PACE), pace is not None)


def _length(path: Path) -> float | None:
    """Seconds of motion in a file; None where it cannot be read."""
    from robot_retarget.human.read import read_motion

    try:
        return read_motion(path, repair=False).duration
    except RobotRetargetError:
        return None


def _pace(manifest: Manifest) -> float | None:
    """Seconds of motion a core does in a second, over the clips that are done."""
    times = manifest.timings()
    done: Sequence[tuple[float, float]] = [
        (row.frames / row.fps, times[row.key][0]) for row in manifest.rows() if row.frames and row.key in times
    ]
    spent = sum(seconds for _, seconds in done)
    return sum(motion for motion, _ in done) / spent if spent else None
