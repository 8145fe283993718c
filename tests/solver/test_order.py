"""The way in which a model is written does not change the result: neither the order of bodies nor geoms that occur twice."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from robot_retarget.base.files import MODELS, SAMPLES
from robot_retarget.graph.describe import describe
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.solver.solve import solve_graph

WRITTEN = MODELS / "op3" / "op3.xml"


def reversed_siblings(body: ET.Element) -> None:
    children = body.findall("body")
    for child in children:
        body.remove(child)
    body.extend(reversed(children))


def doubled_geoms(body: ET.Element) -> None:
    for geom in body.findall("geom"):
        body.append(ET.Element("geom", {key: value for key, value in geom.attrib.items() if key != "name"}))


def rewritten(change: Callable[[ET.Element], None] | None, folder: Path) -> Path:
    """Write the shipped robot with a change of every body, without keyframes, which depend on the order of joints."""
    tree = ET.parse(WRITTEN)
    for frames in tree.getroot().findall("keyframe"):
        tree.getroot().remove(frames)
    if change is not None:
        for body in list(tree.getroot().iter("body")):
            change(body)
    folder.mkdir()
    tree.write(folder / WRITTEN.name)
    (folder / "limits.toml").write_bytes(WRITTEN.with_name("limits.toml").read_bytes())
    return folder / WRITTEN.name


def angles(path: Path) -> dict[str, np.ndarray]:
    robot = load_robot(path)
    motion = read_motion(SAMPLES / "walk.bvh").resample(15).frames(0, 45)
    qpos = solve_graph(describe(motion, robot)).trajectory.qpos
    return dict(zip(robot.joint_names, qpos[:, robot.qpos_index].T, strict=True))


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    return angles(rewritten(None, tmp_path_factory.mktemp("order") / "plain"))


@pytest.mark.parametrize("change", [reversed_siblings, doubled_geoms])
def test_a_walk_is_the_same_however_bodies_are_ordered_and_geoms_repeated(
    change: Callable[[ET.Element], None], plain: dict[str, np.ndarray], tmp_path: Path
) -> None:
    other = angles(rewritten(change, tmp_path / "other"))
    assert list(plain) != list(other) or change is doubled_geoms
    assert max(float(np.abs(plain[name] - other[name]).max()) for name in plain) < 1e-3
