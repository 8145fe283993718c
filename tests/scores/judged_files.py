"""The reference judge of ../shared and its keypoint maps, as map files of this package."""

import importlib.util
import json
from pathlib import Path
from types import ModuleType
from typing import Any

from shared_files import SHARED

ROBOTS = ("unitree_g1", "robotis_op3", "booster_t1")


def judge() -> ModuleType:
    spec = importlib.util.spec_from_file_location("reference_judge", SHARED / "judge/judge.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def skeleton(name: str) -> dict[str, Any]:
    return json.loads((SHARED / f"judge/skeletons/{name}.json").read_text())


def points(robot: str) -> dict[str, Any]:
    return json.loads((SHARED / f"judge/robots/{robot}.json").read_text())


def robot_file(robot: str) -> Path:
    return SHARED / f"robots/{robot}/{robot}.xml"


def map_file(folder: Path, joints: dict[str, Any], spots: dict[str, Any]) -> Path:
    """The judge's maps as a map file."""
    lines = ["[human]", *(f"{k} = {json.dumps(v)}" for k, v in joints.items())]
    lines += ["[robot]", *(f"{k} = {json.dumps(v)}" for k, v in spots.items())]
    path = folder / "map.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


def numbers(figures: Any) -> dict[str, float]:
    """Figures that apply."""
    return {name: value for name, value in figures.items() if value is not None}
