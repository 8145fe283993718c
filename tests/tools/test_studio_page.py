"""The studio in a browser: from a dropped file to an exported one, with everything between done by mouse and keys."""

import shlex
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Tab, needs_browser, tab
from forked import run
from studio_page import Opened, opened_studio, short_clip

import robot_retarget as rr

pytestmark = needs_browser
DROP = (
    "const t = new DataTransfer(); t.items.add(new File([arguments[1]], arguments[0]));"
    "document.dispatchEvent(new DragEvent('drop', { dataTransfer: t, bubbles: true, cancelable: true }))"
)
STATE = "return viewer.studio.facts?.solved && viewer.studio.line?.state === '{}'"


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Opened]:
    with opened_studio(tmp_path_factory.mktemp("studio")) as found:
        yield found


@pytest.fixture(scope="module")
def page(studio: Opened) -> Iterator[Tab]:
    with tab() as browser:
        browser.driver.set_window_size(1400, 860)
        browser.open(studio.served.address)
        yield browser


def drop(page: Tab, path: Path) -> None:
    page.driver.execute_script(DROP, path.name, path.read_text(encoding="utf-8"))


def choose(page: Tab, label: str, value: str) -> None:
    """Choose a value of the select with a label."""
    page.driver.execute_script(
        "const s = document.querySelector(`select[aria-label='${arguments[0]}']`); s.value = arguments[1]; s.dispatchEvent(new Event('change'))",
        label,
        value,
    )


def test_a_file_that_is_no_motion_is_refused_on_the_page(page: Tab, tmp_path: Path) -> None:
    bad = tmp_path / "notes.txt"
    bad.write_text("no motion")
    drop(page, bad)
    page.until("return document.getElementById('message').textContent.includes('notes.txt')")
    assert page.run("return document.getElementById('message').checkVisibility()")


def test_a_folder_without_files_is_refused_on_the_page(page: Tab) -> None:
    page.run("document.dispatchEvent(new DragEvent('drop', { dataTransfer: new DataTransfer(), cancelable: true }))")
    page.until("return document.getElementById('message').textContent.includes('holds no file')")


def test_a_clip_is_dropped_mended_touched_up_judged_and_exported_as_the_shell_does(
    studio: Opened, page: Tab, tmp_path: Path
) -> None:
    page.until("return document.querySelector('#robot option[value=g1_class]') !== null")
    page.run("document.getElementById('robot').value = 'g1_class'")
    drop(page, short_clip(tmp_path))
    page.until("return viewer.takes.length === 1 && viewer.takes[0].human !== null")
    page.until(STATE.format("solved"))
    choose(page, "left hand of the human", "LeftElbow")
    page.until("return viewer.studio.facts.keypoints.find((row) => row.name === 'l_hand').human === 'LeftElbow'")
    page.until(STATE.format("solved"))
    (project,) = studio.studio.projects.values()
    assert project.map_file is not None and 'l_hand = "LeftElbow"' in project.map_file.read_text(encoding="utf-8")
    before = _dragged(page)
    page.until("return viewer.touch.state?.edits === 1")
    after = page.run("return viewer.touch.at(viewer.touch.keypoints.names.indexOf('l_hand')).toArray()")
    assert abs(after[2] - before[2]) > 0.01, (before, after)
    page.run("document.getElementById('judge-it').click()")
    page.until("return viewer.studio.facts?.verdict")
    page.run("document.getElementById('fold-away').open = true; document.getElementById('export').scrollIntoView()")
    page.run("document.getElementById('export').click()")
    page.until("return document.getElementById('message').textContent.includes('downloads')")
    assert 0 < page.run("return document.getElementById('message').getBoundingClientRect().top") < 200
    exported = studio.asked("export", project=project.key, format="mjlab")
    lines = page.run("return document.getElementById('commands').textContent").splitlines()
    for line in [*lines[1:-1], lines[-1].replace("--format csv", "--format mjlab").replace(".csv", ".mjlab.npz")]:
        assert run(*shlex.split(line)[1:]).returncode in (0, 1), line
    assert (project.place / "mended.mjlab.npz").read_bytes() == exported
    assert [said for said in page.complaints() if "status of 400" not in said] == []


def _dragged(page: Tab) -> list[float]:
    """Drag the left hand 60 pixels up; return where it was [m]."""
    from selenium.webdriver import ActionChains

    page.run("viewer.touch.toggle(); viewer.player.seek(0.4)")
    time.sleep(0.3)  # the form takes room from the picture
    page.run("viewer.stage.drawn().then(() => (window.drew = true))")
    page.until("return window.drew")
    x, y, *place = page.run(
        "const t = viewer.touch, at = t.at(t.keypoints.names.indexOf('l_hand')), p = at.clone().project(viewer.stage.camera);"
        "const b = viewer.stage.renderer.domElement.getBoundingClientRect();"
        "return [b.left + (p.x + 1) / 2 * b.width, b.top + (1 - p.y) / 2 * b.height, ...at]"
    )
    actions = ActionChains(page.driver)
    actions.w3c_actions.pointer_action.move_to_location(round(x), round(y)).pointer_down()
    actions.w3c_actions.pointer_action.move_to_location(round(x), round(y) - 30).move_to_location(
        round(x), round(y) - 60
    ).pointer_up()
    actions.perform()
    return place


def test_a_second_browser_sees_the_same_clips(studio: Opened, page: Tab) -> None:
    with tab() as other:
        other.open(studio.served.address)
        other.until("return viewer.studio.lines.length === 1")
        key = other.run("return viewer.studio.lines[0].key")
        other.until("return viewer.takes.length === 1 && location.hash.length > 1")
        assert rr.load_trajectory(studio.studio.project(key).trajectory_file).robot == "g1_class"


def test_a_file_that_is_left_out_is_named_beside_the_clip_that_came_with_it(page: Tab, tmp_path: Path) -> None:
    short_clip(tmp_path).rename(tmp_path / "second.bvh")
    files = [["broken.bvh", "HIERARCHY x"], ["second.bvh", (tmp_path / "second.bvh").read_text(encoding="utf-8")]]
    page.driver.execute_script(
        "const t = new DataTransfer(); arguments[0].forEach(([name, text]) => t.items.add(new File([text], name)));"
        "document.dispatchEvent(new DragEvent('drop', { dataTransfer: t, bubbles: true, cancelable: true }))",
        files,
    )
    page.until("return viewer.studio.line?.clip === 'second.bvh' && viewer.studio.facts && viewer.takes.length === 1")
    assert "broken.bvh" in page.run("return document.getElementById('message').textContent")


def test_every_control_is_reached_by_keys_and_has_a_name(page: Tab) -> None:
    page.run("document.querySelectorAll('details').forEach((fold) => (fold.open = true))")
    nameless = page.run(
        "return [...document.querySelectorAll('button, select, input:not([type=file]), a')].filter((e) => e.checkVisibility() &&"
        "!(e.ariaLabel || e.getAttribute('aria-label') || e.textContent.trim() || e.title || e.closest('label') || e.labels?.length))"
        ".map((e) => e.outerHTML.slice(0, 80))"
    )
    assert nameless == []
    assert page.run("return [...document.querySelectorAll('[tabindex]')].every((e) => e.tabIndex <= 0)")
