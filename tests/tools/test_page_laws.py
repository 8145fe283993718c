"""Laws of every page, with long data in a browser, wide and narrow, light and dark."""

import base64
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from browser import Tab, needs_browser, tab
from long_pages import MESSAGE, batch_page, long_keyframes, long_robot, long_studio, long_viewer, report_page
from shared_files import ROOT

from robot_retarget.robot import Robot, load_robot
from robot_retarget.tools.studio.studio import Studio
from robot_retarget.tools.view.web.keyframes import serve_keyframes
from robot_retarget.tools.view.web.live import LiveRobot

pytestmark = needs_browser
WIDTHS = 390, 1280
ROW = 300
"""Greatest height of a row [pixels]."""
CONTRAST = 4.5
"""Least contrast of text (WCAG 2.2, 1.4.3)."""
SMALLEST = 8.5
"""Least size of letters in charts [pixels]."""
FAULTS = Path(__file__).with_name("page_faults.js").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def browser() -> Iterator[Tab]:
    with tab() as opened:
        yield opened


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    found = long_robot(tmp_path_factory.mktemp("robot"))
    assert len(found.joint_names) == 40
    return found


@pytest.fixture(scope="module")
def pages(robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """The address of each page."""
    folder = tmp_path_factory.mktemp("pages")
    live = LiveRobot(load_robot("op3"), facts=lambda: FACTS)
    studio, project = long_studio(robot, folder)
    served = (
        Studio(folder / "live", live).served(0),
        studio.served(0),
        serve_keyframes(long_keyframes(robot, folder), 0),
    )
    threads = [threading.Thread(target=one.forever, daemon=True) for one in served]
    for thread in threads:
        thread.start()
    viewer = long_viewer(robot).save(folder / "viewer.html")
    yield {
        "report": report_page(robot, folder).as_uri(),
        "batch": batch_page(folder).as_uri(),
        "viewer": viewer.as_uri(),
        "live": served[0].address,
        "studio": f"{served[1].address}#{quote(project, safe='')}",
        "keyframes": served[2].address,
        "gallery": (ROOT / "docs/demo/index.html").as_uri(),
        "demo": (ROOT / "docs/demo/walk.html").as_uri(),
    }
    for one, thread in zip(served, threads, strict=True):
        one.close()
        thread.join(5)


FACTS: dict[str, Any] = {
    "state": "following",
    "source": "UDP 127.0.0.1:39539",
    "rate": 59.9,
    "latency_ms": 12.3,
    "faults": {MESSAGE: 12, "a frame that came late": 3},
}


def opened(browser: Tab, address: str, width: int, theme: str = "light") -> None:
    """A page in a window of a width, in a theme."""
    size = {"width": width, "height": 844 if width < 640 else 900, "deviceScaleFactor": 1, "mobile": width < 640}
    browser.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    features = [{"name": "prefers-color-scheme", "value": theme}]
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    if browser.driver.current_url != address:
        browser.driver.get(address)
    browser.until("return !document.getElementById('data') || document.documentElement.dataset.ready === 'yes'")


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", ["report", "batch", "viewer", "live", "studio", "keyframes", "gallery", "demo"])
def test_every_row_value_and_letter_of_a_page_with_long_data_can_be_read(
    browser: Tab, pages: dict[str, str], name: str, width: int
) -> None:
    for theme in ("light", "dark"):
        opened(browser, pages[name], width, theme)
        if name == "studio":
            browser.until("return viewer.studio.facts?.verdict && document.querySelectorAll('#clips li').length === 8")
        if name == "live":
            browser.until("return document.querySelectorAll('#live dd')[4]?.textContent.includes('× 12')")
        if name == "keyframes":
            browser.until("return Boolean(viewer.keyframes.rows) && !viewer.keyframes.busy")
        if place := os.environ.get("PICTURE"):
            picture = browser.driver.execute_cdp_cmd("Page.captureScreenshot", {"captureBeyondViewport": True})
            Path(place, f"{name}-{width}-{theme}.png").write_bytes(base64.b64decode(picture["data"]))
        assert browser.driver.execute_script(FAULTS, ROW, CONTRAST, SMALLEST) == "", (name, width, theme)


@pytest.mark.parametrize("width", [390, 900, 1280])
def test_the_state_of_a_stream_covers_no_part_of_the_robot(browser: Tab, pages: dict[str, str], width: int) -> None:
    opened(browser, pages["live"], width)
    browser.until("return document.querySelectorAll('#live dd').length > 4")
    card, scene, heading = (
        browser.run(f"return document.getElementById('{one}').getBoundingClientRect()")
        for one in ("live", "scene", "heading")
    )
    assert heading["bottom"] <= scene["top"] + 1
    assert browser.run("return document.getElementById('robot').value") == "op3"
    assert scene["height"] > 300 and scene["width"] > 0.55 * width
    assert card["left"] >= scene["right"] - 1 or card["top"] >= scene["bottom"] - 1


def test_the_table_of_a_batch_is_sorted_by_keys_too(browser: Tab, pages: dict[str, str]) -> None:
    opened(browser, pages["batch"], 1280)
    first = "return document.querySelector('#clips tbody td').textContent"
    assert browser.run(first) == "broken_0"
    browser.run("document.getElementById('find').focus()")
    browser.keys("\ue004", "\ue007")  # tab, enter: the first column, from its end
    assert browser.run(first).startswith("session_16")
    assert browser.run("return document.querySelector('#clips th').ariaSort") == "descending"
    browser.keys("\ue004", "\ue004", "\ue007")  # the state
    assert browser.run("return document.activeElement.textContent") == "state ↑" and browser.run(first).startswith(
        "session_00"
    )


def test_a_batch_of_sixteen_clips_is_a_page_of_less_than_four_thousand_pixels(
    browser: Tab, pages: dict[str, str]
) -> None:
    opened(browser, pages["batch"], 1280)
    assert browser.run("return document.documentElement.scrollHeight") < 4000


def test_a_message_of_a_clip_that_failed_stands_on_the_page_once(browser: Tab, pages: dict[str, str]) -> None:
    opened(browser, pages["batch"], 1280)
    said = browser.run("return [...document.querySelectorAll('#clips .bad')].map(clip => clip.textContent)")
    assert len(said) == 3 and all(one.count(MESSAGE) == 1 for one in said)
    assert (
        browser.run("return document.body.textContent").count(MESSAGE) == 3 + 3
    )  # the rows, and the script that makes them
