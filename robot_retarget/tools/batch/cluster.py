"""The engine `ray`: the same task function on the nodes of a Ray cluster."""

import time
from collections import deque
from collections.abc import Sequence
from typing import Any

from robot_retarget.base.errors import UsageError, install_line
from robot_retarget.tools.batch.pool import POLL, THREADS, Report, Stopping
from robot_retarget.tools.batch.task import CRASHED, MEMORY, TIMEOUT, Allowance, Task, TaskResult, perform


def run_ray(
    tasks: Sequence[Task], allowance: Allowance, report: Report, stopping: Stopping, address: str | None
) -> None:
    """Perform tasks on a cluster; the folder of results must be one that all nodes share.

    A task on a node that is lost is tried again elsewhere. A task that takes too long is cancelled; memory is bounded by
    Ray's own limit.

    Args:
        address: of the cluster; None starts Ray on this machine.

    Raises:
        UsageError: Ray is not installed.
    """
    ray = _ray()
    began = not ray.is_initialized()
    if began:
        environment = {"env_vars": dict.fromkeys(THREADS, "1")}
        ray.init(address=address, runtime_env=environment, include_dashboard=False, log_to_driver=False)
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
        ready, _ = ray.wait([*flying], timeout=POLL, fetch_local=True)
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
