"""How feet are turned: level where they bear who stands upright, and never farther about the shin than an ankle goes."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.base.files import SAMPLES
from robot_retarget.human.features import features_of
from robot_retarget.human.match import match
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot

DANCE = SHARED / "motions/bvh/cmu_cgspeed_motionbuilder/05_06_dance.bvh"
FALL = SHARED / "motions/bvh/lafan1_procedural/fall_getup_procedural.bvh"


@cache
def shown(path: str) -> tuple[dict[str, Floats], dict[str, Floats], dict[str, np.ndarray]]:
    """The frames of segments (T, 3, 3), the keypoints (T, 3) and when feet stand (T, 2), of a clip at 15 frames a second."""
    motion = read_motion(path).resample(15)
    matched = match(motion, load_robot("op3"))
    human = features_of(motion, matched)
    return human.segments, matched.named(human.positions), human.contacts


@pytest.mark.parametrize("clip", ["walk", "wave", "squat"])
def test_feet_that_stand_are_level(clip: str) -> None:
    frames, _, stands = shown(str(SAMPLES / f"{clip}.bvh"))
    for side in "lr":
        assert np.median(frames[f"{side}_foot"][stands[side].all(axis=1), 2, 2]) > 0.99


@needs_shared
def test_who_lies_with_the_toes_up_does_not_tell_how_a_foot_stands() -> None:
    """A fall whose ankles are lowest where the body lies; it begins and ends upright."""
    frames, _, _ = shown(str(FALL))
    for side in "lr":
        assert frames[f"{side}_foot"][[0, 1, -2, -1], 2, 2].min() > 0.98


@needs_shared
def test_it_does_not_matter_how_high_the_floor_of_a_file_is() -> None:
    motion, robot = read_motion(FALL).resample(15), load_robot("op3")
    raised = replace(motion, positions=np.add(motion.positions, [0.0, 0.0, 50.0]))
    for side in "lr":
        here, there = (features_of(m, match(m, robot)).segments[f"{side}_foot"] for m in (motion, raised))
        assert np.allclose(here, there, atol=1e-6)


@needs_shared
def test_a_foot_that_only_stands_on_its_toes_is_known_by_the_other() -> None:
    """The dancer's right heel is up by half a radian whenever that foot stands."""
    frames, _, stands = shown(str(DANCE))
    up = np.median(frames["r_foot"][stands["r"].all(axis=1), 2, 2])
    assert np.cos(0.7) < up < np.cos(0.3)


@needs_shared
def test_no_foot_is_turned_over_against_its_knee() -> None:
    """This capture turns the left foot right over when it is pointed."""
    frames, x, _ = shown(str(DANCE))
    for side in "lr":
        hip, knee, ankle = (x[f"{side}_{k}"] for k in ("hip", "knee", "ankle"))
        axis = np.cross(unit(knee - hip), unit(ankle - knee))
        bent = np.linalg.norm(axis, axis=1) > 0.25
        assert (frames[f"{side}_foot"][bent, :, 1] * unit(axis[bent])).sum(axis=1).min() > 0.2
