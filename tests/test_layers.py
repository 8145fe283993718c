"""The layers hold: who may import whom, which library may appear where, and how quickly the package loads."""

import ast
import re
import resource
import runpy
import subprocess
import sys
from collections.abc import Set
from functools import cache
from pathlib import Path

import pytest
from shared_files import ROOT

import robot_retarget

PACKAGE = ROOT / "robot_retarget"
LAYERS = {
    "base": set[str](),
    "actuators": set(),
    "scene": set(),
    "trajectory": {"actuators", "scene"},
    "robot": {"actuators", "trajectory", "scene"},
    "contact": {"trajectory", "robot", "scene"},
    "human": {"contact", "trajectory", "robot", "scene"},
    "graph": {"contact", "robot", "human", "scene"},
    "scores": {"contact", "trajectory", "robot", "human", "graph", "scene"},
    "collision": {"trajectory", "robot", "scene"},
    "solver": {"contact", "trajectory", "robot", "human", "graph", "scores", "scene", "collision"},
    "papers": {"human", "graph"},
    "judge": {"contact", "scores", "trajectory", "human", "robot", "solver", "actuators", "collision", "scene"},
    "servo": {"actuators", "trajectory", "scene"},
    "formats": {"actuators", "trajectory", "human", "robot", "scene", "contact"},
    "edit": {"actuators", "contact", "trajectory", "robot", "human", "graph", "solver", "formats", "judge", "scene"},
    "live": {"actuators", "human", "robot", "solver", "servo", "scene"},
}
"""Every folder and module below the commands, lower ones first, with its permitted imports in addition to `base`."""
TOP = {"__init__", "__main__", "tools"}
"""The public names and the commands, which may import everything."""
LIBRARIES = {
    "casadi": ("robot/kinematics.py", "graph/", "solver/", "papers/"),
    "mujoco": (
        "robot/",
        "base/untrusted/models_child.py",
        "scene/geoms.py",
        "scene/mjcf.py",
        "judge/",
        "scores/",
        "tools/view/",
        "formats/bodies.py",
        "formats/mujoco_files.py",
        "servo/twin.py",
        "servo/emulator/__init__.py",
    ),
    "dynamixel_sdk": ("servo/bus.py",),
    "typer": ("tools/cli/",),
    "rich": ("tools/cli/console.py", "tools/cli/console.py"),
    "jinja2": ("base/pages.py",),
    "ray": ("tools/batch/pool.py",),
    "starlette": ("tools/view/web/", "tools/studio/"),
    "uvicorn": ("tools/view/web/serve.py",),
    "anyio": ("tools/view/web/", "tools/studio/"),
    "pyarrow": ("base/untrusted/tables.py",),
    "matplotlib": ("tools/view/",),
    "ezc3d": ("human/readers/c3d_child.py",),
    "fast_simplification": ("tools/view/web/",),
}
UNITS = sorted({path.relative_to(PACKAGE).parts[0].removesuffix(".py") for path in PACKAGE.rglob("*.py")})


def modules(unit: str) -> list[Path]:
    """The files of a folder or of a single module."""
    folder = PACKAGE / unit  # one without modules is what Git leaves of a folder that became a module
    return sorted(folder.rglob("*.py")) or [folder.with_suffix(".py")]


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
    return {name.split(".")[1] for name in names} - {unit}


def test_every_module_is_in_a_layer() -> None:
    assert set(UNITS) == LAYERS.keys() | TOP


def test_layers_import_only_lower_ones() -> None:
    order = list(LAYERS)
    assert {u: upper for u in order if (upper := LAYERS[u] - set(order[: order.index(u)]))} == {}


@pytest.mark.parametrize("unit", LAYERS)
def test_a_layer_imports_only_what_is_stated(unit: str) -> None:
    stated = LAYERS[unit] | ({"base"} - {unit})
    assert imported_units(unit) <= stated


@pytest.mark.parametrize("unit", [unit for unit, stated in LAYERS.items() if stated])
def test_a_layer_states_no_more_than_it_imports(unit: str) -> None:
    assert LAYERS[unit] <= imported_units(unit)


def test_no_module_imports_itself_by_way_of_others() -> None:
    """Wherever an import stands; a kind makes tracks, and a track has its kind, which its annotation alone names."""
    parts = {path: path.relative_to(ROOT).with_suffix("").parts for path in PACKAGE.rglob("*.py")}
    named = {".".join(names).removesuffix(".__init__"): path for path, names in parts.items()}
    ways = {name: _imported_modules(path, named.keys()) - {name} for name, path in named.items()}
    ways["robot_retarget.graph.track"] -= {"robot_retarget.graph.kind"}
    while ends := {name for name in ways if not ways[name] & ways.keys()}:
        ways = {name: found for name, found in ways.items() if name not in ends}
    assert sorted(ways) == []


def _imported_modules(path: Path, known: Set[str]) -> set[str]:
    """The modules of a package that a file imports: `from a import b` is of a.b if that is one, else of a."""
    found = imports(path) & known
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            inner = {f"{node.module}.{alias.name}" for alias in node.names} & known
            found = found - {node.module} | inner if len(inner) == len(node.names) else found | inner
    return set(found)


def test_the_viewer_stands_below_the_public_names() -> None:
    above = ("robot_retarget.tools.cli", "robot_retarget.tools.batch")
    names = {name for path in modules("tools/view") for name in imports(path)}
    assert not {name for name in names if name.startswith(above) or name in {"robot_retarget", "robot_retarget.view"}}


def test_the_table_of_the_rooms_has_their_order() -> None:
    page = (ROOT / "docs/explanation/architecture.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `(\w+)(?:/|\.py)` \|", page, re.MULTILINE) == [*LAYERS, "tools"]


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


def test_no_folder_has_the_name_of_a_public_function() -> None:
    assert not set(UNITS) & set(dir(robot_retarget)) - {"trajectory"}


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


@pytest.mark.parametrize(
    ("line", "origin"),
    [
        ('POSE = (0.0, 0.0, -1.0, 1.0)\n"""Of the world."""', None),
        ('SHARE: float = field(default=1.0, metadata=within(0, 20, ""))\n"""Of a limb [-]."""', None),
        ('BROKEN = 3\n"""Exit code for a file that is refused."""', "fact"),
        ('LARGE = 1e4\n"""A longer limb is refused [m]."""', "bound"),
        ('TWICE = 2 * LARGE\n"""[m]."""', "derived"),
        ('KNEE = 0.4\n"""Of a leg [-]: half and double find the same knees in 20 clips."""', "without"),
        ('KNEE = 0.4\n"""Of a leg [-]: half and double move the knees of 20 clips by 2 and 3 cm."""', "sourced"),
        ('KNEE = 0.4\n"""Of a leg [-], as on page 2: 40 %."""', "without"),
        ('PI: float = 0.4\n"""Of knees [-] (4.61, 4.61)."""', "without"),
        ('PI: float = 0.4\n"""Of knees [-] (4.18, 5.09)."""', "sourced"),
        ('KNEE = (1.0, 0.4)\n"""Of a leg [-]."""', "without"),
        ('KNEE: float = field(default=0.4, metadata=within(0, 1, ""))\n"""Of a leg [0, 1]."""', "without"),
    ],
)
def test_a_number_has_the_origin_that_its_docstring_says(line: str, origin: str | None) -> None:
    tool = runpy.run_path(str(ROOT / "scripts/tools/count_tuning.py"))
    ((_, value, text),) = tool["documented"](ast.parse(line).body)
    assert tool["origin"]("robot/limbs.py", value, text) == origin


def test_numbers_without_a_source_become_no_more() -> None:
    """A number that decides says below it where it comes from; scripts/tools/count_tuning.py --list prints those that do not."""
    tool = runpy.run_path(str(ROOT / "scripts/tools/count_tuning.py"))
    found = [
        number for path in PACKAGE.rglob("*.py") for number, origin in tool["numbers"](path) if origin == "without"
    ]
    assert len(found) <= tool["MOST"], sorted(found)


def test_the_name_of_a_number_has_one_value_in_all_modules() -> None:
    """Two modules may share a name only with its value; the two protocols of servos share theirs as one interface."""
    values: dict[str, dict[str, float]] = {}
    for path in set(PACKAGE.rglob("*.py")) - {PACKAGE / "servo/protocol1.py"}:
        for node in ast.parse(path.read_text()).body:
            match node:
                case ast.Assign([ast.Name(name)], ast.Constant(int() | float() as value)) | ast.AnnAssign(
                    ast.Name(name), value=ast.Constant(int() | float() as value)
                ) if not isinstance(value, bool):
                    values.setdefault(name.lstrip("_"), {})[path.relative_to(PACKAGE).as_posix()] = value
    assert not {name: homes for name, homes in values.items() if len(set(homes.values())) > 1}


def test_every_file_of_tests_has_a_name_of_its_own() -> None:
    """They are imported by their names alone: two of one name cannot be collected together."""
    names = [path.name for path in Path(__file__).parent.rglob("*.py")]
    assert not {name for name in names if names.count(name) > 1}
