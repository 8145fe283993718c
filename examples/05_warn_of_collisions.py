"""Predict self-collisions of a trajectory by the interaction distance of the links' surfaces."""

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES

motion = rr.read_motion(SAMPLES / "clap.bvh").frames(20, 70)
result = rr.retarget(motion, rr.load_robot("op3"), balance="off")
warnings = result.warnings

print(f"{int(warnings.flagged.any(axis=1).sum())} of {len(warnings)} frames carry a warning")
for event in warnings.events[:5]:
    print(event)
