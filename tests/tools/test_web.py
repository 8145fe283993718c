"""The viewer in a browser: everything can be seen, the time moves it, keys work, and the console is quiet."""

import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import Tab, needs_browser, tab
from made_trajectories import robot_of, swing
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES
from robot_retarget.human.match import match
from robot_retarget.human.read import read_motion
from robot_retarget.judge.rollout import simulate
from robot_retarget.robot import Robot, load_robot
from robot_retarget.robot.kinematics import body_frames
from robot_retarget.robot.timing import resample
from robot_retarget.tools.view.web.editor import serve_viewer
from robot_retarget.tools.view.web.shapes import shapes_of
from robot_retarget.tools.view.web.show import Packer, take_header
from robot_retarget.tools.view.web.take import Take, file_names, human_of, take_of
from robot_retarget.tools.view.web.viewer import Viewer, view

G1 = SHARED / "robots/unitree_g1/unitree_g1.xml"
ROBOTS = [pytest.param(("op3", 3.0), id="op3"), pytest.param((str(G1), 15.0), id="g1", marks=needs_shared)]
ARM = {"op3": "l_sho_roll", "unitree_g1": "left_shoulder_roll_joint"}
CLIP = SAMPLES / "wave.bvh"


def moved(robot: Robot) -> Take:
    """An arm that swings into the trunk, with everything that can be said of it."""
    trajectory = resample(swing(robot, ARM[robot.name], 0.9, 0.5, 2.0), robot, 20)
    motion = read_motion(CLIP)
    report = simulate(trajectory, robot, mode="pinned", others=False)
    take = take_of(trajectory, robot, report=report)
    return Take(robot, trajectory, human_of(match(motion, robot), motion), take.warnings, report)


@pytest.fixture(scope="module", params=ROBOTS)
def viewer(request: pytest.FixtureRequest) -> Viewer:
    name, most = request.param
    shown = Viewer((moved(load_robot(name)),))
    assert len(shown.page) < most * 1e6
    return shown


@pytest.fixture(scope="module")
def page(viewer: Viewer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return viewer.save(tmp_path_factory.mktemp("viewer") / "viewer.html")


@pytest.fixture(scope="module")
def opened(viewer: Viewer, page: Path) -> Iterator[Tab]:
    """The page of the OP3 as the live command serves it, that of the other robot as a file."""
    with tab() as browser:
        if viewer.takes[0].robot.name != "op3":
            browser.open(page.as_uri())
            yield browser
            return
        served = serve_viewer(viewer, 0)
        thread = threading.Thread(target=served.forever, daemon=True)
        thread.start()
        browser.open(served.address)
        yield browser
        served.close()
        thread.join()


@needs_browser
def test_robot_and_human_are_to_be_seen(opened: Tab) -> None:
    opened.run("viewer.player.seek(0)")
    for layer, least in (("robot", 0.01), ("human", 0.01)):
        hide = f"viewer.casts[0].show('{layer}', false)"
        assert opened.changed(lambda hide=hide: opened.run(hide)) > least
        opened.run(f"viewer.casts[0].show('{layer}', true)")


@needs_browser
def test_the_time_moves_them(opened: Tab) -> None:
    opened.run("viewer.player.seek(0)")
    scrub = "const bar = document.getElementById('scrub'); bar.value = 1.2; bar.dispatchEvent(new Event('input'))"
    assert opened.changed(lambda: opened.run(scrub)) > 0.003
    assert opened.run("return viewer.player.time") == pytest.approx(1.2)
    assert "1.20 /" in opened.run("return document.getElementById('clock').textContent")


@needs_browser
@pytest.mark.parametrize("layer", ["keypoints", "support", "limits", "simulated", "footholds", "near"])
def test_every_layer_appears(opened: Tab, layer: str) -> None:
    nearest = "const w = viewer.takes[0].warnings; let best = 0; w.state.values.forEach((s, k) => {"
    nearest += (
        "if (s > w.state.values[best]) best = k}); return Math.floor(best / w.pairs.length) / viewer.takes[0].fps"
    )
    opened.run(f"viewer.player.seek({opened.run(nearest)})")
    shown = opened.run(f"return viewer.panel.shown['{layer}']")
    chip = f"document.getElementById('layer-{layer}').click()"
    least = 0.0001 if layer in ("support", "footholds") else 0.0005
    if layer == "simulated":  # lies over the robot where the servos follow well
        opened.run("viewer.panel.toggle('robot')")
    assert opened.changed(lambda: opened.run(chip)) > least
    assert opened.run(f"return viewer.panel.shown['{layer}']") is not shown
    opened.run(chip)
    if layer == "simulated":
        opened.run("viewer.panel.toggle('robot')")


@needs_browser
def test_near_pairs_say_in_words_how_near_and_when(opened: Tab) -> None:
    first = opened.run("const t = viewer.takes[0]; return t.warnings.events[0].first / t.fps")
    opened.run(f"viewer.player.seek({first})")
    opened.until(
        "return [...document.querySelectorAll('#labels div:not([hidden])')]"
        ".some(e => /: contact predicted in \\d\\.\\d\\d s, -?\\d+\\.\\d cm apart$/.test(e.textContent))"
    )


@needs_browser
def test_keys_work(opened: Tab) -> None:
    def time() -> float:
        return opened.run("return viewer.player.time")

    opened.run("viewer.player.pause(); viewer.player.seek(0.5)")
    fps = opened.run("return viewer.player.fps")
    opened.keys("\ue014")  # right
    assert time() == pytest.approx(0.5 + 1 / fps)
    opened.keys("\ue012", "\ue012")  # left
    assert time() == pytest.approx(0.5 - 1 / fps)
    opened.keys("\ue010")  # end
    assert time() == pytest.approx(opened.run("return viewer.player.duration"))
    opened.keys("\ue011", " ")  # home, space
    opened.until("return viewer.player.playing && viewer.player.time > 0.05")
    opened.keys(" ")
    assert not opened.run("return viewer.player.playing")
    speed, loop = opened.run("return [viewer.player.speed, viewer.player.loop]")
    opened.keys("]", "l", "h", "3")
    assert opened.run("return viewer.player.speed") == 2 * speed
    assert opened.run("return viewer.player.loop") is not loop
    assert opened.run("return viewer.casts[0].parts.human.where") == "over"
    assert opened.run("return viewer.casts[0].parts.keypoints.visible")
    opened.keys("[", "l", "h", "h", "3")


@needs_browser
def test_curves_follow_the_time_and_a_click_in_the_scene(opened: Tab) -> None:
    opened.run("viewer.player.seek(0)")
    head = "return document.querySelector('.chart .head').style.transform"
    before = opened.run(head)
    opened.run("viewer.player.seek(1)")
    assert opened.run(head) != before
    opened.run("viewer.charts.choose(0, 2)")
    name = opened.run("return viewer.takes[0].joints.names[2]")
    assert name in opened.run("return document.querySelector('.chart figcaption').textContent")


@needs_browser
def test_the_console_stays_quiet(opened: Tab) -> None:
    assert not [line for line in opened.complaints() if "GPU stall" not in line and "WebGL-" not in line]


@needs_browser
def test_takes_stand_side_by_side(tmp_path: Path) -> None:
    first = replace(moved(load_robot("op3")), name="first.npz")
    with tab() as browser:
        browser.open(Viewer((first, replace(first, name="other.npz"))).save(tmp_path / "two.html").as_uri())
        apart = browser.run("const [a, b] = viewer.casts; return a.position.distanceTo(b.position)")
        assert apart > 0.5
        for k in (0, 1):
            hide = f"viewer.casts[{k}].show('robot', false)"
            assert browser.changed(lambda hide=hide: browser.run(hide)) > 0.005
        curves = browser.run("return document.querySelector('.chart .u-legend').textContent")
        assert "first.npz" in curves and "other.npz" in curves
        assert outside(browser) == 0
        assert not browser.complaints()


def outside(browser: Tab) -> int:
    """Number of corners (a fifth of them) of the robots' shapes, at both ends of the motion, that the camera does not see."""
    return browser.run(
        "viewer.panel.onreset(); let count = 0; const camera = viewer.stage.camera;"
        "for (const time of [0, viewer.player.duration]) { viewer.player.seek(time); camera.updateMatrixWorld();"
        "  for (const cast of viewer.casts) { cast.updateMatrixWorld(true);"
        "    for (const mesh of cast.parts.robot.children) { const { position } = mesh.geometry.attributes, point = cast.position.clone();"
        "      for (let k = 0; k < position.count; k += 5) {"
        "        point.fromBufferAttribute(position, k).applyMatrix4(mesh.matrixWorld).project(camera);"
        "        count += Math.abs(point.x) > 1 || Math.abs(point.y) > 1; } } } } return count"
    )


@pytest.fixture(scope="module")
def solved() -> Viewer:
    return view(rr.retarget(read_motion(CLIP).frames(40, 70), load_robot("op3"), balance="off"))


def test_edges_come_in_order_of_their_cost_over_the_clip(solved: Viewer) -> None:
    packer, (take,) = Packer(), solved.takes
    edges = take_header(take, packer)["stress"]["edges"]
    assert take.solution is not None
    keypoints = take.solution.graph.match.keypoints
    cost = {
        (kind, a, b): take.solution.edge_stress(kind)[:, k].sum()
        for kind in take.solution.measured
        for k, (a, b) in enumerate(take.solution.graph.kinds[kind].ends)
        if a in keypoints and b in keypoints and not take.solution.graph.kinds[kind].axes
    }
    assert [cost[ends] for ends in edges["ends"]] == sorted(cost.values(), reverse=True)[: len(edges["ends"])]


@needs_browser
def test_five_edges_are_shown_with_what_they_ask_for_until_more_are_chosen(solved: Viewer, tmp_path: Path) -> None:
    seen = "return viewer.casts[0].parts.edges.ends.filter(Number.isFinite).length / 6"
    with tab() as browser:
        browser.open(solved.save(tmp_path / "edges.html").as_uri())
        assert browser.run("return document.getElementById('edge-count').hidden")
        browser.run("document.getElementById('layer-edges').click()")
        assert browser.run(seen) == 5
        words = "[...document.querySelectorAll('#labels .edge, #labels .alarm')].map(e => e.textContent)"
        browser.until(f"return {words}.filter(text => /cm, target .* cm$/.test(text)).length >= 5")
        assert not browser.run(f"return {words}.some(text => text.includes('_hand'))")
        browser.run(
            "const c = document.getElementById('edge-count'); c.value = 15; c.dispatchEvent(new Event('change'))"
        )
        assert browser.run(seen) == 15
        assert not browser.complaints()


@needs_browser
def test_a_view_is_saved_as_a_picture_and_the_motion_as_a_film(opened: Tab) -> None:
    opened.run(
        "window.made = {}; viewer.player.seek(1); viewer.exported.picture().then(blob => window.made.picture = blob)"
    )
    opened.until("return window.made.picture?.type === 'image/png' && window.made.picture.size > 10000")
    opened.run("viewer.player.setSpeed(4); viewer.exported.film().then(blob => window.made.film = blob)")
    opened.until("return window.made.film?.type.startsWith('video/') && window.made.film.size > 1000")
    assert opened.run("return viewer.player.loop && !viewer.player.playing")
    opened.run("viewer.player.setSpeed(1)")


@needs_browser
def test_a_film_waits_for_an_encoder_that_is_slower_than_the_motion(opened: Tab) -> None:
    opened.run(
        "window.timer = setTimeout; window.setTimeout = call => timer(call, 0); window.made = {};"
        "viewer.player.setSpeed(400); viewer.exported.film().then(blob => window.made.film = blob)"
    )
    opened.until("return window.made.film")
    assert opened.run("return window.made.film.size") > 1000
    opened.run("window.setTimeout = timer; viewer.player.setSpeed(1)")


@needs_browser
def test_the_dark_theme_darkens_page_scene_and_curves(opened: Tab) -> None:
    ink = "return viewer.charts.plots[0].plot.axes[0].stroke()"

    def theme(name: str) -> tuple[float, str]:
        media = {"features": [{"name": "prefers-color-scheme", "value": name}]}
        opened.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
        opened.until(f"{ink} === getComputedStyle(document.documentElement).getPropertyValue('--ink').trim()")
        return float(opened.picture().mean()), opened.run(ink)

    light, dark, again = theme("light"), theme("dark"), theme("light")
    assert dark[0] < 0.5 * light[0] and dark[1] != light[1] and again[1] == light[1]


def test_a_robot_without_any_geom_is_shown_by_its_links(tmp_path: Path) -> None:
    spec = load_robot("op3").spec()
    for element in [*spec.geoms, *spec.meshes, *spec.sensors, *spec.keys, *spec.excludes]:
        spec.delete(element)
    robot = robot_of(spec.to_xml(), tmp_path / "bare.xml")
    places, turns = (poses[0] for poses in body_frames(robot, robot.standing()[None]))
    shapes = shapes_of(robot)
    assert len(shapes) == robot.model.nbody - 2
    for body, shape in enumerate(shapes, start=2):
        axis = Rotation.from_quat(shape.quaternion, scalar_first=True).apply([0, 0, shape.size[1]])
        ends = [places[shape.body] + turns[shape.body] @ (shape.position + sign * axis) for sign in (-1, 1)]
        np.testing.assert_allclose(ends, [places[robot.model.body_parentid[body]], places[body]], atol=1e-6)


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (("a/wave.npz", "b/clap.npz"), ["wave.npz", "clap.npz"]),
        (("a/run.npz", "b/run.npz"), ["a/run.npz", "b/run.npz"]),
        (("run.npz", "run.npz"), ["run.npz", "run.npz"]),
    ],
)
def test_takes_are_named_by_their_files_with_the_folders_that_tell_them_apart(
    paths: tuple[str, ...], names: list[str]
) -> None:
    assert file_names([Path(path) for path in paths]) == names


def test_the_page_asks_for_nothing_from_elsewhere(page: Path) -> None:
    text = page.read_text()
    head = text[: text.index('<script type="application/octet-stream"')]
    assert "src=" not in head.split("<script")[0] and 'href="http' not in head and "@import" not in head
    assert "MIT License" in text


def test_arrays_come_back_from_a_page_as_they_went_in() -> None:
    import gzip
    import json

    rng = np.random.default_rng(0)
    values = rng.normal(size=(50, 4, 3)).cumsum(axis=0)
    values[7, 2] = np.nan
    packer = Packer()
    data = gzip.decompress(packer.packed({"a": packer.add(values, 1e-3), "b": packer.add(values * 100, 1e-3)}))
    size = int.from_bytes(data[:4], "little")
    for name, scale in (("a", 1), ("b", 100)):
        entry = json.loads(data[4 : 4 + size])[name]
        kind = np.dtype(f"<{entry['type']}")
        whole = np.frombuffer(data, kind, int(np.prod(entry["shape"])), 4 + size + entry["offset"]).reshape(
            entry["shape"]
        )
        with np.errstate(over="ignore"):
            summed = np.cumsum(whole, axis=0, dtype=kind)
        found = np.where(summed == np.iinfo(kind).min, np.nan, summed * entry["step"])
        np.testing.assert_allclose(found, scale * values, atol=0.51e-3)
