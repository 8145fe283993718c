"""Run the short benchmarks on the shipped clips and write `benchmarks/performance.md`: `make bench`.

    python scripts/bench/write_performance.py [-o benchmarks/performance.md]

Every table stands under the command that printed it. The page starts with the date, the processor and the versions.
"""

import argparse
import importlib.metadata
import os
import platform
import subprocess
import sys
from datetime import date
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BENCHES = (
    ("Solver", "bench_solve.py --robots op3 --clips samples/walk.bvh --repeats 3"),
    ("Stream", "bench_stream.py --robots op3 --clips samples/walk.bvh --fps 60 --repeats 3"),
    ("Warnings", "bench_warn.py --robot op3 --random 20 --some 5"),
    ("Simulation", "bench_simulate.py --rounds 3 --worlds 5"),
    ("Distance geometry", "bench_dgp.py"),
)
LIBRARIES = ("casadi", "mujoco", "numpy", "scipy")


def processor() -> str:
    """Return the model name of the processor."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines() if Path("/proc/cpuinfo").exists() else []
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def heading() -> str:
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in LIBRARIES)
    return (
        "# Performance\n\n"
        f"{date.today()}, {processor()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the start. "
        f"Python {platform.python_version()}, {versions}. One core (`OMP_NUM_THREADS=1`).\n"
    )


def section(title: str, command: str) -> str:
    """Run one benchmark and return its section of the page."""
    ran = subprocess.run(
        [sys.executable, *f"scripts/bench/{command}".split()],
        cwd=ROOT,
        env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    if ran.returncode:
        raise SystemExit(f"scripts/bench/{command} ended with {ran.returncode}:\n{ran.stderr[-2000:]}")
    return f"\n## {title}\n\n`OMP_NUM_THREADS=1 python scripts/bench/{command}`\n\n{ran.stdout.strip()}\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "benchmarks/performance.md")
    out = parser.parse_args().out
    page = heading() + "".join(section(title, command) for title, command in BENCHES)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(page, encoding="utf-8")
    print(f"wrote {out}")


if __name__ == "__main__":
    main()
