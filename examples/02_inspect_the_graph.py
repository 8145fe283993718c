"""Look at the graph of a retargeting: its kinds, the edges of two ends, and the table of all edges of a frame."""

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES

motion = rr.read_motion(SAMPLES / "clap.bvh").frames(30, 50)
graph = rr.describe(motion, rr.load_robot("op3"))

print(graph)
for kind, track in graph.between("l_hand", "r_hand").items():
    print(f"{kind}: {track.lower[10, 0]:.3f} … {track.upper[10, 0]:.3f} m, priority {track.priority[10, 0]:.0f}")
table = graph.table(frames=10)
print(f"{len(table)} edges in frame 10; the first: {table[0]}")
