"""The layers hold: who may import whom, which library may appear where, and how quickly the package loads."""

import ast
import resource
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from shared_files import ROOT

import robot_retarget

PACKAGE = ROOT / "robot_retarget"
BASE = {
    "arrays",
    "cache",
    "errors",
    "files",
    "keypoints",
    "notebook",
    "progress",
    "rendering",
    "ramps",
    "report_file",
    "shipped",
    "templates",
    "toml_lines",
    "untrusted",
    "versions",
}
"""Modules that know nothing of motions and robots; every layer may import them."""
CORE = {"trajectory", "motion", "robot", "human", "graph", "score", "solve", "balance"}
LAYERS = {
    **{module: set[str]() for module in sorted(BASE)},
    "actuators": set(),
    "feedback": {"actuators"},
    "goals": {"feedback"},
    "scene": set(),
    "trajectory": {"goals", "scene"},
    "robot": {"actuators", "trajectory", "scene"},
    "human": {"trajectory", "robot", "scene"},
    "motion": {"human"},
    "graph": {"motion", "robot", "human", "scene"},
    "score": {"trajectory", "motion", "robot", "human", "graph"},
    "solve": {"trajectory", "motion", "robot", "human", "graph", "score", "scene"},
    "balance": CORE - {"balance", "motion"} | {"scene"},
    "papers": {"human", "graph"},
    "edit": {"trajectory", "motion", "robot", "graph", "solve", "scene"},
    "collision": {"trajectory", "robot", "scene"},
    "servo": {"actuators", "feedback", "goals", "trajectory"},
    "summary": {"motion", "robot", "human", "graph", "solve"},
    "result": CORE | {"collision"},
    "pipeline": CORE | {"result", "scene"},
    "simulate": CORE - {"motion", "human", "graph", "score", "balance"}
    | {"result", "actuators", "feedback", "goals", "collision", "scene"},
    "formats": {"actuators", "trajectory", "motion", "robot", "scene"},
    "sequence": {"trajectory", "robot", "human", "balance", "result", "pipeline", "formats", "simulate"},
    "view": {"trajectory", "motion", "robot", "human", "solve", "result", "collision", "simulate", "scene"},
    "doctor": {"view"},
    "batch": {"trajectory", "motion", "robot", "graph", "solve", "pipeline", "score", "formats", "edit", "view"},
    "live": {"actuators", "goals", "motion", "robot", "human", "servo", "collision", "simulate", "view", "scene"},
}
"""Every folder and module below the commands, lower ones first, with its permitted imports in addition to `BASE`."""
TOP = {"__init__", "__main__", "cli"}
"""The public names and the commands, which may import everything."""
LIBRARIES = {
    "casadi": ("robot/kinematics.py", "graph/", "solve/", "balance/", "papers/"),
    "mujoco": (
        "robot/",
        "scene/geoms.py",
        "scene/formats/mjcf.py",
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
    "jinja2": ("templates.py",),
    "ray": ("batch/cluster.py",),
    "pyarrow": ("batch/summary.py", "untrusted/tables.py"),
    "pythonosc": ("live/send.py",),
    "matplotlib": ("view/",),
    "ezc3d": ("motion/formats/c3d/child.py",),
    "fast_simplification": ("view/web/",),
}
UNITS = sorted({path.relative_to(PACKAGE).parts[0].removesuffix(".py") for path in PACKAGE.rglob("*.py")})


def modules(unit: str) -> list[Path]:
    """The files of a folder or of a single module."""
    folder = PACKAGE / unit
    return sorted(folder.rglob("*.py")) if folder.is_dir() else [folder.with_suffix(".py")]


@cache
def imports(path: Path) -> frozenset[str]:
    """The modules that a file imports, by their full names."""
    names = set[str]()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level:
            names.add(".".join(["robot_retarget", *path.relative_to(PACKAGE).parts[: -node.level], node.module or ""]))
        elif isinstance(node, ast.ImportFrom):
            whole = node.module == "robot_retarget"
            names |= {f"{node.module}.{alias.name}" for alias in node.names} if whole else {node.module or ""}
    return frozenset(names)


def imported_units(unit: str) -> set[str]:
    """The other folders and modules of the package that a unit imports."""
    names = {name for path in modules(unit) for name in imports(path) if name.startswith("robot_retarget.")}
    return {name.split(".")[1] for name in names} - {unit, "__version__"}


def test_every_module_is_in_a_layer() -> None:
    assert set(UNITS) == LAYERS.keys() | TOP


def test_layers_import_only_lower_ones() -> None:
    order = list(LAYERS)
    assert {u: upper for u in order if (upper := LAYERS[u] - set(order[: order.index(u)]))} == {}


@pytest.mark.parametrize("unit", LAYERS)
def test_a_layer_imports_only_what_is_stated(unit: str) -> None:
    stated = LAYERS[unit] | (BASE if unit not in BASE else BASE - {unit})
    assert imported_units(unit) <= stated


@pytest.mark.parametrize("unit", [unit for unit, stated in LAYERS.items() if stated])
def test_a_layer_states_no_more_than_it_imports(unit: str) -> None:
    assert LAYERS[unit] <= imported_units(unit)


@pytest.mark.parametrize("library", LIBRARIES)
def test_a_library_appears_only_where_it_belongs(library: str) -> None:
    users = [path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py") if _uses(path, library)]
    assert users and all(user.startswith(LIBRARIES[library]) for user in users), users


def _uses(path: Path, library: str) -> bool:
    return library in {name.split(".")[0] for name in imports(path)}


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


def test_no_two_public_classes_share_a_name() -> None:
    homes: dict[str, set[Path]] = {}
    for path in PACKAGE.rglob("*.py"):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, set()).add(path)
    assert not {name: paths for name, paths in homes.items() if len(paths) > 1}


def test_every_file_of_tests_has_a_name_of_its_own() -> None:
    """They are imported by their names alone: two of one name cannot be collected together."""
    names = [path.name for path in Path(__file__).parent.rglob("*.py")]
    assert not {name for name in names if names.count(name) > 1}


def test_modules_of_folders_with_the_name_of_a_function_are_imported_in_every_form() -> None:
    code = ["import pickle", "import robot_retarget as rr"]
    for module in ("solve.compiled", "score.score", "simulate.rollout", "view.picture"):
        folder, name = module.split(".")
        code += [
            f"assert callable(rr.{folder}) and pickle.loads(pickle.dumps(rr.{folder})) is rr.{folder}",
            f"import robot_retarget.{module} as one",
            f"from robot_retarget.{folder} import {name} as two",
            "assert one is two",
        ]
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(code)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert not done.stderr
