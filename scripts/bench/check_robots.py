"""Laws of recognition × robots: how often a robot that is written in another way is taken for something else.

    python scripts/bench/check_robots.py [MJCF ...]     by default the shipped robot and those of ../shared

A violation is silent if it raises no error and adds no remark to those of the unchanged robot.
"""

import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from robot_variants import LAWS, Case, Variant

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import RobotRetargetError
from robot_retarget.robot import Anatomy, Robot, load_robot, recognise, world_points

SHARED = Path(__file__).resolve().parents[3] / "shared" / "robots"
NEAR = 0.01
"""Keypoints may be elsewhere by this share of the robot's height ..."""
HEADING = 5.0
"""... and the robot may look elsewhere by this angle [deg]."""


@dataclass(frozen=True)
class Finding:
    """What came of one variant."""

    law: str
    robot: str
    detail: str
    wrong: tuple[str, ...]
    said: bool


def places(robot: Robot, anatomy: Anatomy) -> dict[str, Floats]:
    """Keypoints in the reference pose, seen from the pelvis [m]."""
    x = world_points(robot, anatomy.points, np.array(robot.model.qpos0)[None])[0]
    return dict(zip(anatomy.names, x - x[anatomy.names.index("pelvis")], strict=True))


def check(case: Case, law: str, variant: Variant, folder: Path) -> Finding:
    """Recognise a variant and compare it with the robot as it is."""
    path = folder / f"{variant.stem}.xml"
    path.write_text(variant.xml)
    name = case.robot.path.stem
    try:
        robot = load_robot(path, _limits(case.robot.path))
        anatomy = recognise(robot)
    except RobotRetargetError as error:
        return Finding(law, name, variant.detail, (str(error).replace(str(path), "it"),), said=True)
    wrong = differences(case, variant, robot, anatomy)
    said = set(anatomy.notes) - set(case.anatomy.notes)
    return Finding(law, name, variant.detail, tuple(wrong), bool(said))


def _limits(path: Path) -> Path | None:
    return next(
        (f for f in (path.with_name(f"{path.stem}.limits.toml"), path.with_name("limits.toml")) if f.is_file()), None
    )


def differences(case: Case, variant: Variant, robot: Robot, anatomy: Anatomy) -> list[str]:
    """What is not where it must be, in words."""
    here, there = places(robot, anatomy), places(case.robot, case.anatomy)
    there = {k: variant.turn.apply(place) for k, place in there.items()}
    height = float(np.ptp([place[2] for place in there.values()]))
    kept = [k for k in there if k not in variant.lost]
    found = [f"{k} is missing" for k in kept if k not in here]
    found += [f"{k} is there" for k in here if k not in there]
    off = {k: float(np.linalg.norm(here[k] - there[k])) / height for k in kept if k in here}
    found += [f"{k} off by {share:.1%}" for k, share in off.items() if share > NEAR]
    cosine = float(anatomy.forward @ variant.turn.as_matrix() @ case.anatomy.forward)
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return found + ([f"looks {angle:.0f}° aside"] if angle > HEADING else [])


def findings(paths: list[Path]) -> Iterator[Finding]:
    """Every variant of every robot."""
    with tempfile.TemporaryDirectory() as folder:
        for path in paths:
            robot = load_robot(path)
            case = Case(robot, recognise(robot), np.random.default_rng(0))
            for law, variants in LAWS.items():
                for variant in variants(case):
                    yield check(case, law, variant, Path(folder))


def table(found: list[Finding]) -> str:
    """Per law: cases, violations, and those that nothing is said of."""
    lines = [f"{'law':40} {'cases':>6} {'wrong':>6} {'silent':>7}"]
    for law in [*LAWS, "all"]:
        own = [f for f in found if law in ("all", f.law)]
        wrong = [f for f in own if f.wrong]
        lines.append(f"{law:40} {len(own):6} {len(wrong):6} {sum(not f.said for f in wrong):7}")
    return "\n".join(lines)


def main() -> None:
    paths = [Path(p) for p in sys.argv[1:]] or [load_robot("op3").path, *sorted(SHARED.glob("*/*.xml"))]
    found = list(findings(paths))
    for f in found:
        if f.wrong:
            print(f"{f.robot}: {f.law}, {f.detail}{'' if f.said else ' (silent)'}: {'; '.join(f.wrong[:4])}")
    print(table(found))


if __name__ == "__main__":
    main()
