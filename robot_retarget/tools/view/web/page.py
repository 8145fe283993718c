"""The viewer's page: one HTML file with everything in it, that opens without a server or a network."""

import base64
import html
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_retarget.base.files import write_text
from robot_retarget.base.pages import rendered
from robot_retarget.tools.view.web.pack import Packer
from robot_retarget.tools.view.web.show import take_header
from robot_retarget.tools.view.web.take import Take, human_of

if TYPE_CHECKING:
    from robot_retarget.judge.report import Report
    from robot_retarget.solver.result import Result

ASSETS = Path(__file__).with_name("assets")
CELL = 720
"""Height of the page in a notebook's cell [pixels]."""


@dataclass(frozen=True, eq=False)
class Viewer:
    """Takes side by side on one page. In a notebook it shows itself."""

    takes: tuple[Take, ...]

    def __repr__(self) -> str:
        return f"<Viewer of {', '.join(take.title for take in self.takes)}>"

    @cached_property
    def data(self) -> bytes:
        """The packed data of the page."""
        return self.packed({})

    def packed(self, more: dict[str, Any]) -> bytes:
        """The takes, and more that the page is to know."""
        packer = Packer()
        return packer.packed({"takes": [take_header(take, packer) for take in self.takes], **more})

    @property
    def page(self) -> str:
        """The HTML."""
        return self.page_with()

    def page_with(self, touchable: bool = False, live: bool = False) -> str:
        """The HTML, with the controls for touch-ups or live poses if a server answers."""
        return rendered(
            ASSETS / "page.html",
            title=" · ".join(take.title for take in self.takes),
            style=_asset("vendor.css") + _asset("style.css"),
            modules=json.dumps({"imports": {f"#{path.stem}": _module(path) for path in sorted(ASSETS.glob("*.js"))}}),
            licences=_asset("vendor.LICENCES.txt").replace("--", "–"),
            touchable=touchable,
            live=live,
            data=base64.b64encode(self.data).decode("ascii"),
        )

    def save(self, path: str | Path) -> Path:
        """Write the page, whole or not at all.

        Raises:
            OutputError: it cannot be written.
        """
        return write_text(path, self.page)

    def _repr_html_(self) -> str:
        frame = f"width:100%;height:{CELL}px;border:0;border-radius:8px"
        return f'<iframe srcdoc="{html.escape(self.page)}" style="{frame}" allow="fullscreen"></iframe>'


def view(*shown: "Take | Result", report: "Report | None" = None) -> Viewer:
    """Look at results of `retarget`, or at takes, side by side: `.save("page.html")`, or the cell of a notebook.

    Args:
        report: of the first (`simulate`), for its badge and its simulated motion.
    """
    takes = tuple(
        what if isinstance(what, Take) else _take(what, report if k == 0 else None) for k, what in enumerate(shown)
    )
    return Viewer(takes)


def _take(result: "Result", report: "Report | None") -> Take:
    warnings = result.warnings if len(result.trajectory) > 1 else None
    return Take(
        result.robot, result.trajectory, human_of(result.match, result.motion), warnings, report, result.solution
    )


def _asset(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")


def _module(path: Path) -> str:
    """A script as an address that a page without a server can import from."""
    return "data:text/javascript;base64," + base64.b64encode(path.read_bytes()).decode("ascii")
