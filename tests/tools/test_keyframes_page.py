"""Keyframes in the browser: poses by sliders and by the mouse; the command line gives the same bytes from the saved file."""

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from action_structs import pages_of
from browser import Tab, needs_browser, tab
from forked import run

from robot_retarget.actuators.map import load_map
from robot_retarget.base.errors import GraphError, TrajectoryError, UsageError
from robot_retarget.edit.keyframe_files import keyframe_file
from robot_retarget.edit.keyframes import Keyframe
from robot_retarget.judge.report import Report
from robot_retarget.judge.rollout import simulate
from robot_retarget.robot import load_robot
from robot_retarget.tools.view.web.keyframes import KeyframeDesk, serve_keyframes
from robot_retarget.trajectory import Trajectory, load_trajectory

OP3 = load_robot("op3")
JUDGED = list[Trajectory]()
"""Trajectories on which a page asked for a verdict."""
QUIET = "return Boolean(viewer.keyframes?.rows) && !viewer.keyframes.busy"
SAID = "return viewer.keyframes.said.textContent"


def judge(trajectory: Trajectory) -> Report:
    JUDGED.append(trajectory)
    return simulate(trajectory, OP3, mode="pinned", draws=0, others=False)


@pytest.fixture(scope="module")
def opened() -> Iterator[Callable[[str], Tab]]:
    """The page of a file."""
    with ExitStack() as stack:
        browser = stack.enter_context(tab())

        def page(name: str) -> Tab:
            served = serve_keyframes(KeyframeDesk(keyframe_file(name, OP3), judge), 0)
            threading.Thread(target=served.forever, daemon=True).start()
            stack.callback(served.close)
            browser.open(served.address)
            browser.until(QUIET)
            return browser

        yield page


def press(page: Tab, button: str) -> None:
    page.run(f"document.getElementById('key-{button}').click()")
    page.until(QUIET)


def slide(page: Tab, joint: str, degrees: float) -> None:
    """Move a slider with the mouse, and let it go."""
    slider = f"const slider = document.getElementById('joint-{joint}'); slider.value = {degrees};"
    page.run(slider + "slider.dispatchEvent(new Event('input'))")
    page.until(QUIET)
    page.run(slider + "slider.dispatchEvent(new Event('change'))")
    page.until(QUIET)


@needs_browser
def test_two_poses_from_nothing_are_judged_saved_and_open_again_and_the_command_gives_the_same_bytes(
    opened: Callable[[str], Tab], tmp_path: Path
) -> None:
    from selenium.webdriver.common.actions.action_builder import ActionBuilder

    page = opened(str(tmp_path / "wave.json"))
    assert page.run("return viewer.keyframes.rows.length") == 1 and not (tmp_path / "wave.json").exists()
    press(page, "add")
    before = page.picture()
    slide(page, "l_sho_roll", 10)
    assert (np.abs(page.picture() - before).max(axis=2) > 20).mean() > 0.002, "the robot on the page stands still"
    hand = "const drag = viewer.keyframes.drag, box = document.getElementById('canvas').getBoundingClientRect();"
    hand += "const p = drag.at(drag.keypoints.names.indexOf('r_hand')).project(viewer.stage.camera);"
    hand += "return [box.left + (p.x + 1) / 2 * box.width, box.top + (1 - p.y) / 2 * box.height]"
    x, y = map(round, page.run(hand))
    act = ActionBuilder(page.driver)
    act.pointer_action.move_to_location(x, y).pointer_down()
    act.pointer_action.move_to_location(x - 10, y - 20).move_to_location(x - 20, y - 40).pointer_up()
    act.perform()
    page.until(f"{QUIET} && /apart/.test(viewer.keyframes.said.textContent)")
    assert np.hypot(*np.subtract(page.run(hand), (x - 20, y - 40))) < 3, "the hand is not where it was dropped"
    page.run(
        "const time = document.getElementById('key-seconds'); time.value = 0.1; time.dispatchEvent(new Event('change'))"
    )
    page.until(f"{QUIET} && / instead of 0.10 s: /.test(viewer.keyframes.said.textContent)")
    press(page, "judge")
    assert page.run("return document.querySelector('#heading i').textContent") in page.run(SAID)
    press(page, "save")
    assert page.run(SAID).startswith(f"wrote {tmp_path / 'wave.json'} and {tmp_path / 'wave.npz'}")
    rows = page.run("return viewer.keyframes.rows")
    done = run("edit", "keyframes", tmp_path / "wave.json", "--robot", "op3", "-o", tmp_path / "again.npz")
    assert done.returncode == 0 and (tmp_path / "again.npz").read_bytes() == (tmp_path / "wave.npz").read_bytes()
    np.testing.assert_array_equal(JUDGED[-1].qpos, load_trajectory(tmp_path / "wave.npz").qpos)
    again = opened(str(tmp_path / "wave.json"))
    assert again.run("return viewer.keyframes.rows") == rows and len(rows) == 2
    press(again, "add")
    press(again, "undo")
    assert again.run("return viewer.keyframes.rows") == rows
    assert not again.complaints()


@needs_browser
def test_an_action_page_opens_is_edited_and_saved_in_its_own_layout(
    opened: Callable[[str], Tab], tmp_path: Path
) -> None:
    stand, servo = OP3.standing()[OP3.qpos_index], load_map("op3")["r_el"]
    path = keyframe_file(tmp_path / "a.bin", OP3).holding([Keyframe(stand), Keyframe(stand, 0.8)]).save()
    was = pages_of(path)
    page = opened(f"{path}#1")
    page.run("viewer.keyframes.choose(1)")
    slide(page, "r_el", 30)
    press(page, "save")
    now = pages_of(path)
    assert now[1].step[1].position[servo.id] == servo.ticks(np.radians(30))
    now[1].step[1].position[servo.id] = was[1].step[1].position[servo.id]
    now[1].header.checksum = was[1].header.checksum
    assert [*map(bytes, now)] == [*map(bytes, was)]
    page.run(
        "const time = document.getElementById('key-pause'); time.value = 9; time.dispatchEvent(new Event('change'))"
    )
    page.until(f"{QUIET} && document.querySelector('#keyframes output.bad')")
    assert "a pause of 9 s: a step of page 1 takes 0 to 2.04 s" in page.run(SAID)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"rows": []}, "rows are a list of 1 to 2000 keyframes"),
        ({"rows": [{"angles": [0.0]}]}, "a keyframe has angles, seconds, pause and step"),
        ({"rows": [{"angles": [0.0], "seconds": 1, "pause": 0, "step": None}]}, "a keyframe has 20 angles"),
        ({"rows": [{"angles": [1e400] * 20, "seconds": 1, "pause": 0, "step": None}]}, "is not finite"),
        ({"at": 3}, "keyframes are 0 to 0, got 3"),
        ({"at": 0, "keypoint": "l_hand", "place": [0, 1]}, "a place is three numbers"),
        ({"at": 0, "keypoint": "tail", "place": [0, 0, 0]}, "no keypoint 'tail'"),
    ],
)
def test_a_page_that_asks_for_nonsense_is_told_so(table: object, said: str, tmp_path: Path) -> None:
    with pytest.raises((UsageError, TrajectoryError, GraphError), match=said):
        KeyframeDesk(keyframe_file(tmp_path / "a.json", OP3), judge).act("pose", table)
