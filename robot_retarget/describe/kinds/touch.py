"""Touch: hands and what they touch, a foot and the other, are as near on the robot, over the path between them."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from robot_retarget.arrays import Floats
from robot_retarget.describe.kinds.kind import Scene
from robot_retarget.describe.kinds.posture import distances
from robot_retarget.describe.measured import Measured
from robot_retarget.describe.track import Track, exact
from robot_retarget.dgp.adapt import path_weights
from robot_retarget.keypoints import ARM


@dataclass(frozen=True)
class Touch:
    """Pairs that may touch; π is 0 while they do not."""

    name: str = "touch"
    head: float = 0.22
    knee: float = 0.14
    hand: float = 0.14
    other: float = 0.1
    """A hand this near to a head, a knee, the other hand or another part touches it, over the path between them [-]."""
    feet: float = 0.045
    """The same for two feet: nearer than they pass each other in a walk [-]."""
    faint: float = 0.02
    """What touches by no more does not touch [-]: a hand that swings past a hip."""
    lead: float = 0.1
    """A touch comes on and goes over so long [s]."""

    def wish(self, scene: Scene) -> Track | None:
        """The normalised distance of the human, while it is that of a touch."""
        match, human = scene.match, scene.human
        pairs = [
            (a, b)
            for a in range(len(match.keypoints))
            for b in range(a)
            if self.reach(match.keypoints[b], match.keypoints[a])
        ]
        if not pairs:
            return None
        i, j = np.array(pairs).T
        names = [(match.keypoints[b], match.keypoints[a]) for a, b in pairs]
        close, reach = human.closeness[:, i, j], np.array([self.reach(*ends) for ends in names])
        touching = np.maximum(np.exp(-((close / reach) ** 8)) - self.faint, 0.0)
        tau = np.maximum(path_weights(match.parents, match.robot_bones)[i, j], 1e-6)
        gently = self._gently(touching, round(self.lead * human.fps))
        return exact(self, names, tau * close, scene.weights.touch * gently, tau)

    def measure(self, track: Track, body: Measured) -> ca.SX:
        """d_uv."""
        return distances(track, body)

    def reach(self, a: str, b: str) -> float:
        """How near two keypoints are when their parts touch, over the path between them; 0 where they cannot [-]."""
        if {a[2:], b[2:]} <= {"ankle", "toe"} and a[0] != b[0]:
            return self.feet
        for hand, part in ((a, b), (b, a)):
            own_arm = part[:2] == hand[:2] and part[2:] in ARM
            if hand.endswith("_hand") and not own_arm:
                return {"head": self.head, "hand": self.hand, "knee": self.knee}.get(part.split("_")[-1], self.other)
        return 0.0

    def _gently(self, touching: Floats, frames: int) -> Floats:
        """(T, C) reached and left gently: the most of the frames around, then their mean."""
        width = 2 * frames + 1
        most = maximum_filter1d(touching, width, axis=0, mode="nearest")
        return np.maximum(uniform_filter1d(most, width, axis=0, mode="nearest"), 0.0)  # a running sum may end at −1e-17
