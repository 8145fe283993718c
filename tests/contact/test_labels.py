"""The rule of contacts against frames of five clips that a person labelled on pictures of the legs."""

import numpy as np
from shared_files import SHARED, needs_shared

import robot_retarget as rr

BVH = SHARED / "motions/bvh"
# Left and right foot at 24 frames from 5 to 95 % of a clip: 1 bears, 0 does not, ? is an instant of touching down or
# lifting off (48 of 240), which a picture does not tell.
LABELS = {
    "cmu_cgspeed_motionbuilder/02_01_walk": ("11111?000?111110000?1111", "?000?11111?000?1111?0000"),
    "cmu_cgspeed_motionbuilder/05_06_dance": ("11000000100?000?10000000", "??1??1?000?00??001111111"),
    "mixamo/test_freebvh_walk": ("00?111111??00?1111111?00", "1110000?1111111?00000?11"),
    "cmu_hahne_3dsmax/jumping_jacks": ("111?0??0?10?100100??0?11", "111?0??0?10?100100??0?11"),
    "soma30_derived/soma30_walk_then_sneak": ("?01100110011011?0?110011", "?1001100110?1101110?1100"),
}


@needs_shared
def test_contacts_of_feet_are_those_that_a_person_sees_in_97_of_100_frames() -> None:
    told = wrong = 0
    for clip, feet in LABELS.items():
        graph = rr.describe(rr.read_motion(BVH / f"{clip}.bvh"), rr.load_robot("g1_class"))
        frames = np.linspace(0.05 * len(graph), 0.95 * len(graph), 24).round().astype(int)
        for side, labels in zip("lr", feet, strict=True):
            stands = graph.human.contacts.of(side)[frames].tolist()
            clear = [(any(parts), label == "1") for parts, label in zip(stands, labels, strict=True) if label != "?"]
            told += len(clear)
            wrong += sum(stood != label for stood, label in clear)
    assert told > 180 and wrong <= 0.03 * told
