"""Robots as others model them: canted hips, grippers, rods on ball joints, arms on a table, maps that name everything."""

from pathlib import Path

import numpy as np
import pytest

from robot_retarget.base.errors import MatchError, RobotError
from robot_retarget.base.files import SAMPLES
from robot_retarget.base.keypoints import KEYPOINTS
from robot_retarget.human.match import match
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.robot import Robot, load_robot, recognise, recognise_with, world_points


def leg(side: str, sign: int, pitch: str = "0 1 0", rod: str = "") -> str:
    """A leg whose hip pitches about an axis given by `pitch`, and whose yaw sits at the knee."""
    return f"""
      <body name="{side}1" pos="0 {sign * 0.1} 0"><joint name="{side}2" axis="{pitch}"/>
       <geom type="sphere" size="0.03" mass="0.1"/>
       <body name="{side}3"><joint name="{side}4" axis="1 0 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="0.3"/>
        <body name="{side}5" pos="0 0 -0.3"><joint name="{side}6" axis="0 0 1"/>
         <geom type="sphere" size="0.03" mass="0.1"/>
         <body name="{side}7"><joint name="{side}8" axis="0 1 0" range="0 2"/>
          <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="0.3"/>{rod}
          <body name="{side}9" pos="0 0 -0.3"><joint name="{side}10" axis="0 1 0"/>
           <geom type="sphere" size="0.02" mass="0.1"/>
           <body name="{side}11"><joint name="{side}12" axis="1 0 0"/>
            <geom type="box" size="0.08 0.03 0.01" pos="0.03 0 -0.04" mass="0.1"/>
           </body></body></body></body></body></body>"""


def legged(legs: str, upper: str = "") -> str:
    return f"""<mujoco><compiler angle="radian"/><worldbody>
     <body name="base" pos="0 0 0.7"><freejoint/>
      <geom type="box" size="0.06 0.1 0.2" pos="0 0 0.25" mass="3"/>{upper}{legs}
     </body></worldbody></mujoco>"""


def arm(side: str, sign: int, end: str = "") -> str:
    return f"""
      <body name="{side}13" pos="0 {sign * 0.15} 0.4"><joint name="{side}14" axis="0 1 0"/>
       <geom type="sphere" size="0.03" mass="0.1"/>
       <body name="{side}15"><joint name="{side}16" axis="1 0 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.2"/>
        <body name="{side}17" pos="0 0 -0.2"><joint name="{side}_elbow" axis="0 1 0" range="-2 0"/>
         <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.2"/>{end}
        </body></body></body>"""


def written(folder: Path, xml: str) -> Path:
    (folder / "robot.xml").write_text(xml)
    return folder / "robot.xml"


def places(robot: Robot, keypoints: tuple[str, ...] = KEYPOINTS) -> dict[str, np.ndarray]:
    anatomy = recognise(robot)
    names = [k for k in keypoints if k in anatomy.sites]
    points = world_points(robot, anatomy.points_of(names), np.array(robot.model.qpos0)[None])[0]
    return dict(zip(names, points, strict=True))


@pytest.mark.parametrize("degrees", [0, 10, 25, 45, 55])
def test_a_canted_hip_is_where_its_axes_cross(degrees: int, tmp_path: Path) -> None:
    y, z = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    legs = leg("l", 1, f"0 {y} {z}") + leg("r", -1, f"0 {y} {-z}")
    found = places(load_robot(written(tmp_path, legged(legs))))
    np.testing.assert_allclose(found["l_hip"], [0, 0.1, 0.7], atol=1e-6)
    np.testing.assert_allclose(found["l_knee"], [0, 0.1, 0.4], atol=1e-6)
    np.testing.assert_allclose(found["r_ankle"], [0, -0.1, 0.1], atol=1e-6)


def spread_leg(side: str, sign: int) -> str:
    """A leg that stands outwards; three hinges of one body are its hip."""
    return f"""
      <body name="{side}1" pos="0 {sign * 0.1} 0" euler="{sign * 0.35} 0 0">
       <joint axis="0 0 1"/><joint axis="0 1 0"/><joint axis="1 0 0"/>
       <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="0.3"/>
       <body name="{side}2" pos="0 0 -0.3"><joint axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="0.3"/>
        <body name="{side}3" pos="0 0 -0.3"><joint axis="0 1 0"/>
         <geom type="box" size="0.08 0.03 0.01" pos="0.03 0 -0.04" mass="0.1"/>
        </body></body></body>"""


def test_a_hip_of_three_hinges_is_where_they_cross_also_under_legs_that_stand_apart(tmp_path: Path) -> None:
    found = places(load_robot(written(tmp_path, legged(spread_leg("l", 1) + spread_leg("r", -1)))))
    np.testing.assert_allclose(found["l_hip"], [0, 0.1, 0.7], atol=1e-6)
    np.testing.assert_allclose(found["r_hip"], [0, -0.1, 0.7], atol=1e-6)


@pytest.mark.parametrize("drop", [0.0, 0.05, 0.1])
def test_a_roll_axis_below_the_ankles_pitch_carries_the_foot_and_is_no_toe_joint(drop: float, tmp_path: Path) -> None:
    legs = "".join(
        leg(side, sign, "0 1 0").replace(f'<body name="{side}11">', f'<body name="{side}11" pos="0.03 0 -{drop}">')
        for side, sign in (("l", 1), ("r", -1))
    )
    anatomy = recognise(robot := load_robot(written(tmp_path, legged(legs))))
    assert robot.model.body(anatomy.sites["l_ankle"].body).name == "l11"
    assert anatomy.sites["l_toe"].evidence == "front edge of the sole"
    np.testing.assert_allclose(places(robot)["l_toe"][0], 0.03 + 0.03 + 0.08, atol=1e-6)


ROD = """
  <body name="crank{0}" pos="0.02 0 0"><joint name="crank{0}" axis="0 1 0"/><geom type="sphere" size="0.01" mass="0.05"/>
   <body name="rod{0}" pos="0 0 -0.01"><joint name="ball{0}" type="ball"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.28" size="0.004" mass="0.02"/></body></body>"""


@pytest.mark.parametrize("hinge", ["", '<joint name="twist{0}" axis="0 0 1"/>'])
def test_rods_on_ball_joints_are_left_out_and_reported(hinge: str, tmp_path: Path) -> None:
    """Also with a passive hinge beside the ball, if the rod closes a loop."""
    ends = ((side, f'<connect body1="{side}11" body2="rod{side}" anchor="0.02 0 0"/>') for side in "lr")
    loops = f"<equality>{''.join(end for side, end in ends if hinge or side == 'l')}</equality>"
    rod = ROD.replace('type="ball"/>', f'type="ball"/>{hinge}')
    xml = legged(leg("l", 1, rod=rod.format("l")) + leg("r", -1, rod=rod.format("r")))
    robot = load_robot(written(tmp_path, xml.replace("</mujoco>", f"{loops}</mujoco>")))
    assert robot.model.neq == 0 and robot.model.nq == 7 + len(robot.joint_names)
    assert (
        "rods on ball joints left out, with the loops they close: rodl to l11, rodr" + (" to r11" if hinge else "")
        in robot.notes
    )
    assert set(places(robot)) >= {"l_hip", "l_knee", "l_ankle"}
    assert robot.spec().compile().nq == robot.model.nq


def test_a_ball_joint_that_carries_a_limb_is_refused(tmp_path: Path) -> None:
    xml = legged(leg("l", 1) + leg("r", -1)).replace(
        '<joint name="l2" axis="0 1 0"/>', '<joint name="l2" type="ball"/>'
    )
    with pytest.raises(RobotError, match="ball joint 'l2'"):
        load_robot(written(tmp_path, xml))


FINGERS = "".join(
    f"""<body name="{{0}}_finger_{k}" pos="{x} 0 -0.22"><joint axis="0 1 0"/><geom type="sphere" size="0.01" mass="0.01"/>
     <body name="{{0}}_finger_{k}b" pos="0 0 -0.03"><joint axis="0 1 0"/><geom type="sphere" size="0.01" mass="0.01"/>
      <body name="{{0}}_finger_{k}c" pos="0 0 -0.03"><joint axis="0 1 0"/><geom type="sphere" size="0.01" mass="0.01"/>
      </body></body></body>"""
    for k, x in enumerate((-0.02, 0.02))
)


@pytest.mark.parametrize("height", ["-0.22", "0.5"], ids=["hanging", "above the shoulders"])
def test_fingers_are_neither_legs_nor_a_head(height: str, tmp_path: Path) -> None:
    fingers = FINGERS.replace("-0.22", height)
    xml = legged("", arm("l", 1, fingers.format("l")) + arm("r", -1, fingers.format("r")))
    robot = load_robot(written(tmp_path, xml))
    anatomy = recognise(robot)
    assert "l_hip" not in anatomy.sites and "l_elbow" in anatomy.sites
    on_fingers = [k for k, site in anatomy.sites.items() if "finger" in robot.model.body(site.body).name]
    assert not on_fingers


def test_the_fingers_of_one_hand_are_no_pair_of_arms(tmp_path: Path) -> None:
    xml = legged("", arm("l", 1, FINGERS.format("l")))
    with pytest.raises(MatchError, match="no two chains"):
        recognise(load_robot(written(tmp_path, xml)))


def test_a_gripper_moves_no_hand_from_its_wrist(tmp_path: Path) -> None:
    jaw = '<body name="{0}_gripper" pos="0.001 0 -0.2"><joint axis="0.01 0 1"/><geom type="box" size=".02 .01 .04" mass=".1"/></body>'
    legs = leg("l", 1) + leg("r", -1)
    found = places(
        load_robot(written(tmp_path, legged(legs, arm("l", 1, jaw.format("l")) + arm("r", -1, jaw.format("r")))))
    )
    assert np.linalg.norm(found["l_hand"] - found["l_elbow"]) < 0.25


def test_two_arms_on_a_table_are_no_humanoid(tmp_path: Path) -> None:
    base = '<body name="{0}_base" pos="0 {1} 0"><geom type="box" size="0.1 0.1 0.02"/>{2}</body>'
    station = base.format("l", 0.45, arm("l", 1)) + base.format("r", -0.45, arm("r", -1))
    xml = f"<mujoco><worldbody><geom type='plane' size='2 2 0.1'/>{station}</worldbody></mujoco>"
    with pytest.raises(MatchError, match=r"two arms are bolted to the world 1\.20 m apart"):
        recognise(load_robot(written(tmp_path, xml)))


def test_a_map_of_all_keypoints_is_used_where_no_robot_is_recognised(tmp_path: Path) -> None:
    lopsided = leg("l", 1) + leg("r", -1).replace("0 0 -0.3", "0 -0.1 -0.25").replace('axis="1 0 0"', 'axis="0 1 0.6"')
    robot = load_robot(written(tmp_path, legged(lopsided)))
    with pytest.raises(MatchError):
        recognise(robot)
    bodies = {"hip": "3", "knee": "7", "ankle": "11", "toe": "11"}
    lines = {k: ["base", 0.0, 0.0, 0.0] for k in KEYPOINTS}
    lines |= {f"{s}_{k}": [f"{s}{b}", 0.0, 0.0, 0.0] for s in "lr" for k, b in bodies.items()}
    anatomy = recognise_with(robot, lines)
    assert set(anatomy.names) == set(KEYPOINTS) and set(anatomy.soles) == {"l", "r"}
    np.testing.assert_allclose(anatomy.forward, [1, 0, 0], atol=1e-9)
    assert any("the map, which names every keypoint, is used" in note for note in anatomy.notes)
    del lines["head"]
    with pytest.raises(MatchError):
        recognise_with(robot, lines)


def test_a_map_of_all_keypoints_is_used_where_no_human_is_recognised(tmp_path: Path) -> None:
    wave = read_motion(SAMPLES / "wave.bvh")
    human = match(wave, load_robot("op3")).recognition
    joints = [human.marks[k].joints[0] for k in KEYPOINTS]
    names = tuple(f"p{k}" for k in range(len(joints)))
    cloud = Motion(
        Skeleton(names, np.full(len(names), -1), np.zeros((len(names), 3))), wave.positions[:, joints], None, 30
    )
    with pytest.raises(MatchError):
        match(cloud, load_robot("op3"))
    path = tmp_path / "map.toml"
    path.write_text("[human]\n" + "".join(f'{k} = "p{i}"\n' for i, k in enumerate(KEYPOINTS)))
    found = match(cloud, load_robot("op3"), path)
    assert found.keypoints == match(wave, load_robot("op3")).keypoints
    assert any("the map, which names every keypoint, is used" in note for note in found.notes)


def test_the_hinge_of_a_gripper_is_no_elbow(tmp_path: Path) -> None:
    """Of an elbow without its name and a gripper that turns nearer to the middle of the arm."""
    grip = """<body name="{0}_gripper" pos="0 0 -0.05"><joint name="{0}18" axis="0 1 0"/>
     <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.02" mass="0.1"/></body>"""
    arms = "".join(arm(side, sign, grip.format(side)) for side, sign in (("l", 1), ("r", -1)))
    robot = load_robot(written(tmp_path, legged(leg("l", 1) + leg("r", -1), arms.replace("_elbow", "_joint"))))
    sites = recognise(robot).sites
    assert [robot.model.body(sites[f"l_{part}"].body).name for part in ("shoulder", "elbow")] == ["l15", "l17"]


def test_the_rods_of_a_parallel_leg_are_not_the_leg(tmp_path: Path) -> None:
    """A longer chain beside the leg, whose links below the thigh follow it by gears."""
    rod = """
     <body name="{0}rod1"><joint name="{0}p1" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.01"/>
      <body name="{0}rod2" pos="0 0 -0.3"><joint name="{0}p2" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.01"/>
       <body name="{0}rod3" pos="0 0 -0.3"><joint name="{0}p3" axis="0 1 0"/><geom type="box" size="0.1 0.04 0.01" pos="0.05 0 -0.08"/>
     </body></body></body>"""
    legs = (
        leg(s, sign).replace(f'<body name="{s}5"', f'{rod.format(s)}<body name="{s}5"')
        for s, sign in (("l", 1), ("r", -1))
    )
    gears = "".join(f'<joint joint1="{s}p{k}" joint2="{s}p1" polycoef="0 -1 0 0 0"/>' for s in "lr" for k in (2, 3))
    xml = legged("".join(legs)).replace("</mujoco>", f"<equality>{gears}</equality></mujoco>")
    robot = load_robot(written(tmp_path, xml))
    sites = recognise(robot).sites
    assert [robot.model.body(sites[f"l_{part}"].body).name for part in ("knee", "ankle")] == ["l7", "l11"]


def test_frames_fixed_to_a_link_make_no_gripper_of_it(tmp_path: Path) -> None:
    """A frame in the middle of the trunk, a gripper fixed to the forearm."""
    frame = '<body name="{0}" pos="0 0 {1}"><geom type="sphere" size="0.01" mass="0.01"/></body>'
    arms = "".join(arm(side, sign, frame.format(f"{side}_gripper", -0.2)) for side, sign in (("l", 1), ("r", -1)))
    legs = leg("l", 1) + leg("r", -1)
    xml = legged(legs, frame.format("imu_middle", 0.2) + arms)
    sites = recognise(load_robot(written(tmp_path, xml))).sites
    plain = recognise(load_robot(written(tmp_path, legged(legs, arms.replace("_gripper", "_tip"))))).sites
    assert {k: site.confidence for k, site in sites.items()} == {k: site.confidence for k, site in plain.items()}


def test_feet_without_shapes_have_no_toes_and_a_note(tmp_path: Path) -> None:
    box = '<geom type="box" size="0.08 0.03 0.01" pos="0.03 0 -0.04" mass="0.1"/>'
    mass = '<inertial pos="0 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>'
    xml = legged(leg("l", 1) + leg("r", -1))
    assert "l_toe" in recognise(load_robot(written(tmp_path, xml))).sites
    anatomy = recognise(load_robot(written(tmp_path, xml.replace(box, mass))))
    assert not {"l_toe", "r_toe"} & set(anatomy.sites) and set(anatomy.soles) == {"l", "r"}
    assert any("the feet have no shapes" in note for note in anatomy.notes)
