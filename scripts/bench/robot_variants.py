"""The same robot written in other ways: what must be recognised in each is known from the robot as it is.

Every law takes the specification of a robot and what was recognised in it, and gives variants: an MJCF, where its
keypoints must stand, and which of them it has lost.
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.robot import Anatomy, Robot
from robot_retarget.robot.limbs import HAND_SHARE
from robot_retarget.robot.links import Links

HINGE, FREE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_FREE
SLIDES = (0.02, 0.06, 0.15)
"""By so much anchors are moved along their axes, over the robot's height."""
TURNS = (30, 90, 180, 250)
"""By so much models are turned about z [deg]."""
HEAD, ARMS = {"neck", "head"}, {f"{s}_{k}" for s in "lr" for k in ("shoulder", "elbow", "hand")}
REFERENCES = {
    "body": ("body", "body1", "body2", "objname", "refname", "target", "childbody"),
    "joint": ("joint", "joint1", "joint2", "jointinparent", "objname"),
}
"""Attributes that name a body or a joint."""


@dataclass(frozen=True)
class Case:
    """What a variant is made from."""

    robot: Robot
    anatomy: Anatomy
    rng: np.random.Generator

    def spec(self) -> mujoco.MjSpec:
        """A fresh specification, its assets where they are."""
        spec = mujoco.MjSpec.from_file(str(self.robot.path))
        folder = self.robot.path.parent
        spec.meshdir, spec.texturedir = (str((folder / part).resolve()) for part in (spec.meshdir, spec.texturedir))
        return spec

    @property
    def height(self) -> float:
        """Of the bodies [m]."""
        return float(np.ptp(Links(self.robot).data.xpos[1:, 2]))

    def body(self, spec: mujoco.MjSpec, keypoint: str) -> mujoco.MjsBody:
        """The body that carries a keypoint."""
        return spec.bodies[self.anatomy.sites[keypoint].body]


@dataclass(frozen=True)
class Variant:
    """A robot written in another way."""

    detail: str
    xml: str
    turn: Rotation = field(default_factory=Rotation.identity)
    """About z, of everything."""
    lost: frozenset[str] = frozenset()
    """Keypoints that may be missing or elsewhere."""
    stem: str = "variant"


Law = Callable[[Case], Iterator[Variant]]


def moved_anchors(case: Case) -> Iterator[Variant]:
    """A hinge is a line: its anchor may be anywhere on it."""
    for share in SLIDES:
        spec = case.spec()
        for joint in _hinges(case, spec):
            joint.pos = joint.pos + _along(joint) * case.rng.uniform(-share, share) * case.height
        yield Variant(f"by up to {share:.0%} of the height", spec.to_xml())


def moved_frames(case: Case) -> Iterator[Variant]:
    """As a URDF has it: the body's frame moves with the anchor, what the body carries stays where it is."""
    for share in SLIDES:
        spec = case.spec()
        for joint in _hinges(case, spec):
            body = joint.parent
            if len(body.joints) == 1 and not body.frames and body.name:
                _move_frame(case, body, _along(joint) * case.rng.uniform(-share, share) * case.height)
        yield Variant(f"by up to {share:.0%} of the height", spec.to_xml())


def shifted_zeros(case: Case) -> Iterator[Variant]:
    """Where a joint's angle is called zero is a matter of taste."""
    spec = case.spec()
    first = spec.compile()
    keys = list(spec.keys)
    poses = [np.array(key.qpos) for key in keys]
    for joint in _hinges(case, spec):
        shift = case.rng.uniform(-1, 1)
        if first.jnt_limited[joint.id]:
            joint.ref, joint.range = joint.ref + shift, joint.range + shift
            for pose in filter(len, poses):
                pose[first.jnt_qposadr[joint.id]] += shift
    for key, pose in zip(keys, poses, strict=True):
        key.qpos = pose if len(pose) else key.qpos
    yield Variant("by up to 1 rad", spec.to_xml())


def renamed(case: Case) -> Iterator[Variant]:
    """Names help, and must not be needed."""
    for what in (("joint",), ("body",), ("joint", "body")):
        tree = ET.fromstring(case.spec().to_xml())
        for kind in what:
            _rename(tree, kind)
        yield Variant(f"{' and '.join(what)} names without meaning", ET.tostring(tree, encoding="unicode"))
    yield Variant("another file name", case.spec().to_xml(), stem="left_arm_of_a_quadruped")


def turned(case: Case) -> Iterator[Variant]:
    """Where x and y point is a matter of taste."""
    for degrees in TURNS:
        spec, turn = case.spec(), Rotation.from_euler("z", degrees, degrees=True)
        first = spec.compile()
        for body in spec.worldbody.bodies:
            pose = Rotation.from_quat(first.body_quat[body.id], scalar_first=True)
            body.pos, body.quat = turn.apply(first.body_pos[body.id]), (turn * pose).as_quat(scalar_first=True)
            body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        for key in [key for key in spec.keys if case.robot.floating and len(key.qpos)]:
            key.qpos = turned_pose(np.array(key.qpos), case.robot.root_address, turn)
        yield Variant(f"by {degrees}°", spec.to_xml(), turn)


def turned_pose(qpos: np.ndarray, root: int, turn: Rotation) -> np.ndarray:
    """A configuration whose free joint is turned about the world's origin."""
    pose = qpos.copy()
    pose[root : root + 3] = turn.apply(qpos[root : root + 3])
    own = Rotation.from_quat(qpos[root + 3 : root + 7], scalar_first=True)
    pose[root + 3 : root + 7] = (turn * own).as_quat(scalar_first=True)
    return pose


def other_keyframes(case: Case) -> Iterator[Variant]:
    """A keyframe says how a robot may begin, not what it is."""
    count = len(list(case.spec().keys))
    for chosen in range(count):
        spec = case.spec()
        for k, key in enumerate(list(spec.keys)):
            key.name = "home" if k == chosen else f"key {k}"
        yield Variant(f"keyframe {chosen} called home", spec.to_xml())
    if count and case.robot.floating:
        spec = case.spec()
        for key in [key for key in spec.keys if len(key.qpos)]:
            key.qpos = turned_pose(np.array(key.qpos), case.robot.root_address, Rotation.from_euler("z", 2.0))
        yield Variant("keyframes turned by 2 rad", spec.to_xml())
    spec = case.spec()
    for key in list(spec.keys):
        spec.delete(key)
    if count:
        yield Variant("no keyframes", spec.to_xml())


def without_parts(case: Case) -> Iterator[Variant]:
    """A robot without a head, arms, or a waist is the same below."""
    if "head" in case.anatomy.sites and case.anatomy.sites["head"].body != case.anatomy.sites["chest"].body:
        spec = _bare(case)
        spec.delete(_limb_root(case, spec, "head"))
        yield Variant("no head", spec.to_xml(), lost=frozenset(HEAD))
    if set(case.anatomy.sites) >= ARMS:
        spec = _bare(case)
        for limb in [_limb_root(case, spec, hand) for hand in ("l_hand", "r_hand")]:
            spec.delete(limb)
        yield Variant("no arms", spec.to_xml(), lost=frozenset(ARMS | HEAD | {"chest"}))
    waist = _waist(case)
    if waist:
        spec = _bare(case)
        for joint in [j for j in spec.joints if j.id in waist]:
            spec.delete(joint)
        yield Variant("no waist", spec.to_xml())


def without_tools(case: Case) -> Iterator[Variant]:
    """Sites and actuators are for others."""
    for what in ("sites", "actuators"):
        spec = _bare(case)
        for thing in list(getattr(spec, what)):
            spec.delete(thing)
        yield Variant(f"no {what}", spec.to_xml())


def without_root(case: Case) -> Iterator[Variant]:
    """Some models leave it to whoever includes them to set them free."""
    if case.robot.floating:
        spec = _bare(case)
        for joint in [j for j in spec.joints if j.type == FREE]:
            spec.delete(joint)
        yield Variant("no free joint", spec.to_xml())


def lying(case: Case) -> Iterator[Variant]:
    """In its reference pose a robot may lie on any side, or stand on its head; it is stood up."""
    if case.robot.floating:
        for axis, degrees in (("y", 90), ("y", -90), ("x", 90), ("x", 180)):
            spec, turn = _bare(case), Rotation.from_euler(axis, degrees, degrees=True)
            first = spec.compile()
            for body in spec.worldbody.bodies:
                pose = Rotation.from_quat(first.body_quat[body.id], scalar_first=True)
                body.pos, body.quat = turn.apply(first.body_pos[body.id]), (turn * pose).as_quat(scalar_first=True)
                body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
            yield Variant(f"turned by {degrees}° about {axis}", spec.to_xml())


def ball_elbows(case: Case) -> Iterator[Variant]:
    """An elbow of three hinges that cross is a ball joint, as human models have it; those of both arms mirror each other."""
    if not set(case.anatomy.sites) >= ARMS:
        return
    links, lateral = Links(case.robot), np.cross([0, 0, 1], case.anatomy.forward)
    for turn in Rotation.random(3, rng=case.rng):
        spec, lines = _bare(case), turn.as_matrix()
        for elbow, axes in (("l_elbow", lines), ("r_elbow", lines - 2 * np.outer(lines @ lateral, lateral))):
            site, body = case.anatomy.sites[elbow], case.body(spec, elbow)
            if len(body.joints) == 1:
                bend = body.joints[0]
                name, own = bend.name, axes @ links.data.xmat[site.body].reshape(3, 3)
                spec.delete(bend)
                for k, axis in enumerate(own):
                    body.add_joint(name=f"{name}_{k}", pos=site.offset, axis=axis, range=(-2, 2))
        yield Variant("three hinges in place of one", spec.to_xml())


def frame_hands(case: Case) -> Iterator[Variant]:
    """The end of a forearm may be a frame, its shape a ball at the elbow."""
    spec = _bare(case)
    sites = case.anatomy.sites
    arms = [(sites[f"{side}_elbow"], sites[f"{side}_hand"]) for side in "lr" if set(sites) >= ARMS]
    if arms and all("no wrist joint" in hand.evidence and elbow.body == hand.body for elbow, hand in arms):
        for elbow, hand in arms:
            body = spec.bodies[hand.body]
            for geom in list(body.geoms):
                spec.delete(geom)
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0], pos=elbow.offset, mass=0.1)
            body.add_body(name=f"{body.name}_end", pos=elbow.offset + (hand.offset - elbow.offset) / HAND_SHARE)
        yield Variant("the hand is a frame", spec.to_xml())


LAWS: dict[str, Law] = {
    "joint anchors moved along their axes": moved_anchors,
    "body frames moved along their axes": moved_frames,
    "joint angles counted from elsewhere": shifted_zeros,
    "names changed": renamed,
    "the model turned about z": turned,
    "another keyframe": other_keyframes,
    "no head, arms, waist": without_parts,
    "no sites, actuators": without_tools,
    "no root joint": without_root,
    "lying in the reference pose": lying,
    "elbows as ball joints": ball_elbows,
    "hands as frames": frame_hands,
}


def _hinges(case: Case, spec: mujoco.MjSpec) -> list[mujoco.MjsJoint]:
    spec.compile()  # numbers the joints
    own = set(case.robot.joint_ids.tolist())
    return [joint for joint in spec.joints if joint.id in own and joint.type == HINGE]


def _along(joint: mujoco.MjsJoint) -> np.ndarray:
    return np.array(joint.axis) / np.linalg.norm(joint.axis)


def _move_frame(case: Case, body: mujoco.MjsBody, shift: np.ndarray) -> None:
    """Move a body's frame by a vector in it, and all that it carries back."""
    pose = Rotation.from_quat(case.robot.model.body_quat[body.id], scalar_first=True)
    body.pos = body.pos + pose.apply(shift)
    body.ipos = body.ipos - shift
    parts: list[Any] = [*body.geoms, *body.sites, *body.bodies, *body.cameras, *body.lights]
    for part in parts:
        if np.isfinite(getattr(part, "fromto", np.array([np.nan]))[0]):
            part.fromto = part.fromto - np.tile(shift, 2)
        else:
            part.pos = part.pos - shift


def _rename(tree: ET.Element, kind: str) -> None:
    own = [element for element in tree.iter(kind) if "name" in element.attrib]
    own = [element for element in own if kind != "joint" or element in _within(tree, "worldbody")]
    table = {element.attrib["name"]: f"{kind[0]}{k}" for k, element in enumerate(own)}
    for element in own:
        element.attrib["name"] = table[element.attrib["name"]]
    for element in tree.iter():
        for key in REFERENCES[kind]:
            if element.attrib.get(key) in table and element.attrib.get("objtype", kind) in (kind, "xbody"):
                element.attrib[key] = table[element.attrib[key]]


def _within(tree: ET.Element, tag: str) -> set[ET.Element]:
    return {element for part in tree.iter(tag) for element in part.iter()}


def _bare(case: Case) -> mujoco.MjSpec:
    """The robot without what speaks of its joints: keyframes, sensors, tendons, actuators, equalities."""
    spec = case.spec()
    for what in ("keys", "sensors", "actuators", "equalities", "tendons", "excludes", "pairs"):
        for thing in list(getattr(spec, what)):
            spec.delete(thing)  # before it is compiled: five times as fast
    spec.compile()
    return spec


def _limb_root(case: Case, spec: mujoco.MjSpec, end: str) -> mujoco.MjsBody:
    """The body nearest to the chest that carries a head or a hand and no other end."""
    sites = case.anatomy.sites
    others = {
        sites[k].body for k in ("l_hand", "r_hand", "head", "l_ankle", "r_ankle", "chest") if k in sites and k != end
    }
    body = case.body(spec, end)
    while not others & {b.id for b in _carried(body.parent)}:
        body = body.parent
    return body


def _carried(body: mujoco.MjsBody) -> list[mujoco.MjsBody]:
    return [body, *(b for child in body.bodies for b in _carried(child))]


def _waist(case: Case) -> set[int]:
    """Hinges between the root and the chest, where the legs hang on the root."""
    links, sites = Links(case.robot), case.anatomy.sites
    if "l_hip" not in sites:
        return set()
    chest, hip = (links.path(int(links.weld[sites[k].body])) for k in ("chest", "l_hip"))
    return {axis.joint for axis in links.axes_along([link for link in chest if link not in hip])}
