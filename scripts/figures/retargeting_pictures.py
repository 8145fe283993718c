"""Draw the strips of docs/retargeting.md: `python scripts/figures/retargeting_pictures.py [--out FOLDER]`. Needs Pillow."""

import argparse
from dataclasses import replace
from pathlib import Path

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES
from robot_retarget.tools.view.film import strip
from robot_retarget.tools.view.picture import Picture

MOMENTS = {"clap": (47, 79, 5), "squat": (0, 76, 5), "walk": (45, 101, 7)}
"""Of each clip: the first frame, the one past the last, how many moments between them are shown."""
HEIGHT = 360
"""Of a strip [pixels]."""


def draw(name: str, robot: rr.Robot, target: Path) -> Path:
    """Retarget a sample clip and show some moments of it, the human beside the robot."""
    first, stop, count = MOMENTS[name]
    result = rr.retarget(rr.read_motion(SAMPLES / f"{name}.bvh"), robot, balance="off")
    part = slice(first, stop)
    shown = replace(
        result.trajectory, qpos=result.trajectory.qpos[part], source_time=result.trajectory.source_time[part]
    )
    human, bones = result.match.figure(result.motion)
    picture = strip(robot, shown, human[first:stop], bones, count=count, height=HEIGHT)
    if not isinstance(picture, Picture):
        raise SystemExit(picture.reason)
    return picture.save(target / f"{name}.png")


def main() -> None:
    """Write the pictures."""
    ask = argparse.ArgumentParser(description=__doc__)
    ask.add_argument("--out", type=Path, default=Path("docs/retargeting"))
    folder = ask.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    for name in MOMENTS:
        print(draw(name, rr.load_robot("op3"), folder))


if __name__ == "__main__":
    main()
