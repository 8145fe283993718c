"""MuJoCo: what becomes of a trajectory on servos."""
