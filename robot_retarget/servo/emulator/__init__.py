"""A Dynamixel bus without hardware: devices with the semantics of their registers, a motor each, faults on request."""
