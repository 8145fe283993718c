"""Draft the servo map of a new robot: find its servos, move each a little, and note which joint a person saw move."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from robot_retarget.actuators.control_tables import Model, model_numbered
from robot_retarget.actuators.map import Limits, Servo, ServoMap
from robot_retarget.base.arrays import minimum_jerk
from robot_retarget.base.errors import ServoError, known
from robot_retarget.servo.bus import Bus
from robot_retarget.servo.outcome import PlaybackEnd, PlaybackOptions
from robot_retarget.servo.plan import ServoPlan
from robot_retarget.servo.play import play
from robot_retarget.servo.protocol import LAST_ID

BAUDS = (2_000_000, 1_000_000, 57_600, 3_000_000, 4_000_000, 115_200)
"""Rates in the order in which they are tried [1/s]; 57,600 is that of a new servo."""
SHIFT = 0.15
"""A servo moves by this and back [rad]: three times the 0.045 by which the dry friction of a 2XL430 holds it back, at the gain of
its data sheet."""
SHIFT_TIME = 1.5
"""Time of that movement, there and back [s]: 0.4 rad/s at most, half of the approach speed of `Limits`."""


class FoundServo(NamedTuple):
    """A servo that answered."""

    id: int
    number: int
    """Of its model."""
    firmware: int
    baud: int
    protocol: int

    @property
    def model(self) -> Model | None:
        """Its data sheet; None for an unknown model."""
        return model_numbered(self.number)


def find_servos(port: str | Path, bauds: Iterable[int] = (), last: int = LAST_ID) -> Iterator[FoundServo]:
    """Yield the servos that answer at the first rate with any, under Protocol 2 and 1.

    Args:
        port: a serial port, or that of an emulator.
        bauds: rates to try; `BAUDS` without any [1/s].
        last: highest id to try.

    Raises:
        ServoError: The port cannot be opened.
    """
    for baud in bauds or BAUDS:
        any_found = False
        for protocol in (2, 1):
            with Bus(port, baud, version=protocol) as bus:
                for answer in bus.scan(range(last + 1)):
                    any_found = True
                    yield FoundServo(*answer, baud, protocol)
        if any_found:
            return


def draft(
    robot: str,
    ranges: Mapping[str, tuple[float, float]],
    port: str | Path,
    ask: Callable[[FoundServo], str],
    bauds: Iterable[int] = (),
    last: int = LAST_ID,
    options: PlaybackOptions | None = None,
) -> ServoMap:
    """Return a map of the servos on a port.

    Each servo with torque off moves by `SHIFT` towards larger positions and back, and is released. Its zero is where it stood.

    Args:
        robot: name of the robot.
        ranges: lowest and highest angle of each joint of the robot [rad].
        port: a serial port, or that of an emulator.
        ask: receives a servo after it moved; returns the joint and the sense in which it turned, `l_knee +`, or nothing
            to leave the servo out.
        bauds: as for `find_servos`.
        last: as for `find_servos`.
        options: as for `play`.

    Raises:
        ServoError: no servo answers, one is of an unknown model or has torque on, or an answer names no joint.
    """
    found = list(find_servos(port, bauds, last))
    if not found:
        raise ServoError(f"no servo answers on {port} (power, cable, --baud)")
    servos: list[Servo] = []
    for one in found:
        model = one.model
        if model is None:
            raise ServoError(f"servo {one.id} is model {one.number}, which has no row (docs: my servo is not listed)")
        zero, towards = _nudge(one, model, port, options or PlaybackOptions())
        answer = ask(one).split()
        if not answer:
            continue
        joint, sense = answer[0], answer[-1]
        left = [name for name in ranges if name not in {servo.joint for servo in servos}]
        if joint not in left or sense not in ("+", "-") or len(answer) != 2:
            raise ServoError(f"{' '.join(answer)!r} is no joint with + or -; {known(left, 40, typed=joint)}")
        lower, upper = ranges[joint]
        sign = towards if sense == "+" else -towards
        servos.append(Servo(joint, one.id, model.name, sign, zero, lower=lower, upper=upper))
    return ServoMap(robot, tuple(servos), found[0].baud)


def _nudge(found: FoundServo, model: Model, port: str | Path, options: PlaybackOptions) -> tuple[int, int]:
    """Move one servo a little and release it. Returns where it stood [ticks], and +1 if it moved towards larger positions."""
    with Bus(port, found.baud, options.lockstep, found.protocol) as bus:
        here, torque = (bus.value(found.id, model.registers[name]) for name in ("present_position", "torque_enable"))
        voltage = bus.value(found.id, model.registers["present_input_voltage"]) / 10
    if torque:
        raise ServoError(f"servo {found.id} has torque on: switch it off first, the draft moves free servos")
    towards = 1 if here < model.steps / 2 else -1
    limits = Limits(approach_time=0.1, min_voltage=0.8 * voltage, max_voltage=1.2 * voltage)
    servo = Servo(f"servo_{found.id}", found.id, model.name, towards, here, lower=-2 * SHIFT, upper=2 * SHIFT)
    alone = ServoMap("draft", (servo,), found.baud, limits)
    rate = 50.0
    rise = SHIFT * minimum_jerk(np.linspace(0, 1, round(SHIFT_TIME / 2 * rate)))
    plan = ServoPlan(np.concatenate([rise, rise[::-1]])[:, None], rate)
    how = PlaybackOptions(end_pose=False, release=True, grace=0.0, lockstep=options.lockstep)
    outcome = play(plan, alone, port, how)
    if outcome.ended not in (PlaybackEnd.FINISHED, PlaybackEnd.ASTRAY):
        raise ServoError(f"servo {found.id}: {outcome.sentence}")
    return here, towards
