"""Put two takes of one motion side by side on a page that opens offline."""

from pathlib import Path
from tempfile import mkdtemp

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES

motion = rr.read_motion(SAMPLES / "hips_and_bow.bvh").frames(0, 40)
robot = rr.load_robot("op3")
takes = [rr.retarget(motion, robot, preset=preset, balance="off") for preset in ("directions", "distances")]
for take in takes:
    print(take.likeness.sentence)

page = rr.view(*takes).save(Path(mkdtemp()) / "compared.html")
print(page, f"{page.stat().st_size / 1e6:.1f} MB")
