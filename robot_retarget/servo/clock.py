"""System settings for even ticks. Settings that the system refuses are skipped."""

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
def real_time() -> Iterator[None]:
    """Disable garbage collection; request precise timers, locked memory and real-time priority."""
    _precise_timers()
    with _uncollected(), _resident(), _preferred():
        yield


@contextlib.contextmanager
def without_sleep_states() -> Iterator[None]:
    """Disable sleep states of the processor (Linux PM QoS): leaving one takes 50 µs or more, twice per exchange."""
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
    """Sleep until a time of the monotonic clock. Returns the time after it."""
    ahead = due - time.monotonic()
    if ahead > 0:
        time.sleep(ahead)
    return time.monotonic()


def _precise_timers() -> None:
    """Set the timer slack of this thread to 1 ns; the default is 50 µs."""
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
    """Lock touched memory: code that is read from disk again takes milliseconds."""
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
