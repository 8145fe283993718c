"""Run a reader of untrusted files in a separate process, with limits of memory and processor time."""

import os
import subprocess
import sys
from pathlib import Path

BROKEN, TOO_MUCH = 3, 4
"""Exit codes for a file that the reader refuses, and for one over a bound; the sentence is on stderr."""


def run(script: str, *arguments: str, patience: float) -> tuple[int, str]:
    """Run a script of the package; return its exit code and the last line on its stderr.

    Args:
        patience: longest time [s]; a process that takes longer is ended, as one that uses up its limit.
    """
    package = str(Path(__file__).parents[3])
    path = os.pathsep.join([package, *filter(None, [os.environ.get("PYTHONPATH")])])
    command = [sys.executable, "-P", script, *arguments]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", check=False, timeout=patience,
            env=os.environ | {"PYTHONPATH": path},
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return -1, ""
    return done.returncode, (done.stderr.strip().splitlines() or [""])[-1]


def limit(memory: int, seconds: int) -> None:
    """Limit memory [bytes] and processor time [s] of this process and disable its core dumps, where the system can."""
    try:
        import resource
    except ImportError:
        return
    for kind, most in ((resource.RLIMIT_DATA, memory), (resource.RLIMIT_CPU, seconds), (resource.RLIMIT_CORE, 0)):
        resource.setrlimit(kind, (most, most))
