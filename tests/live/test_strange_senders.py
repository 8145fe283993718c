"""What a sender gets wrong is refused as a fault, and its last line counts."""

import os
from types import SimpleNamespace

import numpy as np
import pytest

from robot_retarget.human.skeleton import Skeleton
from robot_retarget.live.frame import Fault, FaultCounter, RefusedError, SenderClock
from robot_retarget.live.headsets import HeadsetSource, TrackedBody
from robot_retarget.live.messages import LineDecoder, line_of, skeleton_line
from robot_retarget.live.receiver import Receiver, StdinPort

BODY = Skeleton(("a", "b"), np.array([-1, 0]), np.array([[0.0, 0, 0], [0, 0, 1.0]]))


def test_the_last_line_counts_without_the_end_of_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    read_end, write_end = os.pipe()
    with os.fdopen(write_end, "wb") as out:
        out.write(skeleton_line(BODY) + line_of(1.0, BODY.rest()).rstrip(b"\n"))
    with os.fdopen(read_end, "rb") as standard_input:
        monkeypatch.setattr("sys.stdin", standard_input)
        faults = FaultCounter()
        source = Receiver(StdinPort(), LineDecoder(faults), faults)
        frames = [source.newest(0.1) for _ in range(3) if not source.ended]
    found = [frame for frame in frames if frame is not None]
    assert len(found) == 1 and not faults.counts
    np.testing.assert_allclose(found[0].positions, BODY.rest())


@pytest.mark.parametrize(
    ("poses", "tracked"),
    [((24, 6), (24,)), ((23, 7), (24,)), ((24, 7), (23,)), ((0,), (0,)), ((24, 7, 1), (24,)), ((24,), (24,))],
)
def test_a_headset_body_of_another_shape_is_a_fault(poses: tuple[int, ...], tracked: tuple[int, ...]) -> None:
    body = TrackedBody(np.zeros(poses), np.ones(tracked, dtype=bool), None)
    faults = FaultCounter()
    source = HeadsetSource(SimpleNamespace(ask=lambda: body, close=lambda: None), faults)  # type: ignore[arg-type]
    assert source.newest(0.0) is None
    assert faults.counts == {str(Fault.MALFORMED): 1}


@pytest.mark.parametrize("stamp", [np.nan, np.inf, -np.inf])
def test_a_stamp_that_is_no_number_becomes_no_time(stamp: float) -> None:
    clock = SenderClock(FaultCounter())
    first = clock.time(1.0, 10.0)
    with pytest.raises(RefusedError, match="not finite"):
        clock.time(stamp, 10.1)
    assert clock.time(1.1, 10.1) == pytest.approx(first + 0.1)
