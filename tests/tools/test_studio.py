"""The studio gives the same bytes as the shell and Python, refuses bad files with a reason, and stops when it is told to."""

import io
import json
import os
import shlex
import signal
import socket
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from forked import run
from shared_files import ROOT
from studio_page import Opened, opened_studio, short_clip

import robot_retarget as rr
from robot_retarget.base.files import SAMPLES
from robot_retarget.tools.studio.facts import marks_of
from robot_retarget.tools.studio.uploads import plain_name
from robot_retarget.tools.view.web import serve as web


@pytest.fixture(scope="module")
def wave(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip of 24 frames of the sample."""
    return short_clip(tmp_path_factory.mktemp("clip"))


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Opened]:
    with opened_studio(tmp_path_factory.mktemp("studio")) as found:
        yield found


def shell(line: str) -> None:
    words = shlex.split(line)
    if words[0] == "mkdir":
        return
    done = run(*words[1:])
    assert done.returncode in (0, 1), done.stderr


def without_speed(report: bytes) -> dict[str, object]:
    """The figures of a report but for how quickly they were simulated, which is no fact of the motion."""
    return {name: value for name, value in json.loads(report)["figures"].items() if name != "steps_per_second"}


def test_studio_shell_and_python_give_the_same_bytes(opened: Opened, wave: Path, tmp_path: Path) -> None:
    project = opened.solved(wave, "g1_class")
    assert "costly edge" in {mark["kind"] for mark in marks_of(project, project.take)}
    opened.do(project, "judge")
    trajectory, report = (project.place / name for name in ("trajectory.npz", "report.pinned.json"))
    ours, figures = trajectory.read_bytes(), without_speed(report.read_bytes())
    exported = opened.asked("export", project=project.key, format="mjlab")
    *lines, last = project.commands()
    for line in [*lines, last.replace("--format csv", "--format mjlab").replace(".csv", ".mjlab.npz")]:
        shell(line)
    assert (project.place / "trajectory.mjlab.npz").read_bytes() == exported
    assert trajectory.read_bytes() == ours and without_speed(report.read_bytes()) == figures
    made = rr.simulate(rr.retarget(project.motion_file, "g1_class")).trajectory
    assert made is not None and made.save(tmp_path / "python.npz").read_bytes() == ours


def test_choices_a_map_and_edges_give_the_bytes_of_the_commands_that_the_page_names(opened: Opened, wave: Path) -> None:
    project = opened.solved(wave, "g1_class")
    project.choices |= {"favour": "directions", "speed": "0.8", "trim": "0:0.5"}
    opened.asked("do", b'{"what": "mend", "value": ["human", "l_hand", "LeftElbow"]}', project=project.key)
    opened.do(project, "kinds", ["touch"])
    assert project.work.state == "solved", project.line()
    mended = opened.asked("edit", json.dumps(EDGE).encode(), project=project.key)
    assert mended
    opened.do(project, "judge")
    files = "trajectory.npz", "mended.npz"
    ours = {name: (project.place / name).read_bytes() for name in files}
    for line in project.commands()[:-1]:
        shell(line)
    assert {name: (project.place / name).read_bytes() for name in files} == ours


EDGE = {"a": "l_hand", "b": [0.3, 0.3, 1.2], "at": 0, "frames": [5, 9], "priority": 1e4}


def test_a_studio_that_is_started_again_shows_the_clips_of_its_folder(
    wave: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with opened_studio(tmp_path) as first:
        project, removed = (first.studio.project(first.drop(wave, "g1_class")["projects"][0]) for _ in range(2))
        first.do(removed, "remove")
        first.do(project, "solve", {"favour": "directions"})
        first.asked("edit", json.dumps(EDGE).encode(), project=project.key)
        first.do(project, "judge")
        line, commands, qpos = project.line(), project.commands(), project.take.trajectory.qpos
    with opened_studio(tmp_path) as again:
        again.studio.reopen()
        again.studio.bring(wave, "g1_class")
        ((key, found),) = again.studio.projects.items()
        again.wait(found)
        assert found.line() == line | {"version": found.version, "left": None} and key == project.key
        assert found.commands() == commands and (found.take.trajectory.qpos == qpos).all()
        again.asked("undo", b"{}", project=key)
        assert (found.take.trajectory.qpos != qpos).any()
        (found.place / "project.json").write_text("{}")
    with opened_studio(tmp_path) as broken:
        broken.studio.reopen()
        assert "project.json is left out" in capsys.readouterr().err and not broken.studio.projects


def test_two_clips_at_once_have_the_bytes_of_each_alone(opened: Opened, wave: Path) -> None:
    alone = (opened.solved(wave, "g1_class").place / "trajectory.npz").read_bytes()
    both = [opened.studio.project(opened.drop(wave, "g1_class")["projects"][0]) for _ in range(2)]
    for project in both:
        opened.wait(project)
        assert (project.place / "trajectory.npz").read_bytes() == alone


def test_the_human_is_there_before_a_second_and_the_robot_before_five(opened: Opened) -> None:
    opened.studio.robot("op3")
    began = time.monotonic()
    project = opened.studio.project(opened.drop(SAMPLES / "walk.bvh")["projects"][0])
    human = opened.asked("take", project=project.key)
    shown = time.monotonic() - began
    while project.version < 3:
        time.sleep(0.02)
    moved = opened.asked("take", project=project.key)
    drafted = time.monotonic() - began
    opened.asked("do", b'{"what": "remove"}', project=project.key)
    assert human != moved
    assert shown < 1.0 * SLOW and drafted < 5.0 * SLOW, (shown, drafted)


SLOW = 3.0
"""How much slower a busy machine of a test may be than a quiet one [-]."""


def test_a_solve_is_stopped_and_begun_again(opened: Opened) -> None:
    project = opened.studio.project(opened.drop(SAMPLES / "walk.bvh")["projects"][0])
    while project.work.state != "solving":
        time.sleep(0.02)
    opened.do(project, "stop")
    assert project.work.state == "stopped" and opened.refusal("export", project=project.key, format="csv")[0] == 400
    assert not (project.place / "trajectory.npz").exists()
    opened.asked("do", b'{"what": "solve", "value": {"balance": "off"}}', project=project.key)
    began, work = time.monotonic(), project.work
    opened.do(project, "stop")
    assert work.state == "stopped" and time.monotonic() - began < 5


@pytest.mark.parametrize(
    ("value", "reason"),
    [({"balance": "perhaps"}, "balance"), ({"speed": "quick"}, "speed"), ({"colour": "red"}, "colour"), (7, "")],
)
def test_a_choice_that_is_none_is_refused_with_a_reason(opened: Opened, wave: Path, value: object, reason: str) -> None:
    project = opened.solved(wave, "g1_class")
    message = json.dumps({"what": "solve", "value": value}).encode()
    status, said = opened.refusal("do", message, project=project.key)
    assert status in (400, 500) and reason in said


def zip_of(**files: str | bytes) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, content in files.items():
            archive.writestr(name.replace("__", "/"), content)
    return packed.getvalue()


def climbing(name: str) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("walk.bvh", (SAMPLES / "walk.bvh").read_bytes())
        archive.writestr(name, "out")
    return packed.getvalue()


MESHED = "<mujoco><asset><mesh name='m' file='meshes/m.stl'/></asset><worldbody><body><freejoint/><geom mesh='m' type='mesh'/></body></worldbody></mujoco>"
BOX = "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("notes.txt", b"no motion", "notes.txt"),
        ("walk.bvh", b"HIERARCHY\nROOT", "walk.bvh"),
        ("photo.png", b"\x89PNG\r\n\x1a\n" + bytes(600), "photo.png: unknown kind"),
        ("empty.zip", zip_of(), "empty.zip holds no motion (.bvh"),
        ("texts.zip", zip_of(read="me"), "no robot (.xml"),
        ("alone.xml", MESHED.encode(), "with the meshes"),
        ("broken.zip", b"PK\x03\x04 and no more", "broken.zip"),
        ("box.xml", BOX.encode(), "box"),
        ("climbs.zip", climbing("../../evil.txt"), "leads out"),
        ("roots.zip", climbing("/tmp/evil.txt"), "leads out"),
        ("windows.zip", climbing("C:\\evil.txt"), "leads out"),
        ("backwards.zip", climbing("a\\..\\..\\evil.txt"), "leads out"),
    ],
)
def test_a_file_that_is_none_is_refused_with_a_reason_and_leaves_nothing(
    opened: Opened, tmp_path: Path, name: str, content: bytes, reason: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    before, projects = sorted(opened.studio.place.rglob("*")), dict(opened.studio.projects)
    status, said = opened.refusal("drop", content, name=name, robot="op3")
    assert status == 400 and reason in said, said
    assert str(opened.studio.place) not in said and said.count(name) < 2, said
    assert sorted(opened.studio.place.rglob("*")) == before and opened.studio.projects == projects


def test_a_file_that_is_too_large_is_refused_before_it_is_read(opened: Opened, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web, "LARGEST", 1000)
    head = f"POST /drop?token={opened.served.token}&name=large.bvh HTTP/1.1\r\nHost: localhost\r\nContent-Length: 500000000\r\n\r\n"
    with socket.create_connection(("127.0.0.1", opened.served.port), 5) as wire:
        wire.sendall(head.encode())
        answer = wire.recv(4096).decode()
    assert " 413 " in answer.splitlines()[0]
    status, said = opened.refusal("drop", b"x" * 2000, name="large.bvh", robot="op3")
    assert status in (400, 413) and "large.bvh has more than" in said


def test_a_zip_of_clips_is_a_list_of_clips(opened: Opened, wave: Path, tmp_path: Path) -> None:
    path = tmp_path / "two.zip"
    path.write_bytes(zip_of(**{"a__one.bvh": wave.read_bytes(), "a__two.bvh": wave.read_bytes(), "read.txt": "me"}))
    keys = opened.drop(path, "g1_class")["projects"]
    assert [key.split("/")[-1] for key in keys] == ["one.bvh@g1_class", "two.bvh@g1_class"]
    for key in keys:
        opened.wait(opened.studio.project(key))


def test_a_robot_of_a_zip_is_chosen_and_followed(opened: Opened, wave: Path, tmp_path: Path) -> None:
    folder = ROOT / "models/g1_class"
    path = tmp_path / "my robot.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for each in folder.rglob("*"):
            archive.write(each, Path("robot") / each.relative_to(folder))
        archive.writestr("robot/a.xml", '<mujoco><include file="g1_class.xml"/></mujoco>')
    name = opened.drop(path)["robot"]
    project = opened.solved(wave, name)
    other = tmp_path / "g1_class.zip"
    other.write_bytes(path.read_bytes())
    assert [opened.drop(other)["robot"] for _ in range(2)] == ["my_g1_class", "g1_class_2"]
    assert opened.studio.robots["g1_class"] == "g1_class", "a shipped robot is replaced"
    assert name == "my_robot" and project.robot is not None and project.robot.name == "g1_class"


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("../../etc/passwd", "passwd"),
        ("C:\\x\\walk.bvh", "walk.bvh"),
        ("a b;$(x).bvh", "a_b_x_.bvh"),
        ("..", "unnamed"),
        ("-rf", "rf"),
        ("行走.bvh", "行走.bvh"),
    ],
)
def test_the_name_of_a_file_is_a_name(given: str, kept: str) -> None:
    assert plain_name(given) == kept


def test_forty_slow_connections_keep_no_page_waiting(opened: Opened) -> None:
    with ExitStack() as wires:
        for _ in range(40):
            wire = wires.enter_context(socket.create_connection(("127.0.0.1", opened.served.port), 5))
            wire.sendall(b"POST /drop?name=slow.bvh HTTP/1.1\r\nHost: loc")
        began = time.monotonic()
        assert b"studio" in opened.asked("")
        assert time.monotonic() - began < 2


def test_a_studio_that_is_killed_while_it_solves_leaves_whole_files(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "robot_retarget",
        "studio",
        str(SAMPLES / "walk.bvh"),
        "--out",
        str(tmp_path / "s"),
        "--port",
        "0",
    ]
    with subprocess.Popen([*command, "--no-browser"], stdout=subprocess.PIPE, text=True) as studio:
        assert studio.stdout is not None and "token=" in studio.stdout.readline()
        time.sleep(1.0)
        os.kill(studio.pid, signal.SIGKILL)
    left = [path for path in (tmp_path / "s").rglob("*") if path.is_file()]
    assert {path.name for path in left} <= {"walk.bvh", "trajectory.npz", "project.json"}
    for path in left:
        if path.suffix == ".npz":
            rr.load_trajectory(path)
