"""Commands as processes of their own that share one start: a server loads the libraries and forks for each command."""

import json
import os
import resource
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

from shared_files import ROOT

ENVIRONMENT = {"PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}", "PATH": "/usr/bin:/bin", "HOME": "/tmp", "CC": ""}


@cache
def server() -> subprocess.Popen[str]:
    """Start the server; it ends with its input."""
    command = [sys.executable, "-c", "import forked; forked.serve()"]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=ENVIRONMENT)


def run(*words: object, cwd: Path | None = None, file_size: int | None = None) -> subprocess.CompletedProcess[str]:
    """Run a command; no file that it writes exceeds `file_size` bytes."""
    given = [str(word) for word in words]
    with tempfile.TemporaryDirectory() as folder:
        process, streams = server(), [Path(folder) / name for name in ("out", "err")]
        assert process.stdin and process.stdout
        print(json.dumps([given, str(cwd or ROOT), file_size, *map(str, streams)]), file=process.stdin, flush=True)
        code = int(process.stdout.readline())
        return subprocess.CompletedProcess(given, code, *(stream.read_text() for stream in streams))


def serve() -> None:
    """Fork for each command of the input; print its exit code."""
    import robot_retarget.judge.rollout
    import robot_retarget.solver.pipeline
    import robot_retarget.tools.cli
    import robot_retarget.tools.summary  # noqa: F401

    for line in sys.stdin:
        child = os.fork()
        if not child:
            _perform(*json.loads(line))
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


def _perform(words: list[str], cwd: str, file_size: int | None, out: str, err: str) -> None:
    """Run a command in this process, and end it."""
    from robot_retarget.__main__ import main

    for number, path in ((0, os.devnull), (1, out), (2, err)):
        os.dup2(os.open(path, os.O_RDWR | os.O_CREAT), number)
    sys.stdout, sys.stderr = (open(number, "w", closefd=False) for number in (1, 2))  # noqa: SIM115
    if file_size is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (file_size, file_size))
    os.chdir(cwd)
    sys.argv = ["robot-retarget", *words]
    code = 0
    try:
        main()
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
