"""Build the sdist and the wheel, and run the main job with each in empty environments, with oldest and newest versions.

python scripts/tools/check_release.py --python python3.11 --python python3.13
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from itertools import product
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CLIP = "import robot_retarget.base.files as s; print(s.SAMPLES / 'wave.bvh')"


def built(folder: Path) -> list[Path]:
    """The sdist and the wheel of this checkout."""
    run([sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT], folder)
    return sorted(folder.glob("*.tar.gz")) + sorted(folder.glob("*.whl"))


def run(words: list[str | Path], folder: Path) -> str:
    """Run a command outside the checkout and return what it prints.

    Raises:
        SystemExit: The command fails; the message holds the end of its output.
    """
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run([str(word) for word in words], cwd=folder, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(map(str, words))} failed:\n{(done.stderr or done.stdout)[-2000:]}")
    return done.stdout


def constraints(folder: Path) -> list[str | Path]:
    """The options of pip that ask for the oldest versions."""
    lowest = folder / "lowest.txt"
    lowest.write_text(run([sys.executable, ROOT / "scripts/tools/lowest_versions.py"], folder), encoding="utf-8")
    return ["--constraint", lowest]


def smoke(python: str, package: Path, oldest: bool, folder: Path) -> str:
    """Install a package in an empty environment and retarget, simulate and judge the shipped wave.

    Returns:
        A row of the table: package, Python, dependencies, versions of NumPy, SciPy, MuJoCo and CasADi, verdict, seconds.
    """
    start = time.monotonic()
    run([python, "-m", "venv", folder / "env"], folder)
    own = folder / "env/bin/python"
    run([own, "-m", "pip", "install", "--quiet", *(constraints(folder) if oldest else []), package], folder)
    clip = run([own, "-c", CLIP], folder).strip()
    command = [
        folder / "env/bin/robot-retarget",
        "run",
        clip,
        "--robot",
        "op3",
        "--draws",
        "0",
        "--out",
        folder / "out",
    ]
    verdict = next(line for line in run(command, folder).splitlines() if "verdict" in line.lower()).strip()
    names = "numpy", "scipy", "mujoco", "casadi"
    listed = f"from importlib.metadata import version as v; print(' '.join(map(v, {names})))"
    versions = run([own, "-c", listed], folder).split()
    kind = "sdist" if package.suffix == ".gz" else "wheel"
    facts = [kind, run([own, "-V"], folder).split()[1], "oldest" if oldest else "newest", *versions, verdict]
    return f"| {' | '.join(facts)} | {time.monotonic() - start:.0f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", action="append", help="an interpreter to try; repeatable")
    pythons = parser.parse_args().python or [sys.executable]
    print("| package | Python | dependencies | NumPy | SciPy | MuJoCo | CasADi | verdict | s |\n|" + "---|" * 9)
    with tempfile.TemporaryDirectory() as scratch:
        packages = built(Path(scratch))
        for package, python, oldest in product(packages, pythons, (True, False)):
            with tempfile.TemporaryDirectory() as folder:
                print(smoke(python, package, oldest, Path(folder)), flush=True)


if __name__ == "__main__":
    main()
