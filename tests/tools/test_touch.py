"""A touch-up in the browser: the command line reproduces the result of the mouse from the saved file."""

import re
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from browser import Tab, needs_browser, tab
from forked import run
from shared_files import ROOT

from robot_retarget.edit.touchup import Session, graph_of
from robot_retarget.human.read import read_motion
from robot_retarget.judge.rollout import simulate
from robot_retarget.robot import load_robot
from robot_retarget.tools.view.web.editor import serve_viewer
from robot_retarget.tools.view.web.take import take_of
from robot_retarget.tools.view.web.viewer import Viewer
from robot_retarget.trajectory import load_trajectory

WAVE = ROOT / "samples/wave.bvh"
SPAN = "--frames", "0:60", "--robot", "op3"
DONE = "const form = document.getElementById('touch'); return !form.classList.contains('busy') && /^\\d+ edit|^solved/.test"
DONE += "(form.querySelector('output').textContent)"


SAID = "return document.querySelector('#touch output').textContent"


def press(opened: Tab, button: str) -> None:
    """Press a button of the form and wait for the answer."""
    opened.run(f"document.querySelector('#touch output').textContent = ''; document.getElementById('{button}').click()")
    opened.until(DONE)


def command(*words: str | Path) -> None:
    """Run a command that writes its file; 1 says that an edge is not met."""
    done = run(*words)
    assert done.returncode in (0, 1), done.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("touch")
    command("solve", WAVE, *SPAN, "--balance", "off", "-o", made / "wave.npz")
    return made


@pytest.fixture(scope="module")
def opened(folder: Path) -> Iterator[Tab]:
    robot, motion = load_robot("op3"), read_motion(WAVE).frames(0, 60)
    trajectory = load_trajectory(folder / "wave.npz")
    judge = partial(simulate, robot=robot, mode="pinned", others=False)
    take = take_of(trajectory, robot, motion, report=judge(trajectory))
    session = Session(graph_of(motion, robot, trajectory), trajectory, folder / "EDITS.toml", folder / "EDITS.npz")
    served = serve_viewer(Viewer((take,)), 0, session, judge)
    thread = threading.Thread(target=served.forever, daemon=True)
    thread.start()
    with tab() as browser:
        browser.open(served.address)
        yield browser
    served.close()
    thread.join()


def drag(opened: Tab, keypoint: str, right: int, down: int) -> None:
    """Take a keypoint with the mouse and let it go elsewhere [pixels]; without a way it is a click."""
    from selenium.webdriver.common.actions.action_builder import ActionBuilder

    place = (
        f"const t = viewer.touch, p = t.at(t.keypoints.names.indexOf('{keypoint}')).project(viewer.stage.camera);"
        "const box = document.getElementById('canvas').getBoundingClientRect();"
        "const x = (p.x + 1) / 2, y = (1 - p.y) / 2;"
    )
    opened.until(place + "return 0 < x && x < 1 && 0 < y && y < 1")  # the camera follows as the page is drawn
    x, y = opened.run(place + "return [box.left + x * box.width, box.top + y * box.height]")
    act = ActionBuilder(opened.driver)
    act.pointer_action.move_to_location(round(x), round(y)).pointer_down()
    if right or down:
        act.pointer_action.move_to_location(round(x + right / 2), round(y + down / 2))
        act.pointer_action.move_to_location(round(x + right), round(y + down))
    act.pointer_action.pointer_up()
    act.perform()


@needs_browser
def test_a_touch_up_by_mouse_gives_the_file_of_the_command_line(opened: Tab, folder: Path) -> None:
    opened.run("viewer.player.seek(1)")
    opened.keys("t")
    drag(opened, "l_hand", 50, -60)
    opened.until(DONE)
    off = "const t = viewer.touch; return t.at(t.keypoints.names.indexOf('l_hand')).distanceTo(t.picks[1])"
    assert opened.run(off) < 0.01 or "joint range" in opened.run(SAID)
    assert re.search(r"· left hand \d\.\d cm from where you dropped it(?!.*hard edge)", opened.run(SAID))
    press(opened, "apply")
    assert opened.run("return viewer.touch.state.edits") == 1, "solve after a drag added its edge again"
    opened.run("document.querySelector('#touch output').textContent = ''")
    drag(opened, "l_hand", 10, 30)
    opened.until(DONE)
    assert opened.run("return viewer.touch.state.edits") == 1, "a second drag of the hand opposes the first"
    assert opened.run(off) < 0.01 or "joint range" in opened.run(SAID)
    drag(opened, "r_hand", 0, 0)
    drag(opened, "r_hip", 0, 0)
    form = "document.getElementById('relation').value = 'most'; document.getElementById('far').value = '9';"
    opened.run(form)
    press(opened, "apply")
    assert "2 edits" in opened.run(SAID) and "interval: at most 9 cm" in opened.run(SAID)
    opened.run("document.getElementById('keep').click()")
    opened.until("return document.querySelector('#touch output').textContent.startsWith('wrote')")
    given = "--motion", WAVE, "--edges", folder / "EDITS.toml"
    command("edit", "mend", folder / "wave.npz", *SPAN, *given, "-o", folder / "again.npz")
    assert (folder / "again.npz").read_bytes() == (folder / "EDITS.npz").read_bytes()
    moved = load_trajectory(folder / "EDITS.npz").qpos - load_trajectory(folder / "wave.npz").qpos
    assert np.abs(moved).max() > 0.1


@needs_browser
def test_undo_shows_what_was_and_redo_what_was_made(opened: Tab) -> None:
    from selenium.webdriver import ActionChains, Keys

    edits = "return viewer.touch.state.edits"
    made = opened.run(edits)
    poses = "return Array.from(viewer.takes[0].poses.values).reduce((sum, value) => sum + Math.abs(value), 0)"
    after = opened.run(poses)
    ActionChains(opened.driver).key_down(Keys.CONTROL).send_keys("z").key_up(Keys.CONTROL).perform()
    opened.until(f"{edits} === {made - 1}")
    opened.until(DONE)
    assert opened.run(poses) != after
    opened.run("document.getElementById('redo').click()")
    opened.until(f"{edits} === {made}")
    assert opened.run(poses) == after


@needs_browser
def test_a_verdict_is_stale_after_a_touch_up_till_it_is_passed_anew(opened: Tab) -> None:
    badge = "document.querySelector('#heading i')"
    assert opened.run(f"return {badge}.className") == "stale"
    assert "before the touch-up" in opened.run("return document.querySelector('#heading').textContent")
    opened.run("document.getElementById('judge').click()")
    opened.until(f"return {badge}.className !== 'stale'")
    assert opened.run(f"return {badge}.textContent") == opened.run("return viewer.takes[0].report.badge.text")
    edits = opened.run("return viewer.touch.state.edits")
    opened.run("viewer.touch.send('undo')")
    opened.until(f"return viewer.touch.state.edits === {edits - 1} && {badge}.className === 'stale'")
    opened.run("viewer.touch.send('redo')")
    opened.until(f"return viewer.touch.state.edits === {edits} && {badge}.className !== 'stale'")


@needs_browser
def test_what_cannot_be_is_said(opened: Tab) -> None:
    opened.run("viewer.touch.send('edit', {a: 'l_hand', b: 'tail', at: 0})")
    opened.until("return document.querySelector('#touch output.bad')?.textContent.includes(\"no keypoint 'tail'\")")


@needs_browser
def test_pages_of_others_cannot_ask(opened: Tab) -> None:
    sent = "return await fetch('edit', {method: 'POST', body: '{}'}).then(answer => answer.status)"
    assert opened.run(sent) == 403
