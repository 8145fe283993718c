"""Machine code gives the results of the virtual machine, which serves if compilation fails."""

import hashlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import enumerate as enumerate_threads

import casadi as ca
import numpy as np
import pytest
from point_functions import point_function

from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import RobotGraph, describe
from robot_retarget.human.read import read_motion
from robot_retarget.robot import Points, Robot, load_robot
from robot_retarget.solver import native
from robot_retarget.solver import problem as problem_module
from robot_retarget.solver import solve as solve_module
from robot_retarget.solver.limits import targets_of
from robot_retarget.solver.native import library_of, machine_code
from robot_retarget.solver.problem import Problem, build_problem
from robot_retarget.solver.solve import solve_graph

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
SMALL = f"""
import os, sys
sys.path.insert(0, {str(Path(__file__).parent.parent)!r})
from robot_retarget.solver.native import machine_code
from robot_retarget.robot import Points, load_robot
from point_functions import point_function
robot = load_robot("op3")
for os.environ["XDG_CACHE_HOME"] in sys.argv[1:]:
    compiled = machine_code(point_function(robot, Points([robot.model.nbody - 1], [[0, 0, 0.1]])))
    print(compiled(robot.standing())[0] if compiled else None)
"""


@pytest.fixture(autouse=True)
def compiling(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "cc")


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "robot-retarget"


@pytest.fixture(scope="module")
def case() -> RobotGraph:
    return describe(read_motion(SAMPLES / "wave.bvh").frames(0, 60), load_robot("op3"))


@pytest.fixture(scope="module")
def whole(case: RobotGraph, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the machine code of the case."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CC", "cc")
        patch.setenv("XDG_CACHE_HOME", str(folder))
        assert built(case, native=True).native
    return folder


@pytest.fixture
def filled(whole: Path, cache: Path) -> Path:
    """A cache with the machine code of the case."""
    return shutil.copytree(whole / cache.name, cache)


def built(graph: RobotGraph, native: bool) -> Problem:
    """The graph's problem after its compilation has finished or failed."""
    before = set(enumerate_threads())
    problem = build_problem(graph.robot, graph.match, graph.tracks, native=native)
    for thread in set(enumerate_threads()) - before:
        thread.join()
    return problem


def small() -> tuple[Robot, Points]:
    robot = load_robot("op3")
    return robot, Points(np.array([robot.model.nbody - 1]), np.array([[0.0, 0.0, 0.1]]))


def said_by_another_process(*folders: Path) -> list[str]:
    """What `SMALL` prints for caches in some folders: a library is loaded once by a process, so a look takes a new one."""
    command = [sys.executable, "-c", SMALL, *map(str, folders)]
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=60).stdout.splitlines()


def fake_compiler(folder: Path, script: str) -> Path:
    folder.mkdir()
    (folder / "cc").write_text(f"#!/bin/sh\n{script}\n")
    (folder / "cc").chmod(0o755)
    return folder


@needs_compiler
def test_temporary_files_of_killed_builds_are_swept_and_those_of_others_stay(cache: Path) -> None:
    cache.mkdir(mode=0o700)
    for name, age in ((".killed-1.so", 3600.0), (".running-2.so", 1.0)):
        (cache / name).touch()
        os.utime(cache / name, (time.time() - age, time.time() - age))
    assert machine_code(point_function(*small())) is not None
    assert [path.name for path in cache.glob(".*")] == [".running-2.so"]


@needs_compiler
def test_machine_code_equals_the_virtual_machine_to_the_last_bit(filled: Path, case: RobotGraph) -> None:
    problems = [built(case, native) for native in (False, True)]
    assert [problem.native for problem in problems] == [False, True]
    targets, draw, robot = targets_of(case.tracks).at(1), np.random.default_rng(0), case.robot
    for _ in range(20):
        q = np.append(draw.normal(size=7), draw.uniform(robot.lower, robot.upper))
        for ours, theirs in zip(*(problem.model(q, targets) for problem in problems), strict=True):
            assert np.all(ours == theirs)
        assert problems[0].cost(q, targets) == problems[1].cost(q, targets)


@needs_compiler
def test_clips_of_two_seconds_are_solved_by_machine_code_with_the_same_result(
    filled: Path, case: RobotGraph, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled = solve_graph(case)
    monkeypatch.setattr(solve_module, "WORTH_COMPILING", len(case) + 1)
    interpreted = solve_graph(case)
    assert (compiled.native, interpreted.native) == (len(case) >= 60, False)
    assert (compiled.trajectory.qpos == interpreted.trajectory.qpos).all()


@needs_compiler
def test_what_was_compiled_once_is_not_compiled_again(cache: Path) -> None:
    function = point_function(*small())
    assert machine_code(function) is not None
    kept = {path: path.stat().st_mtime_ns for path in cache.iterdir()}
    assert {path.suffix for path in kept} == {".so", ".sha256"}
    assert machine_code(function) is not None
    assert {path: path.stat().st_mtime_ns for path in cache.iterdir()} == kept


@pytest.mark.parametrize("script", ["exit 1", "echo rubbish > $(echo $* | sed 's/.*-o //; s/ .*//')"])
def test_a_compiler_that_fails_leaves_the_virtual_machine(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, case: RobotGraph
) -> None:
    monkeypatch.setenv("PATH", f"{fake_compiler(tmp_path / 'bin', script)}{os.pathsep}{os.environ['PATH']}")
    problem = built(case, native=True)
    assert not problem.native
    assert np.isfinite(problem.cost(case.robot.standing(), targets_of(case.tracks).at(0)))


def test_no_compiler_and_no_cache_leave_the_virtual_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cache: Path
) -> None:
    function = point_function(*small())
    monkeypatch.setenv("PATH", str(tmp_path))
    assert machine_code(function) is None
    monkeypatch.undo()
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert machine_code(function) is None


@needs_compiler
def test_processes_that_compile_at_once_all_get_whole_machine_code(cache: Path) -> None:
    command = [sys.executable, "-c", SMALL, str(cache.parent)]
    together = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    said = {process.communicate(timeout=60)[0] for process in together}
    robot, points = small()
    assert said == {f"{point_function(robot, points)(robot.standing())[0]}\n"}
    assert len(list(cache.iterdir())) == 2


def flip_a_bit(library: Path) -> None:
    content = bytearray(library.read_bytes())
    content[content.find(b"\xf2\x0f")] ^= 1  # the first instruction on doubles
    library.write_bytes(content)


def swap_in_another_library(library: Path) -> None:
    """A pair of library and checksum that belong together, under the name of another."""
    robot, points = small()
    other = robot.model.nbody - 2
    machine_code(point_function(robot, Points(np.array([other]), points.offsets)))
    for path in {*library.parent.iterdir()} - {library, library.with_suffix(".so.sha256")}:
        path.rename(library.with_suffix(path.suffix if path.suffix == ".so" else ".so.sha256"))


SPOILED: dict[str, Callable[[Path], object]] = {
    "a flipped bit": flip_a_bit,
    "cut off": lambda library: os.truncate(library, 4096),
    "empty": lambda library: os.truncate(library, 0),
    "of another user": lambda library: os.chown(library, 65534, 65534),
    "writable by all": lambda library: library.chmod(0o666),
    "a link": lambda library: library.symlink_to(library.rename(library.with_name("elsewhere"))),
    "another library": swap_in_another_library,
    "no checksum": lambda library: library.with_suffix(".so.sha256").unlink(),
    "a checksum of another user": lambda library: os.chown(library.with_suffix(".so.sha256"), 65534, 65534),
    "a checksum that is none": lambda library: library.with_suffix(".so.sha256").write_bytes(b"\xff"),
}


@needs_compiler
def test_a_library_that_was_tampered_with_is_compiled_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot, points = small()
    function, libraries, whole = point_function(robot, points), dict[str, Path](), b""
    for how, spoil in SPOILED.items():
        if "of another user" in how and os.geteuid() != 0:  # only root gives files away
            continue
        (tmp_path / how).mkdir()
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / how))
        found = library_of(function)
        assert found is not None
        libraries[how], whole = found, found.read_bytes()
        spoil(found)
    said = said_by_another_process(*(tmp_path / how for how in libraries))
    assert dict(zip(libraries, said, strict=True)) == dict.fromkeys(libraries, str(function(robot.standing())[0]))
    for how, library in libraries.items():
        assert library.read_bytes() == whole, how
        line = library.with_suffix(".so.sha256").read_text()
        assert line == f"{hashlib.sha256(whole).hexdigest()}  {library.name}\n", how
        assert [(path.stat().st_uid, path.stat().st_mode & 0o777) for path in (library.parent, library)] == [
            (os.geteuid(), 0o700),
            (os.geteuid(), 0o600),
        ], how


@needs_compiler
def test_a_folder_of_another_user_is_left_alone(cache: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("only root gives files away")
    cache.mkdir(mode=0o755)
    os.chown(cache, 65534, 65534)
    assert machine_code(point_function(*small())) is None
    assert cache.stat().st_mode & 0o777 == 0o755 and not list(cache.iterdir())


@needs_compiler
def test_a_folder_that_others_may_write_is_closed_to_them(cache: Path) -> None:
    cache.mkdir(mode=0o777)
    cache.chmod(0o777)
    assert machine_code(point_function(*small())) is not None
    assert cache.stat().st_mode & 0o777 == 0o700


@needs_compiler
def test_a_relative_cache_folder_is_ignored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    assert machine_code(point_function(*small())) is not None
    assert not list(Path().iterdir())
    assert list((tmp_path / "home/.cache/robot-retarget").glob("*.so"))


@needs_compiler
def test_a_build_is_loaded_without_building_until_its_code_or_kinds_change(
    filled: Path, case: RobotGraph, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = built(case, native=True)
    monkeypatch.setattr(problem_module, "SymbolicRobot", None)  # nothing can be built any more
    again = built(case, native=True)
    q, targets = case.robot.standing(), targets_of(case.tracks).at(1)
    assert again.native
    for ours, theirs in zip(first.model(q, targets), again.model(q, targets), strict=True):
        assert np.all(ours == theirs)
    touch = case.kinds["touch"]
    changed = [replace(touch, scale=2 * touch.scale) if track is touch else track for track in case.tracks]
    with pytest.raises(TypeError):
        build_problem(case.robot, case.match, changed, native=True)


@needs_compiler
def test_a_list_of_libraries_that_was_tampered_with_leads_to_a_new_build(filled: Path, case: RobotGraph) -> None:
    for listing in filled.glob("*.libraries"):
        listing.write_text("../elsewhere model")
    assert built(case, native=True).native
    assert all("elsewhere" not in listing.read_text() for listing in filled.glob("*.libraries"))


def test_a_compiler_that_takes_too_long_is_ended_with_what_it_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As `cc` starts `cc1`: a process that lives on would keep a core busy."""
    slow = tmp_path / "slow-cc"
    slow.write_text(f"#!/bin/sh\nsleep 300 & echo $! > {tmp_path / 'child'}\nwait\n")
    slow.chmod(0o755)
    monkeypatch.setenv("CC", str(slow))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(native, "BUILD_PATIENCE", 0.5)
    x = ca.SX.sym("x")
    assert native.library_of(ca.Function("f", [x], [2 * x])) is None
    started = int((tmp_path / "child").read_text())
    for _ in range(50):
        state = Path(f"/proc/{started}/stat")
        if not state.exists() or state.read_text().split()[2] == "Z":
            return
        time.sleep(0.02)
    raise AssertionError("it lives on")
