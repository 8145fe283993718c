"""Headsets: the frames of the SDKs' own types, held where a joint is not tracked; a headset that is away gives none."""

import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from headset_sessions import isaac_session, performer, poses_of, record, their_schema

from robot_retarget.base.errors import UsageError
from robot_retarget.human.motion import Motion
from robot_retarget.live.frame import Fault, FaultCounter
from robot_retarget.live.headsets import HeadsetSource, IsaacHeadset, XrtHeadset
from robot_retarget.live.sources import opened

ELBOW = 18


@pytest.fixture(scope="module")
def walker(tmp_path_factory: pytest.TempPathFactory) -> Motion:
    return performer(tmp_path_factory.mktemp("walker"), 0.5)


def test_poses_of_xrobotoolkit_are_the_performers(walker: Motion, monkeypatch: pytest.MonkeyPatch) -> None:
    """Values in the types of xrobotoolkit-sdk 1.1.0: a list of 24 lists of seven floats, and a stamp in nanoseconds."""
    rows, at = poses_of(walker).tolist(), [0]
    rows[10][ELBOW] = [0.0] * 7
    sdk = SimpleNamespace(
        init=lambda: None,
        close=lambda: None,
        is_body_data_available=lambda: at[0] > 0,
        get_body_timestamp_ns=lambda: at[0] * 16_000_000,
        get_body_joints_pose=lambda: rows[at[0] - 1],
    )
    monkeypatch.setitem(sys.modules, "xrobotoolkit_sdk", sdk)
    source = opened("xrt")
    assert source.newest(0.0) is None, "no headset yet"
    frames = []
    for at[0] in range(1, 21):
        frames.append(source.newest(0.1))
        assert source.newest(0.0) is None, "the same body is no new frame"
    times = [frame.time for frame in frames if frame is not None]
    assert len(times) == 20 and (np.diff(times) > 0).all()
    for frame, expected in zip(frames, walker.positions, strict=False):
        assert frame is not None
        off = np.abs(frame.positions - expected).max(axis=1)
        assert np.delete(off, ELBOW).max() < 1e-9 and off[ELBOW] < 0.03


def test_the_sdk_itself_without_a_headset_gives_no_frame() -> None:
    pytest.importorskip("xrobotoolkit_sdk", reason="xrobotoolkit-sdk is not installed")
    source = HeadsetSource(XrtHeadset(), FaultCounter())
    began = time.monotonic()
    assert source.newest(0.2) is None and time.monotonic() - began > 0.15
    source.close()


def test_a_replayed_session_of_isaac_teleop_gives_its_frames_with_lost_joints_held(
    walker: Motion, tmp_path: Path
) -> None:
    deviceio = pytest.importorskip("isaacteleop.deviceio", reason="isaacteleop is not installed")
    records = [record(frame, np.arange(24) != ELBOW) for frame in poses_of(walker)[:20]]
    path = isaac_session(tmp_path / "a.mcap", records, schema=their_schema())
    tracker, faults = deviceio.FullBodyTracker(), FaultCounter()
    with deviceio.ReplaySession.run(deviceio.McapReplayConfig(str(path), [(tracker, "full_body")])) as session:
        source = HeadsetSource(IsaacHeadset(session, tracker), faults)
        for expected in walker.positions[:20]:
            frame = source.newest(0.1)
            assert frame is not None
            off = np.abs(frame.positions - expected).max(axis=1)
            assert np.delete(off, ELBOW).max() < 1e-5 and off[ELBOW] < 0.03
        assert source.newest(0.05) is None
    assert faults.counts[str(Fault.INCOMPLETE)] == 20


def test_an_absent_sdk_is_named_with_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xrobotoolkit_sdk", None)
    with pytest.raises(UsageError, match="pip install xrobotoolkit-sdk"):
        opened("xrt")
    with pytest.raises(UsageError, match="--port applies to received frames; xrt is a headset"):
        opened("xrt", port=1)
