"""Several people in one file: each is a subtree of joints that is a complete human body."""

from dataclasses import replace

import numpy as np

from robot_retarget.base.errors import MatchError, UsageError
from robot_retarget.base.keypoints import SIDES
from robot_retarget.human.capture import Capture
from robot_retarget.human.readers.request import Request
from robot_retarget.human.recognition.limbs import LIMBS
from robot_retarget.human.recognition.recognise import recognise
from robot_retarget.human.skeleton import Skeleton

FEWEST = len(SIDES) * sum(map(len, LIMBS.values()))
"""Joints of two legs and two arms."""


def one_performer(capture: Capture, request: Request) -> tuple[Capture, tuple[str, ...]]:
    """The requested one of several people, or the first with a note that lists them; the capture itself if it holds one.

    Raises:
        UsageError: one of several is requested, and it holds one.
        MotionError: no person has the requested name.
    """
    roots = performers(capture)
    if len(roots) < 2:
        if request.clip is not None:
            raise UsageError(f"{capture.source}: it holds one motion; leave out the # and the text after it")
        return capture, ()
    which, notes = request.choose([capture.skeleton.names[root] for root in roots], capture.source)
    return subtree(capture, roots[which]), notes


def performers(capture: Capture) -> list[int]:
    """The root joints of the people, where siblings are human bodies; nothing where fewer than two are.

    A level with one large branch and otherwise single joints is the wrapper of a scene: the search continues below it.
    """
    level = np.flatnonzero(capture.skeleton.parents < 0).tolist()
    while level:
        sizes = [len(below(capture.skeleton, joint)) for joint in level]
        large = [joint for joint, size in zip(level, sizes, strict=True) if size >= FEWEST]
        if len(large) > 1:
            return [joint for joint in large if _is_human(subtree(capture, joint))]
        if not large or sorted(sizes)[:-1] != [1] * (len(sizes) - 1):
            return []
        level = np.flatnonzero(capture.skeleton.parents == large[0]).tolist()
    return []


def below(skeleton: Skeleton, joint: int) -> list[int]:
    """A joint and all that it carries.

    Args:
        skeleton: names and tree of the joints.
        joint: index of the joint.
    """
    carried = {joint}
    for child in range(joint + 1, len(skeleton)):
        if int(skeleton.parents[child]) in carried:
            carried.add(child)
    return sorted(carried)


def subtree(capture: Capture, joint: int) -> Capture:
    """The capture of a joint and all that it carries.

    Args:
        joint: index of the joint.
    """
    kept = below(capture.skeleton, joint)
    place = {old: new for new, old in enumerate(kept)}
    old = capture.skeleton
    parents = np.array([place.get(int(old.parents[k]), -1) for k in kept])
    skeleton = Skeleton(tuple(old.names[k] for k in kept), parents, old.offsets[kept])
    rotations = None if capture.rotations is None else capture.rotations[:, kept]
    return replace(capture, skeleton=skeleton, positions=capture.positions[:, kept], rotations=rotations)


def _is_human(capture: Capture) -> bool:
    try:
        recognise(capture.skeleton, capture.positions)
    except MatchError:
        return False
    return True
