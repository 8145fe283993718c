"""The local engine: worker processes of one thread each, within limits of time and memory."""

import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import wait
from pathlib import Path

import robot_retarget
from robot_retarget.tools.batch.task import CRASHED, MEMORY, TIMEOUT, Allowance, Task, TaskResult

POLL = 0.1
"""Limits are looked at this often [s]."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
GIB = 2**30

Report = Callable[[TaskResult], None]
Stopping = Callable[[], bool]


def run_local(tasks: Sequence[Task], allowance: Allowance, report: Report, stopping: Stopping, jobs: int) -> None:
    """Perform tasks in worker processes.

    A worker that takes too long or too much memory is ended, and its clip marked. A clip whose worker is killed from outside is
    tried again.

    Args:
        report: called with every outcome, in the order in which tasks end.
        stopping: once it is true no task begins; those that run are finished.
        jobs: how many processes.
    """
    waiting, attempts = deque(tasks), dict.fromkeys(tasks, 0)
    workers = [_Worker() for _ in range(min(jobs, len(tasks)))]
    try:
        while (not (stopped := stopping()) and waiting) or any(worker.task for worker in workers):
            for worker in workers:
                if worker.task is None and waiting and not stopped:
                    worker.begin(waiting.popleft())
            wait([worker.pipe for worker in workers if worker.task], POLL)
            for worker in [worker for worker in workers if worker.task]:
                task, outcome = worker.task, worker.outcome(allowance)
                if outcome is None or task is None:
                    continue
                attempts[task] += 1
                if outcome.state == CRASHED and attempts[task] < allowance.attempts:
                    waiting.appendleft(task)
                else:
                    report(outcome)
    finally:
        for worker in workers:
            worker.end()


class _Worker:
    """A process, and the task it performs."""

    def __init__(self) -> None:
        self.task: Task | None = None
        self._start()

    def begin(self, task: Task) -> None:
        """Hand over a task."""
        self.task, self._began = task, time.monotonic()
        with suppress(OSError):  # `outcome` detects a dead worker
            self.pipe.send(task)

    def outcome(self, allowance: Allowance) -> TaskResult | None:
        """The outcome of the task, once it ended or went over a limit."""
        assert self.task is not None
        task = self.task
        try:
            if self.pipe.poll():
                self.task = None
                return self.pipe.recv()
        except (EOFError, OSError):
            return self._aborted(task, CRASHED, f"its worker ended with exit code {self._process.wait()}")
        seconds = time.monotonic() - self._began
        if seconds > allowance.seconds:
            return self._aborted(task, TIMEOUT, f"took longer than {allowance.seconds:g} s")
        if resident(self._process.pid) > allowance.memory * GIB:
            return self._aborted(task, MEMORY, f"took more than {allowance.memory:g} GiB of memory")
        return None

    def end(self) -> None:
        """Kill the process group."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self.pipe.close()

    def _aborted(self, task: Task, state: str, message: str) -> TaskResult:
        """Kill the process, start another, and return the result of its task."""
        seconds = round(time.monotonic() - self._began, 3)
        self.end()
        self.task = None
        self._start()
        return TaskResult(task.robot_name, task.clip, task.digest, state, message, seconds=seconds)

    def _start(self) -> None:
        self.pipe, theirs = Pipe()
        places = [str(Path(robot_retarget.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
        environment = os.environ | dict.fromkeys(THREADS, "1") | {"PYTHONPATH": os.pathsep.join(filter(None, places))}
        command = [sys.executable, "-m", "robot_retarget.tools.batch.worker", str(theirs.fileno())]
        self._process = subprocess.Popen(
            command, pass_fds=[theirs.fileno()], start_new_session=True, env=environment, stdin=subprocess.DEVNULL
        )
        theirs.close()


def resident(process: int) -> int:
    """Resident memory of a process [bytes]; 0 on systems without /proc."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    except (OSError, IndexError, ValueError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")
