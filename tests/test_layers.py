"""The layers hold: who may import whom, which library may appear where, and how quickly the package loads."""

import ast
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from shared_files import ROOT

import robot_retarget

PACKAGE = ROOT / "robot_retarget"
LAYERS = {
    "motion": {"motion"},
    "dgp": {"dgp"},
    "robot": {"robot"},
    "human": {"motion", "dgp", "robot", "human"},
    "describe": {"motion", "dgp", "robot", "human", "describe"},
    "solve": {"motion", "dgp", "robot", "human", "describe", "solve"},
    "collision": {"robot", "collision"},
    "balance": {"motion", "robot", "human", "describe", "solve", "balance"},
    "simulate": {
        "motion",
        "dgp",
        "robot",
        "human",
        "describe",
        "solve",
        "collision",
        "balance",
        "feedback",
        "simulate",
    },
    "score": {"motion", "dgp", "robot", "human", "describe", "balance", "simulate", "score"},
    "formats": {"motion", "robot", "servo", "formats"},
    "feedback": {"feedback"},
    "servo": {"motion", "robot", "feedback", "servo"},
    "edit": {"motion", "robot", "human", "describe", "solve", "edit"},
    "view": {"motion", "dgp", "robot", "human", "describe", "solve", "collision", "simulate", "view"},
    "batch": {"motion", "robot", "describe", "solve", "score", "formats", "edit", "view", "batch"},
    "live": {"motion", "robot", "servo", "collision", "simulate", "view", "live"},
}
DATASHEETS = {"robot_retarget.servo.map", "robot_retarget.servo.bounds"}
"""What servos turn a robot's joints, and what they may: read by those who plan and judge."""
LIBRARIES = {
    "casadi": ("robot/kinematics.py", "describe/", "solve/", "balance/", "dgp/"),
    "mujoco": (
        "robot/",
        "simulate/",
        "score/",
        "view/",
        "formats/bodies.py",
        "formats/scenes/",
        "servo/twin.py",
        "servo/window.py",
        "live/sinks/physics.py",
    ),
    "dynamixel_sdk": ("servo/bus.py",),
    "typer": ("cli/",),
    "rich": ("cli/console.py", "cli/bars.py"),
    "ray": ("batch/cluster.py",),
    "pyarrow": ("batch/summary.py",),
    "pythonosc": ("live/send.py",),
    "matplotlib": ("view/",),
    "ezc3d": ("motion/formats/c3d/child.py",),
    "fast_simplification": ("view/web/",),
}
MODULES = sorted(PACKAGE.rglob("*.py"))


def imports(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module)
        elif isinstance(node, ast.ImportFrom) and node.level:
            names.add(".".join(["robot_retarget", *path.relative_to(PACKAGE).parts[:-1], node.module or ""]))
    return names


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_module_imports_only_from_its_layers(path: Path) -> None:
    folder = path.relative_to(PACKAGE).parts[0]
    used = {name.split(".")[1] for name in imports(path) - DATASHEETS if name.startswith("robot_retarget.")}
    layered = used & LAYERS.keys()
    if folder in LAYERS:
        assert layered <= LAYERS[folder]
    elif path.name == "goals.py":
        assert layered <= {"feedback"}
    elif path.name in (
        "archive.py",
        "documents.py",
        "errors.py",
        "files.py",
        "arrays.py",
        "keypoints.py",
        "trajectory.py",
        "toml_lines.py",
        "shipped.py",
        "motors.py",
        "unpack.py",
        "unpickle.py",
        "notebook.py",
        "progress.py",
    ):
        assert not layered


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_libraries_appear_only_where_they_belong(path: Path) -> None:
    place = str(path.relative_to(PACKAGE))
    for library in {name.split(".")[0] for name in imports(path)} & LIBRARIES.keys():
        assert place.startswith(LIBRARIES[library]), f"{library} is imported in {place}"


def loading_time(command: list[str]) -> float:
    """Processor time [s], which other work on the machine does not lengthen."""
    times = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, *command], check=True, capture_output=True, cwd=ROOT)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(times)


def test_import_and_help_are_quick() -> None:
    bare = loading_time(["-c", "pass"])
    assert loading_time(["-c", "import robot_retarget"]) - bare < 0.3
    assert loading_time(["-m", "robot_retarget", "--help"]) - bare < 0.5


def test_every_public_name_is_there_and_typed() -> None:
    source = (PACKAGE / "__init__.py").read_text()
    typed = {
        alias.asname for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assert {name for name in typed if name} == set(dir(robot_retarget))
    for name in dir(robot_retarget):
        assert getattr(robot_retarget, name) is not None


def test_functions_named_like_folders_stay_functions() -> None:
    import robot_retarget.simulate.rollout
    import robot_retarget.solve.solve

    assert callable(robot_retarget.retarget) and callable(robot_retarget.simulate)


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(AttributeError, match=r"it has .*read_motion"):
        robot_retarget.read_movie  # noqa: B018


def test_every_file_of_tests_has_a_name_of_its_own() -> None:
    """They are imported by their names alone: two of one name cannot be collected together."""
    names = [path.name for path in Path(__file__).parent.rglob("*.py")]
    assert not {name for name in names if names.count(name) > 1}
