"""Table and picture of the robots that were tried: `python scripts/figures/robots.py FOLDER [--out docs/robots]`.

FOLDER holds the models as `OWNER/NAME/PATH`; robots.csv beside this script names them. Every robot performs the sample
wave. The table states which keypoints it has, the mean angle between its limbs and the human's, the processor time for a
frame, and the verdict of a simulation with the actuators of its own model.
"""

import argparse
import csv
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

import robot_retarget as rr
from robot_retarget.base.errors import RobotRetargetError
from robot_retarget.base.files import SAMPLES, folder, replacing
from robot_retarget.human.motion import Motion
from robot_retarget.tools.view.film import painter
from robot_retarget.tools.view.staging import arrange

LIST = Path(__file__).with_suffix(".csv")
CLIP = SAMPLES / "wave.bvh"
MOMENT = 2.2
"""Time of the picture, one hand raised [s]."""
COLUMNS, CELL = 6, 260
"""Pictures in a row, and the height and the width of one [pixels]."""
KEYPOINTS = 18
"""Of a robot with arms, legs and a head."""
HEAD = """# Robots that were tried

{count} humanoids perform the sample wave. Each model file is read unchanged, without a configuration by hand.

![{count} robots in the same moment of the wave, each next to the human]({picture})

`benchmarks/robots.md` has the source of each model, its joints, the recognised keypoints, the limb error, the time of a frame and the verdict.

- Keypoints: {all} where a robot has arms, legs and a head. A robot without a part performs with the parts it has.
- Limb error: mean angle between the limbs of robot and human (`limb_deg_mean` of [score](reference/scores.md)).
- Simulation: free-standing, with the actuators of the model file, in one world. The wave is solved with `--balance off`.
  [Your own robot](tutorials/own-robot.md) shows how the OP3 passes with its servos. Some models have torque motors whose gains
  no bound limits: `simulate` refuses their goals.
- `python scripts/figures/robots.py FOLDER` makes this page from the model files of the repositories.
"""
TABLE = """# Robots that were tried

`scripts/figures/robots.py` writes this table.

| robot | source | joints | keypoints | limb error [°] | CPU time of a frame [ms] | simulation |
|---|---|---|---|---|---|---|
"""


@dataclass(frozen=True)
class Trial:
    """What came of the clip on one robot."""

    cells: tuple[str, ...]
    picture: Image.Image | None = None

    @property
    def row(self) -> str:
        """The robot's row of the table."""
        return f"| {' | '.join(self.cells)} |"


def trial(name: str, repository: str, model: Path, motion: Motion) -> Trial:
    """Retarget the clip to one robot; a refusal is the robot's row."""
    source = f"[{repository}](https://github.com/{repository})"
    try:
        robot = rr.load_robot(model)
        rr.retarget(motion.frames(0, 9), robot, balance="off")
        began = time.process_time()
        result = rr.retarget(motion, robot, balance="off")
        spent = (time.process_time() - began) / len(result.trajectory)
        limbs = rr.score(result).figures["limb_deg_mean"]
    except RobotRetargetError as error:
        return Trial((name, source, "", "", "", "", str(error).replace(str(model), "the model")))
    counts = str(len(robot.joint_names)), f"{len(result.match.keypoints)} of {KEYPOINTS}"
    return Trial((name, source, *counts, f"{limbs:.1f}", f"{1e3 * spent:.1f}", verdict(result)), picture(name, result))


def verdict(result: rr.Result) -> str:
    """The verdict of a simulation without drawn worlds, if it can be simulated."""
    try:
        return rr.simulate(result, draws=0).badge.level
    except RobotRetargetError:
        return "not simulated"


def picture(name: str, result: rr.Result) -> Image.Image:
    """The robot beside the human at the moment of the picture, with its name."""
    figure = result.match.figure(result.motion)
    staging = arrange(result.robot, result.trajectory, *figure, np.array([MOMENT]))
    with painter(staging, round(CELL * staging.aspect), CELL) as (paint, _):
        made = Image.fromarray(paint(0))
    made.thumbnail((CELL, CELL))
    cell = Image.new("RGB", (CELL, CELL + 22), "white")
    cell.paste(made, ((CELL - made.width) // 2, (CELL - made.height) // 2))
    ImageDraw.Draw(cell).text((CELL / 2, CELL + 10), name, fill="black", anchor="mm", font_size=14)
    return cell


def sheet(pictures: Iterable[Image.Image]) -> Image.Image:
    """All pictures in rows."""
    cells = list(pictures)
    rows = -(-len(cells) // COLUMNS)
    whole = Image.new("RGB", (COLUMNS * CELL, rows * (CELL + 22)), "white")
    for k, cell in enumerate(cells):
        whole.paste(cell, (k % COLUMNS * CELL, k // COLUMNS * (CELL + 22)))
    return whole


def main() -> None:
    """Write the page and its picture."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("models", type=Path, help="folder of repositories, as OWNER/NAME/…")
    parser.add_argument("--out", type=Path, default=Path("docs/robots"), help="page and picture, without suffix")
    given = parser.parse_args()
    motion, trials = rr.read_motion(CLIP), []
    for row in csv.DictReader(LIST.open(encoding="utf-8")):
        trials.append(trial(row["name"], row["repository"], given.models / row["repository"] / row["path"], motion))
        print(trials[-1].row, flush=True)
    folder(given.out.parent)
    with replacing(given.out.with_suffix(".webp")) as scratch:
        sheet(t.picture for t in trials if t.picture).save(scratch, "WEBP", quality=80)
    text = HEAD.format(count=len(trials), picture=f"{given.out.name}.webp", all=KEYPOINTS)
    table = TABLE + "\n".join(t.row for t in trials) + "\n"
    for path, content in ((given.out.with_suffix(".md"), text), (Path("benchmarks/robots.md"), table)):
        with replacing(path) as scratch:
            scratch.write_text(content, encoding="utf-8")


if __name__ == "__main__":
    main()
