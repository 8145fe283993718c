"""Sentences about pickles without parameters of a human body."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from robot_retarget.human.readers.smpl.parameters import SOMA

ROBOT_KEYS = (
    {"root_pos", "dof_pos"},
    {"root_trans_offset", "dof"},
    {"loop_mode", "frames"},
    {"timed_sequence", "qpos"},
)
SAVE = "save them as .npz with positions (T, J, 3), names, parents and fps"


def sentence(content: Any) -> str:
    """Return the sentence about an unpickled content that holds no parameters of a body."""
    if not isinstance(content, Mapping):
        shape = f" {content.shape}" if isinstance(content, np.ndarray) else ""
        return f"no turns of a body in this pickle; it holds {type(content).__name__}{shape}"
    if "rigid_body_pos" in content:
        return f"a motion of ProtoMotions: rigid_body_pos holds positions of bodies without their names; {SAVE}"
    if any(SOMA in one for one in content.values() if isinstance(one, Mapping)):
        return f"turns of SOMA's 77 joints (GEM-X) without their places: take the joints of its SOMA layer and {SAVE}"
    inner = next((value for value in content.values() if isinstance(value, Mapping)), {})
    if any(keys <= one.keys() for keys in ROBOT_KEYS for one in (content, inner)):
        return "a motion of a robot, not of a human: robot-retarget import FILE --robot ROBOT -o T.npz"
    return f"no turns of a body in this pickle; it holds {', '.join(map(str, content)) or 'nothing'}"
