"""Motion of the root: jerk, height and travel.

    jerk = mean_t ‖p_{t+3} − 3 p_{t+2} + 3 p_{t+1} − p_t‖ · fps³
    height = min_t of the root's height, over that in the reference pose on its soles
    travel = max_t ‖p_t − p_0‖ along the floor

Units: m/s³, 1, m. Range: 0 and more. Source: PHUMA keeps human clips with a root jerk below 50 m/s³ and a pelvis between 0.6 and 1.5 m [arXiv
2510.26236, `preprocess_smplx.py`]; its third filter, the distance to the base of support, has `zmp_out_pct` for a counterpart.
"""

import numpy as np

from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject


def measure(subject: Subject) -> tuple[Value, ...]:
    """Jerk, least height and travel; None for a robot whose root is not free."""
    if not subject.robot.floating:
        return None, None, None
    place = subject.root
    third = np.linalg.norm(np.diff(place, 3, axis=0), axis=1) * subject.fps**3
    travel = np.linalg.norm(place[:, :2] - place[0, :2], axis=1).max()
    return (third.mean() if third.size else None), place[:, 2].min() / standing_height(subject), travel


def standing_height(subject: Subject) -> float:
    """Height of the root over the lowest sole point in the reference pose [m]."""
    pose = subject.robot.neutral()[None]
    floor = subject.floor_of(pose) if subject.soles else 0.0
    return max(float(pose[0, subject.robot.root_address + 2]) - floor, 1e-6)


MEASURE = Measure(
    (
        Figure("root_jerk", "m/s^3", 2, "jerk of the root, mean"),
        Figure(
            "root_height_min",
            "",
            3,
            "lowest root, over its standing height",
            "neither",
            cause="a squat, a fall or lying",
        ),
        Figure("travel_m", "m", 3, "farthest that the root goes from its first place", "neither"),
    ),
    measure,
)
