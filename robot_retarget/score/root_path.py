"""Distance of the robot's pelvis from the human's, scaled path.

    mean_t ‖(p_t − p_0) − (ℓ'/ℓ) R (h_t − h_0)‖ / ℓ'

p the robot's pelvis, h the human's, ℓ' and ℓ their legs, R the turn between their first headings. Unit: leg lengths. Range: 0
and more. Source: this project.
"""

import numpy as np

from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject


def measure(subject: Subject) -> tuple[Value, ...]:
    """The mean over the frames."""
    pair = subject.pair
    assert pair is not None
    if not pair.has("pelvis"):
        return (None,)
    (leg, own), (facing, heading) = pair.legs, pair.headings
    human, robot = pair.human[:, pair.index("pelvis")], pair.robot[:, pair.index("pelvis")]
    scaled = (human - human[0]) * (own / leg) @ (heading[0].T @ facing[0]).T
    return (np.linalg.norm(robot - robot[0] - scaled, axis=1).mean() / own,)


MEASURE = Measure(
    (Figure("root_path_err", "legs", 3, "distance of the pelvis from the human's scaled path, mean"),),
    measure,
    human=True,
)
