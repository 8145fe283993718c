"""Dynamixel servos: the wire protocol, the bus, the player, and an emulated bus to play on without a robot."""
