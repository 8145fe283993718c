"""Being on time: what a process can ask of the system so that its ticks come evenly. What is refused is done without."""

import contextlib
import ctypes
import gc
import os
import time
from collections.abc import Iterator

PRIORITY = 10
"""Among real-time processes, where the system grants one."""
TIMER_SLACK = 29
"""Linux: `prctl(PR_SET_TIMERSLACK, …)`."""
LOCK_CURRENT, LOCK_ON_FAULT = 1, 4
"""Linux: `mlockall(MCL_CURRENT | MCL_ONFAULT)`."""


@contextlib.contextmanager
def on_time() -> Iterator[None]:
    """No garbage collection, precise timers, memory that stays, and real-time priority."""
    _precise_timers()
    with _uncollected(), _resident(), _preferred():
        yield


@contextlib.contextmanager
def wide_awake() -> Iterator[None]:
    """No sleep states of the processor: to leave one takes it 50 µs and more, twice in every exchange (Linux PM QoS)."""
    request = None
    with contextlib.suppress(OSError):
        request = os.open("/dev/cpu_dma_latency", os.O_WRONLY)
        os.write(request, bytes(4))
    try:
        yield
    finally:
        if request is not None:
            os.close(request)


def wait_until(due: float) -> float:
    """Sleep to a time of the monotonic clock; the time it is then."""
    ahead = due - time.monotonic()
    if ahead > 0:
        time.sleep(ahead)
    return time.monotonic()


def _precise_timers() -> None:
    """Have the kernel wake this thread on time: a timer slack of 1 ns, not 50 µs."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(TIMER_SLACK, 1, 0, 0, 0)


@contextlib.contextmanager
def _uncollected() -> Iterator[None]:
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


@contextlib.contextmanager
def _resident() -> Iterator[None]:
    """What has been touched of the memory stays in it: code that is fetched from the disk again takes milliseconds."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).mlockall(LOCK_CURRENT | LOCK_ON_FAULT)
    try:
        yield
    finally:
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).munlockall()


@contextlib.contextmanager
def _preferred() -> Iterator[None]:
    before = None
    with contextlib.suppress(OSError, AttributeError):
        before = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
    try:
        yield
    finally:
        if before is not None:
            with contextlib.suppress(OSError):
                os.sched_setscheduler(0, *before)
