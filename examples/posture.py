"""Posture adaptation: a clap on a body whose arms are 20 % longer; the hands still meet."""

import robot_retarget as rr
from robot_retarget import papers
from robot_retarget.base.files import SAMPLES

motion = rr.read_motion(SAMPLES / "clap.bvh")
longer = [1.2 if name.endswith(("Elbow", "Wrist")) else 1.0 for name in motion.skeleton.names]

body = papers.SkeletalStructure.of(motion)
graph = papers.adapt(motion.positions, body, body.scaled(longer))
clap = papers.solve_frames(graph, motion.positions)

hands = [motion.skeleton.names.index(f"{side}Wrist") for side in ("Left", "Right")]
turned = papers.transfer_directions(motion.positions, body.parents, body.scaled(longer).lengths)
for what, x in (("human", motion.positions), ("bone directions kept", turned), ("distances kept", clap.positions)):
    apart = ((x[:, hands[0]] - x[:, hands[1]]) ** 2).sum(axis=1) ** 0.5
    print(f"{what}: wrists come as near as {apart.min():.3f} m")
