"""The viewer draws the bodies around a robot, with their names."""

from pathlib import Path
from threading import Thread

import numpy as np
from browser import needs_browser, tab

from robot_retarget.robot import load_robot
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import ShapeKind, solid
from robot_retarget.tools.studio.studio import Studio
from robot_retarget.tools.view.web.live import LiveRobot
from robot_retarget.tools.view.web.take import take_of
from robot_retarget.tools.view.web.viewer import Viewer
from robot_retarget.trajectory import Trajectory

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


@needs_browser
def test_bodies_of_a_stream_are_where_its_pose_has_them_and_have_their_size(tmp_path: Path) -> None:
    box = RigidBody("a box", solid(ShapeKind.BOX, (0.2, 0.2, 0.2)), np.array([0.5, 0, 0.1, 1.0, 0, 0, 0]))
    floor = RigidBody("ground", solid(ShapeKind.PLANE, ()), np.array([0, 0, 0, 1.0, 0, 0, 0]))
    live = LiveRobot(OP3, Scene((floor, box)))
    served = Studio(tmp_path, live).served(0)
    thread = Thread(target=served.forever, daemon=True)
    thread.start()
    there = np.array([0.2, 0.05, 0.3, 0.8, 0.6, 0, 0])
    try:
        with tab() as opened:
            opened.open(served.address)
            live.show(OP3.standing(), {"ground": floor.poses, "a box": there}, 0.25)
            opened.until("return viewer.studio.live?.poses > 0")
            mesh = "viewer.casts[0].parts.bodies.children[0]"
            np.testing.assert_allclose(opened.run(f"return {mesh}.position.toArray()"), there[:3], atol=1e-4)
            np.testing.assert_allclose(
                opened.run(f"return {mesh}.quaternion.toArray()"), there[[4, 5, 6, 3]], atol=1e-4
            )
            assert opened.run(f"return [{mesh}.scale.x, {mesh}.visible]") == [0.25, True]
            assert not opened.complaints()
    finally:
        served.close()
        thread.join(5)
