"""Zero moment point outside the support.

    share of frames with a foot on the floor in which the zero moment point leaves the convex hull of the sole points that are down

Sole points within 6 mm of the lowest one are down, so that a tilted sole carries by its edge: on a reference that tilts its soles the
figure counts tilt (one walk: 94 %; 12 % if points within 30 mm carry). A tracker that lays the sole flat has more support.

Unit: %. Range: 0 to 100. Momenta are smoothed over 0.05 s. A robot that is driven by a tracker may leave its support for a moment and
catch itself; a robot in open-loop playback falls. Source: PBHC calls a frame stable if centre of mass and centre of pressure are
within 0.1 m [arXiv 2506.12851]; this is the dynamic form.
"""

import numpy as np

from robot_retarget.robot.stance import planned_stance
from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject


def measure(subject: Subject) -> tuple[Value, ...]:
    """The share of frames, and the 5th percentile of the margin inside the support."""
    stance = planned_stance(subject.robot, subject.trajectory)
    if stance is None:
        return None, None
    margin = stance.zmp_margin[subject.standing & ~np.isnan(stance.zmp_margin)]
    return (100 * np.mean(margin < 0), 100 * np.percentile(margin, 5)) if margin.size else (None, None)


MEASURE = Measure(
    (
        Figure("zmp_out_pct", "%", 2, "frames with the zero moment point outside the support", most=100.0),
        Figure("zmp_margin_cm", "cm", 2, "its distance inside the support, 5th percentile (any sign)", "higher"),
    ),
    measure,
    feet=True,
)
