"""A browser without a screen for pages under test."""

import io
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from PIL import Image

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = next(filter(None, map(shutil.which, BROWSERS)), None)
DRIVER = shutil.which("chromedriver")
needs_browser = pytest.mark.skipif(
    CHROMIUM is None or DRIVER is None, reason="needs chromium and chromedriver to open pages in"
)
SIZE = 900, 760
FLAGS = (
    "--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--hide-scrollbars", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync",
    f"--window-size={SIZE[0]},{SIZE[1]}",
)  # fmt: skip
PATIENCE = 90.0
"""So long a page may take to be ready on a busy machine [s]."""


class Tab:
    """A page that is open."""

    def __init__(self, driver: Any):
        self.driver = driver

    def open(self, address: str) -> None:
        """Go to an address and wait till the viewer is ready."""
        self.driver.get(address)
        self.until("return document.documentElement.dataset.ready === 'yes'")

    def run(self, script: str) -> Any:
        """What a script returns."""
        return self.driver.execute_script(script)

    def until(self, script: str) -> None:
        """Wait till a script returns what is true."""
        began = time.monotonic()
        while not self.run(script):
            waited = time.monotonic() - began
            assert waited < PATIENCE, f"never came true: {script}\n{self.complaints()}"
            time.sleep(min(0.02 + waited / 10, 0.3))  # a question costs a browser 10 ms of a core

    def keys(self, *keys: str) -> None:
        """Press keys, one after the other."""
        from selenium.webdriver import ActionChains

        for key in keys:
            ActionChains(self.driver).send_keys(key).perform()

    def picture(self) -> np.ndarray:
        """(H, W, 3) the scene, drawn now, 0 … 255."""
        import base64

        drawn = self.run(
            "const s = viewer.stage; s.renderer.render(s.scene, s.camera); return s.renderer.domElement.toDataURL()"
        )
        image = Image.open(io.BytesIO(base64.b64decode(drawn.partition(",")[2])))
        return np.asarray(image.convert("RGB"), dtype=int)

    def changed(self, act: Callable[[], Any]) -> float:
        """The part of the scene's pixels that an act changes."""
        before = self.picture()
        act()
        return float((np.abs(self.picture() - before).max(axis=2) > 12).mean())

    def complaints(self) -> list[str]:
        """What the console holds of errors and warnings."""
        return [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")]


@contextmanager
def tab() -> Iterator[Tab]:
    """A browser of its own, closed at the end."""
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service

    options = Options()
    for flag in FLAGS:
        options.add_argument(flag)
    options.binary_location = str(CHROMIUM)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    try:
        yield Tab(driver)
    finally:
        driver.quit()
