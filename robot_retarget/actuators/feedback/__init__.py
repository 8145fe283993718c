"""Balance feedback: an inertial sensor's readings become small additions to goals, the same in simulation and on servos."""
