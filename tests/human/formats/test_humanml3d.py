"""The 263 features of HumanML3D: joints where the motion was that they were made of."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_retarget.base.errors import MotionError
from robot_retarget.human.capture import Request
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers import datasets


def yaw(angle: float) -> np.ndarray:
    """About y, by `angle`."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def made(seed: int, frames: int = 15) -> tuple[np.ndarray, np.ndarray]:
    """A motion (T, 22, 3) that starts at the origin with heading 0, and its features (T, 263)."""
    rng = np.random.default_rng(seed)
    heading = np.concatenate([[0.0], np.cumsum(rng.normal(0, 0.2, frames - 1))])
    root = np.cumsum(rng.normal(0, 0.05, (frames, 3)), axis=0)
    root[:, 1] = 0.9 + 0.1 * np.sin(root[:, 1])
    root[:, [0, 2]] -= root[0, [0, 2]]
    about = rng.normal(0, 0.4, (frames, 21, 3))
    positions = np.zeros((frames, 22, 3))
    features = np.zeros((frames, 263))
    for t in range(frames):
        # The heading is that by which the motion has to be turned back to face ahead.
        turn = yaw(-heading[t])
        positions[t, 0] = root[t]
        positions[t, 1:] = about[t] @ turn.T + [root[t, 0], 0, root[t, 2]]
        features[t, 3] = root[t, 1]
        features[t, 4:67] = about[t].ravel()
        if t + 1 < frames:
            features[t, 0] = (heading[t + 1] - heading[t]) / 2
            features[t, 1:3] = (yaw(-heading[t + 1]).T @ (root[t + 1] - root[t]))[[0, 2]]
    features[:, 67:193] = np.tile([1.0, 0, 0, 0, 1.0, 0], (frames, 21))
    features[:, 259:263] = rng.integers(0, 2, (frames, 4))
    return positions, features


@given(st.integers(0, 2**31))
def test_features_give_back_the_joints_they_were_made_of(seed):
    positions, features = made(seed)
    assert datasets.humanml3d_positions(features) == pytest.approx(positions, abs=1e-9)


def test_contacts_are_taken_and_the_rate_is_the_data_sets(tmp_path):
    _, features = made(3)
    np.save(tmp_path / "clip.npy", features)
    capture = datasets.read_humanml3d(tmp_path / "clip.npy", Request())
    assert capture.fps == 20 and capture.contacts is not None
    assert capture.contacts.astype(float) == pytest.approx(features[:, 259:])
    assert read_motion(tmp_path / "clip.npy").contacts is not None


def test_normalised_features_and_numbers_that_are_none_are_refused(tmp_path):
    _, features = made(4)
    np.save(tmp_path / "clip.npy", (features - features.mean(0)) / (features.std(0) + 0.1))
    with pytest.raises(MotionError, match=r"normalised: multiply by the data set's Std\.npy and add its Mean\.npy"):
        read_motion(tmp_path / "clip.npy")
    features[2, 70] = np.nan
    np.save(tmp_path / "clip.npy", features)
    with pytest.raises(MotionError, match="frame 2, column 70 is not finite"):
        read_motion(tmp_path / "clip.npy")
