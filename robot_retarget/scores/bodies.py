"""Touches of the bodies around a robot, by MuJoCo's distances d of its links from them, as the public comparison of retargeters has them.

    touch: a link is −1.1 mm ≤ d ≤ 2 cm from a body; inside: a link is deeper than 1.1 mm
    kept: frames × contacts of the human with a body in which the same part of the robot touches the same body

A contact of the human is a touch of a hand, elbow, knee, toe or the pelvis, or a foot that stands on a body. A distance within 2 cm
alone says nothing: a hand 12 cm inside a box has it as well. Units: % of frames, mm. Range: 0 to 100 %; 0 and more.
"""

from collections.abc import Sequence

import numpy as np

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.graph.kinds.bodies import links_of
from robot_retarget.human.features import HumanFeatures
from robot_retarget.scores.figure import Figure, Value, measures
from robot_retarget.scores.subject import Subject

TOUCH = (-0.0011, 0.02)
"""Bounds of a touch [m]."""


@measures(
    Figure("body_touch_pct", "%", 1, "frames in which a link touches a body without sinking in", "higher", 100),
    Figure("body_touch_hands_pct", "%", 1, "the same of the hands", "higher", 100),
    Figure("body_touch_feet_pct", "%", 1, "the same of the feet", "higher", 100),
    Figure("body_inside_pct", "%", 1, "frames in which a link is over 1.1 mm inside a body", most=100),
    Figure("body_depth_mm", "mm", 1, "deepest that a link is inside a body"),
    scene=True,
)
def touches(subject: Subject) -> tuple[Value, ...]:
    """Return the shares of frames with touches and with links inside, and the largest depth."""
    distance = subject.body_distances
    shares = [
        _share(distance[..., own]) for own in (slice(None), *(_columns(subject, end) for end in ("hand", "foot")))
    ]
    inside = 100.0 * (distance < TOUCH[0]).any(axis=(1, 2)).mean()
    return *shares, inside, 1e3 * max(-float(distance.min()), 0.0)


@measures(
    Figure("body_contacts_kept_pct", "%", 1, "contacts of the human with bodies that the robot keeps", "higher", 100),
    scene=True,
    human=True,
)
def kept(subject: Subject) -> tuple[Value]:
    """Return the share of frames × contacts that are kept; None without a contact."""
    found = contacts_of(subject)
    made, held = (sum(int(each[k].sum()) for each in found.values()) for k in range(2))
    return (100.0 * held / made if made else None,)


def notes_of(subject: Subject) -> list[str]:
    """Return a note about every body that the human touches: in how many frames of contact the robot touches it, by part."""
    by_body: dict[str, list[str]] = {}
    for (part, body), (touching, held) in contacts_of(subject).items():
        name = part.replace("ankle", "foot")
        by_body.setdefault(body, []).append(f"{name} {int(held.sum())} of {int(touching.sum())} frames")
    return [f"{body}: contacts kept {', '.join(parts)}" for body, parts in by_body.items()]


def contacts_of(subject: Subject) -> dict[tuple[str, str], tuple[Bools, Bools]]:
    """Return per part and body in contact (T,) whether the human touches, and whether the robot does then too."""
    human, scene = subject.around, subject.trajectory.scene
    if human is None or scene is None or subject.anatomy is None:
        return {}
    found = {}
    for (part, body), touching in _human_contacts(human).items():
        if touching.any():
            links = links_of(part, subject.robot, subject.anatomy)
            near = subject.body_distances[:, body][:, np.isin(subject.body_links, links)].min(axis=1)
            found[part, scene.names[body]] = touching, touching & _touching(near)
    return found


def _human_contacts(human: HumanFeatures) -> dict[tuple[str, int], Bools]:
    """Return per part and body (T,) whether a human touches, or stands."""
    around = human.around
    assert around is not None
    found = {pair: around.touches.held[:, k] for k, pair in enumerate(around.touches.pairs)}
    for foot, stands in human.contacts.items():
        own = [k for k, name in enumerate(around.ground.keypoints) if name[0] == foot]
        part = f"{foot}_ankle"
        for body in range(len(around.scene)):
            on = (around.ground.bodies[:, own] == body).any(axis=1) & stands.any(axis=1)
            found[part, body] = on
    return found


def _columns(subject: Subject, end: str) -> np.ndarray:
    """Return (L,) which links are those of the hands with their fingers, or of the feet."""
    anatomy = subject.anatomy
    if anatomy is None:
        return np.zeros(len(subject.body_links), dtype=bool)
    if end == "foot":
        weld = np.asarray(subject.robot.model.body_weldid)
        return np.isin(subject.body_links, [weld[sole.bodies[0]] for sole in anatomy.soles.values()])
    hands = [anatomy.sites[name].body for name in ("l_hand", "r_hand") if name in anatomy.sites]
    return np.isin(subject.body_links, _carried(subject, hands))


def _carried(subject: Subject, bodies: Sequence[int]) -> list[int]:
    """Return the links of some bodies of the model and of those that they carry."""
    parents = subject.robot.model.body_parentid
    found = set(np.asarray(subject.robot.model.body_weldid)[list(bodies)].tolist())
    for body in range(1, len(parents)):
        if int(parents[body]) in found:
            found.add(body)
    return sorted(found)


def _touching(distance: Floats) -> Bools:
    return (distance >= TOUCH[0]) & (distance <= TOUCH[1])


def _share(distance: Floats) -> Value:
    """Return the share of frames in which the nearest of some links (T, B, L) touches [%]; None without such a link."""
    return 100.0 * float(_touching(distance.min(axis=(1, 2))).mean()) if distance.size else None
