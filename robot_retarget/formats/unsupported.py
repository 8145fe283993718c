"""Known files of robot motion that are not read, each with a sentence about its conversion."""

from robot_retarget.formats.pickles.dictionary import holds
from robot_retarget.formats.source import TrajectorySource

SENTENCES = (
    (
        ("action_traj",),
        "a file of ToddlerBot that holds motor positions only. Open it in robot-keyframe-kit, play it and save it: that "
        "file holds qpos",
    ),
    (
        ("keyframes",),
        "keyframes of ToddlerBot without a motion between them. Open it in robot-keyframe-kit, play it and save it",
    ),
)
"""Keys of a pickled dictionary, and the sentence about it."""


def unsupported(source: TrajectorySource) -> str:
    """The sentence about a file of a known program; empty for any other."""
    return next((sentence for keys, sentence in SENTENCES if holds(source.pickled, *keys)), "")
