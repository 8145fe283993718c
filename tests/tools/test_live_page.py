"""A served page follows live poses, in a browser."""

import threading
import time

import numpy as np
from browser import needs_browser, tab

from robot_retarget.robot import load_robot
from robot_retarget.tools.view.web.live import LiveRobot
from robot_retarget.tools.view.web.serve import serve


def test_only_the_latest_pose_is_sent() -> None:
    live = LiveRobot(robot := load_robot("op3"))
    assert live.next(0, 0.01) is None
    for height in (0.3, 0.4, 0.5):
        qpos = robot.standing()
        qpos[2] = height
        live.show(qpos)
    count, pose = live.next(0, 1.0) or (0, b"")
    assert count == 3 and b"0.5" in pose
    assert live.next(count, 0.01) is None


@needs_browser
def test_the_robot_on_the_page_stands_where_the_latest_pose_has_it() -> None:
    live = LiveRobot(robot := load_robot("op3"))
    served = serve(live.viewer, 0, following=live)
    thread = threading.Thread(target=served.forever, daemon=True)
    thread.start()
    try:
        with tab() as browser:
            browser.open(served.address)
            before = browser.picture().astype(int)
            qpos = robot.standing()
            qpos[robot.qpos_index[robot.joint_names.index("l_sho_roll")]] -= 1.2
            qpos[0] += 0.7
            for _ in range(5):
                live.show(qpos)
                time.sleep(0.05)
            browser.until("return viewer.live.poses > 0")
            assert abs(browser.run("return viewer.takes[0].poses.values[0]") - qpos[0]) < 1e-3
            after = browser.picture().astype(int)
            assert (np.abs(after - before).max(axis=2) > 20).mean() > 0.01
            assert not browser.complaints()
    finally:
        served.server.shutdown()
        thread.join(5)
