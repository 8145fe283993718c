"""The tests that depend on MuJoCo, on several of its versions, each in a virtual environment of its own.

    python scripts/tools/mujoco_versions.py [VERSION ...]     by default the oldest that is supported, and the newest

Robots whose MJCF a version cannot read are counted apart: they were written for a newer one.
"""

import re
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

from robot_retarget.base.mujoco_setup import OLDEST

ROOT = Path(__file__).resolve().parents[2]
TESTS = ("tests/robot", "tests/scores/test_look.py", "tests/judge/test_servo_model.py")
UNREADABLE = "MuJoCo does not load it"


def outcome(version: str) -> str:
    """Passed, failed, and failed for a robot that this version cannot read."""
    with tempfile.TemporaryDirectory() as folder:
        venv.create(folder, with_pip=True)
        python = str(Path(folder) / "bin" / "python")
        wanted = "mujoco" if version == "newest" else f"mujoco=={version}"
        install = [python, "-m", "pip", "install", "--quiet", wanted, str(ROOT), "pytest", "hypothesis"]
        subprocess.run(install, check=True)
        tests = [python, "-m", "pytest", "-o", "addopts=", "-rf", "--tb=short", *TESTS]
        said = subprocess.run(tests, cwd=ROOT, capture_output=True, text=True).stdout
    counts = {word: int(number) for number, word in re.findall(r"(\d+) (passed|failed)", said.rsplit("\n", 2)[-2])}
    failures = re.split(r"\n_{3,} .* _{3,}\n", said)[1:]
    unreadable = sum(UNREADABLE in text for text in failures)
    return f"{version:8} {counts.get('passed', 0):7} {counts.get('failed', 0) - unreadable:7} {unreadable:11}"


def main() -> None:
    print(f"{'MuJoCo':8} {'passed':>7} {'failed':>7} {'unreadable':>11}")
    for version in sys.argv[1:] or [".".join(map(str, (*OLDEST, 0))), "newest"]:
        print(outcome(version), flush=True)


if __name__ == "__main__":
    main()
