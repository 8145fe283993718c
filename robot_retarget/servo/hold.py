"""Engage a robot without a jump, leave it holding, release it."""

from contextlib import suppress

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.servo.bus import NoAnswerError, StatusError
from robot_retarget.servo.cycle import Guard, Judge
from robot_retarget.servo.link import Link
from robot_retarget.servo.outcome import FaultError

STRAIN = 0.15
"""A servo left holding is not left pulling at more than this [rad]: two thirds of full duty at the usual gain."""


def take_hold(link: Link, judge: Judge) -> Guard:
    """Goal := present, then torque, servo by servo; nothing moves. Servos with torque on keep it.

    Raises:
        FaultError: a servo does not answer, is outside its range, or does not keep its goal.
    """
    link.set_all("bus_watchdog", 0)
    judge.require_fresh()
    link.command(link.present)
    for name in ("profile_acceleration", "profile_velocity"):
        link.set_all(name, 0)
    goals = link.goals(link.present)
    for k, servo in enumerate(link.map.servos):
        if not link.write_verified(goals, k):
            raise FaultError(f"{servo.joint} does not keep its goal")
        link.bus.write(servo.id, servo.type.registers["torque_enable"], 1)
        link.torque[k] = True
    link.watchdog(link.map.limits.watchdog)
    judge.require_fresh()
    return Guard(link.scale, link.map.limits, np.clip(link.present, link.scale.lower, link.scale.upper))


def leave_holding(link: Link, goal: Floats | None) -> None:
    """Switch the watchdog off, three times as no servo confirms it; move goals that are far from their joints to them."""
    for _ in range(3):
        link.set_all("bus_watchdog", 0)
    if goal is not None:
        link.command(np.where(np.abs(goal - link.present) <= STRAIN, goal, link.present))


def let_go(link: Link) -> None:
    """Torque off: all at once, then each with an answer, as far as they answer."""
    link.set_all("torque_enable", 0)
    for servo in link.map.servos:
        with suppress(NoAnswerError, StatusError):
            link.bus.write(servo.id, servo.type.registers["torque_enable"], 0)
