"""What docstrings name in backticks exists: modules, classes, functions, fields; other words stand in the code or its tables."""

import ast
import importlib
import inspect
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from shared_files import ROOT

PACKAGE = ROOT / "robot_retarget"
FILES = re.compile(r"\.(bin|bvh|csv|html|json|npy|npz|onnx|toml|yaml)$")
ELSEWHERE = {"torch", "observation", "NAME", "R", "preprocess_smplx"}
"""Heads of names of other programs and their files: PyTorch, LeRobot's columns, OpenSim's markers, a script of OmniRetarget."""
GROUPS = {"robot_retarget.kinds"}
"""Groups of entry points."""
FOREIGN = (
    "JointTrajectory PR_SET_PDEATHSIG RAY_ADDRESS EX_SOFTWARE Frames Thorax body_nose_x booster_t1 cc condim connector1 dcmotor xm "
    "g1_mj_description lfemur lhand sha256sum weights_only bn_walk soma30_walk_then_sneak test_freebvh_walk walk_01 PARENT_end _m"
)
"""Names of other programs, robots, skeletons and clips, and parts of names, that the code does not spell out."""
PROGRAMS = {"__main__", "human.readers.c3d_child"}
"""Modules that run when they are imported."""


def docstrings_of(text: str) -> Iterator[tuple[int, str]]:
    """The line and the text of every docstring of a module: of functions, classes, fields and itself."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.lineno, node.value.value


@cache
def texts() -> dict[Path, str]:
    """The modules of the package with their texts."""
    return {path: path.read_text("utf-8") for path in sorted(PACKAGE.rglob("*.py"))}


@cache
def docstrings() -> dict[Path, list[tuple[int, str]]]:
    """The docstrings of each module."""
    return {path: list(docstrings_of(text)) for path, text in texts().items()}


def named(form: str) -> list[tuple[str, str]]:
    """The words of a form in backticks, and where they stand."""
    found = {
        (word, f"{path.relative_to(ROOT)}:{line}")
        for path, own in docstrings().items()
        for line, text in own
        for word in re.findall(r"`([^`\s]+)`", text)
    }
    return sorted(one for one in found if re.fullmatch(form, one[0]))


@cache
def modules() -> dict[str, Any]:
    """The modules of the package by their names in it."""
    files = (path.relative_to(PACKAGE).with_suffix("") for path in PACKAGE.rglob("*.py"))
    names = [".".join(file.parent.parts if file.name == "__init__" else file.parts) for file in files]
    return {name: importlib.import_module(f"{PACKAGE.name}.{name}") for name in names if name and name not in PROGRAMS}


@cache
def candidates(head: str) -> list[Any]:
    """Modules whose name ends with a word, what modules have under that name, and libraries."""
    found = [module for name, module in modules().items() if f".{name}".endswith(f".{head}")]
    found += {id(one): one for module in modules().values() if (one := vars(module).get(head)) is not None}.values()
    libraries = {"np": "numpy", "numpy": "numpy", "typer": "typer", "rr": "robot_retarget"}
    return [*found, *([importlib.import_module(libraries[head])] if head in libraries else [])]


def has(owner: Any, names: list[str]) -> bool:
    """Whether an object has an attribute, which has the next one, …; what a class sets on itself counts."""
    if not names or hasattr(owner, names[0]):
        return not names or has(getattr(owner, names[0]), names[1:])
    bases = [base for base in getattr(owner, "__mro__", ()) if base.__module__.startswith(PACKAGE.name)]
    own = rf"^    {names[0]}:|\bself\.{names[0]}\b[^=\n]* = "
    return len(names) == 1 and any(re.search(own, inspect.getsource(base), re.M) for base in bases)


def resolves(word: str) -> bool:
    if word.endswith(".py"):
        return any(str(path).endswith(f"/{word}") for path in PACKAGE.rglob("*.py"))
    parts = word.split(".")
    splits = ((".".join(parts[:k]), parts[k:]) for k in range(len(parts), 0, -1))
    return any(has(owner, rest) for head, rest in splits for owner in candidates(head))


def spelt_out() -> set[str]:
    """The words of the code without its docstrings, of its tables and pages, and of the tables of models."""
    tables = [*PACKAGE.rglob("*.toml"), *PACKAGE.rglob("*.html"), *(ROOT / "models").rglob("*.toml")]
    words = {word for path in tables for word in re.findall(r"\w+", path.read_text("utf-8"))}
    for path, text in texts().items():
        for _, docstring in docstrings()[path]:
            text = text.replace(docstring, "")
        words |= {path.stem, *re.findall(r"\w+", text)}
    return words


def test_every_dotted_name_in_a_docstring_exists() -> None:
    dotted = [one for one in named(r"[A-Za-z_]\w*(\.\w+)+") if not FILES.search(one[0])]
    assert len(dotted) > 100
    assert not [
        f"{place}: {word}"
        for word, place in dotted
        if word.split(".")[0] not in ELSEWHERE and word not in GROUPS and not resolves(word)
    ]


def test_every_other_name_in_a_docstring_stands_in_the_code() -> None:
    plain = named(r"[A-Za-z_]\w*")
    assert len(plain) > 500
    known = spelt_out() | set(FOREIGN.split())
    assert not [f"{place}: {word}" for word, place in plain if word not in known]


def test_the_parts_of_a_package_that_its_docstring_lists_exist() -> None:
    for name, module in modules().items():
        if (module.__file__ or "").endswith("__init__.py"):
            words = re.findall(r"`([A-Za-z_]\w*)`", module.__doc__ or "")
            assert not [word for word in words if f"{name}.{word}" not in modules() and not hasattr(module, word)], name


@pytest.mark.parametrize("word", ["formats.table.FORMATS", "freeze.freeze", "Robot.colour", "nobody.is_here"])
def test_a_name_that_does_not_exist_is_found(word: str) -> None:
    assert not resolves(word)
