"""A robot in the air over a chair that is not there is held; one that stands, squats or bows is not."""

import numpy as np
import pytest
from made_trajectories import hold

import robot_retarget as rr
from robot_retarget.scores.score import score

OP3 = rr.load_robot("op3")


def posed(**degrees: float) -> rr.Trajectory:
    """The OP3 at rest with some hinges of both sides turned, its lowest sole on the floor."""
    qpos = OP3.standing().copy()
    for name, angle in degrees.items():
        for k, joint in enumerate(OP3.joint_names):
            if joint.endswith(name):
                sign = -1 if joint.startswith("r_") else 1
                qpos[OP3.qpos_index[k]] += sign * np.radians(angle)
    still = hold(OP3, 1.0, qpos=qpos)
    floor = score(still, OP3).figures["float_med_cm"]
    lowered = qpos.copy()
    lowered[2] -= float(floor or 0.0) / 100
    return hold(OP3, 1.0, qpos=lowered)


@pytest.mark.parametrize(
    ("angles", "held"),
    [({}, 0), ({"hip_pitch": 60.0, "knee": -120.0}, 0), ({"hip_pitch": 95.0, "knee": -95.0}, 100)],
)
def test_a_seat_that_is_not_there_is_seen(angles: dict[str, float], held: float) -> None:
    found = score(posed(**angles), OP3).figures
    assert found["held_pct"] == held


def test_a_still_does_not_move_and_has_its_length() -> None:
    found = score(hold(OP3, 2.0), OP3).figures
    assert found["moves_deg"] == 0 and found["duration_s"] == pytest.approx(2.0)
