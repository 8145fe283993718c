"""When feet stand: the schedule that a source says is the one that is kept."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared_files import ROOT, SHARED, needs_shared

import robot_retarget as rr
from robot_retarget.contact.record import ContactRecord, labelled, standing_on
from robot_retarget.contact.rule import ContactRule, contact_schedule, on_soles, without_flicker
from robot_retarget.human.features import features_of
from robot_retarget.human.match import match
from robot_retarget.human.read import read_motion

NPZ = SHARED / "motions" / "other" / "npz"


@pytest.fixture(scope="module")
def walk():
    motion = read_motion(ROOT / "samples" / "walk.bvh").resample(30)
    matched = match(motion, rr.load_robot("op3"))
    return motion, matched, features_of(motion, matched).positions


def test_said_contacts_are_the_stances_side_by_side_and_toe_before_heel(walk):
    motion, matched, x = walk
    said = np.zeros((len(motion), 4), dtype=bool)
    for column, first in enumerate((10, 30, 50, 70)):
        said[first : first + 15, column] = True
    found = contact_schedule(matched.named(x), matched.human_leg, motion.fps, labelled(said))
    assert np.array_equal(found.of("l"), said[:, [1, 0]])
    assert np.array_equal(found.of("r"), said[:, [3, 2]])


def test_a_contact_too_short_to_be_true_is_passed_over(walk):
    motion, matched, x = walk
    said = np.zeros((len(motion), 4), dtype=bool)
    said[20:22, 0] = True
    assert not contact_schedule(matched.named(x), matched.human_leg, motion.fps, labelled(said)).of("l").any()


@pytest.mark.parametrize("fps", [15, 24, 25, 30, 50, 60, 100, 120])
@pytest.mark.parametrize("shortest", [0.075, 0.15, 0.3])
def test_stances_and_swings_no_longer_than_the_shortest_go_and_longer_ones_stay(fps: int, shortest: float) -> None:
    rule = ContactRule(shortest=shortest)
    for length in range(1, 2 * int(shortest * fps) + 3):
        alone = np.zeros(400, dtype=bool)
        alone[150 : 150 + length] = True
        longer = length > shortest * fps
        assert without_flicker(alone, fps, rule).sum() == length * longer
        assert (~without_flicker(~alone, fps, rule)).sum() == length * longer


@needs_shared
@pytest.mark.parametrize("name", ["01_single_text_prompt", "06_root_waypoints"])
def test_heels_are_still_while_a_generated_motion_says_they_stand(name):
    motion = read_motion(NPZ / f"kimodo_soma30_{name}.npz")
    matched = match(motion, rr.load_robot("op3"))
    x = features_of(motion, matched).positions
    said = contact_schedule(matched.named(x), matched.human_leg, motion.fps, motion.contacts)
    for side in "lr":
        ankle = x[:, matched.index(f"{side}_ankle")]
        speed = np.linalg.norm(np.gradient(ankle, 1 / motion.fps, axis=0), axis=1)
        standing = said.of(side)[:, 1]
        assert 0.2 < standing.mean() < 0.6
        assert np.quantile(speed[standing], 0.9) < 0.15 < np.quantile(speed[~standing], 0.5)


@needs_shared
def test_contacts_keep_their_frames_when_a_motion_is_cut_or_resampled():
    motion = read_motion(NPZ / "kimodo_soma30_01_single_text_prompt.npz")
    assert motion.contacts is not None
    cut, fast = motion.frames(40, 90), motion.resample(60)
    assert cut.contacts is not None and np.array_equal(cut.contacts.labels, motion.contacts.labels[40:90])
    assert fast.contacts is not None and fast.contacts.labels.shape == (len(fast), 4)
    assert np.array_equal(fast.contacts.labels[::2], motion.contacts.labels)


def lowest_parts(turn: np.ndarray) -> set[str]:
    """Brute force: which parts of a foot, a box with round sides, are nearest to the floor: toe, heel, sole, side, instep."""
    length, width, height = 0.12, 0.08, 0.05
    parts = {
        "toe": [(length, y, z) for y in (-0.03, 0.03) for z in (0.0, -height)],
        "heel": [(-length, y, z) for y in (-0.03, 0.03) for z in (0.0, -height)],
        "sole": [(x, y, -height) for x in (-length, length) for y in (-0.03, 0.03)],
        "side": [(x, side * width, z) for side in (-1, 1) for x in (-0.06, 0.06) for z in (0.0,)],
        "instep": [(x, 0.0, height) for x in (-0.06, 0.06)],
    }
    heights = {name: np.mean(sorted((np.array(points) @ turn.T)[:, 2])[:2]) for name, points in parts.items()}
    return {name for name, height in heights.items() if height < min(heights.values()) + 1e-9}


def left(stands: np.ndarray) -> ContactRecord:
    """Contacts of a left foot alone, whose toe and heel stand as `stands` (T, 2) says."""
    return standing_on(("l",), stands[:, None])


@pytest.mark.parametrize(
    ("pose", "degrees", "part", "stands"),
    [
        ("upright", (0, 0), "sole", (True, True)),
        ("on tiptoe", (50, 0), "toe", (True, True)),
        ("kneeling on bent toes", (100, 0), "toe", (True, False)),
        ("legs stretched, on the heel", (-80, 0), "heel", (False, True)),
        ("prone, on the instep", (170, 0), "instep", (False, False)),
        ("on the inner side", (0, 90), "side", (False, False)),
        ("on the outer side", (20, -80), "side", (False, False)),
    ],
)
def test_a_foot_stands_on_its_sole_toes_or_heel_alone(pose, degrees, part, stands):
    pitch, roll = degrees
    turn = Rotation.from_euler("yx", [pitch, roll], degrees=True).as_matrix()
    found = on_soles(left(np.ones((1, 2), bool)), {"l_foot": turn[None]})
    assert tuple(found.of("l")[0]) == stands, pose
    assert part in lowest_parts(turn)


def test_a_foot_without_axes_keeps_its_schedule():
    stands = np.array([[True, False], [True, True]])
    np.testing.assert_array_equal(on_soles(left(stands), {"r_foot": np.eye(3)[None]}).of("l"), stands)
