"""What is sent is what arrives: VMC and lines of JSON, checked against the motion and by hand."""

import json
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from perform import PROTOCOLS, humanoid, sending, unity_place, unity_turn
from performers import clip
from scipy.spatial.transform import Rotation

from robot_retarget.base.errors import UsageError
from robot_retarget.human.motion import Motion
from robot_retarget.human.recognition import recognise
from robot_retarget.human.skeleton import forward, forward_once
from robot_retarget.live.bones import (
    BONES,
    OPTIONAL,
    PASSED_OVER,
    mean_offsets,
    place_of,
    turn_of,
)
from robot_retarget.live.frame import FaultCounter, Frame
from robot_retarget.live.messages import LineDecoder
from robot_retarget.live.receiver import Decoder
from robot_retarget.live.vmc import VmcDecoder

numbers = st.floats(-3, 3)


def fed(decoder: Decoder, packet: bytes, arrived: float) -> list[Frame]:
    """The frame that a packet completes, if it does."""
    return [decoder.newest()] if decoder.feed(packet, arrived) else []


def sent(decoder: Decoder, motion: Motion, protocol: str, frames: int = 10) -> list[Frame]:
    """The frames that a decoder makes of a motion's packets, 1/60 s apart."""
    packets, found = PROTOCOLS[protocol](motion), []
    for t in range(frames):
        for packet in packets(t, t / 60):
            found += fed(decoder, packet, 100 + t / 60)
    return found


def message(address: str, *values: str | float) -> bytes:
    """An OSC message, put together by hand."""
    padded = lambda text: text.encode() + b"\0" * (4 - len(text.encode()) % 4)  # noqa: E731
    tags = "," + "".join("s" if isinstance(value, str) else "f" for value in values)
    body = b"".join(padded(v) if isinstance(v, str) else struct.pack(">f", v) for v in values)
    return padded(address) + padded(tags) + body


@given(st.tuples(numbers, numbers, numbers), st.tuples(numbers, numbers, numbers))
def test_unity_s_axes_turn_into_ours_and_rotations_with_them(axis: tuple[float, ...], point: tuple[float, ...]) -> None:
    # x right, y up, z ahead, left-handed: a positive angle turns the other way round in a mirror.
    turn, place = Rotation.from_rotvec(axis), list(point)
    q = turn.as_quat().tolist()
    ours = Rotation.from_quat(turn_of(q), scalar_first=True)
    assert np.allclose(ours.apply(place_of(place)), place_of(turn.apply(place).tolist()), atol=1e-9)
    assert np.allclose(unity_place(place_of(place)), place) and np.allclose(unity_turn(turn_of(q)), q)


def test_ahead_left_and_up_are_where_unity_has_them() -> None:
    ahead, left, up = (place_of(p) for p in ([0, 0, 1], [-1, 0, 0], [0, 1, 0]))
    assert (np.array([ahead, left, up]) == np.eye(3)).all()


@pytest.mark.parametrize("turned", [True, False])
def test_positions_and_rotations_arrive_as_they_were_sent(turned: bool) -> None:
    motion = clip()
    motion = motion if turned else Motion(motion.skeleton, motion.positions, None, motion.fps)
    faults = FaultCounter()
    frames = sent(LineDecoder(faults, whole=True), motion, "json")
    assert len(frames) == 10 and not faults.counts
    for t, frame in enumerate(frames):
        assert np.allclose(frame.positions, motion.positions[t], atol=2e-5)
        assert frame.skeleton.names == motion.skeleton.names
        if motion.rotations is None:
            assert frame.rotations is None
        else:
            assert frame.rotations is not None and np.allclose(frame.rotations, motion.rotations[t], atol=1e-5)


def test_bones_arrive_where_the_joints_were() -> None:
    motion = clip("walk")
    frames = sent(VmcDecoder(FaultCounter()), motion, "vmc")
    assert len(frames) == 9  # the first teaches what belongs to a frame
    marks = recognise(motion.skeleton, motion.positions).marks
    for t, frame in enumerate(frames, start=1):
        for bone, keypoint in (
            ("LeftHand", "l_hand"),
            ("RightFoot", "r_ankle"),
            ("Head", "head"),
            ("LeftToes", "l_toe"),
        ):
            joint, place = marks[keypoint].joints[0], frame.skeleton.names.index(bone)
            assert np.allclose(frame.positions[place], motion.positions[t, joint], atol=1e-4)
            assert motion.rotations is not None and frame.rotations is not None
            cosine = abs(frame.rotations[place] @ motion.rotations[t, joint])
            assert cosine == pytest.approx(1, abs=1e-6)


def test_a_bone_s_pose_is_in_its_carrier_and_that_of_the_hips_in_the_root() -> None:
    # Standing at (1, 0, 2) m of Unity, turned by a quarter about up: what is ahead of the root is then to its right.
    bones, quarter = mean_offsets(BONES), [0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]
    said = [message("/VMC/Ext/Root/Pos", "root", 1.0, 0.0, 2.0, *quarter)]
    said += [message("/VMC/Ext/Bone/Pos", bone, *unity_place(at), 0.0, 0.0, 0.0, 1.0) for bone, at in bones.items()]
    decoder = VmcDecoder(FaultCounter())
    frames = [frame for t in range(4) for packet in said for frame in fed(decoder, packet, t / 60)]
    frame = frames[-1]
    hips, toes = (frame.positions[frame.skeleton.names.index(bone)] for bone in ("Hips", "LeftToes"))
    x, _, z = unity_place(bones["Hips"])
    assert hips == pytest.approx([2 - x, -(1 + z), bones["Hips"][2]], abs=1e-6)
    ahead = toes - frame.positions[frame.skeleton.names.index("LeftFoot")]
    assert ahead[1] < -0.1 and abs(ahead[0]) < 0.05


def test_bones_whose_lengths_are_not_sent_are_those_of_the_mean_body() -> None:
    said = [message("/VMC/Ext/Bone/Pos", bone, *[0.0] * 6, 1.0) for bone in BONES]
    decoder = VmcDecoder(FaultCounter())
    frames = [frame for t in range(4) for packet in said for frame in fed(decoder, packet, t / 60)]
    at = dict(zip(frames[-1].skeleton.names, frames[-1].positions, strict=True))
    assert 0.7 < np.linalg.norm(at["LeftUpperLeg"] - at["LeftFoot"]) < 0.9
    assert 0.4 < np.linalg.norm(at["LeftUpperArm"] - at["LeftHand"]) < 0.6
    assert at["LeftHand"][1] > at["RightHand"][1] + 1 and at["Head"][2] > at["Hips"][2] + 0.4


def test_a_frame_in_one_packet_and_in_many_is_the_same() -> None:
    motion = clip()
    at_once = sent(VmcDecoder(FaultCounter()), motion, "vmc")
    bones = humanoid(motion)
    decoder, found = VmcDecoder(FaultCounter()), []
    for t in range(10):
        said = [message("/VMC/Ext/Root/Pos", "root", *[0.0] * 6, 1.0)]
        said += [
            message("/VMC/Ext/Bone/Pos", name, *unity_place(bones.places[t, k]), *unity_turn(bones.turns[t, k]))
            for k, name in enumerate(bones.names)
        ]
        for packet in (*said, message("/VMC/Ext/T", t / 60)):
            found += fed(decoder, packet, 100 + t / 60)
    assert len(found) == len(at_once)
    assert all(np.allclose(a.positions, b.positions, atol=1e-6) for a, b in zip(found, at_once, strict=True))


def test_who_comes_in_the_middle_of_a_frame_does_not_mix_two() -> None:
    motion, faults = clip("walk"), FaultCounter()
    packets, decoder, found = PROTOCOLS["vmc"](motion), VmcDecoder(faults), []
    for t in range(10):
        for packet in packets(t, t / 60)[(t == 0) :]:  # the first packet of the first frame was missed
            found += fed(decoder, packet, 100 + t / 60)
    whole = sent(VmcDecoder(FaultCounter()), motion, "vmc")
    assert len(found) >= 7
    assert all(np.allclose(a.positions, b.positions) for a, b in zip(found[::-1], whole[::-1], strict=False))


def test_every_bone_of_unity_is_known_and_those_a_vrm_must_have_are_asked_for() -> None:
    assert len(BONES) + len(PASSED_OVER) >= 55 and not PASSED_OVER & set(BONES)
    assert {"Hips", "Spine", "Head", "LeftHand", "RightFoot"} <= set(BONES) - OPTIONAL


def test_a_motion_without_rotations_is_no_vmc_and_that_is_said() -> None:
    motion = clip()
    with pytest.raises(UsageError, match="positions only"):
        sending(Motion(motion.skeleton, motion.positions, None, motion.fps), "vmc://127.0.0.1")


@pytest.mark.parametrize("target", ["ftp://x:1", "vmc:", "json://127.0.0.1", "vmc://h:99999", "nowhere"])
def test_a_target_that_is_none_is_named(target: str) -> None:
    with pytest.raises(UsageError, match=r"target|port"):
        sending(clip(), target)


def test_lines_may_come_in_pieces_and_a_skeleton_without_offsets() -> None:
    motion, decoder = clip(), LineDecoder(FaultCounter())
    names, parents = list(motion.skeleton.names), motion.skeleton.parents.tolist()
    text = b"".join(
        json.dumps(
            {"skeleton": {"names": names, "parents": parents}, "positions": motion.positions[t].tolist()}
        ).encode()
        + b"\n"
        for t in range(3)
    )
    found = [frame for k in range(0, len(text), 1000) for frame in fed(decoder, text[k : k + 1000], 10 + k / 1e5)]
    assert len(found) == 3 and len({id(frame.skeleton) for frame in found}) == 1
    assert np.allclose(
        found[0].skeleton.rest()[1:] - found[0].skeleton.rest()[0], motion.positions[0, 1:] - motion.positions[0, 0]
    )


@given(st.integers(0, 2**32 - 1))
def test_a_pose_in_plain_numbers_is_that_of_whole_clips(seed: int) -> None:
    rng = np.random.default_rng(seed)
    parents = np.array([-1, *(int(rng.integers(0, k)) for k in range(1, 12))])
    places, turns = rng.normal(size=(12, 3)), Rotation.random(12, rng).as_quat(scalar_first=True)
    positions, rotations = forward(parents, places[None], turns[None])
    once = forward_once(parents.tolist(), list(map(tuple, places.tolist())), list(map(tuple, turns.tolist())))
    assert np.allclose(once[0], positions[0], atol=1e-9)
    assert np.allclose(np.abs((np.array(once[1]) * rotations[0]).sum(axis=1)), 1)
