"""Take the pictures of the report and the viewer for the documentation: `python scripts/figures/page_pictures.py [--out FOLDER]`.

They need Chromium, chromedriver and Pillow. `run` makes the pages from sample clips.
"""

import argparse
import io
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any

from PIL import Image
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES, folder, replacing
from robot_retarget.human.surroundings import with_scene
from robot_retarget.tools.studio.studio import Studio

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
)
CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
COLOURS = 256
"""Of a picture: half of the bytes of true colours."""
DRAWN = 2.0
"""So long a page takes to draw, at most [s]."""
PICTURES = {
    "simulation": ("walk/report.html", (1160, 1010), ""),
    "viewer": (
        "walk/viewer.html",
        (1200, 1010),
        "viewer.player.seek(4.5); viewer.panel.toggle('near'); viewer.panel.toggle('edges')",
    ),
    "bodies": ("bodies.html", (1000, 700), "viewer.player.seek(4.5)"),
    "compare": ("two.html", (1200, 1140), "viewer.player.seek(2.5); viewer.panel.toggle('near')"),
}
"""Page, width and height of the window [pixels], and what happens on the page before the picture."""
SMALL = (480, 336)
"""Width and height of the small pictures of the README [pixels]."""
LARGE = (1000, 843)
"""Width and height of their window, of which the browser takes 143 in height: the page has the proportions of `SMALL` [pixels]."""
STILLS = {
    "still_report": ("walk/report.html", LARGE, ""),
    "still_touchup": ("touchup.html", LARGE, "viewer.player.seek(2.2); viewer.touch.toggle()"),
    "still_graph": (
        "clap/viewer.html",
        LARGE,
        "viewer.player.seek(2.2); viewer.panel.label(); ['near', 'keypoints', 'edges'].forEach((layer) => viewer.panel.toggle(layer))",
    ),
    "still_batch": ("set/summary.html", LARGE, ""),
}
"""Page, window and script of the small pictures."""
STUDIO = (1400, 900)
"""Width and height of the window of the studio, whose page has 757 pixels in height [pixels]."""


def main() -> None:
    """Make the pages in a folder of their own, and take the pictures."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs"))
    target = folder(parser.parse_args().out)
    with tempfile.TemporaryDirectory() as scratch, _browser() as browser:
        pages = Path(scratch)
        _pages(pages)
        for name, (page, size, script) in {**PICTURES, **STILLS}.items():
            browser.set_window_size(*size)
            browser.get((pages / page).as_uri())
            time.sleep(DRAWN)
            browser.execute_script(script)
            time.sleep(DRAWN)
            _save(browser.get_screenshot_as_png(), target / f"{name}.png", SMALL if name in STILLS else None)
        _studio(browser, pages / "studio")
        _save(browser.get_screenshot_as_png(), target / "studio.png", None)


def _studio(browser: Any, place: Path) -> None:
    """Show a clip in the studio, solved and judged, and another one in its list."""
    opened = Studio(place)
    served = opened.served(0)
    Thread(target=served.forever, daemon=True).start()
    for clip, robot in (("clap", "g1_class"), ("wave", "op3")):
        opened.bring(SAMPLES / f"{clip}.bvh", robot)
        project = [*opened.projects.values()][-1]
        opened.begin(project, project.solve, project.judge)
        while project.work.state not in ("judged", "failed"):
            time.sleep(DRAWN)
    browser.set_window_size(*STUDIO)
    browser.get(served.address)
    time.sleep(2 * DRAWN)
    browser.execute_script("viewer.player.seek(2.5)")
    time.sleep(DRAWN)
    served.close()


def _pages(pages: Path) -> None:
    """Make reports, viewers, two trajectories on one page, a page for corrections, and a folder of clips."""
    for clip in ("walk", "wave", "clap"):
        _command("run", SAMPLES / f"{clip}.bvh", "--robot", "op3", "--out", pages / clip)
    takes = [shutil.copy(pages / clip / "trajectory.npz", pages / f"{clip}.npz") for clip in ("walk", "wave")]
    _command("view", *takes, "--robot", "op3", "--static", pages / "two.html")
    _bodies(pages / "bodies.html")
    result = rr.retarget(SAMPLES / "wave.bvh", "op3", balance="off")
    (pages / "touchup.html").write_text(rr.view(result).page_with("touch"), encoding="utf-8")
    clips = folder(pages / "clips")
    for clip in SAMPLES.glob("*.bvh"):
        shutil.copy(clip, clips)
    _command("batch", clips, "--robot", "op3", "--out", pages / "set")


def _bodies(page: Path) -> None:
    """Make the viewer of a box that is lifted from a table."""
    lift = with_scene(rr.read_motion(SAMPLES / "scenes/box.bvh"), rr.read_scene(SAMPLES / "scenes/box.toml"))
    rr.view(rr.solve(rr.describe(lift, "op3"), balance="off")).save(page)


def _command(*words: str | Path) -> None:
    subprocess.run([sys.executable, "-m", "robot_retarget", *map(str, words)], check=True)


@contextmanager
def _browser() -> Iterator[Any]:
    options = Options()
    for flag in FLAGS:
        options.add_argument(flag)
    options.binary_location = str(next(filter(None, map(shutil.which, CHROMIUM)), ""))
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    try:
        yield driver
    finally:
        driver.quit()


def _save(picture: bytes, path: Path, size: tuple[int, int] | None) -> None:
    image = Image.open(io.BytesIO(picture)).convert("RGB")
    image = image.resize(size, Image.Resampling.LANCZOS) if size else image
    with replacing(path) as scratch:
        image.quantize(COLOURS, dither=Image.Dither.NONE).save(scratch, format="PNG", optimize=True)
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
