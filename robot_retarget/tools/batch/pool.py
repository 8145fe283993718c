"""The local engine: worker processes of one thread each, within limits of time and memory."""

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import robot_retarget
from robot_retarget.base.errors import UsageError, install_line
from robot_retarget.tools.batch.task import CRASHED, MEMORY, TIMEOUT, Allowance, Task, TaskResult, perform

LIMIT_POLL = 0.1
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
            wait([worker.pipe for worker in workers if worker.task], LIMIT_POLL)
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
        command = [sys.executable, "-m", "robot_retarget.tools.batch.pool", str(theirs.fileno())]
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


# A worker process: takes tasks from a pipe and sends their outcomes back, until the pipe closes.
#
# Run as `python -m robot_retarget.tools.batch.pool FD` by `pool.py`, in a new session: Ctrl-C reaches only the parent.

_DEATH_SIGNAL = 1
"""`PR_SET_PDEATHSIG` of prctl(2)."""


def serve(pipe: Connection) -> None:
    """Perform the tasks of a pipe."""
    with suppress(EOFError, OSError):
        while True:
            pipe.send(perform(pipe.recv()))


def end_with_parent() -> None:
    """Ask the kernel to kill this process when the parent dies; elsewhere than on Linux the closed pipe ends it."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_DEATH_SIGNAL, signal.SIGKILL)


if __name__ == "__main__":
    end_with_parent()
    serve(Connection(int(sys.argv[1])))


# The engine `ray`: the same task function on the nodes of a Ray cluster.


def run_ray(tasks: Sequence[Task], allowance: Allowance, report: Report, stopping: Stopping) -> None:
    """Perform tasks on the cluster of `RAY_ADDRESS`, or of this machine alone; all nodes share the folder of results.

    A task on a node that is lost is tried again elsewhere. A task that takes too long is cancelled; memory is bounded by
    Ray's own limit.

    Raises:
        UsageError: Ray is not installed.
    """
    ray = _ray()
    began = not ray.is_initialized()
    if began:
        environment = {"env_vars": dict.fromkeys(THREADS, "1")}
        ray.init(runtime_env=environment, include_dashboard=False, log_to_driver=False)
    remote = ray.remote(num_cpus=1, max_retries=allowance.attempts - 1, memory=None)(perform)
    try:
        _drive(ray, remote, deque(tasks), allowance, report, stopping)
    finally:
        if began:
            ray.shutdown()


def _drive(
    ray: Any, remote: Any, waiting: deque[Task], allowance: Allowance, report: Report, stopping: Stopping
) -> None:
    """Hand a task to every processor until none is left; tasks in flight are finished when it is to stop."""
    flying: dict[Any, tuple[Task, float]] = {}
    while (not (stopped := stopping()) and waiting) or flying:
        processors = max(1, int(ray.cluster_resources().get("CPU", 1)))
        while waiting and len(flying) < processors and not stopped:
            task = waiting.popleft()
            flying[remote.remote(task)] = task, time.monotonic()
        ready, _ = ray.wait([*flying], timeout=LIMIT_POLL, fetch_local=True)
        for reference in ready:
            report(_outcome(ray, reference, flying.pop(reference)[0]))
        for reference, (task, began) in [*flying.items()]:
            if time.monotonic() - began > allowance.seconds:
                ray.cancel(reference, force=True)
                del flying[reference]
                report(_marked(task, TIMEOUT, f"took longer than {allowance.seconds:g} s"))


def _outcome(ray: Any, reference: Any, task: Task) -> TaskResult:
    """The outcome of a task, or the mark of what ended it."""
    try:
        return ray.get(reference)
    except ray.exceptions.OutOfMemoryError as error:
        return _marked(task, MEMORY, _first_line(error))
    except ray.exceptions.RayError as error:
        return _marked(task, CRASHED, _first_line(error))


def _marked(task: Task, state: str, message: str) -> TaskResult:
    return TaskResult(task.robot_name, task.clip, task.digest, state, message)


def _first_line(error: Exception) -> str:
    return str(error).strip().partition("\n")[0]


def _ray() -> Any:
    try:
        import ray
    except ImportError as error:
        raise UsageError(f"--engine ray needs Ray: {install_line('cluster')}") from error
    return ray
