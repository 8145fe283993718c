"""The report's page opens offline in a browser, without errors, with its charts to be seen."""

import base64
import io
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from made_trajectories import hold, swing
from PIL import Image

from robot_retarget.base.errors import TrajectoryError
from robot_retarget.collision import warnings_of
from robot_retarget.judge.playback import Playback, roll_out
from robot_retarget.judge.report import Report, SimulatedTrajectory, build_report
from robot_retarget.judge.rollout import plant_of, simulate
from robot_retarget.judge.verdict import Thresholds
from robot_retarget.robot import load_robot
from robot_retarget.robot.contacts import replay_contacts
from robot_retarget.tools.view.charts import MEASURED, PLAIN, WANTED
from robot_retarget.tools.view.film import LOOP_FPS, MOST_PICTURES, AnimatedWebP, loop
from robot_retarget.tools.view.page import save_page
from robot_retarget.tools.view.picture import Picture, Unavailable
from robot_retarget.trajectory import Trajectory, fingerprint

OP3 = load_robot("op3")
SHORT = Playback(settle_after=0.0)
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="needs a Chromium to open the page in")
QUIET = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--enable-logging=stderr",
    "--window-size=1180,3600",
]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A motion that fails, on its feet: an arm swings through the trunk."""
    folder = tmp_path_factory.mktemp("page")
    moved = swing(OP3, "l_sho_roll", 0.9, 0.5, 2.0)
    warnings = warnings_of(moved, OP3)
    report = simulate(moved, OP3, mode="free", draws=0, warnings=warnings, others=False)
    red = Picture(np.full((20, 60, 3), (200, 30, 60), np.uint8))
    film = loop(OP3, moved)
    written = save_page(report, judged(report), folder / "report.html", warnings=warnings, strip=red, film=film)
    assert written == folder / "report.html"
    return folder / "report.html"


def judged(report: Report) -> Trajectory:
    """The trajectory with the goals that the report is of."""
    assert report.trajectory is not None
    return report.trajectory


def opened(path: Path, folder: Path) -> tuple[str, np.ndarray]:
    """What a browser says of a page, and the page as it shows it."""
    shot = folder / "shot.png"
    command = [str(CHROMIUM), *QUIET, f"--user-data-dir={folder / 'profile'}", f"--screenshot={shot}", path.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    return done.stderr, np.asarray(Image.open(shot).convert("RGB"), dtype=int)


def count(pixels: np.ndarray, colour: str) -> int:
    rgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)])
    return int((np.abs(pixels - rgb).max(axis=2) < 24).sum())


@needs_chromium
def test_a_browser_shows_every_chart_without_a_word_of_complaint(page: Path, tmp_path: Path) -> None:
    said, pixels = opened(page, tmp_path)
    assert "CONSOLE" not in said
    assert count(pixels, MEASURED) > 4000 and count(pixels, PLAIN) > 1500 and count(pixels, WANTED) > 2000
    assert count(pixels, "#c81e3c") > 1000  # the picture


@needs_chromium
def test_a_page_with_an_error_would_be_noticed(tmp_path: Path) -> None:
    broken = tmp_path / "broken.html"
    broken.write_text("<script>missing()</script>", encoding="utf-8")
    said, pixels = opened(broken, tmp_path)
    assert "CONSOLE" in said and count(pixels, MEASURED) == 0


def test_the_page_asks_nothing_of_the_network_and_runs_no_script(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    sources = re.findall(r"""(?:src|href)\s*=\s*["']([^"']*)""", text)
    assert sources and all(source.startswith(("data:", "#")) for source in sources)
    assert "<script" not in text and "@import" not in text and "url(http" not in text


def test_the_verdict_comes_first_and_every_reason_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert text.index('class="badge">fail') < text.index("limits kept")
    assert "overlap by up to" in text and "✗" in text
    assert (
        "What helps: solve it again within ranges and with its links apart<code>" in text[: text.index("limits kept")]
    )
    drawn = re.findall(r'<svg[^>]*id="([\w-]+)"', text)
    assert drawn[6:] == ["errors", "torques", "balance", "margin", "timeline"]
    assert all(name.startswith("tracking-") for name in drawn[:6])


def folded(text: str) -> tuple[str, str]:
    """The section on limits: exceeded limits are shown, all others are folded."""
    section = re.search(r'<section class="checks">(.*?)</section>', text, re.DOTALL)
    assert section
    view, _, rest = section[1].partition("<details")
    return view, rest


def test_a_broken_limit_is_in_full_view_and_the_others_are_folded(page: Path) -> None:
    view, rest = folded(page.read_text(encoding="utf-8"))
    broken, every = view.count('<tr><td class="no"'), rest.count("<tr><td class=")
    assert broken == rest.count('<tr><td class="no"') > 0 and 'class="yes"' not in view
    assert f"{every - broken} of {every} limits kept" in view and "<details open" not in view + rest


def test_limits_that_are_all_kept_are_one_line(tmp_path: Path) -> None:
    report = simulate(hold(OP3, 0.2), OP3, others=False)
    save_page(report, judged(report), tmp_path / "report.html")
    view, rest = folded((tmp_path / "report.html").read_text(encoding="utf-8"))
    every = rest.count('<tr><td class="yes"')
    assert (
        report.verdict == "pass" and not view.strip() and f"<summary>{every} of {every} limits kept</summary>" in rest
    )


def test_angles_are_in_degrees_only(page: Path) -> None:
    shown = re.sub(r"data:[^'\"]*", "", page.read_text(encoding="utf-8"))
    assert not re.search(r"\brad\b", shown) and "rms error [°]" in shown


def test_the_film_is_in_the_head_and_plays_the_whole_motion_again_and_again(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    found = re.search(r'src="data:image/webp;base64,([^"]*)"', text[: text.index("</header>")])
    assert found
    with Image.open(io.BytesIO(base64.b64decode(found[1]))) as film:
        assert film.info["loop"] == 0 and getattr(film, "n_frames", 1) == 20


def test_a_longer_motion_is_shown_faster_in_as_many_pictures() -> None:
    film = loop(OP3, hold(OP3, 30.0))
    assert isinstance(film, AnimatedWebP) and film.pace == pytest.approx(30.0 * LOOP_FPS / MOST_PICTURES, rel=0.01)
    with Image.open(io.BytesIO(film.data)) as pictures:
        assert getattr(pictures, "n_frames", 1) <= MOST_PICTURES  # equal pictures become one


def test_a_film_that_cannot_be_drawn_is_replaced_by_a_sentence(tmp_path: Path) -> None:
    report = simulate(hold(OP3, 0.2), OP3, others=False)
    save_page(report, judged(report), tmp_path / "report.html", film=Unavailable("pictures need Pillow"))
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "No film: pictures need Pillow." in text[: text.index("</header>")]


def test_the_dark_theme_knows_every_colour_of_the_charts(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    dark = re.search(r"prefers-color-scheme: dark\) \{(.*?)\n\}", text, re.DOTALL)
    assert dark
    used = set(re.findall(r"var\((--\w+), #", text))
    assert used and used <= set(re.findall(r"(--\w+):", dark[1]))
    assert not re.search(r"(?:fill|stroke): #[0-9a-f]{6}", text[text.index("<svg") :])


def test_a_report_links_to_the_viewer_that_lies_beside_it(tmp_path: Path) -> None:
    still, beside = hold(OP3, 0.2), tmp_path / "viewer.html"
    report = simulate(still, OP3, others=False)
    assert report.trajectory is not None
    for there in (False, True):
        save_page(report, report.trajectory, tmp_path / "report.html", viewer=beside)
        assert ('href="viewer.html"' in (tmp_path / "report.html").read_text(encoding="utf-8")) is there
        beside.write_text("")


def test_ids_of_the_charts_do_not_meet(page: Path) -> None:
    ids = re.findall(r'\bid="([^"]+)"', page.read_text(encoding="utf-8"))
    clips = [name for name in ids if len(name) == 11 and name.startswith("p")]
    assert len(clips) == len(set(clips)) > 0


def test_what_people_called_their_files_is_only_text(tmp_path: Path) -> None:
    from dataclasses import replace

    named = replace(hold(OP3, 0.2), source="<script>alert(1)</script>")
    report = simulate(named, OP3, others=False)
    save_page(report, judged(report), tmp_path / "report.html")
    assert "<script" not in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_a_report_of_another_trajectory_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TrajectoryError, match="of another trajectory"):
        save_page(simulate(hold(OP3, 0.2), OP3, others=False), hold(OP3, 0.4), tmp_path / "report.html")
    assert not list(tmp_path.iterdir())


def test_a_simulation_that_broke_down_at_once_still_has_a_page(tmp_path: Path) -> None:
    from dataclasses import replace

    moved = hold(OP3, 0.2)
    report = simulate(moved, OP3, others=False)
    bare = replace(report, verdict="fail", reasons=("the simulation broke down at -1 s",), series={})
    save_page(bare, judged(report), tmp_path / "report.html")
    assert "broke down" in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(("reached", "plainly"), [(0.3, 0.6), (0.6, 0.3)])
def test_a_simulation_that_broke_down_before_the_other_has_a_page(
    tmp_path: Path, reached: float, plainly: float
) -> None:
    moved, plant = hold(OP3, 0.6), plant_of(OP3, "pinned")
    rollout, plain = (roll_out(plant, hold(OP3, seconds), "pinned", SHORT) for seconds in (reached, plainly))
    played = SimulatedTrajectory(moved, plant, "pinned", replay_contacts(OP3, moved.qpos), rollout, plain)
    report = build_report(played, fingerprint(moved), Thresholds())
    assert report.series["plain"].shape == report.series["wanted"].shape
    assert np.isnan(report.series["plain"]).any() == (plainly < reached)
    save_page(report, moved, tmp_path / "report.html")
    assert "Tracking" in (tmp_path / "report.html").read_text(encoding="utf-8")
