"""A few hundred damaged files, settings and packets of each kind; `scripts/tools/fuzz.py` reads as many as one likes."""

import importlib.util
import sys
from pathlib import Path

import pytest
from shared_files import ROOT

SPEC = importlib.util.spec_from_file_location("fuzz", ROOT / "scripts/tools/fuzz.py")
assert SPEC is not None and SPEC.loader is not None
fuzz = importlib.util.module_from_spec(SPEC)
sys.modules["fuzz"] = fuzz
SPEC.loader.exec_module(fuzz)


@pytest.mark.parametrize("name", fuzz.TARGETS)
def test_damage_ends_in_data_or_in_a_sentence(name: str, tmp_path: Path) -> None:
    for folder in ("seeds", "work"):
        (tmp_path / folder).mkdir()
    target = fuzz.TARGETS[name](tmp_path / "seeds", [])
    found = fuzz.run(target, len(target.seeds) + 60, tmp_path / "work", None)
    assert set(found) <= {"read", "refused"}
    assert set(range(len(target.seeds))) <= set(found["read"]), "whole files are read"
