"""Make the looping film of the README: the human and robots in one motion, side by side, as a GIF.

python scripts/figures/readme_film.py op3 my_robot.xml --clip samples/walk.bvh -o docs/film.gif
"""

import argparse
from pathlib import Path

import numpy as np

import robot_retarget as rr
from robot_retarget.files import replacing
from robot_retarget.shipped import SAMPLES
from robot_retarget.view.painter import painter
from robot_retarget.view.picture import Pixels
from robot_retarget.view.staging import arrange

FPS = 12.5
"""Pictures per second; a GIF counts whole hundredths of a second."""
COLOURS = 96


def pictures(robot: rr.Robot, motion: rr.Motion, height: int, with_human: bool) -> list[Pixels]:
    """Render the motion on one robot, with or without the human beside it."""
    result = rr.retarget(motion, robot)
    points, bones = result.match.figure(result.motion) if with_human else (None, None)
    times = np.arange(int(result.trajectory.duration * FPS)) / FPS
    staging = arrange(robot, result.trajectory, points, bones, times)
    with painter(staging, round(height * staging.aspect), height) as (paint, _):
        return [paint(k) for k in range(len(times))]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="+", help="shipped names, MJCF files or names of robot_descriptions")
    parser.add_argument("--clip", type=Path, default=SAMPLES / "walk.bvh")
    parser.add_argument("--frames", type=int, nargs=2, default=(0, 120), help="of the clip")
    parser.add_argument("--height", type=int, default=260, help="of the film [pixels]")
    parser.add_argument("-o", "--out", type=Path, default=Path("docs/film.gif"))
    given = parser.parse_args()
    motion = rr.read_motion(given.clip).frames(*given.frames)
    columns = [pictures(rr.load_robot(name), motion, given.height, k == 0) for k, name in enumerate(given.robots)]
    from PIL import Image

    rows = [np.concatenate(moment, axis=1) for moment in zip(*columns, strict=True)]
    film = [Image.fromarray(row).quantize(COLOURS, dither=Image.Dither.NONE) for row in rows]
    with replacing(given.out) as scratch:
        film[0].save(
            scratch,
            format="GIF",
            save_all=True,
            append_images=film[1:],
            duration=round(1000 / FPS),
            loop=0,
            optimize=True,
        )
    print(f"wrote {given.out}: {len(film)} pictures, {given.out.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
