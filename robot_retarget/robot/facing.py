"""The heading of a robot: several criteria vote, each only if it exceeds a margin.

The criteria do not use the position of a joint's anchor on its axis, which is arbitrary. Up and across (the line
through both legs or arms) are known; the vote decides which of the two directions normal to them is forward.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import ALIGNED, Floats, unit
from robot_retarget.base.errors import MatchError
from robot_retarget.robot.limbs import (
    LEFT_WORDS,
    ONE_PLACE,
    RIGHT_WORDS,
    Chain,
    MirroredLimbs,
    arm_centres,
    leg_centres,
    sole_cloud,
    words,
)
from robot_retarget.robot.links import Axis, Links

# Axes of joints and links: by custom they lie along those of a body that stands upright.

CUBE = Rotation.create_group("O")
SHOWS_AXIS = 0.2
"""Angles with a smaller sine count as 0 [rad]: of a straight elbow or knee, which shows no axis, of a level foot or head, of a
hand along the axes of its link."""


def snapped_to_axes(turn: Floats, most: float) -> Floats:
    """The nearest of the 24 rotations (3, 3) that take axes to axes, if it is within `most` [rad] of `turn`; else `turn` itself.

    Args:
        turn: (3, 3) rotation.
        most: largest angle [rad].
    """
    turns = CUBE.inv() * Rotation.from_matrix(turn)
    nearest = int(np.argmin(turns.magnitude()))
    return CUBE[nearest].as_matrix() if turns[nearest].magnitude() < most else turn


SURE_VOTES = 2
"""A majority of this number of votes is sure: of eight robots one has fewer than 4, and 1 gives the same."""


@dataclass(frozen=True)
class Vote:
    """The vote of one criterion."""

    criterion: str
    sign: int
    """+1 for the candidate direction, −1 for the opposite, 0 for an abstention."""
    weight: int


@dataclass(frozen=True)
class Facing:
    """The forward and left directions."""

    forward: Floats
    left: Floats
    notes: tuple[str, ...]

    def of(self, pair: MirroredLimbs) -> dict[str, Chain]:
        """Return the left and the right of two limbs."""
        first_is_left = (pair.chains[0].end - pair.chains[1].end) @ self.left > 0
        return dict(zip("lr" if first_is_left else "rl", pair.chains, strict=True))


def facing(
    links: Links, flat: Links, legs: MirroredLimbs | None, arms: MirroredLimbs | None, given: Floats | None = None
) -> Facing:
    """Return forward by the votes of feet, toes, knees, elbows, a keyframe and names, or by the given direction (3,).

    `links` is the robot in its reference pose, `flat` with its soles flat. Without votes, or with equal votes for both,
    the model's x axis is forward.

    Args:
        flat: the links with level soles.
        legs: both legs, if found.
        arms: both arms, if found.
        given: (3,) heading from a map file, if given.

    Raises:
        MatchError: the given direction does not fit: the robot's limbs are not to the left and right of it.
    """
    pair = legs or arms
    assert pair is not None
    across = np.cross(pair.lateral, [0.0, 0.0, 1.0])
    votes = _votes(links, flat, legs, arms, across)
    count = sum(vote.sign * vote.weight for vote in votes)
    if given is not None:
        sign = _sign_of(given, across)
        against = [vote.criterion for vote in votes if vote.sign == -sign] if count * sign <= -SURE_VOTES else []
        notes = (f"the map sets its heading; {_listed(against)} point the other way",) if against else ()
    else:
        sign = int(np.sign(count)) or (1 if across[0] >= 0 else -1)
        notes = _notes(votes, count, sign)
    return Facing(sign * across, sign * pair.lateral, notes)


def _sign_of(given: Floats, across: Floats) -> int:
    cosine = float(given @ across) / float(np.linalg.norm(given))
    if abs(cosine) < ALIGNED:
        raise MatchError(
            f"forward = {given.tolist()} is not across the robot's legs or arms: it looks along ±{across.round(2).tolist()}"
        )
    return int(np.sign(cosine))


def _votes(
    links: Links, flat: Links, legs: MirroredLimbs | None, arms: MirroredLimbs | None, across: Floats
) -> list[Vote]:
    votes = [Vote("names", _names(links, [pair for pair in (legs, arms) if pair]), 2)]
    if legs:
        votes += [
            Vote("feet", _feet(links, flat, legs, across), 1),
            Vote("toes", _toes(links, legs, across), 1),
            Vote("knees", _beyond(_folded(links, legs, across, _middle_of_range(links)), SHOWS_AXIS), 2),
            Vote("the standing keyframe", _beyond(_folded(links, legs, across, _standing(links)), SHOWS_AXIS), 1),
        ]
    if arms:
        votes.append(Vote("elbows", _elbows(links, arms, across), 1))
    return votes


def _notes(votes: Sequence[Vote], count: int, sign: int) -> tuple[str, ...]:
    """Describe the outvoted criteria, and decisions with a small majority."""
    won = [v.criterion for v in votes if v.sign == sign]
    lost = [v.criterion for v in votes if v.sign == -sign]
    if not count:
        against = f": {_listed(won)} against {_listed(lost)}" if won or lost else ""
        return (f"no criterion decides between front and back{against}; the model's x axis followed. {_REMEDY}",)
    notes = [f"{_listed(lost)} point the other way, outvoted by {_listed(won)}"] if lost else []
    if "names" in lost:
        notes[0] = f"names call the left side right: {notes[0]}"
    elif not any(v.criterion == "names" and v.sign for v in votes):
        notes.append(f"names do not distinguish left from right: {_listed(won)} followed")
    return (
        (*notes, f"{_listed(won)} alone decide between front and back. {_REMEDY}")
        if abs(count) < SURE_VOTES
        else tuple(notes)
    )


_REMEDY = "The line `forward = [x, y, z]` in [robot] of a map file decides it"


def _listed(names: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]])) or "nobody"


def _beyond(value: float, margin: float) -> int:
    return int(np.sign(value)) if abs(value) > margin else 0


def _names(links: Links, pairs: list[MirroredLimbs]) -> int:
    """Return the vote of names: +1 if the first chain of limbs, on the candidate left, has a left name."""
    lateral = pairs[0].lateral
    votes = 0
    for pair in pairs:
        first = int(np.sign((pair.chains[0].end - pair.chains[1].end) @ lateral))
        votes += first * int(np.sign(_handedness(links, pair.chains[0]) - _handedness(links, pair.chains[1])))
    return int(np.sign(votes))


def _handedness(links: Links, chain: Chain) -> int:
    """Return the number of left names minus right names; a leading letter counts too (`lfemur`)."""
    total = 0
    for link in chain.links:
        text = words(links.words(link))
        initial = links.model.body(link).name[:1].lower()
        vote = bool(text & LEFT_WORDS) - bool(text & RIGHT_WORDS)
        total += vote or (initial == "l") - (initial == "r")
    return total


def _feet(links: Links, flat: Links, legs: MirroredLimbs, across: Floats) -> int:
    """Return the vote of soles, toes included: forward is the direction in which they reach further from the ankles."""
    ahead, length = 0.0, 0.0
    for chain in legs.chains:
        ankle = leg_centres(links, chain, legs.lateral).get("ankle")
        if ankle is None:
            continue
        foot = np.concatenate([flat.surface(link) for link in links.links_of(ankle.link)])
        along = (sole_cloud(foot) - flat.place(ankle.link, links.local(ankle.link, ankle.point))) @ across
        ahead, length = ahead + along.max() + along.min(), length + np.ptp(along)
    return _beyond(ahead / max(length, 1e-9), ONE_PLACE)


def _toes(links: Links, legs: MirroredLimbs, across: Floats) -> int:
    """Return the vote of toes: forward is the direction from the ankles to the hinges of toes."""
    ahead = 0.0
    for chain in legs.chains:
        ankle = leg_centres(links, chain, legs.lateral).get("ankle")
        beyond = links.links_of(ankle.link)[1:] if ankle else []
        hinges = [a for a in links.axes_along(beyond) if abs(a.direction @ legs.lateral) > ALIGNED]
        ahead += sum(float((a.nearest(ankle.point) - ankle.point) @ across) / chain.reach for a in hinges[:1] if ankle)
    return _beyond(ahead / 2, ONE_PLACE)


def _folded(links: Links, legs: MirroredLimbs, across: Floats, angles: Floats) -> float:
    """Return the angle by which hinge angles (n,) from the reference pose fold the shins back, mean of legs [rad]."""
    folded = 0.0
    for chain in legs.chains:
        knee = leg_centres(links, chain, legs.lateral).get("knee")
        hinges = [a for a in chain.axes if knee and abs(a.direction @ legs.lateral) > ALIGNED and a.link == knee.link]
        for axis in hinges[:1]:
            folded -= _angle(links, axis, angles) * float(np.cross(axis.direction, [0.0, 0.0, -1.0]) @ across)
    return folded / 2


def _elbows(links: Links, arms: MirroredLimbs, across: Floats) -> int:
    """Return the vote of elbows, which move the hands forward."""
    forward = 0.0
    for chain in arms.chains:
        centres = arm_centres(links, chain)
        if not centres:
            continue
        forearm = centres["hand"].point - centres["elbow"].point
        hinges = [a for a in chain.axes if a.link == centres["elbow"].link]
        for axis in hinges[-1:]:
            moved = np.cross(axis.direction, forearm)
            cosine = float(moved @ across) / max(float(np.linalg.norm(moved)), 1e-9)
            forward += _angle(links, axis, _middle_of_range(links)) * cosine * (abs(cosine) > ALIGNED)
    return _beyond(forward / 2, SHOWS_AXIS)


def _middle_of_range(links: Links) -> Floats:
    """Return (n,) the middles of the joints' ranges, relative to the reference pose [rad]."""
    robot = links.robot
    return (robot.lower + robot.upper) / 2 - robot.model.qpos0[robot.qpos_index]


def _standing(links: Links) -> Floats:
    """Return (n,) the angles of the standing keyframe, relative to the reference pose [rad]; 0 without one."""
    robot, key = links.robot, links.robot.standing_key
    return np.zeros(len(robot.qpos_index)) if key is None else (key - robot.model.qpos0)[robot.qpos_index]


def _angle(links: Links, axis: Axis, angles: Floats) -> float:
    return float(angles[links.robot.joint_ids.tolist().index(axis.joint)])


# How a hand is turned where its wrist is straight: forward along the forearm, left along the axis of the elbow.
#
# This holds for any pose in which a body was modelled. The palm of a person faces along the elbow's axis when the forearm
# is turned neither in nor out (palms down and elbows back in a T-pose, palms to the thighs in a stand), and so does that
# of a robot whose wrist hinges are at zero.


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
    if len(bent.axes_along(beyond)) < 3 or bend < SHOWS_AXIS:
        return None
    return snapped_to_axes(bent.data.xmat[bodies[1]].reshape(3, 3).T @ frame, SHOWS_AXIS)
