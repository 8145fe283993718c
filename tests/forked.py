"""Commands and readers of untrusted files as processes of their own that share one start.

A server loads the libraries and forks for each.
"""

import json
import os
import resource
import runpy
import subprocess
import sys
import tempfile
import threading
from functools import cache
from pathlib import Path

from shared_files import ROOT

from robot_retarget.base.untrusted import child

ENVIRONMENT = {"PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}", "PATH": "/usr/bin:/bin", "HOME": "/tmp", "CC": ""}
COMMAND = "robot-retarget"
ASKED = threading.Lock()
"""A server has one question at a time."""
started = child.run
"""A script in an interpreter of its own, as users have it."""


@cache
def server(process: int) -> subprocess.Popen[str]:
    """Start the server of a process; it ends with its input."""
    command = [sys.executable, "-c", "import forked; forked.serve()"]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=ENVIRONMENT)


def run(*words: object, cwd: Path | None = None, file_size: int | None = None) -> subprocess.CompletedProcess[str]:
    """Run a command; no file that it writes exceeds `file_size` bytes."""
    return _done([COMMAND, *(str(word) for word in words)], cwd or ROOT, file_size)


def script(path: str, *arguments: str, patience: float) -> tuple[int, str]:
    """Run a script of the package as `base.untrusted.child.run` does; its own limit of processor time ends it."""
    done = _done([path, *arguments], Path.cwd(), None)
    return done.returncode, (done.stderr.strip().splitlines() or [""])[-1]


def _done(words: list[str], cwd: Path, file_size: int | None) -> subprocess.CompletedProcess[str]:
    with tempfile.TemporaryDirectory() as folder, ASKED:
        process, streams = server(os.getpid()), [Path(folder) / name for name in ("out", "err")]
        assert process.stdin and process.stdout
        print(json.dumps([words, str(cwd), file_size, *map(str, streams)]), file=process.stdin, flush=True)
        code = int(process.stdout.readline())
        return subprocess.CompletedProcess(words[1:], code, *(stream.read_text(errors="replace") for stream in streams))


def serve() -> None:
    """Fork for each question of the input; print its exit code."""
    import robot_retarget.judge.rollout
    import robot_retarget.solver.pipeline
    import robot_retarget.tools.cli
    import robot_retarget.tools.summary  # noqa: F401

    for line in sys.stdin:
        process = os.fork()
        if not process:
            _perform(*json.loads(line))
        print(os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), flush=True)


def _perform(words: list[str], cwd: str, file_size: int | None, out: str, err: str) -> None:
    """Run a command or a script in this process, and end it."""
    from robot_retarget.__main__ import main

    for number, path in ((0, os.devnull), (1, out), (2, err)):
        os.dup2(os.open(path, os.O_RDWR | os.O_CREAT), number)
    sys.stdout, sys.stderr = (open(number, "w", closefd=False) for number in (1, 2))  # noqa: SIM115
    if file_size is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (file_size, file_size))
    os.chdir(cwd)
    sys.argv = words
    code = 0
    try:
        main() if words[0] == COMMAND else runpy.run_path(words[0], run_name="__main__")
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
