"""How feet are turned: level where they bear who stands upright, and never farther about the shin than an ankle goes."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.base.files import SAMPLES
from robot_retarget.contact.record import ContactRecord
from robot_retarget.human.features import features_of
from robot_retarget.human.match import match
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.robot import load_robot

DANCE = SHARED / "motions/bvh/cmu_cgspeed_motionbuilder/05_06_dance.bvh"
FALL = SHARED / "motions/bvh/lafan1_procedural/fall_getup_procedural.bvh"


@cache
def shown(path: str) -> tuple[dict[str, Floats], dict[str, Floats], ContactRecord]:
    """The frames of segments (T, 3, 3), the keypoints (T, 3) and the contacts, of a clip at 15 frames a second."""
    motion = read_motion(path).resample(15)
    matched = match(motion, load_robot("op3"))
    human = features_of(motion, matched)
    return human.segments, matched.named(human.positions), human.contacts


@pytest.mark.parametrize("clip", ["walk", "wave", "squat"])
def test_feet_that_stand_are_level(clip: str) -> None:
    frames, _, stands = shown(str(SAMPLES / f"{clip}.bvh"))
    for side in "lr":
        assert np.median(frames[f"{side}_foot"][stands.of(side).all(axis=1), 2, 2]) > 0.99


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
    up = np.median(frames["r_foot"][stands.of("r").all(axis=1), 2, 2])
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


@needs_shared
def test_the_feet_of_who_never_stands_are_those_of_the_whole_clip() -> None:
    """The middle of a fall alone, in which the hips stay under half a leg, has the feet of the clip that begins upright."""
    motion = read_motion(FALL).resample(15)
    robot = load_robot("op3")
    matched = match(motion, robot)
    whole = features_of(motion, matched)
    hips = whole.positions[:, [matched.index(k) for k in ("l_hip", "r_hip")], 2].mean(axis=1)
    low = np.flatnonzero(hips < 0.45 * matched.human_leg)
    first, last = int(low[0]), int(low[-1]) + 1
    assert (hips[first:last] < 0.5 * matched.human_leg).mean() > 0.98
    part = replace(motion.frames(first, last), whole=None)
    alone = features_of(part, match(part, robot))
    for side in "lr":
        here, there = alone.segments[f"{side}_foot"], whole.segments[f"{side}_foot"][first:last]
        off = Rotation.from_matrix(here.swapaxes(1, 2) @ there).magnitude()
        assert np.degrees(np.median(off)) < 20


def test_an_end_site_under_the_ankle_is_no_toe_and_the_foot_stands_on_its_whole_sole() -> None:
    """The walk with feet that end straight below the ankles: their soles are level, and head as the body does, within 15°."""
    motion = read_motion(SAMPLES / "walk.bvh")
    toes = [k for k, name in enumerate(motion.skeleton.names) if "Toe" in name]
    ends = [k for k in toes if motion.skeleton.names[k].endswith("_end")]
    kept = [k for k in range(len(motion.skeleton)) if k not in toes or k in ends]
    place = {old: new for new, old in enumerate(kept)}
    feet = {end: int(motion.skeleton.parents[int(motion.skeleton.parents[end])]) for end in ends}
    positions = motion.positions.copy()
    for end, ankle in feet.items():
        positions[:, end] = positions[:, ankle] - [0.0, 0.0, 0.08]
    names = tuple(motion.skeleton.names[feet[k]] + "_end" if k in feet else motion.skeleton.names[k] for k in kept)
    parents = np.array([place.get(feet.get(k, int(motion.skeleton.parents[k])), -1) for k in kept])
    skeleton = Skeleton(names, parents, motion.skeleton.offsets[kept])
    assert motion.rotations is not None
    blunt = Motion(skeleton, positions[:, kept], motion.rotations[:, kept], motion.fps)
    matched = match(blunt, load_robot("op3"))
    assert not {"l_toe", "r_toe"} & set(matched.keypoints)
    human = features_of(blunt, matched)
    for side in "lr":
        stands, axes = human.contacts.of(side), human.segments[f"{side}_foot"]
        assert np.array_equal(stands[:, 0], stands[:, 1]) and 0.3 < stands.mean() < 0.9
        assert np.median(axes[stands[:, 0], 2, 2]) > 0.97
        ahead = unit(axes[stands[:, 0], :2, 0])
        assert np.median((ahead * human.heading[stands[:, 0]]).sum(axis=1)) > np.cos(np.radians(15))
