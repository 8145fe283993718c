"""The viewer draws the bodies around a robot, with their names."""

from pathlib import Path

import numpy as np
from browser import needs_browser, tab

from robot_retarget.robot import load_robot
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import ShapeKind, solid
from robot_retarget.trajectory import Trajectory
from robot_retarget.view.web import Viewer, take_of

OP3 = load_robot("op3")


@needs_browser
def test_bodies_are_seen_move_and_have_names(tmp_path: Path) -> None:
    poses = np.zeros((20, 7))
    poses[:, 1], poses[:, 2], poses[:, 3] = np.linspace(-0.2, 0.2, 20), 0.3, 1.0
    still = np.array([0.15, 0, 0.05, 1, 0, 0, 0])
    box = RigidBody("a box", solid(ShapeKind.BOX, (0.1, 0.1, 0.1)), poses)
    scene = Scene((box, RigidBody("a step", solid(ShapeKind.CYLINDER, (0.2, 0.1)), still)))
    stands = np.repeat(OP3.standing()[None], 20, axis=0)
    take = take_of(Trajectory(stands, 20.0, OP3.joint_names, OP3.name, scene=scene), OP3)
    page = Viewer((take,)).save(tmp_path / "viewer.html")
    with tab() as opened:
        opened.open(page.as_uri())
        names = "return [...document.querySelectorAll('#labels div:not([hidden])')].map((label) => label.textContent)"
        opened.until(f"return (() => {{ {names} }})().includes('a box')")
        assert {"a box", "a step"} <= set(opened.run(names))
        assert opened.changed(lambda: opened.run("viewer.player.seek(0.95)")) > 0.01
        assert opened.changed(lambda: opened.run("document.getElementById('layer-bodies').click()")) > 0.02
        assert not {"a box", "a step"} & set(opened.run(names))
        assert not opened.complaints()
