"""MuJoCo judges a trajectory: replay, tracking servos, contacts, a verdict."""
