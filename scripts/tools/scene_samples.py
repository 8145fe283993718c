"""Make the sample scenes of `samples/scenes/`: a box that is lifted from a table, a step, a chair.

Each is a composed clip (make_samples.py); the box and its table are in a TOML beside it, step and chair are found in the clip. The files come out
the same on every run.

    python scripts/tools/scene_samples.py [--out samples/scenes]
"""

import argparse
from pathlib import Path

import numpy as np
from make_samples import APART, FPS, HANGING, SIDES, STANDING, clock, hand, mirrored, standing
from mannequin import ANKLE_HEIGHT, HIP_DROP, WAIST, Act, Foot, Hand, perform
from moves import Floats, through

from robot_retarget.human.motion import Motion
from robot_retarget.human.readers.bvh import write_bvh

BOX = np.array([0.24, 0.3, 0.2])
"""Edges of the box [m]."""
TABLE = np.array([0.3, 0.5, 0.6])
"""Edges of the table [m]."""
AHEAD = 0.44
"""From the ankles to the middle of the table [m]."""
PALM = 0.02
"""From the wrist to the face of the box that a palm presses [m]."""
HANGS = float(STANDING[2] + HIP_DROP + WAIST + HANGING.wrist[2])
"""Height of the wrists of a standing body whose arms hang [m]."""
RISE, TREAD = 0.14, 0.42
"""Height of the step, and how far a foot goes to it [m]."""
SEAT = 0.36
"""How far the hips go down to the chair [m]."""
SCENE = """# A box on a table, in metres; the box moves along box.npz.
[[body]]
name = "table"
shape = "box"
size = {table}
position = [{ahead}, 0, {middle}]

[[body]]
name = "box"
shape = "box"
size = {box}
poses = "box.npz"
order = "wxyz"
fps = 30
"""


def box() -> tuple[Motion, Floats]:
    """A box is lifted from a table to the chest, held, and put down again; with its poses (T, 7)."""
    time = clock(9.0)
    lifted = through(time, (2.4, 0.0), (4.0, 1.0), (5.0, 1.0), (6.6, 0.0))
    lowered = ((0.4, 0.0), (1.8, 1.0), (2.6, 1.0), (4.4, 0.15), (4.6, 0.15), (6.2, 1.0), (7.1, 1.0), (8.4, 0.0))
    down = through(time, *lowered)
    place = np.array([AHEAD, 0.0, TABLE[2] + BOX[2] / 2]) + np.outer(lifted, [-0.1, 0, 0.32])
    gripped = through(time, (1.1, 0.0), (2.2, 1.0), (6.8, 1.0), (7.9, 0.0))
    act = standing(
        time,
        stance=0.12,
        hips=np.outer(down, [-0.12, 0, -0.10]),
        pelvis=np.radians(np.outer(down, [0, 37, 0])),
        spine=np.radians(np.outer(down, [0, 18, 0])),
        head=np.radians(np.outer(down, [0, -10, 0])),
        hands={side: _gripping(side, place, gripped, down) for side in SIDES},
        hands_in="world",
    )
    poses = np.concatenate([place, np.tile([1.0, 0, 0, 0], (len(time), 1))], axis=1)
    return perform(act, FPS, "box"), poses


def _gripping(side: str, place: Floats, gripped: Floats, down: Floats) -> Hand:
    """A hand that hangs, or holds the side of a box at `place`."""
    share = gripped[:, None]
    beside = np.array([0.05, 0.245, HANGS]) + np.outer(down, [0.24, 0, -0.1])
    grip = place + np.array([-0.06, BOX[1] / 2 + PALM, 0.03])
    wrist = (1 - share) * beside + share * grip + np.outer(0.1 * np.sin(np.pi * gripped), [0, 1, 0])
    fingers = (1 - share) * HANGING.fingers + share * np.array([1.0, 0, -0.15])
    still = [np.tile(way, (len(place), 1)) for way in ([-0.3, 1.0, -0.6], [0.0, -1.0, 0.0])]
    return Hand(*(mirrored(way, side) for way in (wrist, *still, fingers)))


def step() -> Motion:
    """The left foot steps up, the right one follows; the body stands on the step."""
    time = clock(6.0)
    moves = {"Left": (1.2, 2.2), "Right": (2.8, 3.8)}
    feet = {side: _stepping(time, side, *moves[side]) for side in SIDES}
    hips = through(
        time, (0.4, (0, 0, 0)), (1.2, (0.02, -0.075, -0.03)), (2.2, (0.05, -0.07, -0.04)), (2.9, (0.22, 0.06, -0.06)),
        (3.9, (0.40, 0.075, RISE - 0.02)), (4.8, (TREAD, 0, RISE)),
    )  # fmt: skip
    leans = through(time, (1.2, 0.0), (2.4, 1.0), (3.2, 1.0), (4.4, 0.0))
    rest = np.zeros((len(time), 3))
    act = Act(
        hips=STANDING + hips,
        pelvis=np.radians(np.outer(leans, [0, 10, 0])),
        spine=np.radians(np.outer(leans, [0, 6, 0])),
        head=rest,
        hands={side: hand(time, side, (0, HANGING)) for side in SIDES},
        feet=feet,
    )
    return perform(act, FPS, "step")


def _stepping(time: Floats, side: str, start: float, stop: float) -> Foot:
    """A foot that goes up to the step, first up and then ahead."""
    third = (stop - start) / 3
    up = through(time, (start, 0.0), (start + 2 * third, RISE + 0.06), (stop, RISE))
    ahead = through(time, (start + 0.6 * third, 0.0), (stop - 0.4 * third, TREAD))
    ankle = np.stack([ahead, np.full_like(up, SIDES[side] * 0.09), ANKLE_HEIGHT + up], axis=-1)
    return Foot(ankle, 0 * up, 0 * up)


def chair() -> Motion:
    """The body sits down on a chair, sits for two seconds, and stands up."""
    time = clock(7.6)
    sat = through(time, (0.6, 0.0), (2.2, 1.0), (4.6, 1.0), (6.2, 0.0))
    leans = through(time, (0.5, 0.0), (1.5, 1.0), (2.6, 0.1), (4.2, 0.1), (5.2, 1.0), (6.4, 0.0))
    reaches = ((0.6, HANGING), (1.6, APART), (5.4, APART), (6.6, HANGING))
    act = standing(
        time,
        stance=0.11,
        hips=np.outer(sat, [-0.44, 0, -SEAT]),
        pelvis=np.radians(np.outer(leans, [0, 38, 0])),
        spine=np.radians(np.outer(leans, [0, 12, 0])),
        head=np.radians(np.outer(leans, [0, -18, 0])),
        hands={side: hand(time, side, *reaches) for side in SIDES},
    )
    return perform(act, FPS, "chair")


def main() -> None:
    parser = argparse.ArgumentParser(description="Make the sample scenes.")
    parser.add_argument("--out", type=Path, default=Path(__file__).resolve().parents[2] / "samples/scenes")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    carried, poses = box()
    for motion in (carried, step(), chair()):
        path = folder / f"{motion.source}.bvh"
        write_bvh(motion, path)
        # The sign of a zero is rounding noise that differs from run to run.
        path.write_text(path.read_text().replace("-0.000000", "0.000000"), newline="\n")
        print(f"{motion.source}: {len(motion)} frames, {motion.duration:.1f} s")
    np.savez(folder / "box.npz", poses=poses.round(6))
    filled = SCENE.format(table=TABLE.tolist(), box=BOX.tolist(), ahead=AHEAD, middle=TABLE[2] / 2)
    (folder / "box.toml").write_text(filled, newline="\n")


if __name__ == "__main__":
    main()
