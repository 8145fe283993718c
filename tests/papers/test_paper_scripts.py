"""The scripts that redraw the papers and measure the core still run."""

import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


def test_figures_are_drawn_and_the_table_is_written(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    wanted = ["2019-fig1", "interaction-fig2", "interaction-fig3"]
    command = [
        sys.executable,
        str(SCRIPTS / "figures" / "reproduce_papers.py"),
        "--out",
        str(tmp_path),
        "--only",
        *wanted,
    ]
    subprocess.run(command, check=True, cwd=SCRIPTS.parent, env=_environment(), capture_output=True)
    pictures = sorted(path.name for path in tmp_path.glob("*.png"))
    assert pictures == ["mucherino-2019-fig2.png", "mucherino-2019-fig3.png", "mucherino-omer-2019-fig1.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in tmp_path.glob("*.png"))
    table = (tmp_path / "table.md").read_text(encoding="utf-8")
    assert "held ends: min 0.200000, ends move 0e+00" in table
    assert "2 lines with equal α = 2" in table


def _environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(SCRIPTS.parent), "OMP_NUM_THREADS": "1"}


def test_benchmark_prints_its_rows() -> None:
    bench = runpy.run_path(str(SCRIPTS / "bench" / "bench_dgp.py"))
    rows = bench["tree_rows"]()
    assert len(rows) == 2
    assert all(figure.endswith("ms") for _, figure in rows)
