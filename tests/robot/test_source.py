"""Robots as their files have them: URDF is loaded, a missing root joint is made up for, and both are said."""

import resource
import xml.etree.ElementTree as ET
from pathlib import Path

import forked
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robot_retarget.base.errors import RobotError
from robot_retarget.base.untrusted import child, models_child
from robot_retarget.robot import Robot, load_robot, recognise, world_points
from robot_retarget.robot.catalog import NO_ROOT
from robot_retarget.robot.kinematics import body_frames


def as_urdf(robot: Robot, path: Path, mesh: str = "") -> Path:
    """A robot's links and hinges as a URDF: link frames at the joints, boxes for shapes."""
    model, root = robot.model, ET.Element("robot", name="made")
    for body in range(1, model.nbody):
        link = ET.SubElement(root, "link", name=model.body(body).name)
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "mass", value=str(max(float(model.body_mass[body]), 0.01)))
        ET.SubElement(inertial, "inertia", ixx="1e-3", iyy="1e-3", izz="1e-3", ixy="0", ixz="0", iyz="0")
        for geom in np.flatnonzero(model.geom_bodyid == body):
            shape = ET.SubElement(link, "collision")
            rpy = Rotation.from_quat(model.geom_quat[geom], scalar_first=True).as_euler("xyz")
            _origin(shape, model.geom_pos[geom] + 0.0, rpy)
            half = model.geom_aabb[geom][3:]
            ET.SubElement(ET.SubElement(shape, "geometry"), "box", size=_text(2 * half))
        if mesh:
            shape = ET.SubElement(link, "visual")
            ET.SubElement(ET.SubElement(shape, "geometry"), "mesh", filename=mesh)
        parent = int(model.body_parentid[body])
        if parent:
            _joint(root, robot, body, parent)
    path.write_text(ET.tostring(root, encoding="unicode"))
    return path


def _joint(root: ET.Element, robot: Robot, body: int, parent: int) -> None:
    model, first = robot.model, int(robot.model.body_jntadr[body])
    hinged = bool(model.body_jntnum[body])
    name = model.joint(first).name if hinged else f"weld_{body}"
    joint = ET.SubElement(root, "joint", name=name, type="revolute" if hinged else "fixed")
    ET.SubElement(joint, "parent", link=model.body(parent).name)
    ET.SubElement(joint, "child", link=model.body(body).name)
    rpy = Rotation.from_quat(model.body_quat[body], scalar_first=True).as_euler("xyz")
    _origin(joint, model.body_pos[body], rpy)
    if hinged:
        assert not model.jnt_pos[first].any()
        ET.SubElement(joint, "axis", xyz=_text(model.jnt_axis[first]))
        low, high = model.jnt_range[first]
        ET.SubElement(joint, "limit", lower=str(low), upper=str(high), effort="4", velocity="4.8")


def _origin(element: ET.Element, place: np.ndarray, rpy: np.ndarray) -> None:
    ET.SubElement(element, "origin", xyz=_text(place), rpy=_text(rpy))


def _text(numbers: np.ndarray) -> str:
    return " ".join(f"{x:.12g}" for x in numbers)


@pytest.fixture
def urdf(tmp_path: Path) -> Robot:
    return load_robot(as_urdf(load_robot("op3"), tmp_path / "op3_made.urdf"))


def test_a_urdf_has_the_kinematics_ranges_and_speeds_that_it_was_written_from(urdf: Robot) -> None:
    op3 = load_robot("op3")
    assert urdf.joint_names == op3.joint_names and urdf.floating and NO_ROOT in urdf.notes
    assert np.allclose(np.stack([urdf.lower, urdf.upper], axis=1), op3.model.jnt_range[op3.joint_ids])
    assert np.allclose(urdf.max_speed, 4.8) and np.allclose(urdf.max_torque, 4)
    q, there = urdf.neutral(), op3.neutral()
    q[:7] = there[:7]
    q[urdf.qpos_index] = there[op3.qpos_index] = np.linspace(-0.2, 0.3, len(op3.joint_names)).clip(op3.lower, op3.upper)
    here, other = (body_frames(robot, pose[None])[0][0] for robot, pose in ((urdf, q), (op3, there)))
    names = {urdf.model.body(b).name: here[b] for b in range(urdf.model.nbody)}
    assert all(np.allclose(names[op3.model.body(b).name], other[b], atol=1e-6) for b in range(1, op3.model.nbody))


def test_a_urdf_is_recognised_as_the_robot_it_is(urdf: Robot) -> None:
    op3 = load_robot("op3")
    places = []
    for robot in (urdf, op3):
        anatomy = recognise(robot)
        q = robot.neutral()
        q[:7] = 0, 0, 0, 1, 0, 0, 0
        places.append(dict(zip(anatomy.names, world_points(robot, anatomy.points, q[None])[0], strict=True)))
    off = {k: float(np.linalg.norm(places[0][k] - place)) for k, place in places[1].items()}
    assert max(off.values()) < 0.02, off


def test_meshes_that_are_not_there_are_left_out_and_said(tmp_path: Path) -> None:
    robot = load_robot(as_urdf(load_robot("op3"), tmp_path / "made.urdf", mesh="package://made/meshes/nothing.dae"))
    assert any("meshes not found" in note and "(visual)" in note for note in robot.notes)


def test_meshes_of_a_package_are_found_over_the_urdf(tmp_path: Path) -> None:
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    faces = [(1, 3, 2), (1, 2, 4), (2, 3, 4), (3, 1, 4)]
    lines = [f"v {_text(corner)}" for corner in corners] + [f"f {a} {b} {c}" for a, b, c in faces]
    for folder in ("made/meshes", "made/urdf"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "made/meshes/part.obj").write_text("\n".join(lines))
    robot = load_robot(
        as_urdf(load_robot("op3"), tmp_path / "made/urdf/made.urdf", mesh="package://made/meshes/part.dae")
    )
    assert robot.notes == (NO_ROOT,)
    assert (robot.model.geom_type == mujoco.mjtGeom.mjGEOM_MESH).sum() == robot.model.nbody - 1


def test_a_broken_urdf_is_named(tmp_path: Path) -> None:
    path = tmp_path / "broken.urdf"
    path.write_text("<robot><link/></robot")
    with pytest.raises(RobotError, match=r"broken\.urdf: MuJoCo does not load it"):
        load_robot(path)


@pytest.mark.parametrize("way", [(0, 0, 0), (90, 0, 0), (-90, 0, 0), (0, 90, 0), (0, -90, 0), (180, 0, 0)])
def test_a_robot_with_legs_and_no_root_joint_is_set_free_and_stands(tmp_path: Path, way: tuple[int, ...]) -> None:
    op3 = load_robot("op3")
    spec = op3.spec()
    body = spec.bodies[op3.root_body]
    for joint in list(body.joints):
        spec.delete(joint)
    for key in list(spec.keys):
        spec.delete(key)
    body.quat = Rotation.from_euler("xyz", way, degrees=True).as_quat(scalar_first=True)
    path = tmp_path / "bolted.xml"
    path.write_text(spec.to_xml())
    robot = load_robot(path)
    assert robot.floating and any(note.startswith(NO_ROOT) for note in robot.notes)
    anatomy, known = recognise(robot), recognise(op3)
    assert {k: robot.model.body(s.body).name for k, s in anatomy.sites.items()} == {
        k: op3.model.body(s.body).name for k, s in known.sites.items()
    }
    assert robot.spec().compile().nq == robot.model.nq


def test_keyframes_of_a_robot_that_is_set_free_begin_where_it_stands(tmp_path: Path) -> None:
    op3 = load_robot("op3")
    spec = op3.spec()
    for joint in list(spec.bodies[op3.root_body].joints):
        spec.delete(joint)
    for key in spec.keys:
        key.qpos = np.array(key.qpos)[7:]
    path = tmp_path / "bolted.xml"
    path.write_text(spec.to_xml())
    assert load_robot(path).standing()[7:] == pytest.approx(op3.standing()[7:])


MJCF = """<mujoco><worldbody><body name="base" pos="0 0 1"><freejoint/><geom size=".1"/><body name="leg" pos="0 0 0">
<joint name="knee" axis="0 1 0" range="-1 1"/><geom name="shin" type="capsule" fromto="0 0 0 0 0 -.4" size=".05"/></body></body>
</worldbody></mujoco>"""
URDF = """<robot name="r"><link name="base"/><link name="leg"><inertial><origin xyz="0 0 0"/><mass value="1"/>
<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="knee" type="revolute">
<parent link="base"/><child link="leg"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5" velocity="3"/></joint></robot>"""


@pytest.mark.parametrize(
    ("text", "old", "new", "named"),
    [
        (MJCF, 'pos="0 0 0"', 'pos="nan 0 0"', "leg"),
        (MJCF, 'range="-1 1"', 'range="-1 nan"', "knee"),
        (MJCF, 'axis="0 1 0"', 'axis="0 nan 0"', "knee"),
        (MJCF, 'size=".05"', 'size="nan"', "shin"),
        (URDF, 'value="1"', 'value="nan"', "value of <mass>"),
        (URDF, 'ixx=".1"', 'ixx="inf"', "ixx of <inertia>"),
        (URDF, 'effort="5"', 'effort="nan"', "effort of <limit>"),
        (URDF, 'velocity="3"', 'velocity="fast"', "velocity of <limit> is no number"),
    ],
)
def test_a_number_that_is_none_is_refused_and_named(text: str, old: str, new: str, named: str, tmp_path: Path) -> None:
    path = tmp_path / ("r.xml" if text is MJCF else "r.urdf")
    path.write_text(text.replace(old, new))
    assert old in text
    with pytest.raises(RobotError, match=rf"r\.(xml|urdf): .*{named}"):
        load_robot(path)


def test_contact_pairs_with_the_floor_of_a_scene_are_left_out_and_stated(tmp_path: Path) -> None:
    text = load_robot("op3").path.read_text()
    pair = '<contact><pair name="chest_floor" geom1="chest" geom2="floor_of_a_scene"/></contact>'
    path = tmp_path / "paired.xml"
    path.write_text(text.replace("</mujoco>", f"{pair}</mujoco>"))
    with pytest.raises(ValueError, match="floor_of_a_scene"):
        mujoco.MjModel.from_xml_path(str(path))
    robot = load_robot(str(path))
    assert any("chest_floor" in note for note in robot.notes)
    assert recognise(robot).names == recognise(load_robot("op3")).names


TEXTURE = '<texture name="{}" type="{}" builtin="flat" width="9999" height="9999"/>'
ASKING = {
    "pixels": f"<asset>{''.join(TEXTURE.format(name, '2d') for name in 'abc')}</asset>",
    "cubes": f"<asset>{''.join(TEXTURE.format(k, 'cube') for k in range(20))}</asset>",
    "heights": '<asset><hfield name="h" nrow="30000" ncol="30000" size="1 1 1 1"/></asset>',
    "users": '<size nuser_body="200000000"/>',
    "bodies": "<worldbody>" + "<body/>" * 3000 + "</worldbody>",
    "arena": '<size memory="100G"/>',
}


@pytest.mark.parametrize("what", ASKING)
@pytest.mark.parametrize("included", [False, True])
def test_a_model_that_asks_for_gigabytes_is_refused_and_takes_no_memory(
    what: str, included: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(child, "run", forked.started)
    own = MJCF.replace("</mujoco>", f"{ASKING[what]}</mujoco>")
    path = tmp_path / "r.xml"
    path.write_text(MJCF.replace("</mujoco>", '<include file="part.xml"/></mujoco>') if included else own)
    (tmp_path / "part.xml").write_text(f"<mujocoinclude>{ASKING[what]}</mujocoinclude>")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(RobotError, match=r"r\.xml: the model asks for too much: .*more than"):
        load_robot(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # kilobytes


def test_a_model_that_takes_hours_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten million replicas; the processor time that it may take is a fact of the process."""
    monkeypatch.setattr(child, "run", forked.started)
    monkeypatch.setattr(models_child, "SECONDS", 1)
    path = tmp_path / "r.xml"
    many = '<worldbody><replicate count="10000000" offset="1 0 0"><geom size="1"/></replicate></worldbody>'
    path.write_text(MJCF.replace("</mujoco>", f"{many}</mujoco>"))
    with pytest.raises(RobotError, match="asks for too much: more than 1536 MB"):
        load_robot(path)


def test_a_model_is_compiled_apart_once_and_a_shipped_one_never(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[str] = []
    monkeypatch.setattr(child, "run", lambda *a, **k: started.append(a[1]) or forked.started(*a, **k))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    path = tmp_path / "r.xml"
    path.write_text(MJCF)
    for name in ("op3", path, "op3", path):
        load_robot(name)
    assert started == [str(path)]
    path.write_text(MJCF.replace("knee", "other"))
    load_robot(path)
    assert started == [str(path), str(path)]


def test_a_urdf_that_is_a_chain_without_end_or_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "r.urdf"
    path.write_text('<robot name="r">' + "<link>" * 200_000 + "</link>" * 200_000 + "</robot>")
    with pytest.raises(RobotError, match=r"r\.urdf: "):
        load_robot(path)
    path.write_bytes(b'<robot name="r\xf8"/>')
    with pytest.raises(RobotError, match=r"r\.urdf: MuJoCo does not load it: not well-formed"):
        load_robot(path)


def test_a_file_that_mujoco_reads_need_not_be_well_formed(tmp_path: Path) -> None:
    path = tmp_path / "r.xml"
    path.write_text(MJCF.replace("<worldbody>", "<!-- <geom/> <!-- nested --> --><worldbody>"))
    assert load_robot(path).joint_names == ("knee",)


def test_attributes_of_a_urdf_that_are_no_numbers_are_left_alone(tmp_path: Path) -> None:
    path = as_urdf(load_robot("op3"), tmp_path / "robot.urdf")
    noted = path.read_text().replace("<box ", '<box name="left_thigh" ')
    checked = '</link><link name="noted"><collision_checking><capsule name="test"/></collision_checking></link>'  # as LAAS writes
    fixed = '<joint name="note" type="fixed"><parent link="body_link"/><child link="noted"/></joint></robot>'
    path.write_text(noted.replace("</link>", checked, 1).replace("</robot>", fixed))
    assert recognise(load_robot(path)).names == recognise(load_robot("op3")).names
    path.write_text(path.read_text().replace('<box name="left_thigh" size="', '<box size="wide ', 1))
    with pytest.raises(RobotError, match=r"robot\.urdf: size of <box> is no number: 'wide [^M]*$"):
        load_robot(path)


def test_an_mjcf_is_read_by_its_content_whatever_its_ending(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "op3.xml").write_text(load_robot("op3").path.read_text())
    (tmp_path / "robot.mjcf").write_text('<mujoco><include file="parts/op3.xml"/></mujoco>')
    assert load_robot(tmp_path / "robot.mjcf").joint_names == load_robot("op3").joint_names


def test_a_template_is_refused_with_the_command_that_expands_it(tmp_path: Path) -> None:
    (tmp_path / "robot.urdf.xacro").write_text("<robot/>")
    with pytest.raises(RobotError, match=r"xacro .*robot\.urdf\.xacro > .*robot\.urdf$"):
        load_robot(tmp_path / "robot.urdf.xacro")


def test_an_inertia_that_no_body_has_is_replaced_by_its_mean_and_noted(tmp_path: Path) -> None:
    """Romeo's thigh: MuJoCo refuses a negative moment."""
    path = as_urdf(load_robot("op3"), tmp_path / "robot.urdf")
    tree = ET.parse(path)
    link = next(one for one in tree.iter("link") if one.get("name") == "l_knee_link")
    moments = {"ixx": "0.039", "iyy": "0.042", "izz": "0.012", "ixy": "0", "ixz": "0.025", "iyz": "0"}
    next(link.iter("inertia")).attrib.update(moments)
    tree.write(path)
    robot = load_robot(path)
    assert robot.model.body("l_knee_link").inertia == pytest.approx([0.031] * 3)
    assert any("moments of inertia that no body has" in note and "l_knee_link" in note for note in robot.notes)
