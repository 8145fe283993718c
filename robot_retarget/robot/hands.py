"""How a hand is turned where its wrist is straight: forward along the forearm, left along the axis of the elbow.

This holds for any pose in which a body was modelled. The palm of a person faces along the elbow's axis when the forearm
is turned neither in nor out (palms down and elbows back in a T-pose, palms to the thighs in a stand), and so does that
of a robot whose wrist hinges are at zero.
"""

import numpy as np

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.robot.axes import BENT, snapped_to_axes
from robot_retarget.robot.links import Links


def hand_frames(shoulder: Floats, elbow: Floats, hand: Floats) -> tuple[Floats, Floats]:
    """Return forward, left and up of a hand that continues its forearm, as columns, (…, 3, 3), of any body.

    Args:
        shoulder, elbow, hand: (…, 3) [m].

    Returns:
        The frames, and the sine of the elbow's bend (…); if it is 0, the roll about the forearm is arbitrary.
    """
    along, upper = unit(hand - elbow), unit(elbow - shoulder)
    axis = np.cross(upper, along)
    left = unit(axis)
    return np.stack([along, left, np.cross(along, left)], axis=-1), np.linalg.norm(axis, axis=-1)


def hand_axes(bent: Links, bodies: tuple[int, int], arm: Floats) -> Floats | None:
    """(3, 3) the hand's frame in its body, where three hinges beyond the elbow turn it any way.

    Args:
        bent: the robot, elbows in the middle of their range, all else in the reference pose.
        bodies: of the elbow and of the hand.
        arm: (3, 3) shoulder, elbow and hand there [m].
    """
    elbow, hand = (int(bent.weld[body]) for body in bodies)
    beyond = [link for link in bent.path(hand) if link not in bent.path(elbow)]
    frame, bend = hand_frames(*arm)
    if len(bent.axes_along(beyond)) < 3 or bend < BENT:
        return None
    return snapped_to_axes(bent.data.xmat[bodies[1]].reshape(3, 3).T @ frame, BENT)
