"""The zero pose of a robot, recorded in the map. The servos' homing offsets stay 0: some firmware moves by them."""

from collections.abc import Collection
from dataclasses import replace

from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.bus import Bus


def record_zeros(bus: Bus, servo_map: ServoMap, joints: Collection[str]) -> ServoMap:
    """A map whose zeros are where the servos of `joints` stand now.

    Raises:
        ServoError: a joint is unknown, a servo is silent, or its torque is on: a pose is set by hand.
    """
    for joint in joints:
        servo_map[joint]
    servos = []
    for servo in servo_map.servos:
        if servo.joint in joints:
            registers = servo.type.registers
            if bus.value(servo.id, registers["torque_enable"]):
                raise ServoError(
                    f"{servo.joint} (servo {servo.id}): torque is on; a zero pose is set by hand, torque off"
                )
            servo = replace(servo, zero=bus.value(servo.id, registers["present_position"]))
        servos.append(servo)
    return replace(servo_map, servos=tuple(servos))
