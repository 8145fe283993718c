#!/usr/bin/env python3
"""How fast `batch` is, and whether it survives kills: clips/s with one and two processes, memory, `kill -9` at random moments.

    python scripts/bench/bench_batch.py --motions ../shared/motions/bvh --robots op3 ../shared/robots/unitree_g1/unitree_g1.xml --clips 200 --kills 20

Clips are windows cut from the motions, in turn. After every kill the run is continued; its outputs and index must equal those of an
undisturbed run byte for byte.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import robot_retarget as rr
from robot_retarget.tools.batch.manifest import INDEX, TIMES

AMASS = 4.3e6
"""Frames of AMASS at 30 frames/s."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--motions", type=Path, required=True, help="folder of motions to cut clips from")
    parser.add_argument("--robots", nargs="+", default=["op3"])
    parser.add_argument("--clips", type=int, default=24)
    parser.add_argument("--seconds", type=float, default=2.0, help="of a clip")
    parser.add_argument("--jobs", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--kills", type=int, default=0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        clips = cut(given.motions, place / "clips", given.clips, given.seconds)
        print(f"{clips} clips of {given.seconds:g} s × {len(given.robots)} robots")
        warm_up(place, given.robots)
        spent = {jobs: timed(place / "clips", place / f"out_{jobs}", given.robots, jobs) for jobs in given.jobs}
        if 1 in spent and 2 in spent:
            print(f"two processes are {spent[1] / spent[2]:.2f} times as fast as one")
        reference = place / f"out_{given.jobs[-1]}"
        same = all(contents(place / f"out_{jobs}") == contents(reference) for jobs in given.jobs)
        print(f"outputs of {given.jobs} processes are {'equal' if same else 'NOT equal'}")
        survived = sum(
            killed(
                place / "clips",
                place / f"killed_{k}",
                given.robots,
                given.jobs[-1],
                k,
                spent[given.jobs[-1]],
                reference,
            )
            for k in range(given.kills)
        )
        if given.kills:
            print(f"{survived} of {given.kills} runs that were killed equal the undisturbed one after continuing")
    return int(not same or survived < given.kills)


def cut(motions: Path, folder: Path, count: int, seconds: float) -> int:
    """Windows of all motions in turn, written as BVH."""
    folder.mkdir()
    sources = []
    for path in sorted(motions.rglob("*.bvh")):
        try:
            motion = rr.read_motion(path)
            rr.match(motion, rr.load_robot("op3"))
        except rr.RobotRetargetError:
            continue
        if motion.duration > seconds:
            sources.append((path.stem, motion))
    written = 0
    for turn in range(count):
        name, motion = sources[turn % len(sources)]
        first = turn // len(sources) * round(seconds * motion.fps / 2)
        last = first + round(seconds * motion.fps)
        if last <= len(motion):
            rr.write_bvh(motion.frames(first, last), folder / f"{name}_{first}.bvh")
            written += 1
    return written


def warm_up(place: Path, robots: list[str]) -> None:
    """Compile each robot's functions once, as any earlier run has done."""
    one = place / "warm"
    one.mkdir()
    shutil.copy(min((place / "clips").glob("*.bvh")), one)
    subprocess.run(command(one, place / "warm_out", robots, 1), check=False, capture_output=True)


def command(clips: Path, out: Path, robots: list[str], jobs: int) -> list[str]:
    chosen = [word for robot in robots for word in ("-r", robot)]
    line = [sys.executable, "-m", "robot_retarget", "batch", str(clips), *chosen, "--out", str(out), "-j", str(jobs)]
    return [*line, "--pictures", "0", "-q", "--json"]


def timed(clips: Path, out: Path, robots: list[str], jobs: int) -> float:
    """Seconds of a run, printed with its rates and memory."""
    began = time.monotonic()
    subprocess.run(command(clips, out, robots, jobs), check=False, capture_output=True)
    seconds = time.monotonic() - began
    rows = [json.loads(line) for line in (out / INDEX).read_text().splitlines()]
    times = [json.loads(line) for line in (out / TIMES).read_text().splitlines()]
    frames = sum(row["frames"] for row in rows)
    done = sum(row["state"] == "done" for row in rows)
    busy, peak = sum(row["seconds"] for row in times), max(row["peak_mb"] for row in times)
    print(
        f"{jobs} processes: {done} of {len(rows)} done in {seconds:.1f} s, {len(rows) / seconds:.2f} clips/s, {frames / seconds:.0f} "
        f"frames/s, {frames / busy:.0f} frames/s a core, at most {peak:.0f} MB a process; AMASS {AMASS / (frames / busy) / 3600:.0f} core-hours"
    )
    return seconds


def killed(clips: Path, out: Path, robots: list[str], jobs: int, seed: int, usual: float, reference: Path) -> bool:
    """Kill the parent or a worker at a random moment, continue, and compare with the undisturbed run."""
    chance = random.Random(seed)
    process = subprocess.Popen(command(clips, out, robots, jobs), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    time.sleep(chance.uniform(0.05, 0.95) * usual)
    victims = [process.pid, *children(process.pid)]
    victim = chance.choice(victims)
    try:
        os.kill(victim, signal.SIGKILL)
    except ProcessLookupError:
        victim = 0
    process.wait()
    subprocess.run(command(clips, out, robots, jobs), check=False, capture_output=True)
    same = contents(out) == contents(reference)
    who = "none, the run had ended" if not victim else "the parent" if victim == process.pid else "a worker"
    print(f"kill {seed}: {who}; {'equal' if same else 'NOT equal'}", flush=True)
    shutil.rmtree(out)
    return same


def children(parent: int) -> list[int]:
    """Process ids of a process's children."""
    listed = subprocess.run(["ps", "-o", "pid=", "--ppid", str(parent)], check=False, capture_output=True, text=True)
    return [int(word) for word in listed.stdout.split()]


def contents(out: Path) -> dict[str, bytes]:
    """Outputs and index by name."""
    files = sorted(path for path in out.rglob("*") if path.is_file() and path.suffix in (".npz", ".jsonl", ".csv"))
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


if __name__ == "__main__":
    sys.exit(main())
