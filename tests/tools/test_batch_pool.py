"""Worker processes: limits, workers that are killed, Ctrl-C, a parent that is killed."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import psutil
import pytest
from shared_files import ROOT
from small_batches import contents, cut_clips, here, job_of, rows_of, run

from robot_retarget.tools.batch.pool import run_local
from robot_retarget.tools.batch.task import Allowance

PATIENCE = 120.0
"""Of a busy machine [s]."""


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cut_clips(tmp_path_factory.mktemp("clips"))


@pytest.fixture(scope="module")
def done(clips: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("done") / "out"
    run(job_of(clips, out), here)
    return out


def workers() -> list[psutil.Process]:
    running = [p for p in psutil.Process().children() if p.status() != psutil.STATUS_ZOMBIE]
    return [p for p in running if "robot_retarget.tools.batch.pool" in " ".join(p.cmdline())]


def test_processes_write_the_same_bytes_as_one(clips: Path, done: Path, tmp_path: Path) -> None:
    run(job_of(clips, tmp_path / "out"), partial(run_local, jobs=2))
    assert contents(tmp_path / "out") == contents(done)
    assert not workers()


def test_a_clip_that_takes_too_long_or_too_much_memory_is_marked(clips: Path, tmp_path: Path) -> None:
    for allowance, state in ((Allowance(seconds=0.3), "timeout"), (Allowance(memory=0.02), "memory")):
        job = job_of(clips, tmp_path / state, allowance=allowance, include=("wave*",))
        ended, _ = run(job, partial(run_local, jobs=1))
        assert ended.states == {state: 1}
        assert ("longer than" if state == "timeout" else "more than") in ended.failures[0].message
    job = replace(job, allowance=Allowance(), retry=("memory",))
    assert run(job, partial(run_local, jobs=1))[0].states == {"done": 1}


def test_a_worker_that_is_killed_loses_nothing(clips: Path, done: Path, tmp_path: Path) -> None:
    killed = []

    def engine(tasks, allowance, report, stopping) -> None:
        def watching() -> bool:
            if not killed and workers():
                time.sleep(0.2)
                killed.append(workers()[0].pid)
                os.kill(killed[0], signal.SIGKILL)
            return stopping()

        run_local(tasks, allowance, report, watching, jobs=2)

    ended, _ = run(job_of(clips, tmp_path / "out"), engine)
    assert killed and ended.states == {"done": 3}
    assert contents(tmp_path / "out") == contents(done)


def batch(clips: Path, out: Path) -> subprocess.Popen[str]:
    arguments = [
        sys.executable,
        "-m",
        "robot_retarget",
        "batch",
        clips,
        "-r",
        "op3",
        "--out",
        out,
        "-j",
        "2",
        "--pictures",
        "0",
    ]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        list(map(str, arguments)), env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


def until(happened, process: subprocess.Popen[str]) -> None:
    end = time.monotonic() + PATIENCE
    while not happened() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.02)


def test_a_parent_that_is_killed_leaves_no_worker_and_continues(clips: Path, done: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    process = batch(clips, out)
    until(lambda: any(out.glob("op3/*.npz")), process)
    children = psutil.Process(process.pid).children()
    process.kill()
    process.wait()
    psutil.wait_procs(children, timeout=600)
    assert not any(child.is_running() and child.status() != psutil.STATUS_ZOMBIE for child in children)
    run(job_of(clips, out), here)
    assert {name: data for name, data in contents(out).items() if name.endswith((".npz", ".jsonl"))} == contents(done)


def test_ctrl_c_finishes_running_clips_and_exits_with_130(clips: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    process = batch(clips, out)
    until(lambda: len(psutil.Process(process.pid).children()) == 2, process)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130, said
    assert 1 <= len(rows_of(out)) <= 2
