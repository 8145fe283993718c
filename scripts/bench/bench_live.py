"""How long it takes from a performer's frame to a robot's pose: over UDP on this machine, sender and receiver in processes of their own.

    python scripts/bench/bench_live.py --robot op3 --fps 60 --seconds 60

    python scripts/bench/bench_live.py --servos            # the goals of an emulated OP3 with its weight

Latency is from when the sender begins to put a frame together to when its pose is there. The second row is of a sender
ten times as fast: its frames are dropped, not queued.
"""

import argparse
import multiprocessing
import tempfile
import time
from pathlib import Path

import numpy as np
from perform import send

import robot_retarget as rr
from robot_retarget.actuators.goals import RATE
from robot_retarget.actuators.map import load_map
from robot_retarget.base.files import SAMPLES
from robot_retarget.live.frame import FaultCounter
from robot_retarget.live.loop import LivePose, Loop
from robot_retarget.live.receiver import Receiver, UdpPort
from robot_retarget.live.sinks import ServoSink, run_servos
from robot_retarget.live.vmc import VmcDecoder
from robot_retarget.servo.play import emulator_process

HOST = "127.0.0.1"
WARM = 3.0
"""What is not measured: the first frames build the stream [s]."""


class Watch:
    """A sink that looks at the clock when a pose is there."""

    def __init__(self, decoder: VmcDecoder, began: float) -> None:
        self.decoder, self.began = decoder, began
        self.latencies: list[float] = []
        self.loop: Loop | None = None

    def show(self, pose: LivePose) -> None:
        offset, loop = self.decoder.clock.offset, self.loop
        now = time.monotonic()
        if offset is None or loop is None or loop.last is None or loop.resting or now - self.began < WARM:
            return
        self.latencies.append(now - (loop.last.time - offset + self.began))


def measured(robot: rr.Robot, motion: rr.Motion, speed: float, seconds: float) -> tuple[Loop, Watch, Receiver]:
    """A run of so long [s]."""
    faults = FaultCounter(print)
    port, decoder = UdpPort(HOST, 0, faults), VmcDecoder(faults)
    receiver, began = Receiver(port, decoder, faults), time.monotonic()
    watch = Watch(decoder, began)
    loop = watch.loop = Loop(receiver, lambda skeleton: rr.Stream(robot, skeleton), watch, print)
    target = f"vmc://{HOST}:{port.address[1]}"
    sender = multiprocessing.get_context("spawn").Process(
        target=send, args=(motion, target, speed, seconds + WARM, None, began), daemon=True
    )
    sender.start()
    loop.run(seconds)
    sender.join()
    receiver.close()
    return loop, watch, receiver


def played(robot: rr.Robot, motion: rr.Motion, seconds: float) -> None:
    """Follow the sender on an emulated robot with physics, and print what its servos were sent."""
    servo_map, faults = load_map(robot.name), FaultCounter(print)
    port, decoder = UdpPort(HOST, 0, faults), VmcDecoder(faults)
    receiver, sink = Receiver(port, decoder, faults), ServoSink(robot, servo_map)
    target = f"vmc://{HOST}:{port.address[1]}"
    loop = Loop(receiver, lambda skeleton: rr.Stream(robot, skeleton), sink, print)
    sender = multiprocessing.get_context("spawn").Process(
        target=send, args=(motion, target, 1.0, seconds + WARM), daemon=True
    )
    with emulator_process(servo_map, "--physics") as serial, tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "play.npz"
        sender.start()
        outcome, tally = run_servos(loop, sink, servo_map, serial, seconds, log, print)
        with np.load(log) as found:
            rows = {name: found[name] for name in ("goal", "present", "time", "late")}
    sender.join()
    receiver.close()
    low, high = np.array([servo.reach for servo in servo_map.servos]).T
    step, ahead = np.abs(np.diff(rows["goal"], axis=0)), np.abs(rows["goal"][1:] - rows["present"][:-1])
    print(f"{len(rows['time'])} ticks, {tally.frames} frames: {outcome.sentence}")
    print(f"goals outside their ranges: {int(((rows['goal'] < low - 1e-9) | (rows['goal'] > high + 1e-9)).sum())}")
    print(
        f"goals faster than {servo_map.limits.speed:g} rad/s: {int((step > servo_map.limits.speed / RATE + 1e-9).sum())}"
    )
    print(
        f"goals over the step cap of {servo_map.limits.jump:g} rad: {int((ahead > servo_map.limits.jump + 1e-9).sum())}"
    )
    print(f"largest step {step.max():.4f} rad, furthest ahead {ahead.max():.3f} rad; {outcome.figures}")


def main() -> None:
    """Print a row for the performer and one for a sender ten times too fast, or what servos were sent."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else "")
    parser.add_argument("--robot", default="op3")
    parser.add_argument("--clip", type=Path, default=SAMPLES / "walk.bvh")
    parser.add_argument("--fps", type=float, default=60.0)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--servos", action="store_true", help="follow on an emulated robot with physics instead")
    args = parser.parse_args()
    robot, motion = rr.load_robot(args.robot), rr.read_motion(args.clip).resample(args.fps)
    if args.servos:
        return played(robot, motion, args.seconds)
    print(f"{'sender':>12} {'frames':>7} {'dropped':>7} {'held':>5} {'p50 ms':>7} {'p99 ms':>7} {'max ms':>7}  faults")
    for speed, seconds in ((1.0, args.seconds), (10.0, args.seconds / 4)):
        loop, watch, receiver = measured(robot, motion, speed, seconds)
        p50, p99, most = 1000 * np.quantile(watch.latencies, (0.5, 0.99, 1.0))
        rate, tally = f"{args.fps * speed:g} Hz", loop.stats
        print(
            f"{rate:>12} {tally.frames:7} {receiver.dropped:7} {tally.held:5} {p50:7.2f} {p99:7.2f} {most:7.2f}  "
            f"{dict(receiver.faults.counts) or 'none'}"
        )


if __name__ == "__main__":
    main()
