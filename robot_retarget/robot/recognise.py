"""Find a humanoid in a model: the body and the point of each keypoint, without a manual file.

Evidence comes from the tree (mirrored pairs of chains), from geometry (flexion axes, intersections of axes, contacts
with the floor) and from names, in this order; each keypoint has a confidence and its evidence.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats, frozen
from robot_retarget.base.errors import MatchError
from robot_retarget.base.keypoints import ARM
from robot_retarget.robot.anatomy import (
    GUESSED,
    LIKELY,
    SURE,
    UNSURE,
    Anatomy,
    KeypointSite,
    symmetric_places,
    symmetric_soles,
)
from robot_retarget.robot.facing import Facing, facing, hand_axes
from robot_retarget.robot.limbs import (
    ARM_WORDS,
    ONE_PLACE,
    MirroredLimbs,
    arm_centres,
    box_middle,
    foot_links,
    grasps,
    leg_centres,
    mirrored_pairs,
    toe_centre,
    words,
)
from robot_retarget.robot.links import Links
from robot_retarget.robot.model import Robot
from robot_retarget.robot.soles import flat_footed, sole, tread

HEAD_WORDS = {"head", "skull", "face"}
TRUNK_WORDS = {"torso", "chest", "trunk", "thorax"}
NECK_PLACE = 0.3
"""Position of a neck without usable hinges, as a share of the way from the shoulders to the head; a trunk of one piece
ends in a head if it exceeds the shoulders by this share of their height over the pelvis [-]. In the skeletons of 30
clips it is 0.34 to 0.45 (quartiles); half and double move the necks of three of eight robots by 2 to 7 cm."""
CHEST = 0.15
"""Place of the chest, as a share of the way from the shoulders to the pelvis [-]. In the skeletons of 30 clips it is
0.17 to 0.37 (quartiles); half and double move the chests of the OP3 by 1 and 2 cm."""
ASIDE = 0.2
"""A head is less aside than this share of its height over the pelvis [-]: 0.5 are an arm of the Kuavo S30, 0.00 the heads of eight robots."""
BARE = "the feet have no shapes in the file: each sole is the point of its ankle, and no foot has a toe"
KEPT = 4
"""Number of cached anatomies: recognition takes half a second and several stages need it."""


def recognise(robot: Robot, forward: Floats | None = None) -> Anatomy:
    """Find pelvis, trunk, head, arms and legs of a robot, and its soles.

    Args:
        forward: (3,) the robot's heading in its reference pose, if known; by default `facing` determines it.

    Raises:
        MatchError: the model is no humanoid; the message says why.
    """
    whole = robot.whole or robot
    return _recognised(whole) if forward is None else _anatomy(whole, forward)


@lru_cache(maxsize=KEPT)
def _recognised(robot: Robot) -> Anatomy:
    return _anatomy(robot, None)


def _anatomy(robot: Robot, forward: Floats | None) -> Anatomy:
    links = Links(robot)
    pairs = mirrored_pairs(links)
    legs = _legs(links, pairs)
    arms = _arms(links, pairs, legs)
    _refuse_quadruped(robot, links, pairs, arms)
    if legs is None and arms is None:
        raise MatchError(
            f"{robot.name} is no humanoid: no two chains of hinges mirror each other as arms or legs "
            f"({len(robot.joint_names)} hinges, {len(links.leaves)} ends)"
        )
    if legs is None and arms is not None:
        _refuse_arms_on_a_table(robot, arms)
    flat = flat_footed(links, foot_links(links, legs) if legs else [])
    sides = facing(links, flat, legs, arms, forward)
    limbs = _limbs(links, sides, legs, arms)
    found = assemble((links, flat), limbs | _trunk(links, legs, arms, limbs), sides)
    return found if arms else replace(found, notes=(*found.notes, *_lone_arms(links, legs)))


def _lone_arms(links: Links, legs: MirroredLimbs | None) -> list[str]:
    """Name the chains that are called arms on a robot without two that mirror each other."""
    taken = legs.links if legs else set[int]()
    ends = [leaf for leaf in links.leaves if leaf not in taken and words(links.words(leaf)) & ARM_WORDS]
    names = [links.model.body(leaf).name for leaf in ends if len(links.axes_along(links.path(leaf))) > 1]
    return [f"arms come in mirrored pairs: the chain that ends at {names[0]} is left out"] if names else []


def _legs(links: Links, pairs: list[MirroredLimbs]) -> MirroredLimbs | None:
    """Return the lowest pair with three hinges or more per chain, among the legs by name or by the trunk.

    Of chains that end at one height, as a leg and the rods of a parallel one, it has the most hinges that move by themselves.
    """
    limbs = {link for pair in pairs for link in pair.links}
    trunk = np.concatenate([links.surface(x)[:, 2] for x in links.ids if x not in limbs])
    long = [p for p in pairs if min(len(c.axes) for c in p.chains) >= 3 and p.lowest < p.height]
    candidates = [p for p in long if (p.called(links) or _hang(p, trunk)) < 0]
    if not candidates:
        return None
    lowest = min(p.lowest for p in candidates)
    reach = max(c.reach for p in candidates for c in p.chains)
    model, joined = links.model, mujoco.mjtEq.mjEQ_JOINT
    led = {int(model.eq_obj1id[k]) for k in range(model.neq) if model.eq_type[k] == joined}

    def moves(pair: MirroredLimbs) -> tuple[int, float]:
        chain = pair.chains[0]
        return min(6, sum(axis.joint not in led for axis in chain.axes)), chain.reach

    return max((p for p in candidates if p.lowest < lowest + ONE_PLACE * reach), key=moves)


def _hang(pair: MirroredLimbs, trunk: Floats) -> int:
    """Return −1 for legs, which start on the lower half of the trunk, heights (P,) [m], or end far below it; +1 for arms."""
    low = pair.height < trunk.min() + np.ptp(trunk) / 2
    return -1 if low or pair.lowest < trunk.min() - pair.chains[0].reach / 2 else 1


def _arms(links: Links, pairs: list[MirroredLimbs], legs: MirroredLimbs | None) -> MirroredLimbs | None:
    """Return the pair of the longest chains that start above the legs."""
    taken = legs.links if legs else set[int]()
    free = [p for p in pairs if p.called(links) >= 0 and not taken & p.links]
    if legs:
        free = [p for p in free if p.height > legs.height]
    return max(free, key=lambda p: (round(p.chains[0].reach, 3), len(p.chains[0].axes)), default=None)


def _refuse_quadruped(robot: Robot, links: Links, pairs: list[MirroredLimbs], arms: MirroredLimbs | None) -> None:
    standing = [p for p in pairs if len(p.chains[0].axes) >= 3 and p.called(links) <= 0]
    lowest = min(standing, key=lambda p: p.lowest, default=None)
    if lowest is None:
        return
    reach = max(c.reach for c in lowest.chains)
    others = [p for p in pairs if p is not lowest and not p.links & lowest.links]
    walking = [
        p
        for p in others
        if abs(p.lowest - lowest.lowest) < ONE_PLACE * reach and abs(p.height - lowest.height) < ONE_PLACE * reach
    ]
    if walking and (arms is None or arms in (lowest, *walking)):
        names = [links.model.body(p.chains[0].links[-1]).name for p in (lowest, walking[0])]
        raise MatchError(
            f"{robot.name} is no humanoid: four limbs of equal height reach the ground (ending at {' and '.join(names)})"
        )


def _refuse_arms_on_a_table(robot: Robot, arms: MirroredLimbs) -> None:
    """Refuse two arms on the world that are too far apart for a trunk between them."""
    apart = float(np.linalg.norm(arms.chains[0].start - arms.chains[1].start))
    if arms.carrier == 0 and apart > max(chain.reach for chain in arms.chains):
        raise MatchError(
            f"{robot.name} is no humanoid: two arms are bolted to the world {apart:.2f} m apart, with no trunk between them"
        )


def assemble(poses: tuple[Links, Links], sites: dict[str, KeypointSite], sides: Facing) -> Anatomy:
    """Complete the found keypoints to an anatomy: toes, soles, and the frame of each segment.

    Args:
        poses: the links in the reference pose, and with level soles.
        sites: the keypoints; each ankle without a toe gets one, if its foot has a shape.
    """
    links, standing = poses
    feet = {s: sites[f"{s}_ankle"].body for s in "lr" if f"{s}_ankle" in sites}
    ankles = {side: _world(standing, sites[f"{side}_ankle"]) for side in feet}
    surfaces = symmetric_soles({s: standing.surface(foot, seen=True) for s, foot in feet.items()}, ankles, sides.left)
    shaped = {side: foot for side, foot in feet.items() if np.ptp(surfaces[side], axis=0).any()}
    for side, foot in shaped.items():
        toe = toe_centre(standing, foot, surfaces[side], ankles[side], sides.forward)
        sites = {f"{side}_toe": _site(standing, toe.link, toe.point, toe.confidence, toe.evidence)} | sites
    sites = {k: _doubted(links, k, site) for k, site in _symmetrized(links, sites, sides.left).items()}
    soles = {side: sole(standing, foot, surfaces[side]) for side, foot in feet.items()}
    notes = [*sides.notes, *links.robot.notes, *_partial(sites), *([BARE] if shaped != feet else [])]
    treads = {side: tread(standing, foot) for side, foot in feet.items()}
    return Anatomy(sites, _frames(links, standing, sites, sides), soles, treads, frozen(sides.forward), tuple(notes))


def _symmetrized(links: Links, sites: dict[str, KeypointSite], left: Floats) -> dict[str, KeypointSite]:
    """Return the sites at their symmetric places on both sides of the robot."""
    places = symmetric_places({k: _world(links, site) for k, site in sites.items()}, left)
    return {k: replace(site, offset=links.local(site.body, places[k])) for k, site in sites.items()}


def _doubted(links: Links, keypoint: str, site: KeypointSite) -> KeypointSite:
    """Return the site with a confidence of at most `UNSURE` on a finger or gripper; hands may be there."""
    if keypoint.endswith("hand") or not grasps(links, int(links.weld[site.body])):
        return site
    return replace(site, confidence=min(site.confidence, UNSURE), evidence=f"{site.evidence}, on a finger or gripper")


def _limbs(
    links: Links, sides: Facing, legs: MirroredLimbs | None, arms: MirroredLimbs | None
) -> dict[str, KeypointSite]:
    found: dict[str, KeypointSite] = {}
    for side, chain in (sides.of(legs) if legs else {}).items():
        centres = leg_centres(links, chain, sides.left)
        found |= {f"{side}_{k}": _site(links, c.link, c.point, c.confidence, c.evidence) for k, c in centres.items()}
    for side, chain in (sides.of(arms) if arms else {}).items():
        centres = arm_centres(links, chain)
        found |= {f"{side}_{k}": _site(links, c.link, c.point, c.confidence, c.evidence) for k, c in centres.items()}
    return found


def _partial(sites: dict[str, KeypointSite]) -> list[str]:
    heads = {"legs": "l_hip", "arms": "l_shoulder", "head": "head"}
    absent = [part for part, keypoint in heads.items() if keypoint not in sites]
    return [f"partial humanoid: no {' and no '.join(absent)}"] if absent else []


def _world(links: Links, site: KeypointSite) -> Floats:
    return links.place(site.body, site.offset)


def _site(links: Links, link: int, point: Floats, confidence: float, evidence: str) -> KeypointSite:
    return KeypointSite(link, links.local(link, point), confidence, evidence)


def _trunk(
    links: Links, legs: MirroredLimbs | None, arms: MirroredLimbs | None, limbs: dict[str, KeypointSite]
) -> dict[str, KeypointSite]:
    """Return the pelvis between the hips, the chest slightly below the shoulders, and neck and head above."""
    lower = legs.carrier if legs else links.root
    used = {link for pair in (legs, arms) if pair for limb in pair.limbs for link in links.links_of(limb)}
    upper = arms.carrier if arms else _armless_trunk(links, used)
    trunk = links.surface(upper)
    if "l_hip" in limbs and "r_hip" in limbs:
        pelvis = (_world(links, limbs["l_hip"]) + _world(links, limbs["r_hip"])) / 2
        sites = {"pelvis": _site(links, lower, pelvis, SURE, "middle of the hips")}
    else:
        pelvis = np.array([*((trunk.min(0) + trunk.max(0)) / 2)[:2], trunk[:, 2].min()])
        sites = {"pelvis": _site(links, lower, pelvis, GUESSED, "bottom of the trunk, no legs")}
    if "l_shoulder" in limbs and "r_shoulder" in limbs:
        shoulders = (_world(links, limbs["l_shoulder"]) + _world(links, limbs["r_shoulder"])) / 2
        chest = shoulders + CHEST * (pelvis - shoulders)
        sites["chest"] = _site(links, upper, chest, SURE, "a little under the middle of the shoulders")
    else:
        shoulders = np.array([*pelvis[:2], trunk[:, 2].max()])
        sites["chest"] = _site(links, upper, shoulders, GUESSED, "top of the trunk, no arms")
    return sites | _head(links, upper, used, (shoulders, pelvis), limbs)


def _armless_trunk(links: Links, used: set[int]) -> int:
    """Return the last link on the way up with a trunk name, else the root."""
    named = [x for x in links.ids if x not in used and words(links.words(x)) & TRUNK_WORDS]
    return max(named, key=lambda x: len(links.path(x)), default=links.root)


@dataclass(frozen=True, eq=False)
class _Top:
    """A head candidate: points (N, 3) of a link, the evidence, and the joint to the trunk, if any."""

    link: int
    cloud: Floats
    evidence: str
    confidence: float
    base: Floats | None = None


def _head(
    links: Links, trunk: int, used: set[int], middles: tuple[Floats, Floats], limbs: dict[str, KeypointSite]
) -> dict[str, KeypointSite]:
    """Return the head by name, else the topmost link above the shoulders, else the top of the trunk.

    Args:
        middles: (3,) of the shoulders, and the pelvis.
    """
    shoulders, pelvis = middles
    height = float(shoulders[2] - pelvis[2])
    below = links.path(trunk)
    free = [x for x in links.ids if x not in used and x not in below and links.surface(x)[:, 2].max() > shoulders[2]]
    free = [x for x in free if not grasps(links, x) and _in_the_middle(links, x, limbs, pelvis)]
    top = _topmost(links, trunk, free, shoulders) if free else _trunk_top(links, trunk, shoulders, height)
    if top is None or not (free or "l_shoulder" in limbs):
        return {}
    head = box_middle(top.cloud)
    neck = top.base if top.base is not None else shoulders + NECK_PLACE * (head - shoulders)
    where = trunk if top.base is None else links.parent(top.link) if links.axes[top.link] else top.link
    return {
        "neck": _site(links, where if where in links.ids else trunk, neck, LIKELY, "base of the head"),
        "head": _site(links, top.link, head, top.confidence, top.evidence),
    }


def _in_the_middle(links: Links, link: int, limbs: dict[str, KeypointSite], pelvis: Floats) -> bool:
    """Whether a link is over the middle between the limbs: its way aside is less than `ASIDE` of its height over the pelvis."""
    pair = next(([f"l_{k}", f"r_{k}"] for k in ("hip", "shoulder") if f"l_{k}" in limbs and f"r_{k}" in limbs), [])
    if not pair:
        return True
    lateral = _world(links, limbs[pair[0]]) - _world(links, limbs[pair[1]])
    offset = box_middle(links.surface(link)) - pelvis
    return abs(offset @ lateral) < ASIDE * np.linalg.norm(lateral) * abs(offset[2])


def _topmost(links: Links, trunk: int, free: list[int], shoulders: Floats) -> _Top:
    """Return the highest link with a head name, else the highest of all."""
    named = [x for x in free if words(links.words(x)) & HEAD_WORDS]
    link = max(named or free, key=lambda x: links.surface(x)[:, 2].max())
    cloud = links.surface(link)
    axes = links.axes_along([x for x in links.path(link) if x not in links.path(trunk)])
    between = shoulders + NECK_PLACE * (box_middle(cloud) - shoulders)
    base = axes[-1].nearest(axes[0].anchor if len(axes) > 1 else between) if axes else between
    return _Top(link, cloud, *(("by name", SURE) if named else ("topmost link", LIKELY)), base)


def _trunk_top(links: Links, trunk: int, shoulders: Floats, height: float) -> _Top | None:
    """Return the highest geom of the trunk above the shoulders, or the upper half of a single geom above them."""
    geoms = [int(g) for b in links.bodies(trunk) for g in np.flatnonzero(links.model.geom_bodyid == b)]
    above = [p for p in map(links.geom_points, geoms) if box_middle(p)[2] > shoulders[2]]
    if above:
        return _Top(trunk, max(above, key=lambda p: p[:, 2].max()), "topmost geom of the trunk, no neck joint", LIKELY)
    surface = links.surface(trunk)
    top = float(surface[:, 2].max() - shoulders[2])
    if top < NECK_PLACE * height:
        return None
    upper = surface[surface[:, 2] > shoulders[2] + top / 2]
    return _Top(trunk, upper, "what of the trunk stands over the shoulders, no neck joint", GUESSED)


def _frames(
    links: Links, standing: Links, sites: dict[str, KeypointSite], sides: Facing
) -> dict[str, tuple[int, Floats]]:
    """Return each segment's body with its forward, left and up; a head fixed to the chest has none.

    Feet have their frames from the flat stance, other segments from the reference pose.
    """
    world = np.stack([sides.forward, sides.left, [0.0, 0.0, 1.0]], axis=1)
    segments = {"pelvis": "pelvis", "chest": "chest", "head": "head"}
    segments |= {f"{s}_foot": f"{s}_ankle" for s in "lr"}
    frames = {}
    for segment, keypoint in segments.items():
        if keypoint in sites:
            body, pose = sites[keypoint].body, standing if segment.endswith("foot") else links
            frames[segment] = body, frozen(pose.data.xmat[body].reshape(3, 3).T @ world)
    if "head" in frames and frames["head"][0] == frames["chest"][0]:
        del frames["head"]
    return frames | _hands(links, sites)


def _hands(links: Links, sites: dict[str, KeypointSite]) -> dict[str, tuple[int, Floats]]:
    """Return the frames of hands with three-axis rotation, as continuations of their forearms."""
    arms = {s: [sites[f"{s}_{k}"] for k in ARM] for s in "lr" if f"{s}_elbow" in sites}
    robot = links.robot
    pose = robot.neutral()
    for elbow in {arm[1].body for arm in arms.values()}:
        hinges = np.isin(robot.joint_ids, [axis.joint for axis in links.axes[elbow]])
        pose[robot.qpos_index[hinges]] = ((robot.lower + robot.upper) / 2)[hinges]
    bent, frames = Links(robot, pose), {}
    for side, arm in arms.items():
        axes = hand_axes(bent, (arm[1].body, arm[2].body), np.array([_world(bent, site) for site in arm]))
        if axes is not None:
            frames[f"{side}_hand"] = arm[2].body, frozen(axes)
    return frames
