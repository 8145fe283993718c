"""Draw the strips of docs/tutorials/box-step-chair.md: `python scripts/figures/scene_pictures.py [--out FOLDER] [box|step|seat|size]…`. Needs Pillow.

`box` is the OP3 in simulation, with a box that friction holds; `size` is a box of 40 cm in its true size beside the OP3 and the G1.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import robot_retarget as rr
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import ShapeKind, solid
from robot_retarget.tools.view.film import strip
from robot_retarget.tools.view.picture import Picture

SCENES = Path(__file__).resolve().parents[2] / "samples/scenes"
HEIGHT = 320
"""Of a strip [pixels]."""
CUBE = 0.4
"""Edge of the box that shows sizes [m]."""


def drawn(result: rr.Result, target: Path, trajectory: rr.Trajectory | None = None, count: int = 6) -> Path:
    """Draw moments of a result, the human beside the robot."""
    human, bones = result.match.figure(result.motion)
    picture = strip(result.robot, trajectory or result.trajectory, human, bones, count=count, height=HEIGHT)
    if not isinstance(picture, Picture):
        raise SystemExit(picture.reason)
    return picture.save(target)


def box(folder: Path) -> Path:
    """Draw a box that the OP3 lifts, as simulated."""
    result = rr.retarget(
        SCENES / "box.bvh", rr.load_robot("op3"), scene=SCENES / "box.toml", legs="follow", balance="static"
    )
    print(rr.simulate(result, objects="free", draws=0))
    return drawn(result, folder / "box.png")


def step(folder: Path) -> Path:
    """Draw the OP3 that steps on a step that is found in the capture, as simulated."""
    result = rr.retarget(SCENES / "step.bvh", rr.load_robot("op3"), terrain="auto")
    report = rr.simulate(result, draws=0)
    print(report)
    return drawn(result, folder / "step.png", replace(result.trajectory, qpos=report.series["simulated"]))


def seat(folder: Path) -> Path:
    """Draw a seat that is found in the capture."""
    return drawn(
        rr.retarget(SCENES / "chair.bvh", rr.load_robot("g1_class"), terrain="auto", balance="off"), folder / "seat.png"
    )


def size(folder: Path) -> Path:
    """Draw a box of 40 cm beside the OP3 and the G1, in its true size and scaled with the human."""
    motion, pictures = rr.read_motion(SCENES / "chair.bvh").frames(0, 2), []
    place = np.array([-1.2, 0.0, CUBE / 2, 1, 0, 0, 0])
    cube = Scene((RigidBody("box", solid(ShapeKind.BOX, (CUBE, CUBE, CUBE)), place),))
    for robot in ("op3", "g1_class"):
        for scale in (1.0, None):
            result = rr.retarget(motion, rr.load_robot(robot), scene=replace(cube, scale=scale), balance="off")
            picture = strip(
                result.robot, result.trajectory, *result.match.figure(result.motion), count=1, height=HEIGHT
            )
            if not isinstance(picture, Picture):
                raise SystemExit(picture.reason)
            pictures.append(picture)
    whole = Picture(np.concatenate([picture.pixels for picture in pictures], axis=1))
    return whole.save(folder / "size.png")


PICTURES = {each.__name__: each for each in (box, step, seat, size)}


def main() -> None:
    """Write the pictures."""
    ask = argparse.ArgumentParser(description=__doc__)
    ask.add_argument("names", nargs="*", default=list(PICTURES))
    ask.add_argument("--out", type=Path, default=Path("docs/tutorials"))
    given = ask.parse_args()
    for name in given.names:
        print(PICTURES[name](given.out), flush=True)


if __name__ == "__main__":
    main()
